"""The table as shown on the screen, in a Markdown code block, to be pasted into an issue."""

from __future__ import annotations

from analyzer.exports import txt

__all__ = ["Format"]


class Format(txt.Format):
    """The table of `modlens decode` between Markdown fences."""

    before = "```text\n"
    after = "```\n"
