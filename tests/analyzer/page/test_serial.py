"""Listening to a port of the computer, by Web Serial."""

from __future__ import annotations

import base64
import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import pytest

from analyzer.line import Line
from analyzer.page import CORE
from tests.conftest import Modlens, without
from tests.support.browser import Browser
from tests.support.firefox import Firefox, running
from tests.support.page import SAVED, STATE
from tests.support.settings_search import BAUDS
from tests.support.uart import Uart, Wire

REQUEST = "010300000001840a"
RESPONSE = "0103020007f986"
"""Application Protocol V1.1b3, 6.3: register 0 is 7."""
RECORDING = (
    "new Blob(Live.pieces).arrayBuffer().then((it) =>"
    " btoa(Array.from(new Uint8Array(it), (one) => String.fromCharCode(one)).join('')))"
)
STATE_TEXT = "return document.getElementById('state').textContent"

FAKE = """
// A port that gives `steps`: [ms to wait, hex, or the name of an error]; where they are an object,
// those of the settings, again and again. Writing to it is an error of the page.
class FakePort {
  constructor(steps) {
    Object.assign(this, { known: steps, steps, calls: [], at: 0, given: 0 });
    Object.assign(this, { readable: null, isOpen: false });
  }
  get writable() { this.calls.push('writable'); throw new Error('the page writes'); }
  async open(settings) {
    const { baudRate, dataBits, parity } = settings;
    this.calls.push(['open', settings]);
    this.isOpen = true;
    if (!Array.isArray(this.known)) this.steps = this.known[`${baudRate}-${dataBits}-${parity}`];
    this.renew();
  }
  async close() { this.calls.push('close'); this.isOpen = false; this.readable = null; }
  async setSignals(signals) { this.calls.push(['setSignals', signals]); }
  async next() {
    while (this.at >= this.steps.length) {
      if (this.steps.length && !Array.isArray(this.known)) this.at = 0;
      else await new Promise((resume) => setTimeout(resume, 20));
    }
    const [wait, what] = this.steps[this.at++];
    await new Promise((resume) => setTimeout(resume, wait));
    return what;
  }
  renew() {
    const pull = async (controller) => {
      const what = await this.next();
      if (/Error$/.test(what)) {
        if (what === 'NetworkError') this.readable = null;
        else this.renew();
        controller.error(new DOMException('', what));
      } else controller.enqueue(Uint8Array.from(what.match(/../g), (one) => parseInt(one, 16)));
      this.given += 1;
    };
    const cancel = () => { if (this.isOpen) this.renew(); };
    this.readable = new ReadableStream({ pull, cancel }, { highWaterMark: 0 });
  }
}
window.port = new FakePort(arguments[0]);
navigator.serial.requestPort = async () => window.port;
document.getElementById('serial-line').value = arguments[1];
document.getElementById('listen').click();
"""
Steps = Sequence[tuple[int, str]]


class Window(Protocol):
    """What both browsers do alike."""

    def run(self, script: str, *arguments: Any) -> Any:
        """What a script of the page returns."""

    def ask(self, promise: str, *arguments: Any) -> Any:
        """What a promise of the page is fulfilled with."""

    def wait(self, condition: str, seconds: float = ...) -> None:
        """Wait until an expression is true."""


@pytest.fixture(autouse=True)
def _core() -> None:
    if not CORE.exists():
        without("the compiled core of the page (make page)")


def begin(browser: Browser, steps: Steps | Mapping[str, Steps], line: str) -> None:
    """Let the page listen to a port that gives these reads."""
    browser.run(FAKE, steps, line)
    browser.wait("window.port.calls.length > 0")


def end(window: Window) -> None:
    window.run("document.getElementById('stop').click()")
    window.wait(f"{STATE} === 'ended'")


def exchanges(count: int) -> list[tuple[int, str]]:
    return [step for _ in range(count) for step in ((30, REQUEST), (10, RESPONSE))]


def cells(text: str) -> list[Mapping[str, str]]:
    """The rows without the name of the recording."""
    return [row | {"source": ""} for row in csv.DictReader(io.StringIO(text))]


def assert_rows_of_tap(window: Window, folder: Path, modlens: Modlens) -> list[Mapping[str, str]]:
    """The rows of the page are those that the command has of the recording that it saves."""
    raw = folder / "line.pcapng"
    raw.write_bytes(base64.b64decode(window.ask(RECORDING)))
    rows = []
    for table in ("findings", "frames", "transactions"):
        rows = cells(window.ask(SAVED, table))
        replayed = modlens("decode", raw, "--replay", "--table", table, "--to", "csv").out
        assert rows == cells(replayed), table
    return rows


def test_what_is_read_is_decoded_and_nothing_is_written(
    opened: Browser, tmp_path: Path, modlens: Modlens
) -> None:
    begin(opened, exchanges(20), "9600-8E1")
    opened.wait("window.port.given === 40")
    opened.wait(f"{STATE} === 'live'")
    end(opened)
    rows = assert_rows_of_tap(opened, tmp_path, modlens)
    assert [(row["data"], row["status"]) for row in rows] == [("7", "ok")] * 20
    calls = opened.run("return window.port.calls")
    settings = {"baudRate": 9600, "dataBits": 8, "parity": "even", "stopBits": 1}
    assert calls[0] == ["open", settings | {"bufferSize": 1 << 20}]
    signals = {"dataTerminalReady": False, "requestToSend": False}
    assert calls[1:] == [["setSignals", signals], "close"]


