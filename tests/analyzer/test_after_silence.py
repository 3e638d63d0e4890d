"""After a request that nobody answered comes the next one, though it may look like a response."""

from __future__ import annotations

from pathlib import Path

import pytest

import modlens
from tests.support.ordinary_traffic import framed


def log_of(path: Path, last: list[bytes]) -> Path:
    """A log of sixteen good polls, a write without response, and 200 ms later an exchange.

    A response comes 4 ms after its request, and the next request 6 ms after that.
    """
    lines, now = [], 1_700_000_000_000_000
    polls = [bytes([unit, 3, 1, unit, 0, 2]) for unit in range(1, 9)] * 2
    for poll in polls:
        answer = bytes([poll[0], 3, 4, 0, poll[0], 19, 136])
        for adu, wait in ((poll, 6000), (answer, 4000)):
            now += wait
            lines.append((now, adu))
    unanswered = bytes.fromhex("01 10 00 db 00 01 02 05 5a")
    for adu, wait in ((unanswered, 6000), (last[0], 205_000), (last[1], 4000), (polls[0], 6000)):
        now += wait
        lines.append((now, adu))
    text = [f"{at // 1_000_000}.{at % 1_000_000:06} {framed(adu).hex(' ')}\n" for at, adu in lines]
    path.write_text("".join(text))
    return path


@pytest.mark.parametrize(
    "exchange",
    [
        ("07 05 03 22 ff 00", "07 05 03 22 ff 00"),
        ("07 06 03 22 00 07", "07 06 03 22 00 07"),
        # Eight inputs from 0x0329 on: it may as well be 24 of them.
        ("02 02 03 29 00 08", "02 02 01 a7"),
    ],
)
def test_an_exchange_after_a_timeout(tmp_path: Path, exchange: tuple[str, str]) -> None:
    log = log_of(tmp_path / "line.log", [bytes.fromhex(frame) for frame in exchange])
    rows = list(modlens.decode(log).transactions)
    silent, last = rows[16], rows[17]
    assert (silent.status, silent.function) == ("no_response", 16)
    assert (last.status, last.unit) == ("ok", int(exchange[0][:2], 16))
    assert not last.findings
