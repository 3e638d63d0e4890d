"""MQTT: values, transactions and the state of the tap, for whoever subscribes.

- `PREFIX/status`: `online`, retained; `offline` as the last will
- `PREFIX/BUS/transaction`: a JSON object for each transaction (the columns of JSON lines)
- `PREFIX/BUS/day`: the row of `analyzer.bus_days` of this day so far, as a JSON object, retained;
  sent every minute in which it changes, and for the last time after midnight (UTC)
- `PREFIX/BUS/event`, `PREFIX/BUS/trouble`, `PREFIX/BUS/UNIT/_problem`: what is wrong, and when
  that changes (see `analyzer.feeds.troubles`)
- `PREFIX/BUS/UNIT/NAME`: the last value of a register or coil, retained; sent when it changes

With `discovery`, Home Assistant is informed of devices and sensors (see
`analyzer.feeds.home_assistant`), and again when it restarts.
Nothing is subscribed to but Home Assistant's own state: a listener takes no commands.

What the broker has not confirmed waits in a spool, in a file if one is named, and is sent when it
is back; so each message arrives at least once (quality of service 1).
"""

from __future__ import annotations

import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import _modlens
from analyzer.addresses import SHORT
from analyzer.columns import pick
from analyzer.counts import count_of
from analyzer.feeds.broker import Broker, tls_context
from analyzer.feeds.home_assistant import DISCOVERY, HomeAssistant
from analyzer.feeds.spool import Message, Spool
from analyzer.feeds.troubles import TroubleTopics
from analyzer.installing import how_to_install
from dissectors.errors import UsageError

__all__ = ["Mqtt"]

IN_FLIGHT = 200
"""Messages that may be given to the client before the first of them is acknowledged."""

_KEEPALIVE_S = 30
_MAX_RECONNECT_S = 30
_FIRST_OUTCOME_S = 3.0
"""How long the start of a tap waits to hear whether the broker accepts the connection."""

_GOODBYE_S = 2.0
_DAY_EVERY_S = 60.0
_KEPT_DAYS = 2
"""Days that are counted: yesterday's row is sent again."""

_MAX_VALUES = 200_000


