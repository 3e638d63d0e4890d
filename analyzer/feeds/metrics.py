"""Prometheus metrics of the bus over HTTP, under `/metrics`.

The server listens on loopback unless another address is given. Registers are not exported by
number, because each would be a time series of its own; values named by a profile are.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any, Protocol

import _modlens
from analyzer.counts import count_of
from analyzer.feeds.metrics_server import BoundedServer
from analyzer.installing import how_to_install
from dissectors.errors import SourceError, UsageError

__all__ = ["Metrics", "parse_address"]

LOOPBACK = "127.0.0.1"
_UPDATE_S = 1.0
_LAST_PORT = 65535
_BUCKETS = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5)


def parse_address(text: str) -> tuple[str, int]:
    """Parse `[HOST:]PORT`; gives host and port, `UsageError` if it is neither.

    >>> parse_address("9502")
    ('127.0.0.1', 9502)
    """
    host, _, port = text.rpartition(":")
    if not port.isdecimal() or int(port) > _LAST_PORT:
        raise UsageError(f"--metrics {text}: write a port as 9502, or host:port")
    return host.strip("[]") or LOOPBACK, int(port)


class BrokerFeed(Protocol):
    """What is published of a feed to a broker."""

    @property
    def is_connected(self) -> bool:
        """Whether the broker has accepted the connection."""

    @property
    def waiting(self) -> int:
        """The number of messages that the broker has not acknowledged."""


class RecordingState(Protocol):
    """What is published of a raw recording."""

    @property
    def trouble(self) -> str | None:
        """Why nothing can be recorded at the moment."""

    @property
    def lost(self) -> int:
        """Bytes of the line that are missing in the recording."""


class Metrics:
    """A sink that counts, and a server that publishes the counters; `port` is the server's.

    `broker` is the MQTT feed of the same tap, and `recording` gives the state of its raw recording
    (None before it has begun): they are published as well. `UsageError` where the
    package prometheus-client is not installed, `SourceError` where the port cannot be had.
    """

    table = "transactions"

    def __init__(
        self,
        where: tuple[str, int],
        stats: Callable[[], Mapping[str, Any]],
        broker: BrokerFeed | None = None,
        recording: Callable[[], RecordingState | None] | None = None,
    ) -> None:
        try:
            import prometheus_client as prometheus  # noqa: PLC0415
        except ImportError as error:
            raise UsageError(
                f"--metrics needs a package: {how_to_install('prometheus-client')}"
            ) from error
        self.row_count = 0
        self._stats = stats
        self._broker = broker
        self._recording = recording
        self._next_update_s = 0.0
        registry = prometheus.CollectorRegistry()
        rows, unit = ("bus", "unit", "function", "status"), ("bus", "unit")
        self._transactions = prometheus.Counter(
            "modbus_transactions", "Transactions by status", rows, registry=registry
        )
        self._times = prometheus.Histogram(
            "modbus_response_time_seconds",
            "Time from the end of a request to the start of its response",
            unit,
            buckets=_BUCKETS,
            registry=registry,
        )
        self._seen = prometheus.Gauge(
            "modbus_last_seen_timestamp_seconds",
            "Time of the last response of a unit",
            unit,
            registry=registry,
        )
        self._values = prometheus.Gauge(
            "modbus_register_value", "Values of named registers", (*unit, "name"), registry=registry
        )
        self._damaged = prometheus.Gauge(
            "modbus_bad_checksum_total", "Frames with a checksum error", ("bus",), registry=registry
        )
        self._busy = prometheus.Gauge(
            "modbus_bus_utilization_ratio",
            "Bus utilization: share of the time in which bytes are on the line",
            ("bus",),
            registry=registry,
        )
        self._troubles = prometheus.Gauge(
            "modlens_trouble",
            "1 while there is this trouble; unit is empty where the whole bus has it",
            (*unit, "code"),
            registry=registry,
        )
        self._open: dict[int, tuple[str, str, str]] = {}
        self._connected = prometheus.Gauge(
            "modlens_mqtt_connected", "1 while the broker accepts messages", registry=registry
        )
        self._undelivered = prometheus.Gauge(
            "modlens_mqtt_undelivered_messages", "Messages not acknowledged yet", registry=registry
        )
        if recording is not None:
            self._recording_works = prometheus.Gauge(
                "modlens_recording_works", "1 while reads can be recorded", registry=registry
            )
            self._unrecorded = prometheus.Gauge(
                "modlens_recording_lost_bytes", "Bytes missing in the recording", registry=registry
            )
        try:
            self._server = BoundedServer(where, prometheus.make_wsgi_app(registry))
        except OSError as error:
            raise SourceError(f"--metrics {where[0]}:{where[1]}: {error.strerror}") from error
        self.port = int(self._server.server_port)
        self.name = f"http://{where[0]}:{self.port}/metrics"

    def put(self, batch: _modlens.Batch) -> None:
        """Count the transactions of a batch."""
        table = batch.transactions
        self.row_count += len(table)
        for row in table:
            self._count(row)
        if time.monotonic() >= self._next_update_s:
            self._next_update_s = time.monotonic() + _UPDATE_S
            self._update_gauges()

    def trouble(self, event: Mapping[str, Any]) -> None:
        """Take an event; see `analyzer.feeds.troubles`."""
        number, unit = event["number"], event["unit"]
        before = self._open.pop(number, None)
        if before is not None and before not in self._open.values():
            self._troubles.remove(*before)
        if event["event"] != "end":
            labels = (event["bus"], "" if unit is None else str(unit), event["code"])
            self._open[number] = labels
            self._troubles.labels(*labels).set(1)

    def outcome(self) -> str:
        """What became of the rows, for the end of a run."""
        return f"{count_of(self.row_count, 'transaction')} counted"

    def close(self) -> None:
        """Stop the server."""
        self._server.stop()

    def rollback(self) -> None:
        """Nothing to do: there is no incomplete output."""

    def _count(self, row: _modlens.Row) -> None:
        self._transactions.labels(row.bus, row.unit, row.function, row.status).inc()
        if row.response_time_us is not None:
            self._times.labels(row.bus, row.unit).observe(row.response_time_us / 1e6)
        if row.status in ("ok", "exception") and row.time is not None:
            self._seen.labels(row.bus, row.unit).set(row.time.timestamp())
        for name, value in (row.readings or {}).items():
            if isinstance(value, int | float):
                self._values.labels(row.bus, row.unit, name).set(value)

    def _update_gauges(self) -> None:
        """Update the gauges that come from the statistics.

        This is done in the sink's thread, because the server's thread must not call the core.
        """
        if self._broker is not None:
            self._connected.set(self._broker.is_connected)
            self._undelivered.set(self._broker.waiting)
        recording = None if self._recording is None else self._recording()
        if recording is not None:
            self._recording_works.set(recording.trouble is None)
            self._unrecorded.set(recording.lost)
        for bus in self._stats()["buses"]:
            self._damaged.labels(bus["bus"]).set(bus["frames"].get("bad_checksum", 0))
            if bus["utilization"] is not None:
                self._busy.labels(bus["bus"]).set(bus["utilization"])
