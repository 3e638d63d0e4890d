"""Events of troubles: to files, topics, commands and addresses; a real line over a pty."""

from __future__ import annotations

import http.server
import json
import os
import pty
import signal
import subprocess
import sys
import termios
import threading
import time
import tty
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

if sys.platform != "linux":
    pytest.skip("the line is one of Linux' ptys", allow_module_level=True)

from analyzer import SourceError, UsageError
from analyzer.feeds.notify import Notifier
from analyzer.feeds.spool import Message
from analyzer.feeds.troubles import EventFile, TroubleTopics
from tests.conftest import ROOT, command, environment
from tests.doctor.frames import read_request, rtu

SCHEMA = json.loads((ROOT / "docs" / "events.schema.json").read_text("utf-8"))


def event(number: int = 1, what: str = "begin", unit: int | None = 3) -> dict[str, Any]:
    return {
        "time": "2026-11-21T10:00:00.000000Z",
        "event": what,
        "number": number,
        "bus": "boiler",
        "unit": unit,
        "code": "device_absent",
        "severity": "error",
        "since": "2026-11-21T09:59:00.000000Z",
        "sentence": f"Sentence {number}.",
        "advice": "Look.",
        "text": f"trouble: Sentence {number}.",
    }


def states(messages: Iterator[Message]) -> dict[str, Any]:
    return {one.topic: json.loads(one.payload) for one in messages if one.retain}


def test_topics_say_whether_a_bus_and_a_unit_have_a_problem() -> None:
    """Retained; a bus has a problem as long as any of its units has one."""
    topics = TroubleTopics("plant")
    assert states(topics.meet("boiler", 3))["plant/boiler/3/_problem"]["problem"] == 0
    assert not list(topics.meet("boiler", 3))
    begun = states(topics.event(event()))
    assert begun["plant/boiler/trouble"]["sentence"] == "Sentence 1."
    assert begun["plant/boiler/3/_problem"]["problem"] == 1
    states(topics.event(event(2, unit=None)))
    over = states(topics.event(event(1, "end")))
    assert over["plant/boiler/3/_problem"]["problem"] == 0
    assert over["plant/boiler/trouble"]["sentence"] == "Sentence 2."
    assert states(topics.event(event(2, "end", None)))["plant/boiler/trouble"]["problem"] == 0


def test_a_command_gets_the_event(tmp_path: Path) -> None:
    """As JSON on standard input; its line in the environment."""
    said: list[str] = []
    out = tmp_path / "out"
    notifier = Notifier(f"sh -c 'cat > {out}; echo \"$MODLENS_TEXT\" >> {out}'", said.append)
    notifier(event())
    notifier.close()
    document, text = out.read_text("utf-8").split("}", 1)
    assert json.loads(document + "}") == event()
    assert (text.strip(), said) == ("trouble: Sentence 1.", [])


def test_an_address_gets_a_post_that_is_tried_again() -> None:
    """A server that fails once."""
    got: list[tuple[str | None, Any]] = []

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers["Content-Length"]))
            got.append((self.headers["Content-Type"], json.loads(body)))
            self.send_response(503 if len(got) == 1 else 204)
            self.end_headers()

        def log_message(self, *_words: object) -> None: ...

    with http.server.HTTPServer(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        said: list[str] = []
        notifier = Notifier(f"http://127.0.0.1:{server.server_port}/x", said.append, pause_s=0.01)
        notifier(event())
        deadline = time.monotonic() + 10
        while len(got) < 2 and time.monotonic() < deadline:
            time.sleep(0.01)
        notifier.close()
        server.shutdown()
    assert got == [("application/json", event())] * 2
    assert said == []


def test_what_cannot_be_delivered_is_reported() -> None:
    """With what is lost."""
    said: list[str] = []
    notifier = Notifier("false", said.append, pause_s=0.01)
    notifier(event())
    notifier.close()
    assert said == ["--notify false: exit status 1; lost: trouble: Sentence 1."]
    for wrong in ("no-such-program x", "ftp://host", "'"):
        with pytest.raises(UsageError, match="--notify"):
            Notifier(wrong, said.append)


def test_a_file_of_events_is_not_overwritten(tmp_path: Path) -> None:
    """As any file of a tap."""
    file = EventFile(str(tmp_path / "e.jsonl"))
    file(event())
    file.close()
    assert json.loads((tmp_path / "e.jsonl").read_text("utf-8")) == event()
    with pytest.raises(SourceError, match="exists"):
        EventFile(str(tmp_path / "e.jsonl"))


def exchanges(line: int, seconds: float, silent: int | None) -> None:
    """Three units, asked in turn every 60 ms; one of them may be silent."""
    end = time.monotonic() + seconds
    number = 0
    while time.monotonic() < end:
        number += 1
        unit = number % 3 + 1
        os.write(line, rtu(unit, read_request(3, 0, 2)))
        time.sleep(0.02)
        if unit != silent:
            os.write(line, rtu(unit, bytes([3, 4, 0, number % 200, 1, 2])))
        time.sleep(0.04 if unit != silent else 0.15)


@pytest.mark.skipif(
    os.environ.get("MODLENS_CI") != "1",
    reason="two minutes at real speed: MODLENS_CI=1",
)
def test_a_unit_that_is_off_is_an_event_within_a_minute_and_its_end_as_well(
    tmp_path: Path,
) -> None:
    """At real speed: 25 s healthy, 35 s off, then healthy until the end is reported."""
    jsonschema = pytest.importorskip("jsonschema")
    far, near = pty.openpty()
    tty.setraw(near)
    settings = termios.tcgetattr(near)
    settings[4] = settings[5] = termios.B19200
    termios.tcsetattr(near, termios.TCSANOW, settings)
    events = tmp_path / "events.jsonl"
    notified = tmp_path / "notified"
    words = ["--line", "19200-8N1", "-o", f"events:{events}", "--doctor"]
    running = subprocess.Popen(
        command("tap", os.ttyname(near), *words, "--notify", f"tee -a {notified}"),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        env=environment(),
        cwd=ROOT,
        text=True,
    )
    try:
        assert running.stderr is not None
        assert "listening" in running.stderr.readline()
        exchanges(far, 25, None)
        went_off = time.time()
        exchanges(far, 35, 2)
        came_back = time.time()
        deadline = time.monotonic() + 100
        while events.read_text("utf-8").count('"end"') < 1 and time.monotonic() < deadline:
            exchanges(far, 2, None)
    finally:
        running.send_signal(signal.SIGINT)
        _, said = running.communicate(timeout=60)
        os.close(far)
        os.close(near)
    found = [json.loads(one) for one in events.read_text("utf-8").splitlines()]
    assert [(one["event"], one["unit"]) for one in found] == [("begin", 2), ("end", 2)], found
    for one in found:
        jsonschema.validate(one, SCHEMA)
    from datetime import datetime  # noqa: PLC0415

    begin, end = (datetime.fromisoformat(one["time"]).timestamp() for one in found)
    assert went_off < begin < went_off + 60
    assert came_back < end < came_back + 100
    assert "trouble: Unit 2" in said
    assert "over after 3" in said
    assert notified.read_text("utf-8").count('"event"') == 2
