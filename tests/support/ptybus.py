"""A half-duplex RS-485 line made of pseudo terminals, with the pacing of a real one.

Every participant gets the path of a pty slave, which it opens like a serial port. What one writes
is delivered to the others (never back to itself), a character when its last stop bit would have
ended. Ptys carry no parity and no line errors: `baud` and `char_bits` set the times only, whatever
the participants ask of their port. Linux only; no collisions (see `tests.support.line`
and `tests.support.colliding_line`).

    with PtyBus(["master", "unit1", "tap"]) as bus:
        with ChunkLogRecorder(bus.path("tap"), "bus.jsonl") as recorder:
            port = os.open(bus.path("master"), os.O_RDWR | os.O_NOCTTY)
            os.write(port, bytes.fromhex("010300000001840a"))
            recorder.wait_for(8)
    bus.truth[0].sender   # 'master'
"""

from __future__ import annotations

import os
import select
import threading
import time
import tty
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self, TextIO

from tests.support.line import HalfDuplexLine, Transmission

READ_SIZE = 4096
NS_PER_S = 1_000_000_000
EPOCH_NS = time.time_ns() - time.monotonic_ns()
"""Added to the monotonic clock: bus and recorder share one time since 1970 that never runs back."""


class BusError(Exception):
    """The bus or a recorder broke down; the message says where, the cause is chained."""


@dataclass(frozen=True, slots=True)
class Sent:
    """What one write put on the line: the ground truth of who sent what, and when.

    `time_ns` is the start of the first character and `end_ns` the end of the last stop bit, in
    nanoseconds since 1970. `data` is what the line carried, `written` what the sender wrote.
    """

    time_ns: int
    end_ns: int
    sender: str
    data: bytes
    written: bytes


