"""What people do to logs before they ask: encodings, prefixes, quotes, copies, mixtures."""

from __future__ import annotations

import codecs
import queue
import subprocess
import threading
from collections import deque
from collections.abc import Callable
from pathlib import Path

import pytest

import _modlens
from analyzer import decode
from analyzer.api import Decoding
from dissectors.errors import SourceError
from tests.conftest import Modlens, command, environment
from tests.support.logs import NOON, LogEntry, write

# The example of section 6.3 of the specification, with the checksums that go with unit 1.
ASK, ANSWER = bytes.fromhex("0103006b00037417"), bytes.fromhex("010306022b00000064057a")
EXCHANGE = [LogEntry(NOON, True, ASK), LogEntry(NOON + 20_000_000, False, ANSWER)]
WIRE = [ASK.hex(), ANSWER.hex()]
SPACED = [ASK.hex(" "), ANSWER.hex(" ")]
LOG = "2026-11-21 12:00:00.250 Tx: {}\n2026-11-21 12:00:00.270 Rx: {}\n".format(*SPACED)

Decode = Callable[..., list[str]]


@pytest.fixture(name="frames")
def _frames(tmp_path: Path) -> Decode:
    def frames(data: bytes | str, **options: object) -> list[str]:
        """The whole frames of a log, in hex; without checksum as well."""
        path = tmp_path / "bus.log"
        path.write_bytes(data if isinstance(data, bytes) else data.encode())
        rows = decode(path, **options).frames  # type: ignore[arg-type] # the options of decode
        return [row.hex.hex() for row in rows if row.verdict in ("ok", "no_checksum")]

    return frames


@pytest.mark.parametrize(
    ("encoding", "mark"),
    [
        ("utf-8", codecs.BOM_UTF8),
        ("utf-16-le", codecs.BOM_UTF16_LE),
        ("utf-16-be", codecs.BOM_UTF16_BE),
        ("utf-16-le", b""),
        ("gbk", b""),
        ("cp1251", b""),
    ],
)
def test_encodings(encoding: str, mark: bytes, frames: Decode) -> None:
    """PowerShell's, Windows' and those of Chinese and Russian terminals; CRLF is nothing odd."""
    chatter = {"gbk": "\u4e32\u53e3\u5df2\u6253\u5f00", "cp1251": "\u041f\u043e\u0440\u0442 COM3"}
    text = f"{chatter.get(encoding, 'port open')}\r\n" + LOG.replace("\n", "\r\n")
    assert frames(mark + text.encode(encoding)) == WIRE


def test_sscom_in_gbk(frames: Decode) -> None:
    """The dialect whose words are Chinese, in the encoding in which it is saved."""
    assert frames(write("sscom", EXCHANGE).encode("gbk")) == WIRE


PREFIXES = {
    "syslog": "Nov 21 12:00:0{} gateway meterd[812]: ",
    "rfc5424": "<13>1 2026-11-21T12:00:0{}.5Z gateway meterd 812 - - ",
    "journald": "Nov 21 12:00:0{} gateway meterd[812]: DEBUG:root:",
    "docker": "2026-11-21T12:00:0{}.123456789Z ",
    "docker-compose": "meter-1  | 2026-11-21 12:00:0{} ",
    "home-assistant": "2026-11-21 12:00:0{}.250 DEBUG (SyncWorker_4) [custom_components.meter] ",
    "colours": "\x1b[0;36m[12:00:0{}][D]\x1b[0m ",
    "mail": "> ",
    "mail-twice": "> > ",
}


@pytest.mark.parametrize("prefix", PREFIXES.values(), ids=PREFIXES)
@pytest.mark.parametrize("form", ["Tx: {}|Rx: {}", "send: {}|recv: {}", ">> {}|<< {}"])
def test_prefixes(prefix: str, form: str, frames: Decode) -> None:
    """Whatever a logger, a pager or a mailer puts in front."""
    lines = [
        prefix.format(number) + part.format(data)
        for number, (part, data) in enumerate(zip(form.split("|"), SPACED, strict=True))
    ]
    chatter = [f"{prefix.format(2)}connected", f"{prefix.format(3)}done"]
    assert frames("\n".join([chatter[0], *lines, chatter[1]]) + "\n") == WIRE


