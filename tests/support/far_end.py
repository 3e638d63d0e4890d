"""A line of a pseudo terminal that is unplugged and plugged in again."""

from __future__ import annotations

import os
import pty
import tty
from pathlib import Path


class FarEnd:
    """The far end of a line whose near end can go away and come back under one name."""

    def __init__(self, link: Path) -> None:
        """Plug it in."""
        self.link = link
        self.plug()

    def plug(self) -> None:
        """Put a new pty behind the name."""
        self.far, near = pty.openpty()
        tty.setraw(near)
        os.symlink(os.ttyname(near), self.link)
        self._near = near

    def pull(self) -> None:
        """The name goes, then what stood behind it."""
        self.link.unlink()
        os.close(self._near)
        os.close(self.far)
