"""A half-duplex serial line as a calculation: who sends when, who has received what by now.

It is the timing half of `tests.support.ptybus`: no port, no clock and no thread in here, so that it
can be tested with invented times. It is not a model of collisions: what is written while somebody
else is sending waits until the line is free.

All times are integer nanoseconds of one clock that never runs back.

>>> line = HalfDuplexLine({"master": ("unit",), "unit": ("master",)}, char_ns=1_000)
>>> line.submit(Transmission("master", b"ab", b"ab", submitted_ns=0))
>>> line.advance(1_500)
[('unit', b'a')]
>>> line.next_due_ns()
2000
>>> line.advance(2_000)
[('unit', b'b')]
"""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

FIFO_TIMEOUT_CHARS = 4
"""A 16550 reports a partly filled receive FIFO after four character times of silence."""

MAX_TRIGGER = 14
"""The highest trigger level of a 16550; its FIFO holds 16 characters."""


@dataclass(slots=True)
class Transmission:
    """One unbroken run of characters of one sender.

    `written` is what the sender handed over, `data` what the line carries (different only where a
    test disturbs the line). `turnaround` says whether the sender keeps the silence that the line
    asks for after somebody else's characters; noise does not.
    """

    sender: str
    written: bytes
    data: bytes
    submitted_ns: int
    turnaround: bool = True
    start_ns: int | None = None
    end_ns: int = 0
    received: int = 0


@dataclass(slots=True)
class _Receiver:
    pending: bytearray = field(default_factory=bytearray)
    last_ns: int = 0


class HalfDuplexLine:
    """Paces transmissions one after the other and hands out what receivers have got.

    `listeners` maps each participant to those who hear it when it sends; a sender that is not named
    there (noise) is heard by all of them. `char_ns` is the duration of a character with start,
    parity and stop bits. A receiver hands over its characters when `trigger` of them have come or
    when nothing came for four character times. A sender that was not the last one to send waits
    until the line has been silent for `turnaround_ns`.
    """

    def __init__(
        self,
        listeners: Mapping[str, Collection[str]],
        char_ns: int,
        trigger: int = 1,
        turnaround_ns: int = 0,
    ) -> None:
        """Start with a silent line; ValueError for settings that make no sense."""
        if char_ns <= 0:
            raise ValueError(f"char_ns must be positive, not {char_ns}")
        if not 1 <= trigger <= MAX_TRIGGER:
            raise ValueError(f"trigger must be 1 to {MAX_TRIGGER} characters, not {trigger}")
        self._listeners = {sender: tuple(names) for sender, names in listeners.items()}
        self._char_ns = char_ns
        self._trigger = trigger
        self._turnaround_ns = turnaround_ns
        self._queue: deque[Transmission] = deque()
        self._finished: list[Transmission] = []
        self._receivers = {name: _Receiver() for name in listeners}
        self._free_ns = 0
        self._last_sender: str | None = None

    @property
    def idle(self) -> bool:
        """Nothing is being sent, waits to be sent, or lies in a receiver."""
        return not self._queue and not any(r.pending for r in self._receivers.values())

    def submit(self, transmission: Transmission) -> None:
        """Queue a transmission; it starts when the line is free, at `submitted_ns` the soonest."""
        self._queue.append(transmission)

    def take_finished(self) -> list[Transmission]:
        """Return the transmissions that ended since the last call, in wire order."""
        finished, self._finished = self._finished, []
        return finished

    def advance(self, now_ns: int) -> list[tuple[str, bytes]]:
        """Move on to `now_ns` and return what receivers hand over, as (receiver, bytes)."""
        while self._queue and self._send(self._queue[0], now_ns):
            self._finish(self._queue.popleft())
        delivered = []
        for name, receiver in self._receivers.items():
            if receiver.pending and self._hands_over(receiver, now_ns):
                delivered.append((name, bytes(receiver.pending)))
                receiver.pending.clear()
        return delivered

    def next_due_ns(self) -> int | None:
        """Return the time at which `advance` will next have something to do, None if never."""
        due = [
            receiver.last_ns + FIFO_TIMEOUT_CHARS * self._char_ns
            for receiver in self._receivers.values()
            if receiver.pending
        ]
        if self._queue:
            head = self._queue[0]
            due.append(self._start(head) + (head.received + 1) * self._char_ns)
        return min(due, default=None)

    def _start(self, transmission: Transmission) -> int:
        if transmission.start_ns is None:
            start_ns = max(transmission.submitted_ns, self._free_ns)
            turned = self._last_sender not in (None, transmission.sender)
            if transmission.turnaround and turned:
                start_ns = max(start_ns, self._free_ns + self._turnaround_ns)
            transmission.start_ns = start_ns
            transmission.end_ns = start_ns + len(transmission.data) * self._char_ns
        return transmission.start_ns

    def _send(self, transmission: Transmission, now_ns: int) -> bool:
        """Let the characters arrive whose stop bits have ended; say whether that was the last."""
        start_ns = self._start(transmission)
        ended = max(0, (now_ns - start_ns) // self._char_ns)
        arrived = transmission.data[transmission.received : ended]
        transmission.received += len(arrived)
        if arrived:
            for name in self._listeners.get(transmission.sender, self._receivers):
                receiver = self._receivers[name]
                receiver.pending += arrived
                receiver.last_ns = start_ns + transmission.received * self._char_ns
        return transmission.received == len(transmission.data)

    def _finish(self, transmission: Transmission) -> None:
        if transmission.data:
            self._free_ns = transmission.end_ns
        if transmission.data and transmission.turnaround:
            self._last_sender = transmission.sender
        self._finished.append(transmission)

    def _hands_over(self, receiver: _Receiver, now_ns: int) -> bool:
        silent_ns = now_ns - receiver.last_ns
        full = len(receiver.pending) >= self._trigger
        return full or silent_ns >= FIFO_TIMEOUT_CHARS * self._char_ns
