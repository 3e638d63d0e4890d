"""The figures of the document are those that anybody can compute from the exports."""

from __future__ import annotations

import csv
import io
import itertools
import json
import math
from collections import Counter
from collections.abc import Sequence
from datetime import datetime
from typing import Any

import pytest

from tests.conftest import CAPTURES, Modlens

LINES = {"pymodbus_disturbed": (19200, 11), "pymodbus_plant": (57600, 11)}
"""Baud rate and bits a character of recordings."""

FAILED = ("no_response", "bad_request", "bad_response")


def words_of(name: str) -> list[str]:
    return [str(CAPTURES / name / "recording.jsonl"), "--line", f"{LINES[name][0]}-8E1"]


def rows_of(modlens: Modlens, name: str, table: str) -> list[dict[str, str]]:
    done = modlens("export", *words_of(name), "--table", table, "--to", "csv")
    return list(csv.DictReader(io.StringIO(done.out)))


def document_of(modlens: Modlens, name: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(modlens("stats", *words_of(name), "--to", "json").out)
    return found


def percentile(values: Sequence[float], share: float) -> float:
    """The value that this share does not exceed."""
    return sorted(values)[math.ceil(len(values) * share) - 1]


@pytest.mark.parametrize("name", LINES)
def test_requests_and_response_times(name: str, modlens: Modlens) -> None:
    """Counts are exact, percentiles within 2 %, by unit and function and over time."""
    document, rows = document_of(modlens, name), rows_of(modlens, name, "transactions")
    (bus,), (course,) = document["statistics"]["buses"], document["overview"]["buses"]
    requests = {(row["unit"], row["function"]): row for row in course["requests"]["rows"]}
    assert len(bus["units"]) == len(requests)
    for told in bus["units"]:
        own = [
            row
            for row in rows
            if (int(row["unit"]), int(row["function"])) == (told["unit"], told["function"])
        ]
        statuses = Counter(row["status"] for row in own)
        assert told["statuses"] == dict(statuses)
        over_time = requests[told["unit"], told["function"]]
        assert sum(over_time["transactions"]) == len(own)
        assert sum(over_time["ok"]) == statuses["ok"]
        assert sum(over_time["silent"]) == statuses["no_response"]
        times = [float(row["response_time_us"]) for row in own if row["response_time_us"]]
        found = told["response_time"]
        assert found["count"] == sum(over_time["response_time"]["count"]) == len(times)
        assert sum(found["histogram"]["counts"]) == len(times)
        edges = found["histogram"]["edges_us"]
        for at, count in enumerate(found["histogram"]["counts"]):
            assert count == sum(edges[at] <= time < edges[at + 1] for time in times)
        for key, share in (("p50_us", 0.5), ("p95_us", 0.95), ("p99_us", 0.99)):
            assert found[key] == pytest.approx(percentile(times, share), rel=0.02)
        longest = [one for one in over_time["response_time"]["max_us"] if one is not None]
        assert max(longest) == found["max_us"] == max(times)


@pytest.mark.parametrize("name", LINES)
def test_p95_of_each_unit_over_time(name: str, modlens: Modlens) -> None:
    """Of the response times of the requests that begin in a bucket, within 2 %."""
    requests = document_of(modlens, name)["overview"]["buses"][0]["requests"]
    start, step = requests["steps"]["start"], requests["steps"]["step"]
    buckets: dict[tuple[int, int], list[float]] = {}
    for row in rows_of(modlens, name, "transactions"):
        if row["response_time_us"]:
            seconds, _, fraction = row["time"].removesuffix("Z").partition(".")
            begun = datetime.fromisoformat(f"{seconds}+00:00").timestamp() * 1e6
            at = int((begun - start + float(f"0.{fraction}") * 1e6) // step)
            buckets.setdefault((int(row["unit"]), at), []).append(float(row["response_time_us"]))
    told = {
        (row["unit"], at): p95
        for row in requests["units"]
        for at, p95 in enumerate(row["p95_us"])
        if p95 is not None
    }
    assert told.keys() == buckets.keys()
    for key, times in buckets.items():
        assert told[key] == pytest.approx(percentile(times, 0.95), rel=0.02)


@pytest.mark.parametrize("name", LINES)
def test_the_line_over_time(name: str, modlens: Modlens) -> None:
    """Load is bytes times the time of a character; each bucket holds what begins in it."""
    (course,) = document_of(modlens, name)["overview"]["buses"]
    frames = rows_of(modlens, name, "frames")
    transactions = rows_of(modlens, name, "transactions")
    line = course["line"]
    baud, bits = LINES[name]
    total = sum(int(row["byte_length"]) for row in frames)
    assert sum(line["bytes"]) == total
    assert sum(line["busy_us"]) == pytest.approx(total * bits * 1e6 / baud, rel=1e-5)
    assert max(line["busy_us"]) <= line["step"] * 1.2
    assert sum(line["failed"]) == sum(row["status"] in FAILED for row in transactions)
    damaged = ("bad_checksum", "incomplete")
    assert sum(line["damaged"]) == sum(row["verdict"] in damaged for row in frames)
    longest = max(float(row["gap_us"] or 0) for row in frames)
    assert max(line["silence_us"]) == pytest.approx(longest)
    assert sum(line["transactions"]) == len(transactions)


def test_registers_over_time(modlens: Modlens) -> None:
    """Last value, extremes and number of reads of each register."""
    name = "pymodbus_plant"
    (course,) = document_of(modlens, name)["overview"]["buses"]
    rows = [row for row in rows_of(modlens, name, "readings") if row["status"] == "ok"]
    values: dict[tuple[int, str, int], list[int]] = {}
    for row in rows:
        key = (int(row["unit"]), row["register_type"], int(row["address"]))
        values.setdefault(key, []).append(int(row["value"]))
    told = course["registers"]["rows"]
    assert {(row["unit"], row["register_type"], row["address"]) for row in told} == set(values)
    for row in told:
        own = values[row["unit"], row["register_type"], row["address"]]
        assert (row["min"], row["max"], row["value"]) == (min(own), max(own), own[-1])
        assert row["reads"] + row["writes"] == len(own)
        assert row["changes"] == sum(one != other for one, other in itertools.pairwise(own))
        if row["course"] is not None:
            seen = [one for one in row["course"]["min"] if one is not None]
            assert min(seen) == min(own)


def test_the_poll_cycle(modlens: Modlens) -> None:
    """How often each request was sent, and from one to the next."""
    name = "pymodbus_plant"
    (bus,) = document_of(modlens, name)["statistics"]["buses"]
    rows = rows_of(modlens, name, "transactions")
    told = bus["polls"]["requests"]
    assert bus["polls"]["more"] == 0
    assert sum(row["count"] for row in told) == len(rows)
    for row in told:
        own = [
            float(one["elapsed_us"])
            for one in rows
            if (one["address"], one["quantity"]) == (str(row["address"]), str(row["quantity"]))
        ]
        gaps = [later - before for before, later in itertools.pairwise(own)]
        assert row["count"] == len(own)
        assert row["interval"]["p50_us"] == pytest.approx(percentile(gaps, 0.5), rel=0.02)
