"""The table as people see it, in a Markdown block: to paste into a reply or an issue."""

from __future__ import annotations

from analyzer.exports import txt

__all__ = ["Format"]


class Format(txt.Format):
    """The annotated table between fences."""

    before = "```text\n"
    after = "```\n"
