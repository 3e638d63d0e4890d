"""Transactions from an MQTT broker to Parquet files: `python mqtt_to_parquet.py HOST FOLDER NAME`.

One is enough for most; where it is not, start several, each with a name and a part of its own:
`NAME1 --part 1/3`, `NAME2 --part 2/3` ... Each is sent everything, and writes the buses of its
part. The broker keeps what comes while one is away (persistent session, MQTT 5.0, 4.1), also when
it is restarted itself; a message is acknowledged when the file that it is in is on the disk. So
nothing is lost when this program or the broker is killed. What comes again then is left out if it
is in this program's newest file.

Brokers that keep shared subscriptions over a restart can divide the messages themselves:
`--topic '$share/parquet/+/+/transaction'` without `--part`. Mosquitto does not keep them.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import threading
import time
import zlib
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq
from paho.mqtt import client as paho
from paho.mqtt.enums import CallbackAPIVersion
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

from analyzer.batches import schema

SCHEMA = schema("transactions")
TOPIC = "+/+/transaction"
ROWS = 5000
"""A file is written after so many rows at the latest."""

AWAY_S = 7 * 86_400
"""For how long the broker keeps the messages of a consumer that is away."""

Key = tuple[str, int, int | None]


def main() -> None:
    """Write files until SIGTERM or Ctrl-C."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("broker", help="host or host:port")
    parser.add_argument("folder", type=Path)
    parser.add_argument("name")
    parser.add_argument("--topic", default=TOPIC)
    parser.add_argument("--part", type=part_of, default=(1, 1), metavar="K/N")
    parser.add_argument("--seconds", type=float, default=10.0, help="write a file after so long")
    options = parser.parse_args()
    folder, name, seconds = options.folder, options.name, options.seconds
    folder.mkdir(parents=True, exist_ok=True)
    inbox = Inbox(options.part)
    client = connect(options.broker, name, options.topic, inbox)
    stopped: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, frame: stopped.append(number))
    known = newest_keys(folder, name)
    while not stopped:
        connection, batch = inbox.take(seconds)
        if batch:
            known = write(folder, name, [bytes(one.payload) for one in batch], known)
            for one in batch:
                inbox.acknowledge(client, connection, one)
    client.disconnect()
    client.loop_stop()


def part_of(text: str) -> tuple[int, int]:
    """The part that is this consumer's, and how many there are."""
    part, count = map(int, text.split("/"))
    if not 1 <= part <= count:
        raise ValueError
    return part, count


class Inbox:
    """Messages that wait to be written: those of the buses of a part.

    What has not been acknowledged when a connection ends comes again in the next one, where its
    number may be that of another message: then it is neither kept nor acknowledged.
    """

    def __init__(self, part: tuple[int, int]) -> None:
        self._part = part
        self._lock = threading.Condition()
        self._connection = 0
        self._messages: list[paho.MQTTMessage] = []

    def begin(self) -> None:
        """A connection has been made."""
        with self._lock:
            self._connection += 1
            self._messages.clear()

    def put(self, client: paho.Client, message: paho.MQTTMessage) -> None:
        """A message has come; one of another part is acknowledged, and that is all."""
        part, count = self._part
        if zlib.crc32(message.topic.encode()) % count != part - 1:
            client.ack(message.mid, message.qos)
            return
        with self._lock:
            self._messages.append(message)
            if len(self._messages) >= ROWS:
                self._lock.notify()

    def take(self, seconds: float) -> tuple[int, list[paho.MQTTMessage]]:
        """What comes within so many seconds, or as many as make a file; and of which connection."""
        with self._lock:
            self._lock.wait_for(lambda: len(self._messages) >= ROWS, seconds)
            found, self._messages = self._messages[:ROWS], self._messages[ROWS:]
            return self._connection, found

    def acknowledge(self, client: paho.Client, connection: int, one: paho.MQTTMessage) -> None:
        """Tell the broker that it may forget a message."""
        with self._lock:
            if connection == self._connection:
                client.ack(one.mid, one.qos)


