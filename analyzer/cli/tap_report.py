"""The page of what a tap has heard."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from analyzer.cli.recording_document import write_page
from analyzer.live_run import BusStatus
from analyzer.report.document import complete
from analyzer.report.page import page
from analyzer.session import RecordingStatus
from analyzer.settings import Settings

__all__ = ["write_report"]


def write_report(
    name: str, document: Mapping[str, Any], buses: Iterable[BusStatus], settings: Settings
) -> None:
    """Write the page of a tap's document; `SourceError` where that is not possible."""
    details = {"clock": "utc"}
    sources = [
        RecordingStatus(one.bus, "live", 1.0, _origin(one), False, details, ended=True)
        for one in buses
    ]
    write_page(name, page(complete(document, sources, settings.functions)))


def _origin(bus: BusStatus) -> str:
    """Where the line settings of a bus are from."""
    return f"line settings {bus.origin}" if bus.origin else "listened to"
