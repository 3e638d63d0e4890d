"""The recorder still records: one short capture, again, with pymodbus at both ends."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

pytest.importorskip("pymodbus")

from tests.support.recording import CAPTURES, RECIPES, main

NAME = "pymodbus_no_silence"


def test_a_new_recording_has_the_frames_of_the_old_one(tmp_path: Path) -> None:
    """Times differ, bytes do not; a retry on a busy machine may add frames, never change them."""
    main([NAME, "--into", str(tmp_path)])
    new, old = (
        [json.loads(line) for line in (folder / NAME / "frames.jsonl").read_text().splitlines()]
        for folder in (tmp_path, CAPTURES)
    )
    assert {frame["verdict"] for frame in new} == {"ok"}
    assert new[:2] == old[:2]
    assert sorted(path.name for path in (tmp_path / NAME).iterdir()) == [
        "about.toml",
        "frames.jsonl",
        "recording.jsonl",
    ]


def test_each_recipe_has_its_capture() -> None:
    """What can be recorded has been recorded, and says so in the same words."""
    for name, recipe in RECIPES.items():
        assert json.dumps(recipe.shows, ensure_ascii=False) in (
            CAPTURES / name / "about.toml"
        ).read_text(encoding="utf-8")
