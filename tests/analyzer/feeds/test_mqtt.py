"""Publishing to a real broker: Debian's mosquitto on loopback."""

from __future__ import annotations

import json
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Self

import pytest

pytest.importorskip("paho.mqtt.client")

from paho.mqtt import client as paho
from paho.mqtt.enums import CallbackAPIVersion

import _modlens
from analyzer import SourceError, UsageError
from analyzer.feeds.broker import Broker, parse_broker
from analyzer.feeds.mqtt import Mqtt
from analyzer.feeds.spool import Message, Spool
from tests.analyzer.cli.test_triggers import batches
from tests.conftest import need_program

PATIENCE_S = 15.0


def wait(until: Callable[[], bool], keep: Callable[[], object] = lambda: None) -> None:
    """For something to become true."""
    end = time.monotonic() + PATIENCE_S
    while not until():
        assert time.monotonic() < end
        keep()
        time.sleep(0.02)


class Mosquitto:
    """A broker on a free port of loopback that can be stopped and started again."""

    def __init__(self, folder: Path) -> None:
        """Choose the port."""
        with socket.create_server(("127.0.0.1", 0)) as server:
            self.port = int(server.getsockname()[1])
        self._config = folder / "mosquitto.conf"
        self._config.write_text(
            f"listener {self.port} 127.0.0.1\nallow_anonymous true\npersistence false\n"
        )
        self._program = need_program("mosquitto")
        self._running: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Until it listens."""
        self._running = subprocess.Popen(
            [self._program, "-c", str(self._config)],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        wait(self._listens)

    def stop(self) -> None:
        """At once."""
        if self._running is not None:
            self._running.kill()
            self._running.wait()
            self._running = None

    def _listens(self) -> bool:
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", self.port)) == 0


class Subscriber:
    """Everything that a broker sends; used by `with`."""

    def __init__(self, port: int) -> None:
        """Connect, and again whenever the broker comes back."""
        self.got: list[tuple[str, bytes, bool]] = []
        self._ready = threading.Event()
        self._client = paho.Client(
            CallbackAPIVersion.VERSION2, client_id="reader", clean_session=False
        )
        self._client.on_connect = lambda client, *_: client.subscribe("#", qos=1)
        self._client.on_subscribe = lambda *_: self._ready.set()
        self._client.on_message = self._on_message
        self._client.reconnect_delay_set(1, 1)
        self._client.connect_async("127.0.0.1", port)

    def publish(self, topic: str, payload: bytes) -> None:
        """As another program would."""
        self._client.publish(topic, payload, qos=1)

    def topic(self, topic: str) -> list[bytes]:
        """What came to a topic."""
        return [payload for name, payload, _ in list(self.got) if name == topic]

    def _on_message(self, client: object, data: object, message: Any) -> None:
        self.got.append((message.topic, bytes(message.payload), message.retain))

    def __enter__(self) -> Self:
        self._client.loop_start()
        assert self._ready.wait(PATIENCE_S)
        return self

    def __exit__(self, *error: object) -> None:
        self._client.disconnect()
        self._client.loop_stop()


@pytest.fixture
def mosquitto(tmp_path: Path) -> Iterator[Mosquitto]:
    """A broker that runs."""
    server = Mosquitto(tmp_path)
    server.start()
    yield server
    server.stop()


def here(server: Mosquitto) -> Broker:
    """Where it is."""
    return Broker("127.0.0.1", server.port, None, None, "plant")


def pass_through(feed: Mqtt, kinds: str) -> None:
    """Transactions, at a line's pace."""
    for batch in batches(kinds):
        feed.put(batch)
        time.sleep(0.002)


def settle(feed: Mqtt) -> None:
    """Until the broker has confirmed everything."""
    empty = _modlens.Session(_modlens.Functions()).take()
    wait(lambda: feed.waiting == 0, lambda: feed.put(empty))


