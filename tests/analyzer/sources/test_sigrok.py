"""Sessions of sigrok, made from recordings bit by bit: what was sent is what is decoded."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from analyzer import decode
from analyzer.line import parse_line
from dissectors.errors import SourceError
from tests.conftest import CAPTURES, Modlens
from tests.support.sigrok import changes, samples, session, spaced

REQUEST, RESPONSE = bytes.fromhex("0103006b00037417"), bytes.fromhex("010306022b00000064057a")


@pytest.mark.parametrize("settings", ["9600-8N1", "19200-8E1", "115200-8O1", "38400-8N2"])
@pytest.mark.parametrize("inverted", [False, True])
def test_settings_are_found(
    settings: str, inverted: bool, tmp_path: Path, modlens: Modlens
) -> None:
    """Baud rate, parity and polarity; stop bits beyond the first are silence."""
    line = parse_line(settings)
    wire = [*spaced(REQUEST, 0.01, line), *spaced(RESPONSE, 0.05, line)]
    path = tmp_path / "bus.sr"
    path.write_bytes(session(samples(line, [wire], inverted=inverted), ["BUS"]))
    done = modlens("decode", path, "--to", "csv", "--columns", "status,data,response_time_us")
    status, data, response = done.out.splitlines()[1].split(",")
    assert (status, data) == ("ok", "555 0 100")
    end = 0.01 + len(REQUEST) * (wire[1][0] - wire[0][0])
    assert abs(float(response) - (0.05 - end) * 1e6) < 2e6 / line.baud
    assert f"channel BUS: {settings.replace('8N2', '8N1')}" in done.err
    assert ("idle low" in done.err) == inverted


@pytest.mark.parametrize("name", ["brainchild_io_16do", "flowmeter_graph_tool"])
def test_recordings_of_real_devices(name: str, tmp_path: Path) -> None:
    """Their bytes put back on wires at their times; two wires are a two-line tap."""
    folder = CAPTURES / name
    about = (folder / "about.toml").read_text(encoding="utf-8")
    line = parse_line(
        next(row for row in about.splitlines() if row.startswith("line")).split('"')[1]
    )
    reads = [json.loads(row) for row in (folder / "recording.jsonl").read_text().splitlines()]
    named = [read.get("line") for read in reads]
    time = (1 + line.data_bits + (line.parity != "N") + line.stop_bits) / line.baud
    wires = [
        [(read["t"] - time, int(read["hex"], 16)) for read in reads if read.get("line") == which]
        for which in sorted(set(named), key=str)
    ]
    path = tmp_path / "device.sr"
    path.write_bytes(session(samples(line, wires), [f"D{n}" for n in range(len(wires))]))
    expected = [json.loads(row) for row in (folder / "frames.jsonl").read_text().splitlines()]
    found = [(row.line, row.direction, row.verdict, row.hex.hex()) for row in decode(path).frames]
    assert found == [(w.get("line"), w["direction"], w["verdict"], w["hex"]) for w in expected]


def test_the_other_wire_of_the_pair_is_no_second_line(tmp_path: Path, modlens: Modlens) -> None:
    """A and B of RS-485 carry the same, one of them upside down."""
    line = parse_line("9600-8E1")
    wire = [*spaced(REQUEST, 0.01, line), *spaced(RESPONSE, 0.05, line)]
    data = bytes(level | (1 - level) << 1 for level in samples(line, [wire]))
    path = tmp_path / "pair.sr"
    path.write_bytes(session(data, ["A", "B"]))
    done = modlens("decode", path, "--table", "frames", "--to", "csv", "--columns", "line,verdict")
    assert done.out.splitlines()[1:] == [",ok", ",ok"]
    assert "channel B carries the same" in done.err


def test_marks_of_the_receiver(tmp_path: Path) -> None:
    """A wrong parity bit in the samples is a finding on its frame."""
    line = parse_line("19200-8E1")
    wire = [
        *spaced(REQUEST, 0.01, line),
        *spaced(RESPONSE, 0.05, line),
        *spaced(REQUEST, 0.1, line),
    ]
    path = tmp_path / "marked.sr"
    path.write_bytes(session(samples(line, [wire], bad={10: "parity"}), ["BUS"]))
    frames = list(decode(path, line="19200-8E1").frames)
    assert ["line_error" in row.findings for row in frames] == [False, True, False]


def test_no_line_and_no_session(tmp_path: Path, modlens: Modlens) -> None:
    """Samples without a serial line and broken sessions are refused with advice."""
    path = tmp_path / "other.sr"
    path.write_bytes(session(bytes(range(256)) * 500, ["CLK", "DATA"]))
    with pytest.raises(SourceError, match="no Modbus on channels CLK, DATA; name"):
        list(decode(path))
    assert "has CLK, DATA" in modlens("decode", path, "--channels", "RX").err
    path.write_bytes(session(b"", ["CLK"])[:200])
    with pytest.raises(SourceError, match="not a sigrok session"):
        list(decode(path))


@pytest.mark.parametrize("names", [[], ["CLK"]])
def test_fewer_names_than_wires(names: list[str], tmp_path: Path, modlens: Modlens) -> None:
    """A session names one of two wires, or none; a wire without a name has its number."""
    line = parse_line("9600-8N1")
    wire = [*spaced(REQUEST, 0.01, line), *spaced(RESPONSE, 0.05, line)]
    path = tmp_path / "few.sr"
    path.write_bytes(session(samples(line, [[(0.0, 0xFF)], wire]), names))
    for command in ("decode", "doctor", "stats"):
        done = modlens(command, path)
        assert (done.status, "Traceback" in done.err) == (0, False), done.err
    rows = modlens("export", path, "--to", "csv", "--columns", "status").out.splitlines()
    assert rows == ["status", "ok"]


def test_standard_input(tmp_path: Path, modlens: Modlens) -> None:
    """A session from standard input is kept in memory, as it is read twice."""
    line = parse_line("9600-8N1")
    wire = [*spaced(REQUEST, 0.01, line), *spaced(RESPONSE, 0.05, line)]
    data = session(samples(line, [wire]), ["BUS"])
    done = modlens("decode", "-", "--to", "csv", "--columns", "status", stdin=data)
    assert done.out.splitlines() == ["status", "ok"]


@pytest.mark.parametrize("settings", ["9600-8N1", "19200-8E1", "115200-8O1"])
def test_levels_as_saleae_exports_them(settings: str, tmp_path: Path, modlens: Modlens) -> None:
    """A line for each change of any channel, times that begin before the trigger."""
    line = parse_line(settings)
    ask, answer = spaced(REQUEST, 0.01, line), spaced(RESPONSE, 0.05, line)
    wires = [changes(line, ask), changes(line, answer)]
    rows = sorted((time, which, level) for which, wire in enumerate(wires) for time, level in wire)
    now, text = [1, 1], "Time [s],TX,RX,SPARE\n"
    for time, which, level in rows:
        now[which] = level
        text += f"{time - 0.005:.9f},{now[0]},{now[1]},0\n"
    path = tmp_path / "digital.csv"
    path.write_text(text, encoding="ascii")
    done = modlens("decode", path, "--to", "csv", "--columns", "status,data,response_time_us")
    status, data, response = done.out.splitlines()[1].split(",")
    assert (status, data) == ("ok", "555 0 100")
    end = 0.01 + len(REQUEST) * (ask[1][0] - ask[0][0])
    assert abs(float(response) - (0.05 - end) * 1e6) < 2e6 / line.baud
    assert f"channel TX: {settings}" in done.err
    done = modlens("decode", path, "--channels", "NOWHERE")
    assert done.status == 2
    assert "has TX, RX, SPARE" in done.err


def test_channels_of_the_api(tmp_path: Path) -> None:
    """The channels given to the API are the lines, in their order."""
    line = parse_line("19200-8E1")
    path = tmp_path / "bus.sr"
    wires = [spaced(REQUEST, 0.01, line), spaced(RESPONSE, 0.05, line)]
    path.write_bytes(session(samples(line, wires), ["TX", "RX"]))
    assert [txn.status for txn in decode(path, channels=["TX", "RX"])] == ["ok"]
    assert [txn.status for txn in decode(path, channels=["TX"])] == ["not_observed"]


@pytest.mark.parametrize("names", [None, "BUS,RX,TX", "RX,TX", "BUS"])
def test_the_bus_beside_its_two_wires_counts_once(
    names: str | None, tmp_path: Path, modlens: Modlens
) -> None:
    """The bus alone or the pair, whatever channels are named, and never the same bytes twice."""
    line = parse_line("19200-8E1")
    sent, got = spaced(REQUEST, 0.01, line), spaced(RESPONSE, 0.05, line)
    path = tmp_path / "bus.sr"
    wires = [got, sent, sorted([*sent, *got])]
    path.write_bytes(session(samples(line, wires), ["RX", "TX", "BUS"]))
    words = ["--channels", names] if names else []
    done = modlens("decode", path, *words, "--table", "frames", "--to", "csv", "--columns", "hex")
    assert done.out.split()[1:] == [REQUEST.hex(), RESPONSE.hex()]
    left_out = {"RX,TX": 0, "BUS": 0}.get(names or "", 2)
    assert done.err.count("carries the same bytes") == left_out


def test_a_third_line_is_said_to_be_left_out(tmp_path: Path, modlens: Modlens) -> None:
    """Two other buses beside the first one."""
    line = parse_line("19200-8E1")
    wires = [
        [*spaced(REQUEST, start, line), *spaced(RESPONSE, start + 0.03, line)]
        for start in (0.01, 0.11, 0.21)
    ]
    wires[1] += spaced(REQUEST, 0.3, line)
    wires[2] += spaced(RESPONSE, 0.4, line)
    path = tmp_path / "three.sr"
    path.write_bytes(session(samples(line, wires), ["A", "B", "C"]))
    done = modlens("decode", path, "--channels", "A,B,C")
    assert "channel A is left out: a bus has two lines at most" in done.err
