"""`modlens doctor --follow`: events of a network capture while it grows."""

from __future__ import annotations

import json
import subprocess
import time
from pathlib import Path
from random import Random

from tests.conftest import Modlens, command, environment
from tests.doctor.tcp_model import CLIENTS, SERVER, Site

PIECES, PAUSE_S = 60, 0.15
FROM_S, TO_S, END_S = 40.0, 100.0, 220.0


def capture() -> bytes:
    """A client that is served, and another one that is refused for a minute while it is."""
    site = Site(Random(1))
    owner = site.client(0)
    owner.run_until(END_S)
    at_s = FROM_S
    while at_s < TO_S:
        site.network.flow(CLIENTS[1], SERVER).refused(at_s)
        at_s += 2.0
    return site.network.pcap()


def followed(data: bytes, *words: str) -> str:
    """What the command prints while it gets the capture part by part."""
    with subprocess.Popen(
        command("doctor", "-", "--follow", *words),
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        env=environment(),
    ) as doctor:
        assert doctor.stdin is not None
        assert doctor.stderr is not None
        size, said = len(data) // PIECES + 1, ""
        for at in range(0, len(data), size):
            doctor.stdin.write(data[at : at + size])
            doctor.stdin.flush()
            # The first line names the format: from then on, what comes is read at once.
            said = said or doctor.stderr.readline().decode()
            time.sleep(PAUSE_S)
        doctor.stdin.close()
        return doctor.stderr.read().decode()


def test_a_connection_limit_is_reported_while_the_capture_grows(tmp_path: Path) -> None:
    """It begins within 40 s of the first refusal and ends after the last one."""
    said = followed(capture(), "-o", f"events:{tmp_path / 'events.jsonl'}")
    lines = (tmp_path / "events.jsonl").read_text("utf-8").splitlines()
    events = [json.loads(line) for line in lines]
    assert [(event["event"], event["code"]) for event in events] == [
        ("begin", "connection_limit"),
        ("end", "connection_limit"),
    ], events
    assert "trouble: The server takes no more connections" in said
    assert "over after" in said


def test_events_are_those_of_a_growing_capture(modlens: Modlens) -> None:
    """Without `--follow` there is nobody to notify."""
    done = modlens("doctor", "recording.pcap", "--notify", "true")
    assert done.status == 2
    assert "need --follow" in done.err