def connect(broker: str, name: str, topic: str, inbox: Inbox) -> paho.Client:
    """A client whose session the broker keeps, and that acknowledges by hand."""
    client = paho.Client(
        CallbackAPIVersion.VERSION2, f"parquet-{name}", protocol=paho.MQTTv5, manual_ack=True
    )
    kept = Properties(PacketTypes.CONNECT)  # type: ignore[no-untyped-call]
    kept.SessionExpiryInterval = AWAY_S
    kept.ReceiveMaximum = 2 * ROWS

    def subscribe(client: paho.Client, *_: Any) -> None:
        inbox.begin()
        client.subscribe(topic, qos=1)

    def tell(client: paho.Client, data: Any, number: int, reasons: list[Any], *_: Any) -> None:
        sys.stderr.write(f"{name}: {topic}: {', '.join(map(str, reasons))}\n")

    client.on_connect = subscribe
    client.on_subscribe = tell
    client.on_message = lambda client, data, message: inbox.put(client, message)
    client.reconnect_delay_set(1, 30)
    host, _, port = broker.partition(":")
    client.connect_async(host, int(port or 1883), clean_start=False, properties=kept)
    client.loop_start()
    return client


def write(folder: Path, name: str, payloads: list[bytes], known: set[Key]) -> set[Key]:
    """Write a file of these transactions, but those that are known; gives what is known then."""
    rows = {key_of(row): row for payload in payloads if (row := row_of(payload)) is not None}
    new = {key: row for key, row in rows.items() if key not in known}
    if new:
        path = folder / f"{name}-{time.time_ns():020d}.parquet"
        aside = path.with_suffix(".unfinished")
        pq.write_table(table_of(list(new.values())), aside, compression="zstd")
        sync(aside)
        aside.rename(path)
        sync(folder)
        return set(new)
    return known


def sync(path: Path) -> None:
    """Wait until a file, or the names in a folder, are on the disk."""
    file = os.open(path, os.O_RDONLY)
    try:
        os.fsync(file)
    finally:
        os.close(file)


def row_of(payload: bytes) -> dict[str, Any] | None:
    """A message as a row: times as nanoseconds, what JSON nests as JSON text.

    None for one that no tap has sent, which is reported: it must not come again and again.
    """
    try:
        row: dict[str, Any] = json.loads(payload)
        if "time" in row:
            time_ns = pa.array([row["time"]]).cast(pa.timestamp("ns", "UTC")).cast(pa.int64())
            row["time"] = time_ns[0].as_py()
        for column in ("fields", "readings"):
            if column in row:
                row[column] = json.dumps(row[column])
        key_of(row)
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        sys.stderr.write(f"left out, no transaction: {payload[:80]!r} ({error!r})\n")
        return None
    return row


def table_of(rows: list[dict[str, Any]]) -> pa.Table:
    """The rows as a table; those whose values do not fit are reported and left out."""
    try:
        return pa.Table.from_pylist(rows, SCHEMA)
    except (ValueError, TypeError) as error:
        if len(rows) == 1:
            sys.stderr.write(f"left out, no transaction: {rows[0]} ({error})\n")
            return SCHEMA.empty_table()
        middle = len(rows) // 2
        return pa.concat_tables([table_of(rows[:middle]), table_of(rows[middle:])])


def key_of(row: dict[str, Any]) -> Key:
    """What distinguishes transactions: numbers restart with each run of a tap."""
    return row["bus"], row["txn"], row.get("time")


def newest_keys(folder: Path, name: str) -> set[Key]:
    """The transactions in the newest file of this consumer, which may come again."""
    files = sorted(folder.glob(f"{name}-{'[0-9]' * 20}.parquet"))
    if not files:
        return set()
    table = pq.read_table(files[-1], columns=["bus", "txn", "time"])
    times = table["time"].cast(pa.int64()).to_pylist()
    return set(zip(table["bus"].to_pylist(), table["txn"].to_pylist(), times, strict=True))


if __name__ == "__main__":
    main()
