"""TOML that people write, read without the surprises of a hostile file.

The standard library's parser goes as deep as the text says, and takes memory with the square of the
parts of a key.

>>> load('plant = 1', "bus.toml")
{'plant': 1}
>>> load("a = " + "[" * 5000, "bus.toml")
Traceback (most recent call last):
    ...
modlens.ProfileError: bus.toml: TOML that is nested too deeply
"""

from __future__ import annotations

import re
import tomllib
from typing import Any

from dissectors.errors import ProfileError

__all__ = ["load"]

_ENDLESS_KEY = re.compile(r"(?<![\w-])(?:[\w-]++[ \t]*+\.[ \t]*+){100}")
"""A key of a hundred parts; nobody writes one."""


def load(text: str, path: str) -> dict[str, Any]:
    """The tables in a text; `ProfileError` where it is no TOML, or nested beyond measure."""
    try:
        if _ENDLESS_KEY.search(text):
            raise RecursionError
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ProfileError(f"not TOML: {error}", path=path) from None
    except RecursionError:
        raise ProfileError("TOML that is nested too deeply", path=path) from None