class PtyBus:
    """A line with `participants`; opened by `with`.

    `trigger` is the receivers' FIFO level in characters (1: each character by itself). A sender
    that was not the last one to send waits for `turnaround_chars` of silence, 3.5 being what the
    serial line specification asks for (2.5.1.1); 0 leaves it to the participants.

    `hears` maps a participant to the senders it hears, for those who do not hear everybody: the
    units of a four-wire line hear the master only. `disturb(sender, written)` returns what the line
    carries instead of `written`: flipped bits, less, or nothing (`b""`); it runs in the bus thread.

    `line` is the model of the line: `CollidingLine` has collisions.

    Open all ports before the first byte is sent: a pty keeps what nobody reads. What no longer fits
    into a pty that nobody reads is lost, as in a UART, and counted in `lost`.
    Raises ValueError for names or settings that make no sense.
    """

    def __init__(  # noqa: PLR0913 - a line has that many settings, most by keyword
        self,
        participants: Sequence[str],
        baud: int = 19200,
        char_bits: int = 11,
        *,
        trigger: int = 1,
        turnaround_chars: float = 0.0,
        hears: Mapping[str, Collection[str]] | None = None,
        disturb: Callable[[str, bytes], bytes] | None = None,
        line: type[HalfDuplexLine] = HalfDuplexLine,
    ) -> None:
        """Describe the line; nothing is opened yet."""
        self.participants = tuple(participants)
        self.char_ns = char_bits * NS_PER_S // baud
        self.lost = dict.fromkeys(self.participants, 0)
        listeners = _listeners(self.participants, hears or {})
        turnaround_ns = round(turnaround_chars * self.char_ns)
        self._line = line(listeners, self.char_ns, trigger, turnaround_ns)
        self._disturb = disturb
        self._changed = threading.Condition()
        self._truth: list[Sent] = []
        self._failure: Exception | None = None
        self._stopping = False
        self._thread = threading.Thread(target=self._run, name="ptybus", daemon=True)
        self._masters: dict[str, int] = {}
        self._slaves: dict[str, int] = {}
        self._wake: tuple[int, int] = (-1, -1)

    def __enter__(self) -> Self:
        """Make the ptys and start forwarding; OSError when the system has no pty left."""
        try:
            for name in self.participants:
                master, slave = os.openpty()
                self._masters[name], self._slaves[name] = master, slave
                os.set_blocking(master, False)
                tty.setraw(slave)  # no echo, no translation of CR and LF
            self._wake = os.pipe()
        except OSError:
            self._close_files()
            raise
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Stop forwarding and close the ptys; BusError if the bus thread had broken down."""
        self._stopping = True
        self._wake_up()
        self._thread.join()
        self._close_files()
        if error is None:
            self._raise_failure()

    def path(self, participant: str) -> str:
        """Return the path that `participant` opens as its serial port; KeyError if unknown."""
        return os.ttyname(self._slaves[participant])

    @property
    def truth(self) -> tuple[Sent, ...]:
        """What the line has carried so far, in wire order; noise is in it too.

        A write that the system hands over in parts makes several entries without a gap.
        """
        with self._changed:
            return tuple(self._truth)

    def inject(self, data: bytes, sender: str = "noise") -> None:
        """Put `data` on the line as soon as it is free; all receive it undisturbed."""
        noise = Transmission(sender, data, data, time.monotonic_ns(), turnaround=False)
        with self._changed:
            self._line.submit(noise)
        self._wake_up()

    def wait_idle(self, carried: int = 0, timeout: float = 10.0) -> None:
        """Wait until the line is idle and has carried `carried` bytes in all; at most `timeout` s.

        A write that has not yet come out of its pty is not seen: say how many bytes to wait for.
        Raises TimeoutError, or BusError if the bus thread has broken down.
        """

        def settled() -> bool:
            done = sum(len(sent.data) for sent in self._truth) >= carried
            return self._failure is not None or (done and self._line.idle)

        with self._changed:
            if not self._changed.wait_for(settled, timeout):
                raise TimeoutError(f"line not idle with {carried} bytes carried after {timeout} s")
        self._raise_failure()

    def _raise_failure(self) -> None:
        if self._failure is not None:
            raise BusError("the thread of the bus broke down") from self._failure

    def _wake_up(self) -> None:
        os.write(self._wake[1], b"w")

    def _close_files(self) -> None:
        for file in (*self._masters.values(), *self._slaves.values(), *self._wake):
            if file >= 0:
                os.close(file)
        self._masters, self._slaves, self._wake = {}, {}, (-1, -1)

    def _run(self) -> None:
        try:
            while not self._stopping:
                self._forward()
        except Exception as error:  # whatever it is: those who wait must hear of it
            with self._changed:
                self._failure = error
                self._changed.notify_all()

    def _forward(self) -> None:
        with self._changed:
            due_ns = self._line.next_due_ns()
        wait = None if due_ns is None else max(0, due_ns - time.monotonic_ns()) / NS_PER_S
        # select, because poll and epoll round the time up to whole milliseconds
        ready, _, _ = select.select([self._wake[0], *self._masters.values()], [], [], wait)
        if self._wake[0] in ready:
            os.read(self._wake[0], READ_SIZE)
        with self._changed:
            for sender, master in self._masters.items():
                if master in ready:
                    self._accept(sender, os.read(master, READ_SIZE))
            for receiver, data in self._line.advance(time.monotonic_ns()):
                self._deliver(receiver, data)
            self._keep_truth()
            self._changed.notify_all()

    def _accept(self, sender: str, written: bytes) -> None:
        data = self._disturb(sender, written) if self._disturb else written
        self._line.submit(Transmission(sender, written, data, time.monotonic_ns()))

    def _deliver(self, receiver: str, data: bytes) -> None:
        try:
            taken = os.write(self._masters[receiver], data)
        except BlockingIOError:
            taken = 0
        self.lost[receiver] += len(data) - taken

    def _keep_truth(self) -> None:
        for done in self._line.take_finished():
            start_ns = EPOCH_NS + (done.start_ns or 0)
            end_ns = EPOCH_NS + done.end_ns
            self._truth.append(Sent(start_ns, end_ns, done.sender, done.data, done.written))


class ChunkLogRecorder:
    """Reads a serial port or pty and writes each read as a line of a chunk log.

    A line is `{"t": <seconds since 1970, 6 digits>, "hex": "<lower case>"}`; `t` is the time at
    which the read returned, rounded up, so that it is never before the last stop bit. The reads are
    also kept in `chunks` as (nanoseconds since 1970, bytes). Used by `with`; never writes to the
    port. `log_path` None keeps no file. Raises OSError when port or file cannot be opened.
    """

    def __init__(self, port_path: str, log_path: Path | None = None) -> None:
        """Name port and file; nothing is opened yet."""
        self.chunks: list[tuple[int, bytes]] = []
        self._port_path = port_path
        self._log_path = log_path
        self._changed = threading.Condition()
        self._failure: Exception | None = None
        self._thread = threading.Thread(target=self._run, name="chunk log", daemon=True)
        self._port = -1
        self._wake: tuple[int, int] = (-1, -1)
        self._log: TextIO | None = None

    def __enter__(self) -> Self:
        """Open port and file, start reading."""
        self._port = os.open(self._port_path, os.O_RDONLY | os.O_NOCTTY)
        self._wake = os.pipe()
        if self._log_path is not None:
            self._log = self._log_path.open("w", encoding="ascii", newline="\n")
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Stop reading and close the file; BusError if reading had failed."""
        os.write(self._wake[1], b"w")
        self._thread.join()
        for file in (self._port, *self._wake):
            os.close(file)
        if self._log is not None:
            self._log.close()
        if error is None and self._failure is not None:
            raise BusError(f"recording {self._port_path} broke down") from self._failure

    @property
    def data(self) -> bytes:
        """All bytes read so far."""
        with self._changed:
            return b"".join(data for _, data in self.chunks)

    def wait_for(self, count: int, timeout: float = 10.0) -> None:
        """Wait until `count` bytes in all have been read; TimeoutError after `timeout` seconds."""

        def complete() -> bool:
            got = sum(len(data) for _, data in self.chunks)
            return self._failure is not None or got >= count

        with self._changed:
            if not self._changed.wait_for(complete, timeout):
                raise TimeoutError(f"{count} bytes did not come within {timeout} s")

    def _run(self) -> None:
        try:
            while True:
                ready, _, _ = select.select([self._port, self._wake[0]], [], [])
                if self._port not in ready:
                    return
                self._keep(os.read(self._port, READ_SIZE))
        except Exception as error:  # whatever it is: those who wait must hear of it
            with self._changed:
                self._failure = error
                self._changed.notify_all()

    def _keep(self, data: bytes) -> None:
        time_ns = EPOCH_NS + time.monotonic_ns()
        if self._log is not None:
            self._log.write(chunk_line(time_ns, data))
        with self._changed:
            self.chunks.append((time_ns, data))
            self._changed.notify_all()


def chunk_line(time_ns: int, data: bytes) -> str:
    """Return the chunk log line, with its newline, of a read that returned at `time_ns`."""
    seconds, micros = divmod(-(-time_ns // 1000), 1_000_000)
    return f'{{"t": {seconds}.{micros:06d}, "hex": "{data.hex()}"}}\n'


def flip_bit(data: bytes, bit: int) -> bytes:
    """Return `data` with one bit inverted; bit 0 is the lowest of byte 0, bit 8 that of byte 1."""
    damaged = bytearray(data)
    damaged[bit // 8] ^= 1 << bit % 8
    return bytes(damaged)


def _listeners(
    participants: Sequence[str], hears: Mapping[str, Collection[str]]
) -> dict[str, list[str]]:
    """Invert the mapping from each participant to those it receives."""
    if len(set(participants)) != len(participants):
        raise ValueError(f"participants named twice: {list(participants)}")
    named = set(hears).union(*hears.values())
    if unknown := named.difference(participants):
        raise ValueError(f"hears names who is not on the bus: {sorted(unknown)}")
    return {
        sender: [
            name for name in participants if name != sender and sender in hears.get(name, (sender,))
        ]
        for sender in participants
    }
