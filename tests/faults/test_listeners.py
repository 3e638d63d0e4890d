"""What listens on the network can't be filled by a stranger."""

from __future__ import annotations

import socket
import threading
import time
import urllib.request

import pytest

pytest.importorskip("prometheus_client")

from analyzer.feeds.metrics import Metrics
from analyzer.feeds.metrics_server import MAX_CONNECTIONS


def scraped(port: int) -> str:
    """What a Prometheus gets."""
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=10) as answer:
        return str(answer.read().decode())


def test_idle_connections_do_not_keep_a_scraper_out() -> None:
    """A hundred connections that say nothing: threads stay few, and metrics are to be had."""
    metrics = Metrics(("127.0.0.1", 0), lambda: {"buses": []})
    before = threading.active_count()
    idle = [socket.create_connection(("127.0.0.1", metrics.port), 10) for _ in range(100)]
    try:
        end = time.monotonic() + 10
        while threading.active_count() > before + MAX_CONNECTIONS and time.monotonic() < end:
            time.sleep(0.05)
        assert threading.active_count() <= before + MAX_CONNECTIONS
        assert "modlens_mqtt_connected" in scraped(metrics.port)
    finally:
        for one in idle:
            one.close()
        metrics.close()


def test_a_request_that_never_ends_is_ended() -> None:
    """A first line without an end: closed after some seconds, or for somebody else."""
    metrics = Metrics(("127.0.0.1", 0), lambda: {"buses": []})
    with socket.create_connection(("127.0.0.1", metrics.port), 10) as slow:
        slow.sendall(b"GET /metr")
        slow.settimeout(20)
        assert slow.recv(100) == b""
    assert "modlens_mqtt_undelivered" in scraped(metrics.port)
    metrics.close()
