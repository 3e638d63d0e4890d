"""Several ports at once, in order of arrival.

One port is read directly. More than one takes a thread each, so that a wait for one does not spoil
the times of the other; the threads only read and hand over, everything else stays on the caller's
thread.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Generator, Sequence

from analyzer.sources.serial import Chunk, Port
from dissectors.errors import PortError

__all__ = ["arrivals"]

Arrival = tuple[int, Chunk]
"""The number of the port, and what came in."""


def arrivals(ports: Sequence[Port], patience: float) -> Generator[Arrival | None]:
    """What comes in, for ever; None whenever nothing came for `patience` seconds.

    `PortError` if a port is lost. Close the iterator (or let go of it) to end the threads.
    """
    if len(ports) == 1:
        while True:
            chunk = ports[0].read(patience)
            yield None if chunk is None else (0, chunk)
    else:
        yield from _threaded(ports, patience)


def _threaded(ports: Sequence[Port], patience: float) -> Generator[Arrival | None]:
    arrived: queue.SimpleQueue[Arrival | PortError] = queue.SimpleQueue()
    stop = threading.Event()

    def listen(number: int, port: Port) -> None:
        try:
            while not stop.is_set():
                chunk = port.read(patience)
                if chunk is not None:
                    arrived.put((number, chunk))
        except PortError as error:
            arrived.put(error)

    threads = [
        threading.Thread(target=listen, args=pair, name=f"tap {pair[1].name}", daemon=True)
        for pair in enumerate(ports)
    ]
    for thread in threads:
        thread.start()
    try:
        while True:
            try:
                arrival = arrived.get(timeout=patience)
            except queue.Empty:
                yield None
                continue
            if isinstance(arrival, PortError):
                raise arrival
            yield arrival
    finally:
        stop.set()
        for thread in threads:
            thread.join()