class Mqtt:
    """A sink that publishes; `UsageError` where the package paho-mqtt is not installed.

    With `spool` unacknowledged messages are kept in this file; with `discovery` Home Assistant is
    told of each value. The row of the day is sent every `day_every_s` seconds at most. `notify` is
    called, in the sink's thread, when the connection changes.
    """

    table = "transactions"

    def __init__(
        self,
        where: Broker,
        *,
        spool: str | None = None,
        discovery: bool = False,
        day_every_s: float = _DAY_EVERY_S,
        notify: Callable[[str], None] = lambda text: None,
    ) -> None:
        self.name = str(where)
        self.row_count = 0
        self.delivered = 0
        self.state = "connecting"
        self._notify = notify
        self._reported_state = self.state
        self._has_outcome = threading.Event()
        self._spool_path = spool
        self._prefix = where.prefix
        self._troubles = TroubleTopics(where.prefix)
        self._home = HomeAssistant(where.prefix, self._status) if discovery else None
        self._spool = Spool(spool)
        self._columns = pick("transactions", None)
        self._values: dict[str, Any] = {}
        self._days = _modlens.Days(_KEPT_DAYS)
        self._day_every_s, self._day_due_s = day_every_s, time.monotonic() + day_every_s
        self._in_flight: dict[int, int] = {}
        self._confirmed: deque[int] = deque()
        self._connected = self._must_announce = False
        self._client = self._make_client(where)
        self._client.connect_async(where.host, where.port, _KEEPALIVE_S)
        self._client.loop_start()
        self._has_outcome.wait(_FIRST_OUTCOME_S)
        self._report_state()

    def put(self, batch: _modlens.Batch) -> None:
        """Queue the messages of a batch, and publish those that are waiting."""
        self._days.add(getattr(batch, "whole", batch))
        if time.monotonic() >= self._day_due_s:
            self._day_due_s = time.monotonic() + self._day_every_s
            self._spool.add(*self._day_messages())
        table = batch.transactions
        if len(table):
            self._spool.add(*self._messages(table))
            self.row_count += len(table)
        self._publish_waiting()
        self._report_state()

    def trouble(self, event: Mapping[str, Any]) -> None:
        """Queue the messages of an event; see `analyzer.feeds.troubles`."""
        self._spool.add(*self._troubles.event(event))

    def close(self) -> None:
        """Publish `offline` and disconnect; unacknowledged messages stay in the spool's file."""
        self._spool.add(*self._day_messages())
        self._publish_waiting()
        if self._client.is_connected():
            goodbye = self._client.publish(self._status, b"offline", qos=1, retain=True)
            goodbye.wait_for_publish(_GOODBYE_S)
        self._client.disconnect()
        self._client.loop_stop()
        self._acknowledge()
        self._spool.close()

    def rollback(self) -> None:
        """Nothing to do: there is no incomplete output."""

    @property
    def waiting(self) -> int:
        """The number of messages that the broker has not acknowledged."""
        return len(self._spool)

    @property
    def is_connected(self) -> bool:
        """Whether the broker has accepted the connection."""
        return bool(self._client.is_connected())

    @property
    def failed(self) -> bool:
        """Whether there was something to deliver, and the broker has acknowledged nothing."""
        return not self.delivered and (self.row_count > 0 or len(self._spool) > 0)

    @property
    def _status(self) -> str:
        return f"{self._prefix}/status"

    def _make_client(self, where: Broker) -> Any:
        """A client with the last will `offline` on the status topic; not connected yet."""
        try:
            from paho.mqtt import client as paho  # noqa: PLC0415
            from paho.mqtt.enums import CallbackAPIVersion  # noqa: PLC0415
        except ImportError as error:
            raise UsageError(f"--mqtt needs a package: {how_to_install('paho-mqtt')}") from error
        client = paho.Client(CallbackAPIVersion.VERSION2)
        if where.tls:
            client.tls_set_context(tls_context(where))
        if where.user is not None:
            client.username_pw_set(where.user, where.password)
        client.will_set(self._status, b"offline", qos=1, retain=True)
        client.reconnect_delay_set(1, _MAX_RECONNECT_S)
        client.max_inflight_messages_set(IN_FLIGHT)
        client.on_connect = self._on_connect
        client.on_connect_fail = self._on_connect_fail
        client.on_disconnect = self._on_disconnect
        client.on_publish = self._on_publish
        client.on_message = self._on_message
        return client

    def _on_connect(
        self, client: Any, data: object, flags: object, reason: Any, *_: object
    ) -> None:
        """Runs in the client's thread, so it only publishes the status and subscribes."""
        if reason.is_failure:
            self._set_state(f"the broker refuses the connection ({str(reason).lower()})")
            return
        self._set_state("connected")
        client.publish(self._status, b"online", qos=1, retain=True)
        if self._home is not None:
            client.subscribe(f"{DISCOVERY}/status")

    def _on_connect_fail(self, client: Any, data: object) -> None:
        # The client calls this while it handles the exception, and does not pass it on.
        error = sys.exception() if sys.version_info >= (3, 12) else sys.exc_info()[1]
        reason = getattr(error, "strerror", None) or str(error or "no answer")
        self._set_state(f"no connection ({reason})")

    def _on_disconnect(
        self, client: Any, data: object, flags: object, reason: Any, *_: object
    ) -> None:
        if reason.is_failure and self.state == "connected":
            self._set_state(f"the connection is lost ({str(reason).lower()})")

    def _set_state(self, state: str) -> None:
        self.state = state
        self._has_outcome.set()

    def _report_state(self) -> None:
        state = self.state
        if state != self._reported_state:
            self._reported_state = state
            again = "" if state == "connected" else "; trying again"
            self._notify(f"{self.name}: {state}{again}")

    def outcome(self) -> str:
        """What became of the messages, for the end of a run; those of an earlier one count too.

        Messages are more than transactions: values, the row of the day, announcements of sensors.
        """
        total = self.delivered + len(self._spool) + self._spool.dropped
        parts = [f"{self.delivered:,} of {count_of(total, 'message')} delivered"]
        if self._spool.dropped:
            parts.append(f"{self._spool.dropped:,} dropped because the queue was full")
        if len(self._spool):
            kept = "lost" if self._spool_path is None else f"kept in {self._spool_path}"
            parts.append(f"{len(self._spool):,} {kept}")
        return f"{count_of(self.row_count, 'transaction')}; {', '.join(parts)}"

    def _on_publish(self, client: Any, data: object, number: int, *_: object) -> None:
        self._confirmed.append(number)

    def _on_message(self, client: Any, data: object, message: Any) -> None:
        self._must_announce |= bytes(message.payload) == b"online"

    def _publish_waiting(self) -> None:
        if self._must_announce:
            self._must_announce = False
            self._spool.add(*self._home.announcements if self._home is not None else ())
        self._acknowledge()
        if not self._client.is_connected():
            return
        for number, one in self._spool.waiting(IN_FLIGHT - len(self._in_flight)):
            sent = self._client.publish(one.topic, one.payload, qos=1, retain=one.retain)
            self._in_flight[sent.mid] = number

    def _acknowledge(self) -> None:
        numbers = self._take_confirmed()
        self.delivered += len(numbers)
        self._spool.acknowledge(numbers)

    def _take_confirmed(self) -> list[int]:
        """The spool's numbers of the messages acknowledged since the last call."""
        numbers = []
        for _ in range(len(self._confirmed)):
            number = self._in_flight.pop(self._confirmed.popleft(), None)
            if number is not None:
                numbers.append(number)
        return numbers

    def _day_messages(self) -> Iterator[Message]:
        """The rows of days that have changed; of each bus the latest day comes last, and stays."""
        for bus, row in self._days.changed():
            topic = f"{self._prefix}/{_modlens.topic_level(bus)}/day"
            yield Message(topic, row.encode(), retain=True)

    def _messages(self, table: _modlens.Table) -> Iterator[Message]:
        lines = b"".join(table.lines("jsonl", self._columns)).splitlines()
        for row, line in zip(table, lines, strict=True):
            bus = f"{self._prefix}/{_modlens.topic_level(row.bus)}"
            yield Message(f"{bus}/transaction", line)
            yield from self._troubles.meet(row.bus, row.unit)
            if self._home is not None:
                yield from self._home.transaction(row)
            if row.status == "ok":
                for name, value in _values(row):
                    yield from self._value(f"{bus}/{row.unit}/{name}", value, row, name)

    def _value(self, topic: str, value: Any, row: _modlens.Row, name: str) -> Iterator[Message]:
        if self._values.get(topic) == value or len(self._values) >= _MAX_VALUES:
            return
        if self._home is not None and topic not in self._values:
            yield from self._home.value(topic, value, row, name)
        self._values[topic] = value
        payload = str(int(value) if isinstance(value, bool) else value)
        yield Message(topic, payload.encode(), retain=True)


def _values(row: _modlens.Row) -> Iterator[tuple[str, Any]]:
    """Names and values of a transaction: those of a profile's points, else registers and coils."""
    if row.readings:
        for name, value in row.readings.items():
            yield _modlens.topic_level(name), value
        return
    kind = SHORT.get(row.register_type or "")
    if kind is None:
        return
    for first, data in ((row.address, row.data), (row.write_address, row.write_data)):
        if first is not None and data is not None:
            for address, value in enumerate(data, first):
                yield f"{kind}{address}", value