@pytest.mark.parametrize(
    "error", ["BufferOverrunError", "BreakError", "FramingError", "ParityError"]
)
def test_an_error_is_a_mark_and_listening_goes_on(
    error: str, opened: Browser, tmp_path: Path, modlens: Modlens
) -> None:
    """The browser has taken bytes of the second answer out, and names the error after the rest."""
    steps = [*exchanges(1), (30, REQUEST), (10, RESPONSE[:8]), (1, error), *exchanges(3)]
    begin(opened, steps, "19200-8N1")
    opened.wait(f"window.port.given === {len(steps)}")
    opened.wait(f"{STATE} === 'live'")
    assert f"1 {error}" in opened.run(STATE_TEXT)
    end(opened)
    rows = assert_rows_of_tap(opened, tmp_path, modlens)
    assert [row["status"] for row in rows].count("ok") == 4
    assert len(rows) == 5


def received(line: Line, at: Line) -> list[tuple[int, str]]:
    """What a browser reads of 40 exchanges on a line; it takes out what the receiver has marked."""
    wire, now = Wire(line), 0.0
    for frame in (REQUEST, RESPONSE) * 40:
        now = wire.send(bytes.fromhex(frame), now) + 0.02
    reads: list[tuple[int, str]] = []
    last = 0.0
    for one in Uart(at).receive(wire, 0.0):
        if one.error:
            continue
        if reads and one.time_s - last < 0.01:
            reads[-1] = (20, reads[-1][1] + f"{one.byte:02x}")
        else:
            reads.append((20, f"{one.byte:02x}"))
        last = one.time_s
    return reads


@pytest.mark.parametrize("line", [Line(19200, 8, "E", 1), Line(9600, 8, "N", 1)])
def test_the_settings_are_found(
    line: Line, opened: Browser, tmp_path: Path, modlens: Modlens
) -> None:
    """Through a receiver's model at every rate; the slower line gives no byte at the first one."""
    parities = {"N": "none", "E": "even", "O": "odd"}
    tried = [
        Line(baud, data, parity, 1)
        for baud in BAUDS
        for data, parity in ((8, "E"), (8, "N"), (7, "N"), (8, "O"))
    ]
    table = {
        f"{one.baud}-{one.data_bits}-{parities[one.parity]}": received(line, one) for one in tried
    }
    begin(opened, table, "")
    opened.wait("document.getElementById('serial-said').textContent.startsWith('found')", 30)
    opened.wait(f"{STATE} === 'live'")
    heard = opened.run("return window.port.given")
    opened.wait(f"window.port.given > {heard + 8}")
    end(opened)
    rows = assert_rows_of_tap(opened, tmp_path, modlens)
    # The first answer may have a request that was not heard, the last request an end instead.
    assert {row["status"] for row in rows[1:-1]} == {"ok"}
    opens = [one[1] for one in opened.run("return window.port.calls") if one[0] == "open"]
    assert opens[0]["baudRate"] == 115200
    assert (opens[-1]["baudRate"], opens[-1]["parity"]) == (line.baud, parities[line.parity])


def test_a_port_that_goes_away_ends_the_recording(opened: Browser) -> None:
    begin(opened, [*exchanges(3), (5, "NetworkError")], "9600-8E1")
    opened.wait(f"{STATE} === 'ended'")
    assert "the port is gone" in opened.run(STATE_TEXT)


def test_settings_that_no_browser_has_are_refused(opened: Browser) -> None:
    opened.run(FAKE, [], "9600-8M1")
    opened.wait(f"{STATE} === 'ended' || {STATE} === 'refused'")
    assert opened.run("return window.port.calls") == []
    assert "9600-8M1" in opened.run("return document.body.innerText")


@pytest.fixture(scope="module")
def firefox(tmp_path_factory: pytest.TempPathFactory, written: Path) -> Iterator[Firefox]:
    folder = tmp_path_factory.mktemp("firefox")
    with running(
        folder, {"dom.webserial.enabled": True, "dom.webserial.testing.enabled": True}
    ) as found:
        found.open(written, "ready")
        yield found


WRITTEN = """
(async () => {
  const [port] = await navigator.serial.getPorts();
  const writer = port.writable.getWriter();
  const bytes = Uint8Array.from(arguments[0].match(/../g), (one) => parseInt(one, 16));
  for (let at = 0; at < bytes.length; at += 61) {
    await writer.write(bytes.slice(at, at + 61));
    await new Promise((resume) => setTimeout(resume, 30));
  }
  writer.releaseLock();
})()
"""


def test_firefox_reads_its_own_double_of_a_port(
    firefox: Firefox, tmp_path: Path, modlens: Modlens
) -> None:
    """Bytes in blocks of 61 through the browser's own stream of a port."""
    if not firefox.run("return 'serial' in navigator"):
        without("a Firefox with Web Serial (151 and later)")
    assert "settings cannot be searched" in firefox.run("return document.body.innerText")
    firefox.run("document.getElementById('serial-line').value = '115200-8N1'")
    firefox.click("#listen")
    firefox.wait("document.getElementById('state').textContent.startsWith('Listening at')")
    firefox.ask(WRITTEN, (REQUEST + RESPONSE) * 100)
    firefox.wait(f"{STATE} === 'live'")
    end(firefox)
    rows = assert_rows_of_tap(firefox, tmp_path, modlens)
    assert [row["status"] for row in rows] == ["ok"] * 100
