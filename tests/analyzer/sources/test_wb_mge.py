"""The sniffer of a WB-MGE v3, played by a WebSocket server that speaks as its firmware does."""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("websockets")

from websockets.datastructures import Headers
from websockets.http11 import Request, Response
from websockets.sync.server import ServerConnection, serve

from analyzer import PortError, UsageError, decode
from analyzer.live_run import LiveRun
from analyzer.settings import Settings
from analyzer.sources.wb_mge import PASSWORD, _Clock, open_port

REQUEST, RESPONSE = "010300000001840A", "0103020007F986"
MS = 1_000_000
COUNT = 4


class Gateway:
    """Sends exchanges to whoever has logged in and started a port; keeps what it was sent."""

    def __init__(self) -> None:
        self.commands: list[Any] = []
        self._server = serve(self._serve, "127.0.0.1", 0, process_request=self._process)
        self.port = self._server.socket.getsockname()[1]
        self._thread = threading.Thread(target=self._server.serve_forever)
        self._thread.start()

    def _process(self, _: ServerConnection, request: Request) -> Response | None:
        if request.path == "/sniffer/ws":
            return None
        return Response(404, "Not Found", Headers())

    def _serve(self, client: ServerConnection) -> None:
        assert client.request is not None
        if client.request.headers.get("Cookie") not in (None, "session=1"):
            return
        self.commands.append(json.loads(client.recv()))
        started_us = 7_451_250_113
        for number in range(COUNT):
            begin = started_us + number * 100_000
            for other in (1, 2):
                for offset, sender, raw in ((0, "master", REQUEST), (4_321, "slave", RESPONSE)):
                    message = {
                        "type": "packet",
                        "id": number,
                        "port": other,
                        "timestamp_us": begin + offset,
                        "sender": sender,
                        "slave_id": 1,
                        "function": 3,
                        "crc_valid": True,
                        "raw": raw,
                        "size": len(raw) // 2,
                    }
                    client.send(json.dumps(message))
            client.send(json.dumps({"type": "timeout", "id": 9, "port": 2}))
            client.send("no JSON")
            # Later than the times say, so that no later message comes faster than these.
            time.sleep(0.2)
        self.commands += map(json.loads, client)

    def close(self) -> None:
        """End the server."""
        self._server.shutdown()
        self._thread.join()


@pytest.fixture
def gateway() -> Iterator[Gateway]:
    one = Gateway()
    yield one
    one.close()


def test_frames_have_the_times_of_the_gateway_and_nothing_but_commands_is_sent(
    gateway: Gateway,
) -> None:
    """Of the port that was named; response times are those of the gateway, to the microsecond."""
    found: list[Any] = []
    with closing(LiveRun([f"wb-mge://127.0.0.1:{gateway.port}/2"], Settings())) as run:
        for turn, batch in enumerate(run.batches()):
            found += batch.transactions
            if len(found) == COUNT:
                break
            assert turn < 400
    assert [(row.unit, row.status, row.data) for row in found] == [(1, "ok", [7])] * COUNT
    # The response is sent with its request, so that the first ones only set the clock.
    assert found[-1].response_time_us == 4_321
    between = found[-1].time - found[-2].time
    assert between.total_seconds() == pytest.approx(0.1, abs=2e-6)
    end = time.monotonic() + 10
    while len(gateway.commands) < 2 and time.monotonic() < end:
        time.sleep(0.01)
    assert gateway.commands == [{"cmd": "start", "port": 2}, {"cmd": "stop", "port": 2}]


def test_times_follow_the_fastest_message_and_never_run_back() -> None:
    """The way through the network takes 3 to 50 ms, and their clock is faster by 100 ppm."""
    clock, last = _Clock(), 0
    for number in range(2_000):
        arrived = 10**18 + number * 100 * MS
        theirs = int((arrived - 10**18) * 1.0001)
        delay = (3 + number * 7 % 48) * MS
        mapped = clock.map(theirs, arrived + delay)
        assert last <= mapped <= arrived + delay
        assert abs(mapped - arrived - 3 * MS) < 8 * MS
        last = mapped


def test_the_gateway_guesses_who_sent_a_damaged_frame(tmp_path: Path) -> None:
    """Its word is not taken for it, neither in messages nor in the file of its page."""
    messages = tmp_path / "messages.jsonl"
    head = (
        '{"type":"packet","id":1,"port":1,"timestamp_us":%d,"sender":"%s","slave_id":1,"function":3'
    )
    lines = [
        (head + ',"crc_valid":%s,"raw":"%s","size":8}') % (number * 4_321, who, valid, raw)
        for number, (who, valid, raw) in enumerate(
            [
                ("master", "true", REQUEST),
                ("slave", "true", RESPONSE),
                ("slave", "false", REQUEST[:-1] + "B"),
                ("master", "true", REQUEST),
                ("slave", "true", RESPONSE),
            ]
        )
    ]
    messages.write_text("\n".join(lines))
    page = tmp_path / "wb-mge-sniffer-port1.csv"
    page.write_text(
        "#,Time,\u0394t,Sender,Slave,Function code,Payload (HEX),Bytes,CRC\n"
        f'1,12:30:05.250,\u2014,MASTER,0x01,"Read Holding Regs","{spaced(REQUEST)}",8,OK\n'
        f'2,12:30:05.254,+4 ms,SLAVE,0x01,"Read Holding Regs","{spaced(RESPONSE)}",7,OK\n'
        f'3,12:30:05.259,+4 ms,ERR,0x01,"Read Holding Regs","{spaced(REQUEST[:-1])}B",8,ERR\n'
        '4,12:30:05.459,+200 ms,TIMEOUT,0x01,"Read Holding Regs","",0,ERR\n'
        f'5,12:30:05.463,+4 ms,MASTER,0x01,"Read Holding Regs","{spaced(REQUEST)}",8,OK\n'
        f'6,12:30:05.467,+4 ms,SLAVE,0x01,"Read Holding Regs","{spaced(RESPONSE)}",7,OK\n'
    )
    for path in (messages, page):
        found = decode(path)
        assert [(row.status, row.data) for row in found.transactions][::2] == [("ok", [7])] * 2
        damaged = [row for row in found.frames if row.verdict == "bad_checksum"]
        assert [row.hex for row in damaged] == [bytes.fromhex(REQUEST[:-1] + "B")]
    assert decode(messages).transactions[0].response_time_us == 4_321


def spaced(digits: str) -> str:
    """Pairs of digits as the page prints them."""
    return " ".join(digits[at : at + 2] for at in range(0, len(digits), 2))


@pytest.mark.parametrize("name", ["wb-mge://gateway", "wb-mge://gateway/3", "wb-mge:///1"])
def test_a_port_of_the_gateway_is_needed(name: str) -> None:
    with pytest.raises(UsageError, match="1 or 2"):
        open_port(name, None)


def test_a_gateway_that_cannot_be_reached_or_refuses_is_explained(gateway: Gateway) -> None:
    with pytest.raises(PortError, match="cannot be reached"):
        open_port("wb-mge://127.0.0.1:9/1", None)
    with pytest.raises(PortError, match=f"cannot be reached|{PASSWORD}"):
        open_port(f"wb-mge://admin@127.0.0.1:{gateway.port}/1", None)
