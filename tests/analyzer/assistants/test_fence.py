"""An assistant reads what is in the folders, whatever path it names."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from analyzer.assistants.fence import Fence
from analyzer.assistants.tools import RecordingTools
from dissectors.errors import SourceError, UsageError

HEX = "010300000001840A\n0103020007F986\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with recordings, beside a file that nobody may read."""
    inside = tmp_path / "inside"
    (inside / "day").mkdir(parents=True)
    (inside / "bus.hex").write_text(HEX)
    (inside / "day" / "two.hex").write_text(HEX)
    (inside / ".hidden").write_text(HEX)
    (tmp_path / "secret.hex").write_text(HEX)
    (tmp_path / "inside2").mkdir()
    (tmp_path / "inside2" / "other.hex").write_text(HEX)
    (inside / "link.hex").symlink_to(tmp_path / "secret.hex")
    (inside / "linked").symlink_to(tmp_path)
    (inside / "here.hex").symlink_to(inside / "bus.hex")
    os.mkfifo(inside / "pipe")
    return inside


OUTSIDE = [
    "../secret.hex",
    "link.hex",
    "linked/secret.hex",
    "day/../../secret.hex",
    "../inside2/other.hex",
    "/etc/passwd",
    "-",
    "pipe",
    "day",
    "*.hex",
    "",
    "bus.hex\0",
    "link.hex!member",
    "/dev/zero",
]


@pytest.mark.parametrize("name", OUTSIDE)
def test_nothing_outside_is_read(folder: Path, name: str) -> None:
    """By relative and absolute paths, links, patterns, devices and pipes."""
    fence = Fence([str(folder)])
    for path in (name, os.path.join(folder, name)):
        with pytest.raises(UsageError, match="no such recording"):
            fence.resolve(path)
    text, is_error = RecordingTools(fence).call("overview", {"file": name})
    assert is_error
    assert "secret" not in text.replace(repr(name), "")


def test_the_message_does_not_tell_what_there_is(folder: Path) -> None:
    """The same words for a file outside and for none."""
    fence = Fence([str(folder)])
    messages = []
    for name in ("../secret.hex", "../absent.hex"):
        with pytest.raises(UsageError) as caught:
            fence.resolve(name)
        messages.append(str(caught.value).replace(name, "NAME"))
    assert messages[0] == messages[1]


def test_a_profile_outside_is_not_read(folder: Path) -> None:
    """`profile` takes files, too, and names such as `1=../../x.toml`."""
    (folder.parent / "meter.toml").write_text("profile = 1\n")
    tools = RecordingTools(Fence([str(folder)]))
    for word in ("../meter.toml", "1=../meter.toml", f"1={folder.parent / 'meter.toml'}", "../x"):
        text, is_error = tools.call("overview", {"file": "bus.hex", "profile": word})
        assert (is_error, "no such recording" in text) == (True, True), word


def test_what_is_inside_is_found(folder: Path) -> None:
    """By its name in the folder, by its path, by a link that stays inside."""
    fence = Fence([str(folder)])
    for name in ("bus.hex", "day/two.hex", "here.hex", "./day/../bus.hex"):
        assert fence.resolve(name) == os.path.join(folder, name)
        assert fence.resolve(str(folder / name)) == str(folder / name)
    listed = [Path(path).relative_to(folder).as_posix() for path, _ in fence.files()]
    assert listed == ["bus.hex", "here.hex", "day/two.hex"]


def test_a_folder_has_to_exist(tmp_path: Path) -> None:
    with pytest.raises(SourceError, match="no such folder"):
        Fence([str(tmp_path / "absent")])
