"""Records the captures of pymodbus' client and servers talking over a paced pty bus.

    python -m tests.support.recording all
    python -m tests.support.recording pymodbus_ascii --into captures

Writes `NAME/recording.jsonl` (what a tap heard, a chunk log), `NAME/frames.jsonl` (what each
participant says it sent) and `NAME/about.toml`. The three must agree, or nothing is written. The
times differ with every recording, the bytes hardly ever do.
"""

from __future__ import annotations

import argparse
import json
import logging
import platform
import tempfile
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from importlib.metadata import version
from itertools import count
from pathlib import Path

from pymodbus import FramerType
from pymodbus.constants import ExcCodes
from pymodbus.simulator import SimDevice

from tests.support import master_scripts
from tests.support.devices import ANY_ADDRESS, PROFILE_ADDRESS, Behaviour, demo_device
from tests.support.expected import DisagreementError, Frame, expected_frames
from tests.support.ptybus import flip_bit
from tests.support.pymodbus_buses import BusScenario, run_scenario
from tests.support.random_devices import RandomDevice
from tests.support.recipe import Recipe
from tests.support.trouble_recipes import TROUBLE_RECIPES
from tests.support.typed_device import poll_types, typed_device

CAPTURES = Path(__file__).parents[2] / "captures"
EXPECTED_SOURCE = (
    "what each participant's own pymodbus handed to its serial port (hook trace_packet): the "
    "master's bytes are requests, a unit's are responses; checked against what the bus carried"
)
FOUR_WIRE = {"unit1": ["master"], "unit2": ["master"]}


def _all_functions() -> BusScenario:
    return BusScenario({"unit17": demo_device(17)}, master_scripts.all_functions)


def _ascii() -> BusScenario:
    units = {"unit10": demo_device(10)}
    return BusScenario(units, master_scripts.mixed_ascii, framer=FramerType.ASCII, char_bits=10)


def _broadcast() -> BusScenario:
    return BusScenario(_two_devices(), master_scripts.broadcast, hears=FOUR_WIRE)


def _disturbed() -> BusScenario:
    noise = {5: b"\x00\xff\x00", 17: bytes.fromhex("fffefcf0")}
    units = {"unit1": demo_device(1)}
    return BusScenario(units, master_scripts.plain_polls, disturb=_trouble(), noise=noise)


def _exceptions() -> BusScenario:
    codes = [ExcCodes(code) for code in (1, 2, 3, 4, 5, 6, 7, 8, 10)]
    refusals = {(6, address): code for address, code in enumerate(codes, start=1)}
    refusals[23, ANY_ADDRESS] = ExcCodes.ILLEGAL_FUNCTION
    refusals[4, ANY_ADDRESS] = ExcCodes.GATEWAY_NO_RESPONSE
    return BusScenario({"unit1": demo_device(1, Behaviour(refusals))}, master_scripts.exceptions)


def _late_answers() -> BusScenario:
    device = demo_device(1, Behaviour(slow_s={PROFILE_ADDRESS: 0.37}))
    return BusScenario({"unit1": device}, master_scripts.late_answers, retries=1)


def _no_silence() -> BusScenario:
    device = demo_device(1, Behaviour(work_s=(0.0,)))
    return BusScenario({"unit1": device}, master_scripts.plain_polls, turnaround_chars=0.0)


def _timeouts() -> BusScenario:
    return BusScenario({"unit1": demo_device(1)}, master_scripts.timeouts)


def _two_units() -> BusScenario:
    return BusScenario(_two_devices(), master_scripts.two_units, trigger=8, hears=FOUR_WIRE)


def _types() -> BusScenario:
    return BusScenario({"unit5": typed_device(5)}, poll_types, baud=57600, trigger=14)


def _plant() -> BusScenario:
    plant = RandomDevice(303)
    return BusScenario(
        {"unit9": plant.device(9)},
        partial(plant.poll, unit=9),
        baud=57600,
        trigger=14,
        timeout_s=3.0,
    )


def _two_devices() -> dict[str, SimDevice]:
    return {"unit1": demo_device(1), "unit2": demo_device(2)}


