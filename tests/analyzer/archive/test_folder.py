"""An archive as a folder of Parquet: the rows of its files, once each, whatever ends a run."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from analyzer.session import FileRun
from analyzer.settings import Settings
from dissectors.errors import SourceError
from tests.support.fleet import DAMAGED, Traffic, archive

COMMAND = [sys.executable, "-m", "analyzer", "export"]


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An archive of 20 buses and 203 files."""
    folder = tmp_path_factory.mktemp("fleet")
    archive(folder / "archive")
    return folder


def export(place: Path, *words: str, out: str = "out") -> subprocess.CompletedProcess[str]:
    command = [*COMMAND, "archive/**/*", "-o", f"{out}/", "--style", "partitions", *words]
    return subprocess.run(command, cwd=place, capture_output=True, text=True, check=False)


def rows_of_folder(folder: Path) -> list[dict[str, Any]]:
    """All rows of all files, each with the bus that its path names."""
    return sorted(_rows(folder), key=str)


def _rows(folder: Path) -> Iterator[dict[str, Any]]:
    for path in folder.glob("date=*/bus=*/*.parquet"):
        bus = path.parent.name.removeprefix("bus=").replace("%3A", ":").replace("%2F", "/")
        day = path.parent.parent.name.removeprefix("date=")
        for row in pq.ParquetFile(path).read().to_pylist():
            assert day == ("unknown" if row["time"] is None else f"{row['time']:%Y-%m-%d}")
            yield {**row, "bus": bus}


def one_after_the_other(place: Path, table: str = "transactions") -> list[dict[str, Any]]:
    """The rows of each file by itself, without folder, manifest or thread."""
    rows: list[dict[str, Any]] = []
    for path in sorted((place / "archive").rglob("*")):
        if path.is_dir():
            continue
        name = str(path.relative_to(place))
        run = FileRun([str(path)], Settings(tables=(table,), bus_name=path.parent.name))
        try:
            for batch in run.batches():
                for row in pa.table(getattr(batch, table)).to_pylist():
                    rows.append({**row, "source": row["source"].replace(str(path), name)})
        except SourceError:
            continue
    return sorted(({"bus": row.pop("bus"), **row} for row in rows), key=str)


def same(found: list[dict[str, Any]], expected: list[dict[str, Any]]) -> bool:
    def texts(rows: list[dict[str, Any]]) -> list[str]:
        return sorted(str(sorted(row.items(), key=lambda one: one[0])) for row in rows)

    return texts(found) == texts(expected)


@pytest.mark.parametrize("threads", ["1", "2"])
def test_threads_give_the_rows_of_one_file_after_the_other(fleet: Path, threads: str) -> None:
    done = export(fleet, "--threads", threads, out=f"out-{threads}")
    assert done.returncode == 3, "one file is damaged"
    expected = one_after_the_other(fleet)
    assert len(expected) > 20 * 10 * 40
    assert same(rows_of_folder(fleet / f"out-{threads}"), expected)
    told = done.stderr.splitlines()
    for name in DAMAGED:
        assert name in done.stderr
    assert "203 of 203 recordings done, 201 new" in told[-1]


def test_another_table_and_a_filter(fleet: Path) -> None:
    done = export(
        fleet, "--table", "frames", "--where", "verdict == 'ok' and unit == 2", out="frames"
    )
    assert done.returncode == 3
    expected = [
        row
        for row in one_after_the_other(fleet, "frames")
        if row["verdict"] == "ok" and row["unit"] == 2
    ]
    assert same(rows_of_folder(fleet / "frames"), expected)


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """A small archive that a test may change."""
    archive(tmp_path / "archive", buses=4, shifts=3)
    return tmp_path


def test_what_has_not_changed_is_left_alone_and_what_has_is_replaced(place: Path) -> None:
    export(place)
    before = {path: path.stat().st_mtime_ns for path in place.glob("out/date=*/*/*.parquet")}
    again = export(place)
    assert "0 new with 0 rows, 13 unchanged" in again.stderr
    assert again.returncode == 3, "what is damaged is reported again"
    assert {path: path.stat().st_mtime_ns for path in before} == before

    changed = place / "archive/bus-00/shift-001.jsonl"
    changed.write_bytes(changed.read_bytes() + Traffic(0, 7, 10).chunks())
    os.utime(place / "archive/bus-01/shift-000.log", (1, 1))  # touched only
    (place / "archive/bus-02/shift-009.bin").write_bytes(Traffic(2, 9, 10).raw())
    assert "2 new with 60 rows, 12 unchanged" in export(place).stderr
    assert same(rows_of_folder(place / "out"), one_after_the_other(place))


