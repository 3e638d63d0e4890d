"""SQLite: views, types, version; what a filter leaves; live files, and what a kill leaves."""

from __future__ import annotations

import os
import signal
import sqlite3
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from analyzer import Decoding, SourceError, UsageError, decode
from analyzer.columns import TABLES
from analyzer.exports.sink import ExportSink, parse_target
from dissectors.texts import vocabulary
from tests.conftest import CAPTURES, ROOT, environment


def recording() -> Decoding:
    """One with errors and exceptions."""
    return decode(CAPTURES / "pymodbus_disturbed" / "recording.jsonl", line="19200-8E1")


def export(path: Path, *, where: str | None = None, growing: bool = False) -> ExportSink:
    """Write it."""
    one = parse_target(str(path), "transactions")
    sink = ExportSink(one, columns=None, where=where, growing=growing)
    for batch in recording().batches(*TABLES):
        sink.put(batch)
    return sink


def test_the_views_answer_what_is_asked_most(tmp_path: Path) -> None:
    """Newest values, errors, response times: as counted from the rows by hand."""
    path = tmp_path / "log.sqlite"
    export(path).close()
    assert sorted(one.name for one in tmp_path.iterdir()) == ["log.sqlite"]
    rows = list(recording().transactions)
    with sqlite3.connect(path) as base:
        newest = {}
        for row in recording().readings:
            if row.status == "ok":
                newest[row.unit, row.register_type, row.address] = row.value
        found = base.execute("SELECT unit, register_type, address, value FROM v_latest").fetchall()
        assert {tuple(one[:3]): one[3] for one in found} == newest
        errors = base.execute("SELECT txn, status FROM v_errors ORDER BY txn").fetchall()
        assert errors == [(row.txn, row.status) for row in rows if row.status != "ok"]
        times = base.execute("SELECT unit, function, transactions, timed FROM v_response_time")
        for unit, function, count, timed in times:
            own = [row for row in rows if (row.unit, row.function) == (unit, function)]
            assert count == len(own)
            assert timed == sum(row.response_time_us is not None for row in own)
        assert base.execute("PRAGMA user_version").fetchone() == (vocabulary("version"),)
        assert base.execute("PRAGMA journal_mode").fetchone() == ("delete",)
        assert dict(base.execute("SELECT key, value FROM meta"))["program"] == "modlens"


def test_a_filter_on_transactions_holds_for_their_frames_and_values(tmp_path: Path) -> None:
    """All four tables speak of the same transactions."""
    path = tmp_path / "log.sqlite"
    export(path, where="function == 6").close()
    wanted = [row.txn for row in recording().transactions if row.function == 6]
    with sqlite3.connect(path) as base:
        for table in ("frames", "readings", "findings"):
            found = {txn for (txn,) in base.execute(f"SELECT txn FROM {table}")}
            assert found <= set(wanted), table
        assert [txn for (txn,) in base.execute("SELECT txn FROM transactions")] == wanted


def test_it_cannot_go_to_standard_output() -> None:
    """It is a file of pages that are written in any order."""
    one = parse_target("x.sqlite", "transactions")
    with pytest.raises(UsageError, match="name a file"):
        ExportSink(
            type(one)("transactions", "sqlite", None), columns=None, where=None, growing=False
        )


def test_what_cannot_be_written(tmp_path: Path) -> None:
    """Paths that cannot be written are reported by name."""
    with pytest.raises(SourceError, match=r"no/log\.sqlite: cannot be written"):
        export(tmp_path / "no" / "log.sqlite")


READ_ONLY = """
import os, sqlite3, sys
if os.getuid() == 0:
    os.setuid(65534)  # permissions do not hold for root
base = sqlite3.connect(f"file:{sys.argv[1]}", uri=True)
print(base.execute("SELECT count(*) FROM transactions").fetchone()[0])
"""


@pytest.mark.skipif(sys.platform == "win32", reason="permissions of POSIX")
@pytest.mark.parametrize("growing", [False, True])
@pytest.mark.parametrize("how", ["mode=ro", "immutable=0"])
def test_a_finished_file_opens_where_nothing_can_be_written(how: str, growing: bool) -> None:
    """File and folder read-only, another process of another user: a plain file, no WAL."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "log.sqlite")
        export(path, growing=growing).close()
        assert [one.name for one in Path(folder).iterdir()] == ["log.sqlite"]
        # The file format versions of the header (https://sqlite.org/fileformat2.html, 1.3.3).
        assert path.read_bytes()[18:20] == b"\x01\x01"
        path.chmod(0o444)
        Path(folder).chmod(0o555)
        try:
            done = subprocess.run(
                [sys.executable, "-c", READ_ONLY, f"{path}?{how}"],
                capture_output=True, text=True, check=False,
            )  # fmt: skip
        finally:
            Path(folder).chmod(0o755)
        assert (done.stderr, done.returncode) == ("", 0)
        assert int(done.stdout) == len(list(recording().transactions))


def test_a_reader_does_not_keep_a_live_file_from_being_finished(tmp_path: Path) -> None:
    """It stays in WAL mode then, which is said; every row is there."""
    path = tmp_path / "live.sqlite"
    sink = export(path, growing=True)
    reader = sqlite3.connect(path)
    reader.execute("BEGIN")
    reader.execute("SELECT count(*) FROM transactions").fetchone()
    sink.close()
    assert sink.closing_remark() == "another program has it open, so it stays in WAL mode"
    reader.close()
    with sqlite3.connect(path) as base:
        count = base.execute("SELECT count(*) FROM transactions").fetchone()
    assert count == (len(list(recording().transactions)),)


LIVE = """
import sys, time
sys.path.insert(0, {root!r})
from analyzer import decode
from analyzer.columns import TABLES
from analyzer.exports import sqlite
from analyzer.exports.sink import ExportSink, parse_target
sqlite.COMMIT_S = 0.0
sink = ExportSink(parse_target({path!r}, "transactions"), columns=None, where=None, growing=True)
for batch in decode({recording!r}).batches(*TABLES):
    sink.put(batch)
print("there", flush=True)
time.sleep(60)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_a_live_file_can_be_read_while_it_grows_and_after_a_kill(tmp_path: Path) -> None:
    """Committed rows can be read during the tap, and after SIGKILL."""
    path = tmp_path / "live.sqlite"
    source = str(CAPTURES / "pymodbus_disturbed" / "recording.jsonl")
    code = LIVE.format(root=str(ROOT), path=str(path), recording=source)
    running = subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, env=environment()
    )
    assert running.stdout is not None
    assert running.stdout.readline() == b"there\n"
    wanted = len(list(recording().transactions))
    for kill in (False, True):
        if kill:
            os.kill(running.pid, signal.SIGKILL)
            running.wait()
        base = sqlite3.connect(path)
        assert base.execute("SELECT count(*) FROM transactions").fetchone() == (wanted,)
        assert base.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        base.close()
    running.stdout.close()
