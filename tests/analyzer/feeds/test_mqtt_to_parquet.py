"""The consumer of docs/examples: no transaction is lost while it, or the broker, is killed."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

import pyarrow.parquet as pq
import pytest

pytest.importorskip("paho.mqtt.client")

from paho.mqtt import client as paho
from paho.mqtt.enums import CallbackAPIVersion
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties

import _modlens
from analyzer.feeds.mqtt import Mqtt
from tests.analyzer.feeds import test_mqtt
from tests.analyzer.feeds.test_mqtt import Mosquitto, Subscriber, here, settle, wait
from tests.conftest import ROOT
from tests.support.fleet import Traffic

CONSUMER = ROOT / "docs/examples/mqtt_to_parquet.py"
BUSES, REQUESTS, PARTS = 2, 600, 6


class LastingMosquitto(Mosquitto):
    """A broker that keeps its sessions over a restart, as `docs/fleets.md` configures it."""

    def __init__(self, folder: Path) -> None:
        """With the page's settings."""
        super().__init__(folder)
        text = self._config.read_text().replace("persistence false", "persistence true")
        self._config.write_text(
            f"{text}persistence_location {folder}/\nautosave_interval 1\n"
            "max_queued_messages 0\nmax_inflight_messages 0\nuser root\n"
        )

    def restart(self) -> None:
        """As a service manager does it."""
        assert self._running is not None
        self._running.terminate()
        self._running.wait()
        self.start()


@pytest.fixture
def lasting(tmp_path: Path) -> Iterator[LastingMosquitto]:
    """A broker that runs."""
    server = LastingMosquitto(tmp_path)
    server.start()
    yield server
    server.stop()


class Consumer:
    """The example as a process."""

    def __init__(self, port: int, folder: Path, name: str, *words: str) -> None:
        """Start it."""
        command = [sys.executable, str(CONSUMER), f"127.0.0.1:{port}", str(folder), name]
        self._command = [*command, "--seconds", "0.1", *words]
        self._told = folder.parent / f"{name}.txt"
        self.start()

    def start(self) -> None:
        """With a file every tenth of a second, so that many moments can be hit."""
        with self._told.open("wb") as told:
            self._running = subprocess.Popen(self._command, cwd=ROOT, stderr=told)

    def is_subscribed(self) -> bool:
        """Whether the broker knows it: it keeps nothing for strangers."""
        return "Granted QoS 1" in self._told.read_text()

    def end(self, number: int) -> None:
        """By a signal."""
        self._running.send_signal(number)
        self._running.wait(30)


def batches(bus: int) -> Iterator[_modlens.Batch]:
    """The traffic of a bus as a live tap decodes it, in parts."""
    core = _modlens.Session(_modlens.Functions(), live=True)
    number = core.add_bus(f"bus-{bus}", source=f"bus-{bus}", clock="utc")
    reads = list(Traffic(bus, 0, REQUESTS).reads())
    for part in range(PARTS):
        for now, data in _part(reads, part):
            core.feed(number, data, now)
        if part == PARTS - 1:
            core.flush()
        yield core.take()


def _part(reads: list[tuple[int, bytes]], part: int) -> list[tuple[int, bytes]]:
    size = len(reads) // PARTS + 1
    return reads[part * size : (part + 1) * size]


def keys(folder: Path) -> Counter[tuple[Any, ...]]:
    """Bus, number and time of the transactions in all files."""
    found: Counter[tuple[Any, ...]] = Counter()
    for path in folder.glob("*.parquet"):
        for row in pq.read_table(path).to_pylist():
            found[row["bus"], row["txn"], row["time"].value] += 1
    return found