OTHER_DRESSES = {
    "markdown": "```\n{0}\n{1}\n```\n",
    "bold": "**{0}**\n\n**{1}**\n",
    "list": "* Tx: `{0}`\n* Rx: `{1}`\n",
    "one-line": "Tx: {0} Rx: {1}\n",
    "blanks": "{0}\n{1}\n".replace(" ", "\u00a0"),
    "nbsp": "Tx:\u00a0{0}\nRx:\u00a0{1}\n",
    "fullwidth": "\uff34\uff58\uff1a {0}\n\uff32\uff58\uff1a {1}\n",
    "no-line-end": "{0}\n{1}",
}


@pytest.mark.parametrize("dress", OTHER_DRESSES.values(), ids=OTHER_DRESSES)
def test_what_pasting_does(dress: str, frames: Decode) -> None:
    """Markdown, several records on a line, typographers' blanks and letters."""
    assert frames(dress.format(*SPACED)) == WIRE


@pytest.mark.parametrize("mark", ["-- --", "\u2013\u2013 \u2013\u2013", "xx xx", "CRC", "[CRC]"])
def test_placeholders_mean_no_checksum(mark: str, tmp_path: Path) -> None:
    """As manuals print them; the frame is whole all the same."""
    path = tmp_path / "manual.txt"
    path.write_text(f"Tx: {SPACED[0]}\nRx: {ANSWER[:-2].hex(' ')} {mark}\n", encoding="utf-8")
    rows = list(decode(path).frames)
    assert [(row.hex, row.verdict) for row in rows] == [(ASK, "ok"), (ANSWER[:-2], "no_checksum")]


@pytest.mark.parametrize("name", ["mbusd", "emodbus"])
def test_programs_that_print_no_checksum(name: str, tmp_path: Path) -> None:
    """Their rows say so, and requests and responses are found by layout."""
    path = tmp_path / "bus.log"
    bare = [LogEntry(one.ns, one.sent, one.data[:-2]) for one in EXCHANGE]
    path.write_text(write(name, bare), encoding="utf-8")
    (txn,) = decode(path)
    assert (txn.status, txn.data) == ("ok", [555, 0, 100])
    assert {row.verdict for row in decode(path).frames} == {"no_checksum"}


def test_solarman_frames_are_unwrapped(tmp_path: Path, modlens: Modlens) -> None:
    """And the wrapper is said to have been left out."""
    path = tmp_path / "solar.log"
    path.write_text(write("solarman", EXCHANGE), encoding="utf-8")
    done = modlens("decode", path, "--to", "jsonl", "--columns", "status,data")
    assert done.out.splitlines() == ['{"status":"ok","data":[555,0,100]}']
    assert "Solarman V5 wrapper" in done.err


def test_rtu_goes_out_and_mbap_comes_in(tmp_path: Path) -> None:
    """A program that asks in RTU and logs the gateway's TCP frame (mbmd does)."""
    path = tmp_path / "meter.log"
    answer = b"\x00\x35\x00\x00\x00\x09" + ANSWER[:-2]
    lines = [
        f"2026/11/21 12:00:0{n} modbus: sending {ASK.hex(' ')}\n"
        f"2026/11/21 12:00:0{n} modbus: received {answer.hex(' ')}\n"
        for n in range(3)
    ]
    path.write_text("".join(lines), encoding="utf-8")
    assert [(txn.status, txn.data) for txn in decode(path)] == [("ok", [555, 0, 100])] * 3
    assert [row.mode for row in decode(path).frames] == ["rtu", "tcp"] * 3


def test_devices_with_a_name_have_a_bus_each(tmp_path: Path) -> None:
    """Their lines come mixed; answers are those to the questions of the same device."""
    path = tmp_path / "two.log"
    other = bytes.fromhex("010306000100020003fd74")
    lines = [
        f"port /dev/ttyS1: Write: {SPACED[0]}",
        f"port /dev/ttyS2: Write: {SPACED[0]}",
        f"port /dev/ttyS1: ReadFrame: {SPACED[1]}",
        f"port /dev/ttyS2: ReadFrame: {other.hex(' ')}",
    ]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    found = {txn.bus.rpartition(":")[2]: txn.data for txn in decode(path)}
    assert found == {"/dev/ttyS1": [555, 0, 100], "/dev/ttyS2": [1, 2, 3]}


@pytest.mark.parametrize("name", ["hexdump-words", "od-words", "od"])
def test_swapped_words_and_octal(name: str, tmp_path: Path) -> None:
    """Checksums decide between plain, byte-swapped and octal words."""
    path = tmp_path / "dump.txt"
    path.write_text(write(name, EXCHANGE), encoding="utf-8")
    assert [row.data for row in decode(path)] == [[555, 0, 100]]


