"""The document of a recording: what the doctor says, statistics, time series, examples.

`modlens stats --to json` writes it, a report embeds it. docs/stats.schema.json describes it; the
core makes it (crates/modlens-report).
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import _modlens
from analyzer.session import RecordingStatus

__all__ = ["complete", "core_text"]


def complete(
    core: Mapping[str, Any],
    statuses: Sequence[RecordingStatus],
    functions: _modlens.Functions | None = None,
    *,
    title: str | None = None,
) -> dict[str, Any]:
    """The document.

    - `core`: doctor, statistics and overview (`Run.document`)
    - `statuses`: what was reported of the recordings, or of the ports of a tap
    - `functions`: the table of functions that decodes the examples
    - `title`: the name of the plant or bus; else one is made of the names of buses or files
    """
    told = core_text([asdict(one) for one in statuses])
    functions = functions or _modlens.Functions()
    found: dict[str, Any] = json.loads(
        _modlens.report_document(core_text(core), told, functions, title)
    )
    return found


def core_text(value: Mapping[str, Any] | Sequence[Any]) -> str:
    r"""JSON for the core, in which a name of a file that is no text is escaped.

    >>> core_text({"name": "\udcff"})
    '{"name":"\\\\udcff"}'
    """
    text = json.dumps(value, ensure_ascii=False, separators=(",", ":"))
    return re.sub("[\ud800-\udfff]", lambda one: f"\\\\u{ord(one[0]):04x}", text)
