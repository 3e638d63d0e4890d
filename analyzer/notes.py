"""What a program hears of a pass beside its rows: what the command says on standard error."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from analyzer.doubts import warn
from analyzer.session import RecordingStatus
from analyzer.unread import is_lost, unread

__all__ = ["Notes"]


class Notes:
    """The sentences of a pass; `ModlensWarning` says those that are likely to cost rows as well.

    What is among `known`, the sentences of an earlier pass, is no warning again.
    """

    def __init__(self, known: Iterable[str] = ()) -> None:
        self._known = frozenset(known)
        self._texts: list[str] = []

    def __iter__(self) -> Iterator[str]:
        return iter(self._texts)

    def add(self, text: str, *, is_warning: bool = True) -> None:
        """Take a sentence down, and warn."""
        text = _in_python(text)
        self._texts.append(text)
        if is_warning and text not in self._known:
            warn(text)

    def of_status(self, status: RecordingStatus) -> None:
        """Take down what was not read of a recording."""
        if not status.format:
            self.add(f"{status.name}: skipped: {status.reason}", is_warning=status.unreadable)
        if trouble := status.details.get("trouble"):
            self.add(f"{status.name}: {trouble}")
        if status.ended and (found := list(unread(status))):
            self.add("; ".join(map(str.strip, found)), is_warning=is_lost(status))


def _in_python(text: str) -> str:
    """A sentence of the command with what a program writes for its options."""
    return text.replace("try --port", 'try ports="any"').replace("--from", "read_as=")
