"""The servers of `--serve` and `--web`: the line for other programs, and for browsers."""

from __future__ import annotations

import argparse
import os
from contextlib import ExitStack
from pathlib import Path

import _modlens
from analyzer.cli.tap_messages import TapMessages
from analyzer.sources.remote import TOKEN
from dissectors.errors import SourceError, UsageError

__all__ = ["WEB_PLACE", "TapServers"]


WEB_PLACE = "127.0.0.1:4080"
"""Where `--web` serves the page unless another place is named."""


class TapServers:
    """Serve what the tap reads; an observer of the run, because they report their clients."""

    name = "the servers"

    def __init__(self, options: argparse.Namespace, tap_messages: TapMessages) -> None:
        self._place: str | None = options.serve
        self._web_place: str | None = options.web
        self._tap_messages = tap_messages
        self.cores: list[_modlens.Server] = []
        if self._place is None and self._web_place is None and options.serve_token_file is not None:
            raise UsageError("tap: --serve-token-file needs --serve or --web [HOST:]PORT")
        self._token = _token(options.serve_token_file)

    def open(self, opened: ExitStack) -> None:
        """Begin to serve, if that is wanted; `opened` ends it."""
        opened.callback(self.close)
        if self._place is not None:
            address = self._started("--serve", self._place, None).address
            self._tap_messages.info(
                f"serving the line at {address}: modlens tap modlens://{address}, or"
                f" wireshark -k -i TCP@{address}"
                if self._token is None
                else f"serving the line at {address} to those who know the token"
            )
        if self._web_place is not None:
            from analyzer.page import page  # noqa: PLC0415 - the report's code is loaded with it

            server = self._started("--web", self._web_place, page(live=True))
            self._tap_messages.info(f"open {server.url} in a browser")

    def put(self, batch: _modlens.Batch) -> None:
        """Report clients that have come and gone since the last batch."""
        for core in self.cores:
            for text in core.take_messages():
                self._tap_messages.info(text)

    def close(self) -> None:
        """End all connections; clients have a second to take the rest."""
        for core in self.cores:
            core.close()

    def _started(self, option: str, place: str, page: bytes | None) -> _modlens.Server:
        try:
            server = _modlens.Server(place, token=self._token, page=page)
        except ValueError as error:
            raise UsageError(f"tap: {option} {place}: {error}") from error
        except OSError as error:
            raise SourceError(f"{option} {place}: {error.strerror or error}") from error
        self.cores.append(server)
        return server


def _token(file: str | None) -> str | None:
    if file is None:
        return os.environ.get(TOKEN) or None
    try:
        return Path(file).read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"--serve-token-file {file}: {error}") from error
