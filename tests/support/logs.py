r"""Logs as the programs of the table of dialects write them, from bytes, times and sides.

Written from the rows' samples alone: nothing in here is shared with the reader. `write(name,
entries)` gives a text, `WRITERS` the names; `text_of_bytes` what the reader has to give back where
a dialect does not hold the bytes themselves.

>>> print(write("qmodmaster", [LogEntry(NOON, True, b"\x05\x03")]), end="")
[RTU]>Tx > 12:00:00:000 - 05  03
"""

from __future__ import annotations

import base64
import struct
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

__all__ = ["NOON", "SINGLE_LINE", "WRITERS", "LogEntry", "delivered", "write"]

NOON = 1_795_262_400_000_000_000
"""2026-11-21T12:00:00Z in ns since 1970; `date -ud 2026-11-21T12:00 +%s`."""

_MS, _US = 1_000_000, 1_000


@dataclass(frozen=True, slots=True)
class LogEntry:
    """A frame in a log: time in ns, whether the logging program sent it, its bytes."""

    ns: int
    sent: bool
    data: bytes

    def time(self, form: str, digits: int = 3) -> str:
        """The time in a `strftime` format, where `%f` is the fraction with `digits` digits."""
        fraction = f"{self.ns % 1_000_000_000:09d}"[:digits]
        return datetime.fromtimestamp(self.ns // 1_000_000_000, UTC).strftime(
            form.replace("%f", fraction)
        )


def _hex(data: bytes, between: str = " ") -> str:
    return data.hex(between).upper() if between else data.hex().upper()


def _low(data: bytes, between: str = " ") -> str:
    return data.hex(between) if between else data.hex()


def _around(data: bytes, left: str, right: str) -> str:
    return "".join(f"{left}{byte:02x}{right}" for byte in data)


def _visible(data: bytes) -> str:
    return "".join(chr(byte) if 0x20 <= byte < 0x7F else "." for byte in data)


def _python(data: bytes) -> str:
    """A Python literal.

    Wholly in escapes if it would have none, because readers skip plain text.
    """
    text = repr(data)
    return text if "\\" in text else "b'" + "".join(f"\\x{byte:02x}" for byte in data) + "'"


def _octal(data: bytes) -> str:
    """A C string as strace writes it: octal escapes, as short as they can be."""
    names = {9: "\\t", 10: "\\n", 11: "\\v", 12: "\\f", 13: "\\r", 34: '\\"', 92: "\\\\"}
    text = ""
    for at, byte in enumerate(data):
        digit_behind = data[at + 1 : at + 2].isdigit()
        if byte in names:
            text += names[byte]
        elif 0x20 <= byte < 0x7F and at:
            text += chr(byte)
        else:
            text += f"\\{byte:03o}" if digit_behind else f"\\{byte:o}"
    return text


def _lines(data: bytes, width: int = 16) -> Iterator[tuple[int, bytes]]:
    for at in range(0, len(data), width):
        yield at, data[at : at + width]


def _dump(data: bytes, line: Callable[[int, bytes], str], width: int = 16) -> str:
    return "".join(f"{line(at, row)}\n" for at, row in _lines(data, width))


def _words(data: bytes, form: str) -> str:
    padded = data + b"\0" * (len(data) % 2)
    return " ".join(format(word, form) for (word,) in struct.iter_unpack("<H", padded))


def _framed(data: bytes) -> bytes:
    """A frame of a user-defined function code with this data."""
    frame = b"\x05\x41" + data
    register = 0xFFFF
    for byte in frame:
        register ^= byte
        for _ in range(8):
            register = register >> 1 ^ 0xA001 * (register & 1)
    return frame + register.to_bytes(2, "little")


