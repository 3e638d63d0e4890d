"""A hostile program between Modbus/TCP clients and a gateway: it drops, repeats, delays and swaps.

    hostile = HostileProxy(5)
    port = hostile.listen(gateway_port)
    hostile.run(port)              # clients that bear it, until all faults are planted
    hostile.compare(named)         # what each request was called, against what was done to it

Clients and the program know each other by the order of their connections only, as `Relay` does.
"""

from __future__ import annotations

import contextlib
import random
import socket
import struct
import threading
import time
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field

__all__ = ["KINDS", "HostileProxy"]

KINDS = ("dropped", "cached", "late_answer", "wrong_client")
FIRST_CLIENT = 21
CLIENTS = 3
CLIENT_TIMEOUT_S = 3.0
"""Longer than the gateway takes with a request that it sends twice."""
SWAP_S = 0.3
"""So long an answer waits for the one that it is swapped with."""
GIVES_UP_S = 0.2
"""So long the program waits before it says that nobody answered."""
APART_S = 0.5
NO_RESPONSE = b"\x83\x0b"


@dataclass
class Swap:
    """Two clients whose answers wait for each other."""

    clients: list[int]
    answers: dict[int, bytes] = field(default_factory=dict)
    is_given_up: bool = False


class HostileProxy:
    """Hands requests on; plants `each` faults of every kind, one after the other."""

    def __init__(self, each: int, *, seed: int = 1) -> None:
        """Listen later."""
        self._chance = random.Random(seed)
        self._left = dict.fromkeys(KINDS, each)
        self._next = time.monotonic() + 2
        self._lock = threading.Condition()
        self._swap: Swap | None = None
        self._swap_of: dict[int, Swap] = {}
        self._kept: dict[int, bytes] = {}
        self._answers: dict[tuple[int, bytes], bytes] = {}
        self.done: defaultdict[int, dict[int, str]] = defaultdict(dict)
        """By client and transaction id: what was done, where it was not forwarded as it should."""
        self.asked: dict[int, int] = {}

    def listen(self, behind: int) -> int:
        """Serve a port of its own, the gateway's being `behind`."""
        listener = socket.create_server(("127.0.0.1", 0))
        threading.Thread(target=self._accept, args=(listener, behind), daemon=True).start()
        port: int = listener.getsockname()[1]
        return port

    def _accept(self, listener: socket.socket, behind: int) -> None:
        for number in range(FIRST_CLIENT, FIRST_CLIENT + CLIENTS):
            client, _ = listener.accept()
            server = socket.create_connection(("127.0.0.1", behind))
            arguments = (number, client, server)
            threading.Thread(target=self._serve, args=arguments, daemon=True).start()
        listener.close()

    def _serve(self, who: int, client: socket.socket, server: socket.socket) -> None:
        with client, server, contextlib.suppress(OSError):
            while frame := receive(client):
                request = frame[6:]
                fault = self._fault(who, request)
                answer = getattr(self, f"_{fault}")(who, frame, server)
                if answer is not None:
                    client.sendall(frame[:4] + struct.pack(">H", len(answer)) + answer)

    def _fault(self, who: int, request: bytes) -> str:
        """What to do to a request; only to own registers: answers have to tell clients apart."""
        is_own = struct.unpack(">H", request[2:4])[0] < 1000
        with self._lock:
            if who in self._kept:
                return "late_answer"
            if self._swap is not None:
                return self._joins(self._swap, who) if is_own else "forwarded"
            left = [kind for kind, count in self._left.items() if count]
            if not left or not is_own or time.monotonic() < self._next:
                return "forwarded"
            kind = self._chance.choice(left)
            if kind == "cached" and (who, request) not in self._answers:
                return "forwarded"
            self._left[kind] -= 1
            self._next = time.monotonic() + APART_S
            if kind == "wrong_client":
                self._swap = self._swap_of[who] = Swap([who])
            return {"late_answer": "gateway_timeout", "wrong_client": "swapped"}.get(kind, kind)

    def _joins(self, swap: Swap, who: int) -> str:
        """The second client of a swap takes part in it."""
        if len(swap.clients) == 2 or who in swap.clients:
            return "forwarded"
        swap.clients.append(who)
        self._swap_of[who] = swap
        return "swapped"

    def _forwarded(self, who: int, frame: bytes, server: socket.socket) -> bytes | None:
        server.sendall(frame)
        answer = receive(server)[6:]
        self._answers[who, frame[6:]] = answer
        return answer

    def _note(self, who: int, frame: bytes, kind: str) -> None:
        self.done[who][int.from_bytes(frame[:2])] = kind

    def _dropped(self, who: int, frame: bytes, _server: socket.socket) -> None:
        self._note(who, frame, "dropped")

    def _cached(self, who: int, frame: bytes, _server: socket.socket) -> bytes:
        self._note(who, frame, "cached")
        return self._answers[who, frame[6:]]

    def _gateway_timeout(self, who: int, frame: bytes, server: socket.socket) -> bytes:
        """Keep the answer, and say that none came; the next request gets it."""
        answer = self._forwarded(who, frame, server)
        time.sleep(GIVES_UP_S)
        with self._lock:
            self._kept[who] = answer or b""
        self._note(who, frame, "gateway_timeout")
        return frame[6:7] + NO_RESPONSE

    def _late_answer(self, who: int, frame: bytes, server: socket.socket) -> bytes:
        self._forwarded(who, frame, server)
        self._note(who, frame, "late_answer")
        with self._lock:
            return self._kept.pop(who)

    def _swapped(self, who: int, frame: bytes, server: socket.socket) -> bytes | None:
        """Wait for the answer to another client, and give each the other one's."""
        swap = self._swap_of.pop(who)
        answer = self._forwarded(who, frame, server) or b""
        with self._lock:
            swap.answers[who] = answer
            self._lock.notify_all()
            self._lock.wait_for(lambda: len(swap.answers) == 2, SWAP_S)
            if self._swap is swap:
                # The first one that goes on decides for both.
                self._swap, swap.is_given_up = None, len(swap.answers) < 2
                self._left["wrong_client"] += swap.is_given_up
            if swap.is_given_up:
                return answer
            self._note(who, frame, "wrong_client")
            return next(one for client, one in swap.answers.items() if client != who)

    def run(self, port: int) -> None:
        """Run clients on a port until all faults are planted, and a second more."""
        over = threading.Event()
        clients = [
            threading.Thread(target=self._ask, args=(port, place, over)) for place in range(CLIENTS)
        ]
        for client in clients:
            client.start()
            # The order of connections is that of names.
            time.sleep(0.2)
        while any(self._left.values()) or self._swap is not None or self._kept:
            time.sleep(0.1)
        time.sleep(1.5)
        over.set()
        for client in clients:
            client.join()
        time.sleep(0.2)

    def _ask(self, port: int, place: int, over: threading.Event) -> None:
        """A client that waits, gives up, and goes on."""
        who = FIRST_CLIENT + place
        with socket.create_connection(("127.0.0.1", port)) as line:
            line.settimeout(CLIENT_TIMEOUT_S)
            number = 0
            while not over.is_set():
                number += 1
                address = 1000 if number % 3 == 0 else 100 * (place + 1) + number % 4 * 10
                pdu = struct.pack(">BHH", 3, address, 4)
                line.sendall(struct.pack(">HHHB", number, 0, 6, 1) + pdu)
                with contextlib.suppress(TimeoutError):
                    receive(line)
                time.sleep(0.05 + 0.01 * place)
        self.asked[who] = number

    def compare(self, named: Iterable[tuple[str, str]]) -> dict[str, tuple[int, int]]:
        """Of each kind: how many were planted, and how many were called so.

        `named` is the client and the outcome of each request, in the order of requests.
        """
        numbers: defaultdict[str, int] = defaultdict(int)
        counts: defaultdict[str, list[int]] = defaultdict(lambda: [0, 0])
        for client, outcome in named:
            numbers[client] += 1
            who = int(client.rpartition(".")[2])
            kind = self.done[who].get(numbers[client], "forwarded")
            counts[kind][0] += 1
            counts[kind][1] += outcome == kind
        assert sum(numbers.values()) == sum(self.asked.values()), (numbers, self.asked)
        return {kind: (planted, found) for kind, (planted, found) in sorted(counts.items())}


def receive(connection: socket.socket) -> bytes:
    """The next frame; empty at the end."""
    head = connection.recv(6, socket.MSG_WAITALL)
    if len(head) < 6:
        return b""
    return head + connection.recv(int.from_bytes(head[4:6]), socket.MSG_WAITALL)