def test_nothing_is_lost_when_consumers_that_share_are_killed(
    lasting: LastingMosquitto, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(test_mqtt, "PATIENCE_S", 60.0)  # clients wait before they connect again
    out = tmp_path / "out"
    shared = ("--topic", "$share/parquet/+/+/transaction")
    a, b = (Consumer(lasting.port, out, name, *shared) for name in ("a", "b"))

    def meanwhile(part: int) -> None:
        if part == 1:
            a.end(signal.SIGKILL)
        if part == 3:
            a.start()
            b.end(signal.SIGKILL)
        if part == 4:
            b.start()

    published(lasting, tmp_path, out, [a, b], meanwhile)
    assert len({path.name[0] for path in out.glob("*.parquet")}) == 2, "both had their share"


def test_nothing_is_lost_when_the_broker_is_restarted_while_a_consumer_is_away(
    lasting: LastingMosquitto, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each consumer has its part of the buses; the broker is restarted where nobody listens."""
    monkeypatch.setattr(test_mqtt, "PATIENCE_S", 60.0)
    out = tmp_path / "out"
    consumers = [
        Consumer(lasting.port, out, name, "--part", part)
        for name, part in (("a", "1/2"), ("b", "2/2"))
    ]
    a, b = consumers

    def meanwhile(part: int) -> None:
        if part == 0:
            a.end(signal.SIGKILL)
            b.end(signal.SIGKILL)
            lasting.restart()  # what comes now finds no consumer
        if part == 1:
            a.start()
        if part == 2:
            lasting.restart()
        if part == 3:
            b.start()

    published(lasting, tmp_path, out, consumers, meanwhile)
    parts = [
        {row["bus"] for path in out.glob(f"{name}-*.parquet") for row in _rows(path)}
        for name in "ab"
    ]
    assert sorted(map(sorted, parts)) == [["bus-0"], ["bus-1"]], "a part has whole buses"


def test_mosquitto_forgets_shared_subscriptions(lasting: LastingMosquitto) -> None:
    """What the page says; where this fails, the page is to be changed."""

    def client(name: str) -> Any:
        kept = Properties(PacketTypes.CONNECT)  # type: ignore[no-untyped-call]
        kept.SessionExpiryInterval = 600
        one = paho.Client(CallbackAPIVersion.VERSION2, name, protocol=paho.MQTTv5)
        one.connect("127.0.0.1", lasting.port, clean_start=False, properties=kept)
        one.loop_start()
        wait(one.is_connected)
        return one

    done: list[str] = []

    def publish() -> str:
        """What the broker says to a message."""
        done.clear()
        publisher = client("publisher")
        publisher.on_publish = lambda *said: done.append(str(said[3]))
        publisher.publish("plant/pumps/transaction", b"x", qos=1)
        wait(lambda: bool(done))
        publisher.disconnect()
        publisher.loop_stop()
        return done[0]

    for topic, afterwards in (
        ("$share/parquet/+/+/transaction", "No matching subscribers"),
        ("+/+/transaction", "Success"),
    ):
        subscriber = client("subscriber")
        subscriber.on_subscribe = lambda *said: done.append(str(said[3]))
        subscriber.subscribe(topic, qos=1)
        wait(lambda: bool(done))
        subscriber.disconnect()
        subscriber.loop_stop()
        assert publish() == "Success"
        lasting.restart()
        assert publish() == afterwards
        done.clear()


def test_what_no_tap_has_sent_is_left_out_and_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    consumer = load_consumer()
    good = b'{"bus":"pumps","txn":7,"time":"2026-11-20T00:00:00.000000001Z","unit":3}'
    bad = [b"off", b"[1]", b'{"bus":"pumps"}', b'{"bus":"pumps","txn":8,"unit":"three"}']
    consumer.write(tmp_path, "a", [*bad, good], set())
    [path] = tmp_path.glob("*.parquet")
    [row] = _rows(path)
    assert (row["bus"], row["txn"], row["unit"], row["time"].value % 10) == ("pumps", 7, 3, 1)
    assert capsys.readouterr().err.count("left out, no transaction: ") == len(bad)


def test_a_consumer_knows_its_own_files_from_those_of_another_with_a_longer_name(
    tmp_path: Path,
) -> None:
    consumer = load_consumer()
    for number, name in enumerate(("a", "a-2")):
        row = {"bus": "pumps", "txn": number}
        consumer.write(tmp_path, name, [json.dumps(row).encode()], set())
    assert consumer.newest_keys(tmp_path, "a") == {("pumps", 0, None)}


def load_consumer() -> ModuleType:
    """The example as a module."""
    spec = spec_from_file_location("mqtt_to_parquet", CONSUMER)
    assert spec is not None
    assert spec.loader is not None
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _rows(path: Path) -> list[dict[str, Any]]:
    rows: list[dict[str, Any]] = pq.ParquetFile(path).read().to_pylist()
    return rows


def published(
    broker: LastingMosquitto,
    folder: Path,
    out: Path,
    consumers: list[Consumer],
    meanwhile: Callable[[int], None],
) -> None:
    """Publish the traffic of two buses, and wait until all of it is in files."""
    wait(lambda: all(one.is_subscribed() for one in consumers))
    feed = Mqtt(here(broker), spool=str(folder / "spool"))
    expected: Counter[tuple[Any, ...]] = Counter()
    sources = [batches(bus) for bus in range(BUSES)]
    for part, parts in enumerate(zip(*sources, strict=True)):
        for batch in parts:
            for bus, txn, time_ns in batch.transactions.tuples(("bus", "txn", "time")):
                expected[bus, txn, _ns(str(time_ns))] += 1
            feed.put(batch)
        meanwhile(part)
    settle(feed)
    feed.close()
    assert expected.total() == BUSES * REQUESTS
    try:
        wait(lambda: keys(out).keys() >= expected.keys())
    finally:
        for one in consumers:
            one.end(signal.SIGTERM)
    found = keys(out)
    assert found.keys() == expected.keys()
    # A message may come twice, as MQTT allows at this quality of service; the page's query counts
    # it once. What one consumer gets again it leaves out.
    assert found.total() - expected.total() < REQUESTS


def _ns(text: str) -> int:
    import pyarrow as pa  # noqa: PLC0415

    stamp = pa.array([text]).cast(pa.timestamp("ns", "UTC"))
    return int(stamp.cast(pa.int64())[0].as_py())


def test_a_tap_leaves_the_row_of_its_day_with_the_broker(lasting: LastingMosquitto) -> None:
    """Retained: who subscribes later sees it; sent when it has changed."""
    feed = Mqtt(here(lasting), day_every_s=0.0)
    for batch in batches(1):
        feed.put(batch)
    settle(feed)
    feed.close()
    with Subscriber(lasting.port) as late:
        wait(lambda: bool(late.topic("plant/bus-1/day")))
        row = json.loads(late.topic("plant/bus-1/day")[0])
    assert row["verdict"] in {"trouble", "broken"}
    assert abs(row["failed_share"] - 1 / 17) < 0.005
