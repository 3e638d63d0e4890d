"""pyserial's client for RFC 2217, with bounds: its device server may be anybody's.

pyserial queues every byte by itself and without a limit, keeps a suboption that never ends, answers
every option, and its thread dies of a suboption that ends without a beginning. Here the server
waits while `MAX_BLOCKS` wait to be read (TCP then slows it down), a longer suboption than RFC 2217
knows ends the connection, as does what makes no sense, and after `MAX_ANSWERS` options are ignored.
"""

from __future__ import annotations

import time
from typing import Any

from serial import rfc2217

__all__ = ["BoundedSerial"]

MAX_BLOCKS = 256
"""Blocks of at most 1,024 bytes that wait to be read."""

MAX_SUBOPTION = 256
"""The longest suboption of RFC 2217 is a signature, for which 256 bytes are plenty."""

MAX_ANSWERS = 64
"""Telnet has 40 registered options; a server negotiates fewer than ten."""

WAIT_S = 0.01

_IAC, _SB, _SE = 0xFF, 0xFA, 0xF0
_NEGOTIATION = range(0xFB, 0xFF)  # WILL, WONT, DO, DONT (RFC 854)


class BoundedSerial(rfc2217.Serial):
    """A connection to a device server that cannot take all memory."""

    _answers = 0
    _socket: Any
    _read_buffer: Any

    def telnet_send_option(self, action: bytes, option: bytes) -> None:
        """Send an option, unless too many were sent."""
        self._answers += 1
        if self._answers <= MAX_ANSWERS:
            super().telnet_send_option(action, option)

    def _telnet_read_loop(self) -> None:
        decoder = _Telnet(self)
        try:
            while self.is_open:
                try:
                    data = self._socket.recv(1024)
                except TimeoutError:
                    continue
                if not data or not decoder.push(data):
                    break
                while self.is_open and self._read_buffer.qsize() >= MAX_BLOCKS:
                    time.sleep(WAIT_S)
        except (OSError, ValueError, TypeError, AttributeError):
            pass  # the connection is lost or closed, or the server does not keep to RFC 2217
        # A reader that finds this thread ended reads no more: it gets what has come before.
        while self.is_open and self._read_buffer.qsize():
            time.sleep(WAIT_S)


class _Telnet:
    """Takes the commands out of the bytes (RFC 854), and passes the rest on in blocks."""

    def __init__(self, port: Any) -> None:
        self._port = port
        self._command: int | None = None
        self._has_iac = False
        self._suboption: bytearray | None = None

    def push(self, data: bytes) -> bool:
        """Take a block; whether the connection may go on."""
        plain = bytearray()
        for byte in data:
            self._take(byte, plain)
            if self._suboption is not None and len(self._suboption) > MAX_SUBOPTION:
                return False
        if plain:
            self._port._read_buffer.put(bytes(plain))
        return True

    def _take(self, byte: int, plain: bytearray) -> None:
        if self._command is not None:
            self._port._telnet_negotiate_option(bytes([self._command]), bytes([byte]))
            self._command = None
        elif self._has_iac:
            self._has_iac = False
            self._take_command(byte, plain)
        elif byte == _IAC:
            self._has_iac = True
        else:
            (plain if self._suboption is None else self._suboption).append(byte)

    def _take_command(self, byte: int, plain: bytearray) -> None:
        if byte == _IAC:  # doubled: a byte of the data
            (plain if self._suboption is None else self._suboption).append(byte)
        elif byte == _SB:
            self._suboption = bytearray()
        elif byte == _SE and self._suboption is not None:
            self._port._telnet_process_subnegotiation(bytes(self._suboption))
            self._suboption = None
        elif byte in _NEGOTIATION:
            self._command = byte
