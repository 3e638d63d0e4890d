"""What only a tap writes to: the live screen, captures of events, MQTT, metrics."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

from analyzer.cli.live_screen import LiveScreen
from analyzer.cli.outputs import OutputSink, targets
from analyzer.cli.tap_messages import TapMessages
from analyzer.cli.tap_recording import TapRecording
from analyzer.cli.triggers import EventCapture
from analyzer.live_run import LiveRun
from analyzer.views.live.state import LiveState
from analyzer.views.row_lines import TableOptions
from analyzer.views.screen import stdout
from dissectors.errors import UsageError

if TYPE_CHECKING:
    from analyzer.feeds.mqtt import Mqtt

__all__ = ["tap_sinks"]


def tap_sinks(
    options: argparse.Namespace,
    live: LiveRun,
    tap_messages: TapMessages,
    recording: TapRecording,
    opened: ExitStack,
) -> list[OutputSink]:
    """The sinks that only a tap has: live screen, event captures, MQTT, metrics."""
    sinks: list[OutputSink] = []
    if options.view is not None:
        screen = stdout()
        if screen.is_dumb:
            raise UsageError(
                "tap: --view draws pages, which this terminal cannot show (TERM=dumb); without it,"
                " each transaction is printed as a line"
            )
        if not screen.is_terminal:
            raise UsageError(
                "tap: --view needs a terminal; without it, each transaction is printed as a line"
            )
        table_options = TableOptions(options.address, options.times, live.buses)
        state = LiveState(
            table_options, live.stats, live.statuses, live.doctor, trouble=recording.trouble
        )
        tap_messages.screen = LiveScreen(state, options.view, screen, recording.file)
        sinks.append(tap_messages.screen)
    if options.around is not None:
        sinks += [
            EventCapture(options.around, options.where, one, options.columns)
            for one in targets(options)
        ]
    return sinks + _feeds(options, live, tap_messages, recording, opened)


def _feeds(
    options: argparse.Namespace,
    live: LiveRun,
    tap_messages: TapMessages,
    recording: TapRecording,
    opened: ExitStack,
) -> list[OutputSink]:
    feeds: list[OutputSink] = []
    mqtt = _mqtt(options, tap_messages)
    if mqtt is not None:
        feeds.append(mqtt)
    if options.metrics is not None:
        from analyzer.feeds.metrics import Metrics, parse_address  # noqa: PLC0415

        stats: Callable[[], dict[str, Any]] = live.stats
        recorded = None if options.record is None else recording.current
        metrics = Metrics(parse_address(options.metrics), stats, mqtt, recorded)
        tap_messages.info(f"publishing to {metrics.name}")
        feeds.append(metrics)
    for feed in feeds:
        opened.callback(feed.rollback)
    return feeds


def _mqtt(options: argparse.Namespace, tap_messages: TapMessages) -> Mqtt | None:
    if options.mqtt is None:
        return None
    from analyzer.feeds.broker import PASSWORD_VARIABLE, parse_broker  # noqa: PLC0415
    from analyzer.feeds.mqtt import Mqtt  # noqa: PLC0415

    broker = parse_broker(
        options.mqtt,
        password_file=options.mqtt_password_file,
        ca=options.mqtt_ca,
        certificate=options.mqtt_cert,
        key=options.mqtt_key,
    )
    tap_messages.info(f"publishing to {broker}")
    if broker.password_in_url:
        tap_messages.info(
            "--mqtt: everybody on this machine can read the password in the list of processes;"
            f" write mqtt://user@host, and give it by --mqtt-password-file or {PASSWORD_VARIABLE}"
        )
    return Mqtt(
        broker,
        spool=options.mqtt_spool,
        discovery=options.home_assistant,
        notify=tap_messages.info,
    )