def test_a_truncated_file_is_exported_again(place: Path) -> None:
    """As a disk that was full, or a copy that was interrupted, leaves it."""
    export(place)
    before = rows_of_folder(place / "out")
    part = next(place.glob("out/date=*/*/*.parquet"))
    os.truncate(part, part.stat().st_size - 100)
    assert "1 new with" in export(place).stderr
    assert rows_of_folder(place / "out") == before


def test_a_file_that_was_moved_or_copied_is_not_exported_again(place: Path) -> None:
    export(place)
    (place / "archive/bus-02/shift-000.bin").rename(place / "archive/bus-02/renamed.bin")
    shutil.copy(place / "archive/bus-02/shift-001.bin", place / "archive/bus-02/copy.bin")
    before = rows_of_folder(place / "out")
    done = export(place)
    assert "0 new with 0 rows, 12 unchanged, 2 the same as others" in done.stderr
    assert "0 new with 0 rows, 14 unchanged" in export(place).stderr
    assert rows_of_folder(place / "out") == before


def test_other_options_export_everything_anew_and_nothing_is_there_twice(place: Path) -> None:
    export(place)
    export(place, "--where", "unit == 1")
    expected = [row for row in one_after_the_other(place) if row["unit"] == 1]
    assert same(rows_of_folder(place / "out"), expected)


def test_killed_in_the_middle_it_goes_on_and_nothing_is_there_twice(tmp_path: Path) -> None:
    archive(tmp_path / "archive", buses=20, shifts=10, requests=60)
    manifest = tmp_path / "out/_manifest.jsonl"
    command = [*COMMAND, "archive/**/*", "-o", "out/", "--style", "partitions", "--threads", "2"]
    for lines in (20, 60):
        running = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.DEVNULL)
        deadline = time.monotonic() + 60
        while not manifest.exists() or manifest.read_bytes().count(b"\n") < lines:
            assert time.monotonic() < deadline
            assert running.poll() is None, "it ended before it could be killed"
            time.sleep(0.005)
        running.send_signal(signal.SIGKILL)
        running.wait()
    # As a crash of the machine would leave them: a line cut off, files that no line names.
    with manifest.open("ab") as file:
        file.write(b'{"name": "archive/bus-0')
    orphan = next((tmp_path / "out").glob("date=*/bus=*/*.parquet"))
    shutil.copy(orphan, orphan.with_name("0" * 32 + ".parquet"))
    names = {json.loads(line)["name"] for line in manifest.read_bytes().splitlines()[:-1]}
    done = export(tmp_path)
    assert (
        f"{len(names - {f'archive/bus-00/{name}' for name in DAMAGED[1:]})} unchanged"
        in done.stderr
    )
    assert same(rows_of_folder(tmp_path / "out"), one_after_the_other(tmp_path))


def test_interrupted_it_says_how_to_go_on(tmp_path: Path) -> None:
    archive(tmp_path / "archive", buses=8, shifts=10, requests=300)
    command = [*COMMAND, "archive/**/*", "-o", "out/", "--style", "partitions"]
    running = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    manifest = tmp_path / "out/_manifest.jsonl"
    while running.poll() is None and (not manifest.exists() or not manifest.stat().st_size):
        time.sleep(0.005)
    running.send_signal(signal.SIGINT)
    _, told = running.communicate(timeout=60)
    assert running.returncode == 128 + signal.SIGINT
    assert "the same command goes on from here" in told
    assert not (tmp_path / "out/_unfinished").exists()


def test_two_programs_do_not_write_into_one_folder(place: Path) -> None:
    from analyzer.archive.manifest import Manifest  # noqa: PLC0415

    with Manifest(str(place / "out"), ""):
        done = export(place)
    assert done.returncode == 3
    assert "out/: another export writes into this folder" in done.stderr


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["-o", "more/"], "one folder at a time"),
        (["--limit", "3"], "takes no --limit"),
    ],
)
def test_what_makes_no_sense_is_refused(place: Path, words: list[str], message: str) -> None:
    done = export(place, *words)
    assert done.returncode == 2
    assert message in done.stderr
