"""Datagrams of a serial device server."""

from __future__ import annotations

import socket
from contextlib import closing
from typing import Any

import pytest

from analyzer import PortError, UsageError
from analyzer.live_run import LiveRun
from analyzer.settings import Settings
from analyzer.sources.udp import open_port


def test_datagrams_are_decoded() -> None:
    """Empty ones mean nothing; nothing comes back to the sender."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.bind(("127.0.0.1", 0))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        with closing(LiveRun([f"udp://127.0.0.1:{port}"], Settings())) as run:
            for data in ("010300000001840a", "", "0103020007f986"):
                sender.sendto(bytes.fromhex(data), ("127.0.0.1", port))
            found: list[Any] = []
            for turn, batch in enumerate(run.batches()):
                found += batch.transactions
                if found:
                    break
                assert turn < 400
            assert [(row.unit, row.status, row.data) for row in found] == [(1, "ok", [7])]
            sender.setblocking(False)
            with pytest.raises(BlockingIOError):
                sender.recv(100)


def test_an_address_of_another_computer_is_an_error() -> None:
    with pytest.raises(PortError, match="an address of this computer"):
        open_port("udp://192.0.2.1:4001", None)


@pytest.mark.parametrize("name", ["udp://0.0.0.0", "udp://0.0.0.0:99999", "udp://"])
def test_a_port_is_needed(name: str) -> None:
    with pytest.raises(UsageError, match="write the address and port"):
        open_port(name, None)
