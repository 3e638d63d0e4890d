"""Both sides of a gateway: what the model planted is what `modlens join` says.

The model (`tests.support.gateway_model`) knows which request of the network caused which
transaction of the line. Clocks are 3 s apart and drift by 50 ppm.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from analyzer.cli import main
from tests.support.gateway_model import GatewayModel, Truth

LINE = ("--line", "19200-8E1")
FAULTS = {"dropped": 6, "cached": 8, "late_answer": 6, "wrong_client": 5}

Join = Callable[..., tuple[list[dict[str, Any]], str]]


@pytest.fixture
def join(capsys: pytest.CaptureFixture[str]) -> Join:
    """Runs the command; gives its rows and its messages."""

    def run(truth: Truth, *arguments: str, to: str = "jsonl") -> tuple[list[dict[str, Any]], str]:
        words = ["join", str(truth.network), str(truth.line), *LINE, *arguments, "--to", to]
        assert main(words) == 0
        done = capsys.readouterr()
        return [json.loads(line) for line in done.out.splitlines()], done.err

    return run


@pytest.mark.parametrize("seed", range(3))
def test_planted_faults_are_named_and_all_else_is_matched(
    seed: int, tmp_path: Path, join: Join
) -> None:
    truth = GatewayModel(seed=seed, faults=FAULTS).write(tmp_path)
    rows, _ = join(truth)
    found = {row["upstream_txn"]: row for row in rows if "upstream_txn" in row}
    assert len(found) == len(truth.asked)
    planted = Counter(one.outcome for one in truth.asked)
    assert planted["forwarded"] > 1000
    assert set(planted) == {"forwarded", "gateway_timeout", *FAULTS}
    for number, one in enumerate(truth.asked, 1):
        row = found[number]
        assert row["upstream_client"] == one.client
        assert (row["outcome"], row.get("txn")) == (
            one.outcome,
            None if one.line is None else one.line + 1,
        ), (number, one, row)
        if one.age_s is not None:
            assert row["cache_age_us"] == pytest.approx(one.age_s * 1e6, abs=20_000)


def test_clocks_and_units_are_found(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    truth = GatewayModel(seed=5).write(tmp_path)
    output = tmp_path / "joined.csv"
    words = [str(truth.network), str(truth.line), *LINE, "-o", str(output)]
    assert main(["join", *words]) == 0
    said = capsys.readouterr().err
    [clock] = [line for line in said.splitlines() if line.startswith("the line's clock")]
    # In the middle of the ten minutes 50 ppm have added 15 ms to the 3 s.
    offset, error, drift, drift_error = (
        float(part)
        for part in _numbers(clock, "is ", " s", "(± ", " ms", "gains ", " ppm", "(± ", ")")
    )
    assert abs(offset - 3.015) <= error / 1e3 + 0.001
    assert error < 5
    assert abs(drift - 50) <= drift_error
    assert drift_error < 20
    assert "1 is 11 on the line, 2 is 12 on the line" in said


def _numbers(text: str, *marks: str) -> list[str]:
    found = []
    for before, after in zip(marks[::2], marks[1::2], strict=True):
        _, _, text = text.partition(before)
        number, _, text = text.partition(after)
        found.append(number)
    return found


def test_the_writer_of_a_register_has_an_address(tmp_path: Path, join: Join) -> None:
    truth = GatewayModel(seed=6).write(tmp_path)
    rows, _ = join(truth, "--where", "writes(hr, 107)")
    writes = [one for one in truth.asked if one.pdu[0] == 6]
    assert [row["upstream_client"] for row in rows] == [one.client for one in writes]
    assert {row["write_address"] for row in rows} == {107}


def test_constant_values_and_regular_polls_are_matched(tmp_path: Path, join: Join) -> None:
    truth = GatewayModel(seed=7, constant=True, shift_s=-40).write(tmp_path)
    rows, _ = join(truth)
    assert [row.get("txn") for row in rows] == [(one.line or 0) + 1 for one in truth.asked]


def test_parquet_has_the_same_rows(tmp_path: Path, join: Join) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    truth = GatewayModel(seed=8, seconds=120).write(tmp_path)
    output = tmp_path / "joined.parquet"
    rows, _ = join(truth, "-o", str(output))
    table = parquet.read_table(output).to_pylist()
    assert [row["upstream_txn"] for row in table] == [row["upstream_txn"] for row in rows]
    assert [row["gateway_delay_us"] for row in table] == [row["gateway_delay_us"] for row in rows]


def test_recordings_of_other_gateways_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one, other = tmp_path / "one", tmp_path / "other"
    one.mkdir()
    other.mkdir()
    network = GatewayModel(seed=9, seconds=60).write(one).network
    line = GatewayModel(seed=10, seconds=60).write(other).line
    output = tmp_path / "joined.csv"
    assert main(["join", str(network), str(line), *LINE, "-o", str(output)]) == 3
    assert "in common" in capsys.readouterr().err
    assert not output.exists()