def test_a_file_may_mix_dialects(frames: Decode) -> None:
    """A text may change its dialect from block to block, like a forum thread."""
    parts = ["libmodbus", "pymodbus", "qmodmaster", "escaped"]
    text = "I see this:\n" + "and my friend:\n".join(write(name, EXCHANGE) for name in parts)
    assert frames(text) == WIRE * len(parts)


def test_a_dialect_of_several_lines_behind_much_else(frames: Decode) -> None:
    """It begins after the bytes that the format is found in."""
    chatter = "the program says something that is of no use here\n" * 2000
    assert len(chatter) > 64 << 10
    text = write("hex", EXCHANGE) + chatter + write("socat", EXCHANGE)
    assert frames(text) == WIRE * 2


def test_rows_of_a_user(tmp_path: Path, modlens: Modlens) -> None:
    """A row of one's own is read, detected, printed and explained where it is wrong."""
    row = f"""format = 1
[[dialect]]
name = "gateway"
title = "our gateway"
sample = '''
toward (01/03/00/6B/00/03/74/17)
'''
bytes = ["> {SPACED[0]}"]
sent = ["toward ({{hex}})"]
received = ["back ({{hex}})"]
"""
    rows, log = tmp_path / "rows.toml", tmp_path / "bus.log"
    rows.write_text(row.replace("/", " "), encoding="utf-8")
    log.write_text(f"toward ({SPACED[0]})\nback ({SPACED[1]})\n", encoding="utf-8")
    done = modlens("decode", log, "--dialects", rows, "--to", "csv", "--columns", "status,data")
    assert done.out.splitlines() == ["status,data", "ok,555 0 100"]
    assert "gateway" in done.err
    assert "our gateway" in modlens("formats", "--dialects", rows).out
    rows.write_text(row.replace("/", " ").replace("> 01", "> 02"), encoding="utf-8")
    done = modlens("decode", log, "--dialects", rows)
    assert done.status == 2
    assert "the sample gives bytes" in done.err


def test_zone_and_date_make_times_utc(tmp_path: Path) -> None:
    """Berlin is an hour ahead in November; without a date there is no time, only what elapsed."""
    path = tmp_path / "bus.log"
    path.write_text(write("sscom", EXCHANGE), encoding="utf-8")
    (plain,) = decode(path)
    assert (plain.time, plain.elapsed_us) == (None, 0.0)
    (dated,) = decode(path, timezone="Europe/Berlin", date="2026-11-21")
    assert dated.time.isoformat() == "2026-11-21T11:00:00+00:00"
    path.write_text(LOG, encoding="utf-8")
    (local,) = decode(path)
    assert local.time is None
    (zoned,) = decode(path, timezone="Asia/Tokyo")
    assert zoned.time.isoformat() == "2026-11-21T03:00:00.250000+00:00"


def test_a_clock_of_seconds_gives_no_response_time(tmp_path: Path) -> None:
    """With a clock of seconds the response time is empty, not zero."""
    path = tmp_path / "bus.log"
    path.write_text(write("goburrow", EXCHANGE), encoding="utf-8")
    (txn,) = decode(path)
    assert (txn.status, txn.response_time_us) == ("ok", None)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ('"timestamp": 1697041234.250', '"timestamp": 1697041234.270'),
        ('"ts": 1697041234250', '"ts": 1697041234270'),
        ('"time": 1697041234250000000', '"time": 1697041234270000000'),
        ('"t": "2023-10-11T16:20:34.250Z"', '"t": "2023-10-11T16:20:34.270Z"'),
    ],
)
def test_objects_of_a_time_and_bytes(first: str, second: str, tmp_path: Path) -> None:
    """JSON objects of other programs have times, and are read without a valid frame."""
    path = tmp_path / "reads.jsonl"

    def read(*parts: str) -> Decoding:
        rows = zip((first, second), parts, strict=True)
        path.write_text("".join(f'{{{time}, "data": "{part}"}}\n' for time, part in rows), "utf-8")
        return decode(path)

    (exchange,) = read(*WIRE).transactions
    assert exchange.response_time_us == 20_000
    assert b"".join(row.hex for row in read("0103", "c4").frames).hex() == "0103c4"