def test_values_transactions_and_states_arrive(mosquitto: Mosquitto) -> None:
    """Each transaction once and in order, a value when it changes, the state and its end."""
    with Subscriber(mosquitto.port) as reader:
        feed = Mqtt(here(mosquitto))
        pass_through(feed, "..x.")
        settle(feed)
        wait(lambda: len(reader.topic("plant/bus/transaction")) == 4)
        feed.close()
        wait(lambda: reader.topic("plant/status") == [b"online", b"offline"])
        rows = [json.loads(line) for line in reader.topic("plant/bus/transaction")]
        assert [row["status"] for row in rows] == ["ok", "ok", "exception", "ok"]
        assert [row["txn"] for row in rows] == [1, 2, 3, 4]
        assert reader.topic("plant/bus/1/hr0") == [b"7"]
    with Subscriber(mosquitto.port) as late:
        wait(lambda: late.topic("plant/bus/1/hr0") == [b"7"])
        assert not late.topic("plant/bus/transaction")


def test_the_last_will_speaks_when_the_tap_cannot(mosquitto: Mosquitto) -> None:
    """If the connection breaks, the broker publishes the last will."""
    with Subscriber(mosquitto.port) as reader:
        feed = Mqtt(here(mosquitto))
        wait(lambda: reader.topic("plant/status") == [b"online"])
        feed._client.socket().shutdown(socket.SHUT_RDWR)
        wait(lambda: b"offline" in reader.topic("plant/status"))
        feed.close()


def test_home_assistant_is_announced_again_after_a_restart(mosquitto: Mosquitto) -> None:
    """A sensor for each value, no commands; all of them again when it restarts."""
    topic = "homeassistant/sensor/plant_bus_1/hr0/config"
    with Subscriber(mosquitto.port) as reader:
        feed = Mqtt(here(mosquitto), discovery=True)
        pass_through(feed, "..")
        settle(feed)
        wait(lambda: len(reader.topic(topic)) == 1)
        about = json.loads(reader.topic(topic)[0])
        assert about["state_topic"] == "plant/bus/1/hr0"
        assert about["availability_topic"] == "plant/status"
        assert not any("command" in key for key in about)
        reader.publish("homeassistant/status", b"online")
        wait(lambda: len(reader.topic(topic)) == 2, lambda: pass_through(feed, "."))
        feed.close()


def test_a_broker_that_restarts_under_load_gets_everything(
    mosquitto: Mosquitto, tmp_path: Path
) -> None:
    """What was decided while it was away waits, and arrives in order when it is back."""
    spool = str(tmp_path / "spool.sqlite")
    with Subscriber(mosquitto.port) as reader:
        feed = Mqtt(here(mosquitto), spool=spool)
        pass_through(feed, "." * 50)
        settle(feed)
        wait(lambda: len(reader.topic("plant/bus/transaction")) == 50)
    mosquitto.stop()
    pass_through(feed, "x" * 300)
    assert feed.waiting >= 300
    mosquitto.start()
    with Subscriber(mosquitto.port) as reader:
        settle(feed)
        wait(lambda: len(reader.topic("plant/bus/transaction")) >= 300)
        numbers = [json.loads(line)["txn"] for line in reader.topic("plant/bus/transaction")]
        assert set(numbers) == set(range(1, 301))
    feed.close()


def test_what_was_not_sent_is_sent_by_the_next_tap(mosquitto: Mosquitto, tmp_path: Path) -> None:
    """Messages in the spool's file are sent by the next tap."""
    spool = str(tmp_path / "spool.sqlite")
    mosquitto.stop()
    feed = Mqtt(here(mosquitto), spool=spool)
    pass_through(feed, "...")
    feed.close()
    mosquitto.start()
    with Subscriber(mosquitto.port) as reader:
        later = Mqtt(here(mosquitto), spool=spool)
        settle(later)
        wait(lambda: len(reader.topic("plant/bus/transaction")) == 3)
        later.close()


def test_a_spool_is_bounded_and_counts() -> None:
    """A full spool drops its oldest messages, and counts them."""
    spool = Spool(None, limit=3)
    for number in range(5):
        spool.add(Message(str(number), b""))
    assert (len(spool), spool.dropped) == (3, 2)
    assert [one.topic for _, one in spool.waiting(9)] == ["2", "3", "4"]
    assert spool.waiting(9) == []


def test_wrong_words(tmp_path: Path) -> None:
    """A URL of another kind; a spool that cannot be."""
    with pytest.raises(UsageError, match="write mqtt://host"):
        parse_broker("http://host")
    with pytest.raises(UsageError):
        parse_broker("mqtt://host:port")
    with pytest.raises(SourceError, match="spool"):
        Spool(str(tmp_path / "none" / "spool"))
