"""Prometheus' metrics over real HTTP."""

from __future__ import annotations

import socket
import urllib.request
from dataclasses import astuple
from functools import partial
from typing import Any

import pytest

pytest.importorskip("prometheus_client")

from prometheus_client.parser import text_string_to_metric_families

from analyzer import SourceError, UsageError
from analyzer.exports.recorder import RecordingStatus
from analyzer.feeds.metrics import Metrics, parse_address
from tests.analyzer.cli.test_triggers import batches

STATS = {"buses": [{"bus": "bus", "frames": {"bad_checksum": 3}, "utilization": 0.25}]}


def scrape(metrics: Metrics) -> dict[str, Any]:
    """Name and labels -> value, as a scraper reads them."""
    with urllib.request.urlopen(f"http://127.0.0.1:{metrics.port}/metrics", timeout=10) as answer:
        text = answer.read().decode()
    return {
        " ".join(
            [sample.name, *(f"{key}={value}" for key, value in sorted(sample.labels.items()))]
        ): sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
    }


def test_a_scraper_reads_what_happened() -> None:
    """Counters by status, response times, the last time of each unit, load and damage."""
    metrics = Metrics(("127.0.0.1", 0), lambda: STATS)
    for batch in batches("..x"):
        metrics.put(batch)
    found = scrape(metrics)
    assert found["modbus_transactions_total bus=bus function=3 status=ok unit=1"] == 2
    assert found["modbus_transactions_total bus=bus function=3 status=exception unit=1"] == 1
    assert found["modbus_response_time_seconds_count bus=bus unit=1"] == 3
    assert found["modbus_last_seen_timestamp_seconds bus=bus unit=1"] > 10**9
    assert found["modbus_bad_checksum_total bus=bus"] == 3
    assert found["modbus_bus_utilization_ratio bus=bus"] == 0.25
    port = metrics.port
    metrics.close()
    with socket.socket() as probe:
        assert probe.connect_ex(("127.0.0.1", port)) != 0


def test_trouble_of_the_recording_is_a_metric() -> None:
    """While a disk is full, and what is missing afterwards; nothing where nothing is recorded."""
    for trouble, lost in ((None, 0), ("bus.pcapng: no space left", 17)):
        status = RecordingStatus("bus.pcapng", trouble, trouble is not None, 100, lost, 0)
        metrics = Metrics(
            ("127.0.0.1", 0), lambda: STATS, None, partial(RecordingStatus, *astuple(status))
        )
        for batch in batches("."):
            metrics.put(batch)
        found = scrape(metrics)
        metrics.close()
        assert found["modlens_recording_works"] == (trouble is None)
        assert found["modlens_recording_lost_bytes"] == lost
    metrics = Metrics(("127.0.0.1", 0), lambda: STATS)
    assert not any("recording" in name for name in scrape(metrics))
    metrics.close()


def test_a_port_that_is_taken_is_reported() -> None:
    """The error names the port's number."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(SourceError, match=str(port)):
            Metrics(("127.0.0.1", port), lambda: STATS)


def test_addresses() -> None:
    """The address is loopback unless another one is given."""
    assert parse_address("9502") == ("127.0.0.1", 9502)
    assert parse_address("0.0.0.0:80") == ("0.0.0.0", 80)
    for text in ("", "x", "70000", "host:"):
        with pytest.raises(UsageError):
            parse_address(text)