def _trouble() -> Callable[[str, bytes], bytes]:
    """Return a disturbance that strikes certain writes of each sender, counted from 1."""
    numbers = {"master": count(1), "unit1": count(1)}

    def disturb(sender: str, written: bytes) -> bytes:
        strike = TROUBLES.get((sender, next(numbers[sender])))
        return strike(written) if strike else written

    return disturb


TROUBLES: Mapping[tuple[str, int], Callable[[bytes], bytes]] = {
    ("unit1", 2): lambda data: flip_bit(data, 35),
    ("unit1", 5): lambda data: b"",
    ("master", 9): lambda data: flip_bit(data, 17),
    ("unit1", 9): lambda data: b"\x00" + data,
    ("unit1", 11): lambda data: data[:-3],
    ("master", 28): lambda data: data + b"\xff",
    ("unit1", 16): lambda data: data[:4] + b"\x00\x00" + data[6:],
    ("unit1", 18): lambda data: b"\xfe" + data + b"\x00",
}

RECIPES: Mapping[str, Recipe] = {
    "pymodbus_all_functions": Recipe(
        "Every function code that pymodbus' client can send, to unit 17: 1-8, 11, 12, 15-17, 20-24 "
        "and 43/14, function 8 with 17 sub-functions. Byte by byte. Function 24 is asked three "
        "times: pymodbus' client takes the (right) answer for too short and retries after 0.3 s. "
        "The answer to 8/4 (force listen only), which must not exist, is there and has no data "
        "field; 8/21 is the Modbus Plus one, not in the public specification. The file records and "
        "the FIFO are dummies of the server.",
        _all_functions,
    ),
    "pymodbus_ascii": Recipe(
        "ASCII framing, 7E1 pacing (10 bits a character), unit 10: reads, writes, 2000 coils in "
        "one answer (511 characters), diagnostics, files, FIFO, identification, two exceptions.",
        _ascii,
        line="19200-7E1",
        mode="ascii",
        healthy=True,
    ),
    "pymodbus_broadcast": Recipe(
        "Writes to unit 0 (functions 5, 6, 15, 16), 0.1 s of turnaround delay without an answer, "
        "then polls of units 1 and 2 that show that both have obeyed.",
        _broadcast,
        healthy=True,
    ),
    "pymodbus_disturbed": Recipe(
        "A poll cycle on a bad line, disturbed on purpose by the bus: a flipped bit in a request "
        "and in an answer, an answer that never reaches the line, one cut short, one with two "
        "bytes blanked, stray bytes 00, FE, FF glued to frames, bursts of noise in the silence. "
        "Retries after 0.3 s. Noise makes pymodbus' server lose step, so that some undamaged "
        "requests stay unanswered.",
        _disturbed,
    ),
    "pymodbus_exceptions": Recipe(
        "All exception codes: 1 to 8, 10 and 11, partly because the address, the quantity or the "
        "object does not exist, partly because the device was told to refuse. The user-defined "
        "function 41h is refused with code 1. To reads of 126 registers and 2001 coils pymodbus "
        "answers with function 80h (its own function 0) and code 1, which is not what the "
        "specification asks for.",
        _exceptions,
    ),
    "pymodbus_late_answers": Recipe(
        "Unit 1 takes 0.37 s for one block of registers; the master gives up after 0.3 s and asks "
        "again. The first answer arrives during the retry and is taken for its answer; the second "
        "answer arrives when the master no longer waits for it.",
        _late_answers,
    ),
    "pymodbus_no_silence": Recipe(
        "Answers that start within about two character times of the request, as those of "
        "pymodbus' server do when nothing holds it back: between request and answer the silence of "
        "3.5 characters is missing; before each request it is there.",
        _no_silence,
        healthy=True,
    ),
    "pymodbus_timeouts": Recipe(
        "Polls of unit 1, which answers, and of unit 3, which is not on the bus: three requests "
        "each (timeout 0.3 s, two retries). The recording ends with unanswered requests.",
        _timeouts,
    ),
    "pymodbus_types": Recipe(
        "Unit 5 has floats, doubles, counters, signed numbers and a text of known types and orders "
        "(tests/support/typed_device.py), read 60 times as one block of 66 registers. The values "
        "are random walks and waves of our own, not those of a plant. Reads of up to 14 bytes.",
        _types,
        line="57600-8E1",
        healthy=True,
    ),
    "pymodbus_plant": Recipe(
        "Unit 9 is a device that chance has made (tests/support/random_devices.py, seed 303): "
        "floats in both orders, totals that start big, signed and 64-bit numbers, text, states, "
        "constants, polled in blocks 64 times. Reads of up to 14 bytes.",
        _plant,
        line="57600-8E1",
        healthy=True,
    ),
    "pymodbus_two_units": Recipe(
        "A poll cycle of units 1 and 2, 63 transactions, reads of up to 125 registers. "
        "The tap's receiver hands over 8 characters at a time, or fewer after 4 silent ones, as a "
        "16550 does: reads end anywhere in a frame. The units hear the master only (four-wire "
        "line): a pymodbus server goes deaf on a line where it hears another unit's answers.",
        _two_units,
        healthy=True,
    ),
    **TROUBLE_RECIPES,
}


