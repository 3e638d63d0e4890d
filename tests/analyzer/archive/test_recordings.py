"""Which files are recordings of which bus, and which of them belong together."""

from __future__ import annotations

from pathlib import Path

import pytest

import _modlens
from analyzer.archive.recordings import find_recordings, name_of_bus
from dissectors.errors import SourceError


@pytest.mark.parametrize(
    ("path", "root", "by", "bus"),
    [
        ("archive/pumps/2026-11-20.log", "archive", "folder", "pumps"),
        ("archive/north/pumps/1.log", "archive", "folder", "north/pumps"),
        ("archive/pumps.log.gz", "archive", "folder", "pumps"),
        ("archive/2026-11-20/pumps.log.gz", "archive", "stem", "pumps"),
        ("archive/2026-11-20/pumps.log", "archive", "path", None),
        ("pumps.log", "", "folder", "pumps"),
    ],
)
def test_the_name_of_a_bus(path: str, root: str, by: str, bus: str | None) -> None:
    assert name_of_bus(path, root, by) == bus


def test_directories_patterns_and_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("archive/a/1.log", "archive/b/c/1.log", "archive/top.log"):
        Path(name).parent.mkdir(parents=True, exist_ok=True)
        Path(name).write_text("x")
    expected = [("archive/a/1.log", "a"), ("archive/b/c/1.log", "b/c"), ("archive/top.log", "top")]
    for name in ("archive", "archive/", "archive/**/*", "archive/**/*.log"):
        found = [(one.name, one.bus) for one in find_recordings([name], "folder")]
        assert [(name.replace("//", "/"), bus) for name, bus in found] == expected
    assert [one.bus for one in find_recordings(["archive/a/1.log"], "folder")] == ["1"]
    with pytest.raises(SourceError, match="no files"):
        find_recordings(["nothing/*"], "folder")


def test_segments_of_a_tap_are_one_recording(tmp_path: Path) -> None:
    place = tmp_path / "pumps"
    place.mkdir()
    for session in range(2):
        recorder = _modlens.Recorder(str(place / f"s{session}.pcapng"), rotate_bytes=4096)
        port = recorder.add_port("/dev/ttyUSB0", "pumps")
        for number in range(300):
            recorder.write(
                port, 1_795_132_800_000_000_000 + number * 10**7, b"\1\3\0\0\0\1\x84\x0a"
            )
        recorder.close(5.0)
    files = sorted(place.iterdir())
    assert len(files) > 4
    found = find_recordings([str(tmp_path)], "folder")
    assert [one.paths[0] for one in found] == [
        str(next(path for path in files if path.name.startswith(f"s{session}")))
        for session in range(2)
    ]
    assert sorted(path for one in found for path in one.paths) == [str(path) for path in files]
    assert sum(one.size for one in found) == sum(path.stat().st_size for path in files)