_NOTATIONS: dict[str, Callable[[bytes], str]] = {
    "HEX": _hex,
    "hex": _low,
    "plain": lambda data: _low(data, ""),
    "PLAIN": lambda data: _hex(data, ""),
    "wide": lambda data: _hex(data).replace(" ", "  "),
    "colons": lambda data: _hex(data, ":"),
    "dashes": lambda data: _hex(data, "-"),
    "prefixed": lambda data: " ".join(f"{byte:#x}" for byte in data),
    "loose": lambda data: " ".join(f"{byte:X}" for byte in data),
    "squares": lambda data: _around(data, "[", "]"),
    "SQUARES": lambda data: _around(data, "[", "]").upper(),
    "ANGLES": lambda data: _around(data, "<", ">").upper(),
    "commas": lambda data: ", ".join(map(str, data)),
    "numbers": lambda data: "-".join(map(str, data)),
    "octal": _octal,
    "python": _python,
    "base64": lambda data: base64.b64encode(data).decode(),
    "lrc": lambda data: _hex(data + bytes([-sum(data) & 0xFF]), ""),
    "crc": lambda data: _low(_framed(data)),
    "names": lambda data: " ".join(f"{_name(byte)} ({byte:02x})" for byte in data),
    "count": lambda data: str(len(data)),
}

_TIMES: dict[str, tuple[str, int]] = {
    "iso": ("%Y-%m-%d %H:%M:%S.%f", 3),
    "isoT": ("%Y-%m-%dT%H:%M:%S.%f", 3),
    "iso6": ("%Y-%m-%d %H:%M:%S.%f", 6),
    "logging": ("%Y-%m-%d %H:%M:%S,%f", 3),
    "day": ("%H:%M:%S.%f", 3),
    "day6": ("%H:%M:%S.%f", 6),
    "second": ("%H:%M:%S", 0),
    "colon": ("%H:%M:%S:%f", 3),
    "slashes": ("%Y/%m/%d %H:%M:%S", 0),
    "slashes3": ("%Y/%m/%d %H:%M:%S.%f", 3),
    "socat": ("%Y/%m/%d %H:%M:%S.000%f", 6),
    "words": ("%d %b %Y %H:%M:%S", 0),
    "dots": ("%d.%m.%Y %H:%M:%S.%f", 3),
    "month": ("%d %H:%M:%S.%f", 3),
    "dmy": ("%d/%m/%Y %H:%M:%S", 0),
    "at": ("%d/%m/%Y@%H:%M:%S.%f", 3),
    "epoch": ("%s.%f", 6),
}


