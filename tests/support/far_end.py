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
        """Puts a new pty at the name."""
        self.far, near = pty.openpty()
        tty.setraw(near)
        os.symlink(os.ttyname(near), self.link)
        self._near = near

    def pull(self) -> None:
        """Removes the name, then the pty that it named."""
        self.link.unlink()
        os.close(self._near)
        os.close(self.far)
