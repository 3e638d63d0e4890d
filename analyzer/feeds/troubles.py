"""The events of troubles on a tap: to a file, to commands and addresses, and for the broker.

An event is a JSON object (docs/events.schema.json): what began, changed or ended (`event`), when
(`time`), of which bus and unit, the cause (`code`, `sentence`), its evidence (`failed`, `total`,
`examples`), and what to check. When a trouble begins and ends is the core's decision
(crates/modlens-diagnosis/src/events.rs).
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

import _modlens
from analyzer.feeds.spool import Message
from dissectors.errors import SourceError

__all__ = ["EventFile", "TroubleTopics", "Troubles", "line"]

Event = Mapping[str, Any]

PROBLEM = "_problem"
"""The last level of the topic of a unit's trouble; no name of a value begins with an underscore."""


def line(event: Event, *, names_bus: bool) -> str:
    """The event as a line for people.

    >>> event = {"time": "2026-11-21T10:00:00Z", "bus": "b", "text": "trouble: Unit 3 is off."}
    >>> line(event, names_bus=True)[8:]
    ' b: trouble: Unit 3 is off.'
    """
    moment = datetime.fromisoformat(event["time"]).astimezone()
    where = f" {event['bus']}:" if names_bus else ""
    return f"{moment:%H:%M:%S}{where} {event['text']}"


class Troubles:
    """Passes the events of a tap to listeners, after each batch.

    `take` returns the events since the last call.
    """

    name = "the events"
    table = ""

    def __init__(
        self, take: Callable[[], Sequence[Event]], listeners: Sequence[Callable[[Event], None]]
    ) -> None:
        self.row_count = 0
        self._take, self._listeners = take, listeners

    def put(self, batch: _modlens.Batch) -> None:
        """Pass on what has happened; see `analyzer.pump.Sink`."""
        for event in self._take():
            for listener in self._listeners:
                listener(event)

    def close(self) -> None:
        """Nothing to do: files and notifiers are closed by whoever opened them."""

    def rollback(self) -> None:
        """Nothing to do, as above."""


class EventFile:
    """A file of JSON lines that grows by one for each event; it must not exist yet."""

    def __init__(self, path: str) -> None:
        try:
            self._file = Path(path).open("x", encoding="utf-8")
        except FileExistsError:
            raise SourceError(f"-o events:{path}: the file exists; choose another name") from None
        except OSError as error:
            raise SourceError(f"-o events:{path}: {error.strerror}") from error

    def __call__(self, event: Event) -> None:
        """Write one event."""
        self._file.write(json.dumps(event, ensure_ascii=False) + "\n")
        self._file.flush()

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class TroubleTopics:
    """The messages for a broker; `prefix` begins all topics.

    - `PREFIX/BUS/event`: an event
    - `PREFIX/BUS/trouble`, retained: whether there is a problem, the sentence, all open troubles
    - `PREFIX/BUS/UNIT/_problem`, retained: the same of one unit
    """

    def __init__(self, prefix: str) -> None:
        self._prefix = prefix
        self._open: dict[int, Event] = {}
        self._known: set[tuple[str, int | None]] = set()

    def topic(self, bus: str, unit: int | None = None) -> str:
        """The topic of the trouble of a bus, or of a unit."""
        level = f"{self._prefix}/{_modlens.topic_level(bus)}"
        return f"{level}/trouble" if unit is None else f"{level}/{unit}/{PROBLEM}"

    def meet(self, bus: str, unit: int) -> Iterator[Message]:
        """The state of a bus and a unit that have not been seen before."""
        for subject in ((bus, None), (bus, unit)):
            if subject not in self._known:
                self._known.add(subject)
                yield self._state(*subject)

    def event(self, event: Event) -> Iterator[Message]:
        """The event, and the state of its bus and unit after it."""
        bus, unit = event["bus"], event["unit"]
        if event["event"] == "end":
            self._open.pop(event["number"], None)
        else:
            self._open[event["number"]] = event
        topic = f"{self._prefix}/{_modlens.topic_level(bus)}/event"
        yield Message(topic, json.dumps(event).encode(), retain=False)
        yield self._state(bus, None)
        if unit is not None:
            yield self._state(bus, unit)

    def _state(self, bus: str, unit: int | None) -> Message:
        own = [one for one in self._open.values() if one["bus"] == bus]
        own = [one for one in own if unit is None or one["unit"] == unit]
        own.sort(key=lambda one: (one["severity"] != "error", one["number"]))
        state = {
            "problem": int(bool(own)),
            "sentence": own[0]["sentence"] if own else "",
            "check": own[0]["advice"] if own else "",
            "since": own[0]["since"] if own else None,
            "codes": [one["code"] for one in own],
        }
        return Message(self.topic(bus, unit), json.dumps(state).encode(), retain=True)
