"""Lines that another tap serves with `--serve`: `modlens://host:port/BUS`.

The core connects and reads (modlens-recorder/src/remote.rs). Times, line errors and losses are
those of the other tap.
"""

from __future__ import annotations

import os

from _modlens import Remote
from analyzer.sources.schemes import LivePort
from dissectors.errors import PortError

__all__ = ["TOKEN", "open_port"]

TOKEN = "MODLENS_SERVE_TOKEN"
"""The environment variable with the token of a tap that serves other computers."""


def open_port(name: str, settings: str | None) -> LivePort:
    """Connect to a tap; `PortError` if that is not possible."""
    try:
        return Remote(name, os.environ.get(TOKEN) or None)
    except OSError as error:
        raise PortError(str(error), port=name) from error
