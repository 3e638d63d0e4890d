"""The server of `--serve`, which passes the bytes of the line on to other programs."""

from __future__ import annotations

import argparse
import os
from contextlib import ExitStack
from pathlib import Path

import _modlens
from analyzer.cli.tap_messages import TapMessages
from analyzer.sources.remote import TOKEN
from dissectors.errors import SourceError, UsageError

__all__ = ["TapServer"]


class TapServer:
    """Serves what the tap reads; an observer of the run, because it reports its clients."""

    name = "the server"

    def __init__(self, options: argparse.Namespace, tap_messages: TapMessages) -> None:
        self._place: str | None = options.serve
        self._tap_messages = tap_messages
        self.core: _modlens.Server | None = None
        if self._place is None and options.serve_token_file is not None:
            raise UsageError("tap: --serve-token-file needs --serve [HOST:]PORT")
        self._token = _token(options.serve_token_file)

    def open(self, opened: ExitStack) -> None:
        """Begin to serve, if that is wanted; `opened` ends it."""
        if self._place is None:
            return
        try:
            self.core = _modlens.Server(self._place, token=self._token)
        except ValueError as error:
            raise UsageError(f"tap: --serve {self._place}: {error}") from error
        except OSError as error:
            raise SourceError(f"--serve {self._place}: {error.strerror or error}") from error
        opened.callback(self.close)
        address = self.core.address
        self._tap_messages.info(
            f"serving the line at {address}: modlens tap modlens://{address}, or"
            f" wireshark -k -i TCP@{address}"
            if self._token is None
            else f"serving the line at {address} to those who know the token"
        )

    def put(self, batch: _modlens.Batch) -> None:
        """Report clients that have come and gone since the last batch."""
        if self.core is not None:
            for text in self.core.take_messages():
                self._tap_messages.info(text)

    def close(self) -> None:
        """End all connections; clients have a second to take the rest."""
        if self.core is not None:
            self.core.close()


def _token(file: str | None) -> str | None:
    if file is None:
        return os.environ.get(TOKEN) or None
    try:
        return Path(file).read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"--serve-token-file {file}: {error}") from error
