"""`modlens tap --web`: the page shows the line while the tap listens."""

from __future__ import annotations

import csv
import http.client
import io
import os
import re
import socket
import sys
import time
from pathlib import Path
from urllib.parse import urlsplit

import pytest

if sys.platform != "linux":
    pytest.skip("the line is one of Linux' ptys", allow_module_level=True)

import _modlens
import modlens as api
from analyzer.page import CORE
from tests.conftest import Modlens, without
from tests.support.browser import Browser
from tests.support.page import STATE, saved
from tests.support.tapped_line import TappedLine

ROWS = "Page.ask({ call: 'rows', table: 'transactions', columns: [], from: 0, count: 0 })"
UNANSWERED = bytes.fromhex("0203000000018439")


@pytest.fixture(autouse=True)
def _core() -> None:
    if not CORE.exists():
        without("the compiled core of the page (make page)")


def url_of(line: TappedLine) -> str:
    """What the tap says to open."""
    line.wait_for(" in a browser")
    found = re.search(r"open (http://\S+) in a browser", line.saying())
    assert found is not None
    return found[1]


def cells(text: str) -> list[dict[str, str]]:
    """The rows without the name of the recording, which the page does not know."""
    return [row | {"source": ""} for row in csv.DictReader(io.StringIO(text))]


def test_the_page_has_the_rows_of_a_replay(
    browser: Browser, tmp_path: Path, modlens: Modlens
) -> None:
    """Row by row, times and findings included, of a line with a unit that does not answer."""
    raw = tmp_path / "raw.pcapng"
    with TappedLine("--web", "127.0.0.1:0", "--record", raw) as line:
        line.start()
        browser.open(url_of(line), None)
        browser.wait(f"{STATE} === 'waiting'")
        line.wait_for("serving 127.0.0.1:")
        line.send(1.5, pairs=3, pause_s=0.03)
        os.write(line.far, UNANSWERED)
        time.sleep(1.5)
        line.send(1.5, pairs=1, pause_s=0.03)
        browser.wait(f"{STATE} === 'live'")
        browser.wait("document.getElementById('shown').textContent !== '0 rows'")
        assert browser.ask(ROWS)["total"] > 50
        line.end()
    browser.wait(f"{STATE} === 'ended'")
    for table in ("transactions", "frames", "findings"):
        replayed = modlens("decode", raw, "--replay", "--table", table, "--to", "csv").out
        assert cells(saved(browser, table)) == cells(replayed)


def test_a_slow_page_costs_the_tap_nothing(tmp_path: Path) -> None:
    """A browser that takes nothing misses bytes; the recording misses none."""
    raw = tmp_path / "raw.pcapng"
    with TappedLine("--web", "127.0.0.1:0", "--record", raw) as line:
        line.start()
        url = urlsplit(url_of(line))
        stalled = socket.create_connection((str(url.hostname), int(url.port or 0)))
        stalled.sendall(b"GET /recording.pcapng HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        line.wait_for("serving 127.0.0.1:")
        line.send(2.0)
        line.end()
        stalled.close()
    found = api.decode(raw).transactions
    assert len(found) == len(line.sent) // 15
    assert {row.status for row in found} == {"ok"}


def test_only_reading_and_only_for_this_computer() -> None:
    with TappedLine("--web", "127.0.0.1:0") as line:
        line.start()
        port = int(urlsplit(url_of(line)).port or 0)

        def status(method: str, path: str, host: str) -> int:
            client = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
            client.request(method, path, headers={"Host": host})
            found = client.getresponse().status
            client.close()
            return found

        assert status("GET", "/", "localhost") == 200
        assert status("GET", "/", "evil.example") == 401
        assert status("POST", "/", "localhost") == 405
        assert status("GET", "/etc/passwd", "localhost") == 404
        line.end()


def test_other_computers_need_the_token() -> None:
    """It is in the address to open, and in no other place."""
    server = _modlens.Server("0.0.0.0:0", page=b"<p>page</p>")
    try:
        url = urlsplit(server.url)
        token = url.query.partition("token=")[2]
        assert len(token) >= 32
        for path, expected in (("/", 401), (f"/?{url.query}", 200), ("/?token=x", 401)):
            client = http.client.HTTPConnection("127.0.0.1", int(url.port or 0), timeout=10)
            client.request("GET", path, headers={"Host": "gateway"})
            answer = client.getresponse()
            assert answer.status == expected
            assert (b"page" in answer.read()) == (expected == 200)
            client.close()
    finally:
        server.close()
