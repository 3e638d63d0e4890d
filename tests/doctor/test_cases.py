"""The generators: every kind has recordings, chance repeats itself, and what is sent is heard."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from random import Random

import pytest

from analyzer import decode
from analyzer.line import Line
from tests.doctor.captured import TROUBLED, captures
from tests.doctor.cases import COUNTER_CASES, KINDS, make
from tests.doctor.examine import written
from tests.doctor.frames import read_answer, read_request, rtu
from tests.doctor.healthy import LINES, STYLES, healthy_line
from tests.doctor.line_model import Exchange, Habits, Master, Trouble
from tests.doctor.network import Network
from tests.doctor.plant import random_plant
from tests.doctor.recorded import READS, chunk_log, own_bytes_left_out, reads_of
from tests.doctor.wire import Pair

CODES = """
    slow_answers lockstep no_bias polled_too_fast swapped_wires address_off_by_one word_order
    connection_limit two_masters line_noise framing_mismatch driver_enable dead_unit_cost
    register_hole block_too_long gateway_unit_id value_spike bystander connection_churn
    wrong_line_settings gateway_mixup own_echo device_busy wrong_function gaps_in_frames
    duplicate_address foreign_protocol unexpected_writer device_absent bus_saturated wrong_layout
    value_refused
""".split()


def test_each_of_the_32_kinds_has_a_generator() -> None:
    assert sorted(KINDS) == sorted(CODES)
    assert len(set(CODES)) == 32


def test_recorded_troubles_are_kinds_and_no_healthy_line() -> None:
    ill = {capture.name for capture in captures() if not capture.healthy}
    assert set(TROUBLED) <= ill
    assert {expected.code for expected in TROUBLED.values()} <= set(CODES)


@pytest.mark.parametrize("name", [*KINDS, *COUNTER_CASES])
def test_a_seed_gives_the_same_recording_each_time(name: str) -> None:
    case, again, other = make(name, 1), make(name, 1), make(name, 2)
    assert case == again
    assert case.files != other.files
    assert case.files[case.main]
    assert case.main in case.files
    assert case.expected is None or case.expected.code not in case.forbidden


@pytest.mark.parametrize("style", range(len(STYLES)))
def test_healthy_lines_have_hardly_a_damaged_frame(style: int, tmp_path: Path) -> None:
    """Counted by decoding: at most what 0.1 % of accidents can give, with room for chance."""
    case = healthy_line(style + len(STYLES))
    folder = written(case, tmp_path)
    rows = list(decode(folder / case.main))
    failed = [row for row in rows if row.status not in ("ok", "exception")]
    assert len(rows) >= 60
    assert len(failed) <= 3 + len(rows) // 200
    assert style < LINES


def test_both_settings_and_both_senders_decide_what_is_heard() -> None:
    """Two frames at once: the AND of their bits; at another rate: something else, or less."""
    line = Line(9600, 8, "N", 1)
    pair = Pair(line)
    pair.put(0.0, b"\x0f\x03")
    pair.put(0.0, b"\x3c\x05")
    assert bytes(byte for _, byte in pair.heard()) == bytes([0x0F & 0x3C, 0x03 & 0x05])
    slow = Pair(line)
    slow.put(0.0, b"\x55\x55", line=Line(4800, 8, "N", 1))
    assert len(slow.heard()) > 2
    swapped = Pair(line, inverted=True)
    swapped.put(0.0, rtu(1, read_request(3, 0, 1)))
    assert swapped.heard()[-1][1] == 0


def test_a_clean_line_is_read_as_it_was_sent() -> None:
    """Every exchange of the model is a transaction with the same request and its answer."""
    rng = Random(3)
    line = Line(19_200, 8, "E", 1)
    master = Master(Pair(line), random_plant(rng), Habits(), rng)
    exchanges = master.run(100)
    heard = master.pair.heard()
    sent = b"".join(one.data for one in sorted(master.pair.sent, key=lambda one: one.start_s))
    assert bytes(byte for _, byte in heard) == sent
    assert all(one.outcome == "ok" for one in exchanges)
    answers = own_bytes_left_out(exchanges, heard, 11 / 19_200)
    assert len(answers) == len(heard) - sum(len(one.request) for one in exchanges)


@pytest.mark.parametrize("how", READS)
def test_reads_hold_all_bytes_and_are_never_early(how: str) -> None:
    heard = [(0.001 * place + 0.0004, place) for place in range(50)]
    reads = list(reads_of(heard, how, 0.0005))
    assert b"".join(data for _, data in reads) == bytes(range(50))
    at = 0
    for time_s, data in reads:
        at += len(data)
        assert time_s >= heard[at - 1][0]
    assert chunk_log(heard, how).count(b"\n") == len(list(reads_of(heard, how, 0.0)))


def test_a_trouble_knows_what_was_before() -> None:
    """Silence, unit and outcome of the exchange before, and the time since a write."""
    seen: list[Exchange] = []

    class Watches(Trouble):
        """Notes each exchange."""

        def request(self, exchange: Exchange) -> bytes:
            """As it is."""
            seen.append(exchange)
            return exchange.request

    rng = Random(5)
    habits = Habits(pauses_s=(0.05,))
    Master(Pair(Line(9600)), random_plant(rng), habits, rng, Watches()).run(30)
    assert all(one.silence_s == pytest.approx(0.05) for one in seen[1:])
    assert [one.before for one in seen[1:]] == seen[:-1]


def test_a_capture_holds_the_packets_of_a_connection() -> None:
    """By scapy: SYN, data with its acknowledgement, FIN from both; sequence numbers add up."""
    scapy = pytest.importorskip("scapy.all")
    network = Network()
    flow = network.flow("10.0.0.1", "10.0.0.2")
    flow.open(0.0)
    flow.send(0.1, True, read_request(3, 0, 2))
    flow.send(0.2, False, read_answer(3, [1, 2]))
    flow.close(0.3, by_client=False)
    packets = scapy.rdpcap(BytesIO(network.pcap()))
    assert [str(one[scapy.TCP].flags) for one in packets] == [
        *("S", "SA", "A"),
        *("PA", "A", "PA", "A"),
        *("FA", "FA", "A"),
    ]
    first, last = packets[0][scapy.TCP], packets[-1][scapy.TCP]
    assert last.ack == first.seq + 1 + 5 + 1
    assert bytes(packets[3][scapy.TCP].payload) == read_request(3, 0, 2)