def test_nodes_times_between_lines(tmp_path: Path) -> None:
    """`+19ms` is the time since the line of node's before: the response time is known by it."""
    path = tmp_path / "node.log"
    blocks = [
        f"  modbus-serial {{ action: '{action}',\n"
        f"  modbus-serial   data: <Buffer {data}>,\n"
        f"  modbus-serial   unitid: 1 }} +{delta}\n"
        for action, data, delta in (
            ("send serial rtu buffered", SPACED[0], "0ms"),
            ("receive serial rtu buffered port", SPACED[1], "19ms"),
            ("send serial rtu buffered", SPACED[0], "1s"),
            ("receive serial rtu buffered port", SPACED[1], "22ms"),
        )
    ]
    path.write_text("".join(blocks), encoding="utf-8")
    first, second = decode(path)
    assert [first.elapsed_us, second.elapsed_us] == [0.0, 1_019_000.0]
    assert [first.response_time_us, second.response_time_us] == [19_000.0, 22_000.0]


def test_unparsed_lines_are_counted_and_shown(tmp_path: Path, modlens: Modlens) -> None:
    """The first three lines that were not understood are shown."""
    path = tmp_path / "bus.log"
    chatter = "".join(f"what {number} is this\n" for number in range(5))
    path.write_text(chatter + LOG, encoding="utf-8")
    done = modlens("decode", path, "--to", "csv")
    assert "5 of 7 lines could not be parsed" in done.err
    assert [f"what {number} is this" in done.err for number in range(5)] == [True] * 3 + [False] * 2


def test_text_without_modbus_is_refused(frames: Decode) -> None:
    """With a suspicion of what it is: M-Bus here (EN 13757, a short frame)."""
    with pytest.raises(SourceError, match="M-Bus"):
        frames("Tx: 10 40 05 45 16\nRx: E5 E5 E5 E5\n" * 4)


def test_the_table_reads_what_each_dialect_writes() -> None:
    """The table reads line, side, time and bytes without a session."""
    table = _modlens.Dialects()
    found, left_out, unparsed = table.read("hex", f"hello\n{LOG}".encode())
    assert [(line, side, data) for line, side, _, data in found] == [
        (2, "sent", ASK),
        (3, "received", ANSWER),
    ]
    assert [time for _, _, time, _ in found] == [NOON + 250_000_000, NOON + 270_000_000]
    assert (left_out, unparsed) == ([], 1)
    with pytest.raises(ValueError, match="not a text format"):
        table.read("nothing", b"")


@pytest.mark.parametrize("name", ["hex", "socat", "emodbus", "node-modbus-serial"])
def test_a_growing_log_is_followed(name: str, tmp_path: Path) -> None:
    """The last entry is decoded although no further line has completed it; later lines are read."""
    path = tmp_path / "bus.log"
    end = -2 if name == "emodbus" else None
    text = write(name, [LogEntry(one.ns, one.sent, one.data[:end]) for one in EXCHANGE])
    path.write_text(text, encoding="utf-8")
    words = ("decode", path, "--follow", "--to", "csv", "--columns", "status,data")
    run = subprocess.Popen(
        command(*words),
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        env=environment(PYTHONUNBUFFERED="1"),
    )
    assert run.stdout is not None
    try:
        said: queue.Queue[str] = queue.Queue()
        lines = iter(run.stdout.readline, "")
        reading = threading.Thread(target=lambda: deque(map(said.put, lines)), daemon=True)
        reading.start()
        assert said.get(timeout=20) == "status,data\n"
        assert said.get(timeout=20) == "ok,555 0 100\n"
        with path.open("a", encoding="utf-8") as file:
            file.write(text)
        assert said.get(timeout=20) == "ok,555 0 100\n"
    finally:
        run.terminate()
        run.wait()
        run.stdout.close()


@pytest.mark.parametrize("order", [None, "hex", "raw"])
@pytest.mark.parametrize(
    ("name", "change"),
    [
        (
            "bell in a line",
            lambda log: log.replace(b"0103006b00037417\n", b"0103006b00037417\x07\n", 1),
        ),
        ("zero in a line", lambda log: log.replace(b"74", b"7\x004", 1)),
        ("escape in front", lambda log: b"\x01\x02" + log),
        ("Ctrl-Z at the end", lambda log: log + b"\x1a"),
        ("zeros behind", lambda log: log + bytes(5000)),
        ("zeros behind the sample", lambda log: log * 200 + bytes(100_000)),
    ],
)
def test_a_stray_byte_hides_no_log(
    name: str, change: Callable[[bytes], bytes], order: str | None, frames: Decode
) -> None:
    """Only one line is not understood; `--from raw` is refused with the name of the format."""
    log = f"{WIRE[0]}\n{WIRE[1]}\n".encode() * 20
    data = change(log)
    if order == "raw":
        with pytest.raises(SourceError, match="hex"):
            frames(data, read_as=order)
        return
    found = frames(data, read_as=order)
    assert set(found) == set(WIRE), name
    assert len(found) >= len(frames(log)) - 2