class _Fields(dict[str, str]):
    """What is in a template, made when it is asked for."""

    def __init__(self, entry: LogEntry) -> None:
        super().__init__()
        self._entry = entry

    def __missing__(self, key: str) -> str:
        if key in _TIMES:
            return self._entry.time(*_TIMES[key])
        if key == "ms":
            return str(self._entry.ns // _MS % 10**9)
        if key == "us":
            return str(self._entry.ns // _US % 10**12)
        return _NOTATIONS[key](self._entry.data)


_MINIMAL = "MinimalModbus debug mode. "
_WB_MGE = (
    '{{"type":"packet","id":1,"port":1,"timestamp_us":{us},"sender":"WHO","slave_id":5,"function":3'
    ',"crc_valid":true,"raw":"{PLAIN}","size":{count}}}'
)

_LINES: dict[str, tuple[str, str]] = {
    "hex": ("{iso} Tx: {HEX}", "{iso} Rx: {HEX}"),
    "chunks": ('{{"t": {epoch}, "hex": "{plain}"}}',) * 2,
    "strace": ('{day6} write(3, "{octal}", 99) = 9', '{day6} read(3, "{octal}", 99) = 9'),
    "slsnif": ("Host   --> {names}", "Device --> {names}"),
    "qmodmaster": ("[RTU]>Tx > {colon} - {wide}", "[RTU]>Rx > {colon} - {wide}"),
    "modbus-poll": ("Tx:000001-{HEX}", "Rx:000002-{HEX}"),
    "openmodscan": ("Tx: {isoT} << {HEX}", "Rx: {isoT} >> {HEX}"),
    "qmodbus": ("Req >> : {hex}", "<< Resp: {hex}"),
    "modrssim2": ("(socket)TX:{PLAIN}", "(socket)RX:{PLAIN}"),
    "libmodbus": ("{SQUARES}", "{ANGLES}"),
    "mbusd": ("{words} conn[10.0.0.1]: request: {squares}", "{words} tty: response: {squares}"),
    "modbus-cli": ("Tx ({count} bytes): {squares}", "Rx ({count} bytes): {squares}"),
    "pymodbus2": (
        "{logging} MainThread DEBUG transaction :273 SEND: {prefixed}",
        "{logging} MainThread DEBUG transaction :288 RECV: {prefixed}",
    ),
    "pymodbus": (
        "{logging} DEBUG transport:329 send: {prefixed}",
        "{logging} DEBUG transport:312 recv: {prefixed} old_data:  addr=None",
    ),
    "pymodbus-server": (
        "{iso} DEBUG server:97 send: b'{plain}'",
        "{iso} DEBUG server:90 Data Received: {prefixed}",
    ),
    "minimalmodbus": (
        f"{_MINIMAL}Will write to instrument (expecting 9 bytes back): {{HEX}} ({{count}} bytes)",
        f"{_MINIMAL}Response from instrument: {{HEX}} ({{count}} bytes), roundtrip time: 2.1 ms",
    ),
    "modbus-tk": (
        "{logging} DEBUG modbus_rtu.py -> {numbers}",
        "{logging} DEBUG modbus_rtu.py <- {numbers}",
    ),
    "umodbus": ("{logging} DEBUG umodbus --> b'{plain}'", "{logging} DEBUG umodbus <-- b'{plain}'"),
    "nmodbus": (
        "INFO Modbus.IO.ModbusSerialTransport - TX: {commas}",
        "INFO Modbus.IO.ModbusSerialTransport - RX: {commas}",
    ),
    "j2mod": (
        "{iso} [DEBUG] ModbusRTUTransport - Sent: {HEX}",
        "{iso} [DEBUG] ModbusRTUTransport - Read: {HEX}",
    ),
    "goburrow": ("{slashes} modbus: sending {hex}", "{slashes} modbus: received {hex}"),
    "esphome-uart": (
        "[{second}][D][uart_debug:114]: >>> {colons}",
        "[{second}][D][uart_debug:114]: <<< {colons}",
    ),
    "esp-idf": ("I ({ms}) MODBUS: {hex}",) * 2,
    "wiren-board": ("port /dev/ttyS1: Write: {hex}", "port /dev/ttyS1: ReadFrame: {hex}"),
    "docklight": ("{dots} [TX] - {HEX}", "{dots} [RX] - {HEX}"),
    "sscom": (
        "[{day}]\u53d1\u2192\u25c7{HEX} \u25a1",
        "[{day}]\u6536\u2190\u25c6{HEX}",
    ),
    "modbus-serial-monitor": ("DATE={isoT};ERR=NO;FRAME={dashes};SLAVE=5;",) * 2,
    "mdbus": ("{month} G  TX {HEX} ", "{month} G  RX {HEX} "),
    "libmodbuspp": ("Tx-> {HEX}", "Rx-> {HEX}"),
    "wb-mge": (_WB_MGE.replace("WHO", "master"), _WB_MGE.replace("WHO", "slave")),
    "wb-mge-csv": (
        '1,{day},+2 ms,MASTER,0x05,"Read Holding Regs","{HEX}",{count},OK',
        '2,{day},+21 ms,SLAVE,0x05,"Read Holding Regs","{HEX}",{count},OK',
    ),
    "words": (
        "{iso} INFO meter/port1 request >> {HEX}",
        "{iso} INFO meter/port1 response << {HEX}",
    ),
    "loose": ("{loose}",) * 2,
    "decimal": ("Tx: [{commas}]", "Rx: [{commas}]"),
    "escaped": ("{day} sent {python}", "{day} received {python}"),
    "base64": ("{day} {base64}",) * 2,
    "ascii-lines": ("{day} Tx :{lrc}", "{day} Rx :{lrc}"),
    "proved": (
        '{iso} {{"text": "now sent to unit 5: {crc}", "bytes": {count}}}',
        "{iso} which is answered by ({crc}) - Read {count}",
    ),
}


def _line(name: str, entry: LogEntry) -> str:
    sent, received = _LINES[name]
    return (sent if entry.sent else received).format_map(_Fields(entry)) + "\n"


def _head(entry: LogEntry, sent: str, received: str = "") -> str:
    return (sent if entry.sent or not received else received).format_map(_Fields(entry))


def _array(entry: LogEntry) -> str:
    rows = (", ".join(f"0x{byte:02x}" for byte in row) for _, row in _lines(entry.data, 12))
    body = ",\n".join(f"  {row}" for row in rows)
    end = f"unsigned int data_len = {len(entry.data)};"
    return f"unsigned char data[] = {{\n{body}\n}};\n{end}\n"


def _text2pcap(entry: LogEntry) -> str:
    rows = _dump(entry.data, lambda at, row: f"{at:04x}  {_low(row):47}  {_visible(row)}")
    return _head(entry, "O {day6}\n", "I {day6}\n") + rows


def _ip_packet(entry: LogEntry) -> bytes:
    there = (b"\x0a\0\0\1\x0a\0\0\2", b"\xc3\x50\x01\xf6")
    back = (b"\x0a\0\0\2\x0a\0\0\1", b"\x01\xf6\xc3\x50")
    ends, ports = there if entry.sent else back
    ip = struct.pack(">BBHHHBBH", 0x45, 0, 40 + len(entry.data), 1, 0x4000, 64, 6, 0) + ends
    return ip + ports + struct.pack(">IIBBHHH", 1, 1, 0x50, 0x18, 502, 0, 0) + entry.data


def _packet(entry: LogEntry) -> str:
    packet = _ip_packet(entry)
    flags = f"Flags [P.], seq 1:{1 + len(entry.data)}, ack 1, win 9, length {len(entry.data)}"
    names = ("10.0.0.1.50000 > 10.0.0.2.502", "10.0.0.2.502 > 10.0.0.1.50000")[not entry.sent]
    rows = _dump(packet, lambda at, row: f"\t0x{at:04x}:  {row.hex(' ', -2):39}  {_visible(row)}")
    return _head(entry, f"{{day6}} IP {names}: {flags}\n") + rows


def _wireshark(entry: LogEntry) -> str:
    """The address of the second station begins as an IPv6 header does."""
    stations = (bytes.fromhex("001122334455"), bytes.fromhex("66778899aabb"))
    ends = b"".join(stations if entry.sent else stations[::-1])
    packet = ends + b"\x08\0" + _ip_packet(entry)
    names = ("10.0.0.1   10.0.0.2", "10.0.0.2   10.0.0.1")[not entry.sent]
    ports = ("50000 → 502", "502 → 50000")[not entry.sent]
    head = "No.     Time           Source     Destination   Protocol Length Info\n"
    row = (
        f"      7 0.001000       {names}   TCP      {len(packet)}     {ports} [PSH, ACK] Seq=1\n\n"
    )
    return head + row + _dump(packet, lambda at, row: f"{at:04x}  {_low(row):47}   {_visible(row)}")


def _socat(entry: LogEntry) -> str:
    head = _head(entry, "> {socat}", "< {socat}")
    return f"{head}  length={len(entry.data)} from=0 to=9\n {_low(entry.data)}\n--\n"


def _interceptty(entry: LogEntry) -> str:
    mark = "< " if entry.sent else "> \t"
    seen = {byte: f" ({chr(byte)})" for byte in range(0x21, 0x7F)}
    return "".join(f"{mark}0x{byte:02x}{seen.get(byte, '')}\n" for byte in entry.data)


def _jpnevulator(entry: LogEntry) -> str:
    rows = _dump(entry.data, lambda _, row: f"{_hex(row):48}\t{_visible(row)}")
    return _head(entry, "{iso6}: SEND\n", "{iso6}: RECEIVE\n") + rows


def _node(entry: LogEntry) -> str:
    action = "send serial rtu buffered" if entry.sent else "receive serial rtu buffered port"
    head = f"  modbus-serial {{ action: '{action}',\n"
    return head + f"  modbus-serial   data: <Buffer {_low(entry.data)}> }} +4ms\n"


def _esphome(entry: LogEntry) -> str:
    if entry.sent:
        size = len(entry.data)
        line = f"[modbus:184]: Modbus write: {_hex(entry.data, '.')} ({size})\n"
        return _head(entry, "[{second}][V]") + line
    head = _head(entry, "[{second}][V][modbus:058]: Modbus received Byte ")
    return "".join(f"{head} {byte} (0X{byte:x})\n" for byte in entry.data)


def _emodbus(entry: LogEntry) -> str:
    head = (
        f"{'Sent packet' if entry.sent else 'Raw buffer received'}: @3FFB1E40/{len(entry.data)}:\n"
    )
    rows = _dump(entry.data, lambda at, row: f"  | {at:04x}: {_hex(row):48} |{_visible(row):16}|")
    return f"[D] {head}{rows}"


def _emodbus_bytes(entry: LogEntry) -> str:
    head = _head(entry, "[N] {ms}| RTUutils.cpp         [ 292] receive:")
    return "".join(f"{head} {at:3d}: {byte:02X}\n" for at, byte in enumerate(entry.data, 1))


def _eltima(entry: LogEntry) -> str:
    head = _head(entry, "[{dmy}] Written data (COM3)\n", "[{dmy}] Read data (COM3)\n")
    return head + _dump(entry.data, lambda _, row: f"    {_low(row):49} {_visible(row)}")


def _serialtool(entry: LogEntry) -> str:
    size = f"{'Sent' if entry.sent else 'Received'} {len(entry.data)} bytes."
    head = _head(entry, "{at}") + f"::Packet[00000001l]>>Serial [1] COM3 {size}\n"
    return head + _hex(entry.data, "|") + "|\n"


def _epics(entry: LogEntry) -> str:
    head = _head(
        entry, "{slashes3} meters:502 write {count}\n", "{slashes3} meters:502 read {count}\n"
    )
    return f"{head}\n{_dump(entry.data, lambda _, row: _low(row), 20)}"


def _solarman(entry: LogEntry) -> str:
    control, head = (b"\x10\x45", bytes(15)) if entry.sent else (b"\x10\x15", bytes(14))
    frame = b"\xa5" + struct.pack("<H", len(head) + len(entry.data)) + control + b"\1\0\4\3\2\1"
    frame += head + entry.data
    text = _low(frame + bytes([sum(frame[1:]) & 0xFF, 0x15]))
    return f"DEBUG:pysolarmanv5.pysolarmanv5:{'SENT' if entry.sent else 'RECD'}: {text}\n"


def _tracer(entry: LogEntry) -> str:
    return _dump(entry.data, lambda at, row: f"  {at:04x} | {_hex(row)} | {_visible(row)}")


def _saleae(entry: LogEntry) -> str:
    start = entry.ns % 10**12 / 1e9
    rows = enumerate(entry.data)
    return "".join(f"{start + at * 0.001:.15f},0x{byte:02X},,\n" for at, byte in rows)


def _logic2(entry: LogEntry) -> str:
    start = entry.ns % 10**12 / 1e9
    head = 'name,type,start_time,duration,"data"\n'
    rows = enumerate(entry.data)
    return head + "".join(
        f'"Async Serial","data",{start + at * 0.001:.6f},0.000104,0x{byte:02X}\n'
        for at, byte in rows
    )


def _sigrok(entry: LogEntry) -> str:
    return "".join(f"{at}-{at + 834} uart-1: {byte:02X}\n" for at, byte in enumerate(entry.data))


def _table(entry: LogEntry) -> str:
    return "".join(f"byte {at} 0x{byte:02X}\n" for at, byte in enumerate(entry.data))


def _name(byte: int) -> str:
    """What slsnif calls a character."""
    return chr(byte) if 0x21 <= byte < 0x7F else f"C{byte:02X}"


_BLOCKS: dict[str, Callable[[LogEntry], str]] = {
    "c-array": _array,
    "text2pcap": _text2pcap,
    "tcpdump": _packet,
    "wireshark": _wireshark,
    "socat": _socat,
    "interceptty": _interceptty,
    "jpnevulator": _jpnevulator,
    "node-modbus-serial": _node,
    "esphome-modbus": _esphome,
    "emodbus": _emodbus,
    "emodbus-bytes": _emodbus_bytes,
    "eltima": _eltima,
    "serialtool": _serialtool,
    "epics": _epics,
    "solarman": _solarman,
    "tracer": _tracer,
    "saleae-serial": _saleae,
    "saleae-table": _logic2,
    "sigrok-uart": _sigrok,
    "table": _table,
}


def _spy(entries: Iterable[LogEntry]) -> str:
    text = ""
    for one in entries:
        seconds, ms = divmod(one.ns // 1_000_000 % 10**9, 1000)
        head = f"{seconds:06d}.{ms:03d} {'TX' if one.sent else 'RX'}   "
        for at, row in _lines(one.data):
            halves = f"{_hex(row[:8])}  {_hex(row[8:])}".rstrip()
            text += f"{head}{at:04X}  {halves:49} {_visible(row)}\n"
    return text


def _stamped_dump(entries: Iterable[LogEntry]) -> str:
    text, offset = "", 0
    for one in entries:
        head = _head(one, "{iso}")
        for at, row in _lines(one.data):
            text += f"{head}  {offset + at:08x}  {_hex(row):49}  |{_visible(row)}|\n"
        offset += len(one.data)
    return text


def _ser2net(entries: Iterable[LogEntry]) -> str:
    text = ""
    for one in entries:
        head = f"{one.time('%Y/%m/%d %H:%M:%S')} {'tcp ' if one.sent else 'term'}"
        text += "".join(
            f"{head} {_low(row):23}  |{_visible(row)}|\n" for _, row in _lines(one.data, 8)
        )
    return text


def _joined(line: Callable[[int, bytes], str], end: str) -> Callable[[Iterable[LogEntry]], str]:
    def whole(entries: Iterable[LogEntry]) -> str:
        data = b"".join(one.data for one in entries)
        return _dump(data, line) + (format(len(data), end) + "\n" if end else "")

    return whole


def _canonical(at: int, row: bytes) -> str:
    return f"{at:08x}  {_low(row[:8])}  {_low(row[8:])}".ljust(60) + f"|{_visible(row)}|"


_WHOLE: dict[str, Callable[[Iterable[LogEntry]], str]] = {
    "hexdump": _joined(_canonical, "08x"),
    "xxd": _joined(lambda at, row: f"{at:08x}: {row.hex(' ', -2):40} {_visible(row)}", ""),
    "hexdump-words": _joined(lambda at, row: f"{at:07x} {_words(row, '04x')}", "07x"),
    "od-words": _joined(lambda at, row: f"{at:07o} {_words(row, '04x')}", "07o"),
    "od": _joined(lambda at, row: f"{at:07o} {_words(row, '06o')}", "07o"),
    "od-bytes": _joined(lambda at, row: f"{at:07o} {_low(row):47}  >{_visible(row)}<", "07o"),
    "serial-hexdump": _stamped_dump,
    "pyserial-spy": _spy,
    "ser2net": _ser2net,
}

SINGLE_LINE = tuple(_LINES)
"""Dialects that write a record into a line."""

WRITERS = (*SINGLE_LINE, *_BLOCKS, *_WHOLE)
"""The names of all dialects that can be written."""

RESOLUTION = {
    **dict.fromkeys(
        ("hex", "qmodmaster", "openmodscan", "pymodbus2", "pymodbus", "modbus-tk"), _MS
    ),
    **dict.fromkeys(("umodbus", "j2mod", "docklight", "sscom", "modbus-serial-monitor"), _MS),
    **dict.fromkeys(("mdbus", "words", "escaped", "base64", "ascii-lines", "serial-hexdump"), _MS),
    "proved": _MS,
    **dict.fromkeys(
        ("wb-mge-csv", "esp-idf", "emodbus-bytes", "pyserial-spy", "epics", "serialtool"), _MS
    ),
    **dict.fromkeys(
        ("wb-mge", "chunks", "strace", "text2pcap", "tcpdump", "socat", "jpnevulator"), _US
    ),
    **dict.fromkeys(
        ("mbusd", "goburrow", "esphome-uart", "esphome-modbus", "eltima", "ser2net"), 1000 * _MS
    ),
}
"""The steps of the clock of those that print times."""


def write(name: str, entries: Sequence[LogEntry]) -> str:
    """The log in this dialect."""
    if name in _WHOLE:
        return _WHOLE[name](entries)
    if name in _BLOCKS:
        return "".join(map(_BLOCKS[name], entries))
    return "".join(_line(name, one) for one in entries)


def delivered(name: str, data: bytes) -> bytes:
    """What a reader gives for these bytes: themselves, or the characters that are on the line."""
    if name == "proved":
        return _framed(data)
    if name != "ascii-lines":
        return data
    return f":{_NOTATIONS['lrc'](data)}\r\n".encode()
