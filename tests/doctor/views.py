"""The same traffic as others would have recorded it: a capture of Modbus/TCP, logs of both sides.

A gateway is between a client of Modbus/TCP and the serial line, so that each exchange of a
model's master is one of a client as well: `capture` is what a mirror port sees of it, `client_log`
what the client's program writes, `server_log` what the gateway's does.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from tests.doctor.frames import crc, mbap
from tests.doctor.line_model import Exchange
from tests.doctor.network import Network
from tests.doctor.recorded import EPOCH_S
from tests.support.logs import LogEntry, write

__all__ = ["DIALECTS", "capture", "client_log", "server_log", "views_of"]

CLIENT, SERVER = "192.168.1.10", "192.168.1.50"
DIALECTS: Mapping[str, str] = {
    "milliseconds": "pymodbus",
    "seconds": "goburrow",
    "no clock": "libmodbus",
}
"""Programs that log with a clock of this resolution."""


def capture(exchanges: Sequence[Exchange]) -> bytes:
    """A pcap of the client's connection; the gateway hands whole frames on."""
    network = Network()
    flow = network.flow(CLIENT, SERVER)
    flow.open(exchanges[0].start_s - 0.01)
    for sent_s, number, by_client, frame in _frames(exchanges):
        flow.send(sent_s, by_client, mbap(number + 1, frame[0], frame[1:-2]))
    return network.pcap()


def _frames(exchanges: Sequence[Exchange]) -> list[tuple[float, int, bool, bytes]]:
    """Everything that was said, in the order of time; damaged answers are not handed on."""
    said = []
    for exchange in exchanges:
        said.append((exchange.start_s, exchange.number, True, exchange.request))
        for _, end_s, data in exchange.answered:
            if len(data) > 4 and crc(data) == 0:
                said.append((end_s, exchange.number, False, data))
    return sorted(said)


def client_log(exchanges: Sequence[Exchange], dialect: str) -> bytes:
    """Requests sent, answers received; one that comes while another is awaited is also reported."""
    return write(dialect, list(_entries(exchanges, sends=True))).encode()


def server_log(exchanges: Sequence[Exchange], dialect: str) -> bytes:
    """Requests received, answers sent."""
    return write(dialect, list(_entries(exchanges, sends=False))).encode()


def _entries(exchanges: Sequence[Exchange], *, sends: bool) -> Iterator[LogEntry]:
    for sent_s, _, by_client, frame in _frames(exchanges):
        yield LogEntry(round((EPOCH_S + sent_s) * 1e9), by_client == sends, frame)


def views_of(exchanges: Sequence[Exchange]) -> dict[str, bytes]:
    """All of them, by the name of a file."""
    views = {"gateway.pcap": capture(exchanges)}
    for clock, dialect in DIALECTS.items():
        views[f"client, {clock}.log"] = client_log(exchanges, dialect)
        views[f"server, {clock}.log"] = server_log(exchanges, dialect)
    return views