def record(name: str, into: Path = CAPTURES) -> Path:
    """Record the capture `name` again and return its folder, `into/name`.

    Raises KeyError for an unknown name, DisagreementError when tap, bus and participants do not
    agree; then nothing of an older recording is touched.
    """
    recipe = RECIPES[name]
    folder = into / name
    with tempfile.TemporaryDirectory() as scratch:
        log = Path(scratch) / "recording.jsonl"
        outcome = run_scenario(recipe.run_scenario(), log)
        frames = expected_frames(outcome.truth, outcome.traced, recipe.mode)
        if outcome.heard.hex() != "".join(str(frame["hex"]) for frame in frames):
            raise DisagreementError(f"{name}: the tap did not hear what was sent")
        folder.mkdir(parents=True, exist_ok=True)
        (folder / log.name).write_bytes(log.read_bytes())
    (folder / "frames.jsonl").write_text(frame_lines(frames), encoding="ascii")
    (folder / "about.toml").write_text(_about(name, recipe), encoding="utf-8")
    return folder


def frame_lines(frames: Sequence[Frame]) -> str:
    """Return the text of a `frames.jsonl`."""
    return "".join(json.dumps(frame) + "\n" for frame in frames)


def toml_text(table: Mapping[str, str | bool]) -> str:
    """Return a flat table of texts as TOML; a string or truth value of JSON is one of TOML."""
    lines = (f"{key} = {json.dumps(text, ensure_ascii=False)}\n" for key, text in table.items())
    return "".join(lines)


def _about(name: str, recipe: Recipe) -> str:
    command = f"modlens decode captures/{name}/recording.jsonl --line {recipe.line}"
    tools = [f"{tool} {version(tool)}" for tool in ("pymodbus", "pyserial")]
    python = f"{platform.python_implementation()} {platform.python_version()}"
    return toml_text(
        {
            "name": name,
            "file": "recording.jsonl",
            "format": "chunks",
            "origin": "recorded for modlens: python -m tests.support.recording " + name,
            "licence": "MIT, as modlens",
            "line": recipe.line,
            "mode": recipe.mode,
            "shows": recipe.shows,
            "healthy": recipe.healthy,
            "recorded_with": f"{', '.join(tools)}, {python}, tests/support/ptybus.py on Linux ptys "
            "(paced like the line above; a pty carries no parity bit)",
            "expected_source": EXPECTED_SOURCE,
            "command": command,
        }
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Record what the command line names."""
    parser = argparse.ArgumentParser(prog="python -m tests.support.recording", description=__doc__)
    parser.add_argument("name", choices=["all", *RECIPES])
    parser.add_argument("--into", type=Path, default=CAPTURES, help="folder of the captures")
    options = parser.parse_args(arguments)
    logging.disable(logging.CRITICAL)  # pymodbus logs each timeout that was asked for
    for name in RECIPES if options.name == "all" else [options.name]:
        folder = record(name, options.into)
        size = (folder / "recording.jsonl").stat().st_size
        print(f"{name}: {size} bytes")  # noqa: T201 - the command line's own output


if __name__ == "__main__":
    main()
