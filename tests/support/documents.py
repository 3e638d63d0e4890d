"""Documents of recordings, and what hostile ones must not do."""

from __future__ import annotations

import json
import tomllib
from typing import Any

from tests.conftest import CAPTURES, Modlens

RAN_NOTHING = "return window.ran === undefined && document.images.length === 0"

HOSTILE = (
    '</script><script>window.ran=1</script><img src=x onerror="window.ran=1">"\'&\x1b[2J\u202e\x00'
)


def words_of(name: str) -> list[str]:
    """A recording of `captures/` with the options that it needs."""
    folder = CAPTURES / name
    about = tomllib.loads((folder / "about.toml").read_text("utf-8"))
    words = [str(folder / about["file"])]
    if about.get("line"):
        words += ["--line", about["line"]]
    return [*words, "--mode", about["mode"]] if about.get("mode") else words


def document_of(modlens: Modlens, name: str) -> dict[str, Any]:
    done = modlens("stats", *words_of(name), "--to", "json")
    assert done.status == 0, done.err
    found: dict[str, Any] = json.loads(done.out)
    return found


def poisoned(document: dict[str, Any]) -> dict[str, Any]:
    """The document with every text hostile."""
    found: dict[str, Any] = _poisoned(document)
    found["sources"][0]["name"] += "</template></title>"
    return found


def _poisoned(value: Any, key: str = "") -> Any:
    if isinstance(value, dict):
        return {name: _poisoned(one, name) for name, one in value.items()}
    if isinstance(value, list):
        return [_poisoned(one, key) for one in value]
    kept = key in ("format", "verdict", "axis", "bus", "source", "request_hex", "response_hex")
    return value + HOSTILE if isinstance(value, str) and not kept else value


def shows_hostile_texts(text: str) -> None:
    """They are in the text of a page as they are, and what moves a cursor is escaped."""
    assert "<script>window.ran=1</script>" in text
    assert "\\x1b[2J\\u202e\\x00" in text
    assert not any(one in text for one in ("\x1b", "\u202e", "\x00"))
