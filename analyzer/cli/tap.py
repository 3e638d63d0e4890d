"""`modlens tap`: decode a serial line live. It only listens."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from contextlib import ExitStack, closing
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from analyzer.bus_file import choose_buses
from analyzer.cli.detached_streams import DetachedStreams, write_failure
from analyzer.cli.limited_run import LimitedRun
from analyzer.cli.live_watch import add_watch, live_watch, with_watched_tables
from analyzer.cli.messages import Messages
from analyzer.cli.outputs import DAMAGED, TABLE, Outputs, run_settings
from analyzer.cli.parser import add_decoding, add_line, add_rows
from analyzer.cli.segmentation import report_silence_limits
from analyzer.cli.standard_streams import report
from analyzer.cli.stop_signals import StopSignals
from analyzer.cli.tap_messages import TapMessages
from analyzer.cli.tap_recording import TapRecording
from analyzer.cli.tap_server import WEB_PLACE, TapServers
from analyzer.cli.tap_sinks import tap_sinks
from analyzer.cli.triggers import (
    HourlySummary,
    SettingsDoubt,
    StopConditions,
)
from analyzer.cli.troubles_output import add_notify, take_event_files, troubles
from analyzer.doubts import doubts
from analyzer.durations import parse_duration
from analyzer.feeds.troubles import line
from analyzer.live_run import LiveRun, Tap, parse_tap
from analyzer.profiles import Binding, with_vendor_functions
from analyzer.settings import Settings
from analyzer.views.health import show_health
from analyzer.views.live import VIEWS
from analyzer.views.screen import stdout
from analyzer.views.summary import damaged
from dissectors.errors import SourceError, UsageError

if TYPE_CHECKING:
    pass

__all__ = ["add_arguments", "run"]

EPILOG = """\
examples:
  modlens tap /dev/ttyUSB0
  modlens tap /dev/ttyUSB0 --line 19200-8E1 --view table
  modlens tap /dev/ttyUSB0 --doctor --duration 10m
  modlens tap boiler=/dev/ttyUSB0@9600-8N1 pump=/dev/ttyUSB1@19200-8E1
  modlens tap /dev/ttyUSB0 -o event.jsonl --around 200 --where "exception"
  modlens tap --bus plant.toml
  modlens tap socket://192.168.1.50:4001 --mqtt mqtt://localhost/plant
  modlens tap /dev/ttyUSB0 -o events:log.jsonl --notify https://ntfy.sh/plant
  modlens tap /dev/ttyUSB0 --serve 4010
  modlens tap modlens://127.0.0.1:4010 --view health

If no line settings are given, all are detected from the traffic. PORT PORT
taps two separate buses; PORT+PORT taps one bus with one port per direction;
NAME=PORT@SETTINGS names a bus and sets its line settings. If a port is
unplugged, modlens waits for it to come back. -o writes to a file as traffic
arrives; modlens will not overwrite an existing file. --record saves the raw
bytes with timestamps, for modlens decode; if the file already exists, or with
--rotate, a number and the time are appended to its name.
Ctrl-C stops the tap.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument(
        "ports",
        nargs="*",
        metavar="PORT",
        help="a serial device or a URL, see below; not needed with --bus",
    )
    parser.add_argument(
        "--view", choices=VIEWS, help="show a full-screen view instead of one line per transaction"
    )
    parser.add_argument(
        "--doctor",
        action="store_true",
        help="print no transactions; a line when a trouble begins, changes or ends, and at the end"
        " what is wrong, why and what to do, as modlens doctor does",
    )
    parser.add_argument(
        "--report",
        metavar="FILE",
        help="at the end, write the page of modlens report to this file",
    )
    parser.add_argument(
        "--no-reconnect",
        action="store_true",
        help="exit with status 4 when a port disappears, instead of waiting for it",
    )
    _add_recording(parser)
    _add_triggers(parser)
    _add_feeds(parser)
    add_watch(parser)
    add_line(parser)
    parser.add_argument(
        "--detect",
        action="store_true",
        help="find baud rate, parity and stop bits by listening, even if some are given",
    )
    add_rows(parser)
    add_decoding(parser)
    parser.epilog = EPILOG


def _add_recording(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("raw recording")
    group.add_argument(
        "--record", metavar="FILE", help="save the raw bytes with timestamps, as pcapng"
    )
    group.add_argument(
        "--rotate",
        metavar="N",
        help="start a new file after this time or at this size, such as 1h or 64MB",
    )
    group.add_argument(
        "--keep",
        metavar="N",
        help="keep the newest files only: a number of files (168) or a total size (2GB), which"
        " includes the growing file",
    )


def _add_triggers(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("stopping and triggers")
    group.add_argument("--count", type=int, metavar="N", help="stop after this many transactions")
    group.add_argument(
        "--duration", metavar="TIME", help="stop after this time, such as 90s or 1h30m"
    )
    group.add_argument(
        "--stop-on", metavar="EXPR", help="stop at the first transaction that meets this condition"
    )
    group.add_argument(
        "--around",
        type=int,
        metavar="N",
        help="with --where and -o: write each match to its own file, with the N"
        " transactions before and after it",
    )


def _add_feeds(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("feeds")
    group.add_argument(
        "--mqtt",
        metavar="URL",
        help="publish transactions and last values (as --profile names them, else raw registers)"
        " to mqtt://[user@]host/prefix, or mqtts:// for TLS",
    )
    group.add_argument(
        "--mqtt-password-file",
        metavar="FILE",
        help="file with the password (default: $MODLENS_MQTT_PASSWORD)",
    )
    group.add_argument("--mqtt-ca", metavar="FILE", help="CA certificates (PEM) to trust for mqtts")
    group.add_argument("--mqtt-cert", metavar="FILE", help="client certificate (PEM) for mqtts")
    group.add_argument("--mqtt-key", metavar="FILE", help="private key of --mqtt-cert (PEM)")
    group.add_argument(
        "--mqtt-spool",
        metavar="FILE",
        help="file that buffers messages until the broker acknowledges them",
    )
    group.add_argument(
        "--home-assistant",
        action="store_true",
        help="with --mqtt: publish Home Assistant discovery messages",
    )
    group.add_argument(
        "--serve",
        metavar="[HOST:]PORT",
        help="pass the raw bytes on to Wireshark or another modlens tap, as pcapng over TCP",
    )
    group.add_argument(
        "--serve-token-file",
        metavar="FILE",
        help="file with the token that clients have to send (default: $MODLENS_SERVE_TOKEN)",
    )
    group.add_argument(
        "--web",
        nargs="?",
        const=WEB_PLACE,
        metavar="[HOST:]PORT",
        help=f"serve a page that shows the line in any browser (default: {WEB_PLACE}); other"
        " computers need the token that is in the printed address",
    )
    group.add_argument(
        "--metrics", metavar="[HOST:]PORT", help="serve Prometheus metrics over HTTP"
    )
    add_notify(group)


def run(options: argparse.Namespace) -> int:
    """Listen until a signal, a stop condition or the user ends it; gives the exit status."""
    with StopSignals() as stop_signals, DetachedStreams(stop_signals.received) as streams:
        status = _tap(options, stop_signals)
    failure = None if streams.failure is None else write_failure(streams.failure)
    if failure is not None:
        report(f"modlens: {failure.message}")
        return max(status, failure.exit_status)
    return status


def _tap(  # noqa: PLR0915 - in the order in which a tap begins and ends
    options: argparse.Namespace, stop_signals: StopSignals
) -> int:
    take_event_files(options)
    taps, bound = _taps(options)
    settings = with_watched_tables(options, _settings(options, bound))
    messages = Messages(quiet=False)
    tap_messages = TapMessages(messages)
    watch = live_watch(options, tap_messages.info)
    stop_conditions = StopConditions(options.count, _seconds(options.duration), options.stop_on)
    report_silence_limits(settings, messages)
    recording = TapRecording(options, tap_messages)
    servers = TapServers(options, tap_messages)
    live = LiveRun(
        taps,
        settings,
        notify=tap_messages.info,
        reconnect=not options.no_reconnect,
        detect=options.detect,
    )
    with closing(live), ExitStack() as opened:
        extra_sinks = tap_sinks(options, live, tap_messages, recording, opened)
        several = len(live.buses) > 1
        listeners: list[Callable[[Mapping[str, Any]], None]] = [
            lambda event: tap_messages.info(line(event, names_bus=several)),
            *(feed for sink in extra_sinks if (feed := getattr(sink, "trouble", None)) is not None),
        ]
        watched, notifiers = troubles(options, live.events, listeners, tap_messages.info, opened)
        if options.doctor:
            # All that is printed while it listens.
            extra_sinks.append(watched)
        silent = options.view or tap_messages.screen or options.doctor
        to = None if silent else options.to or TABLE
        outputs = opened.enter_context(
            Outputs(
                options,
                messages,
                to=to,
                names=live.buses,
                growing=True,
                extra_sinks=extra_sinks,
                stopping=stop_signals.received,
            )
        )
        outputs.add_observers(
            recording,
            servers,
            *([] if watch is None else [watch]),
            *[stop_conditions] * stop_conditions.any_set,
            HourlySummary(live.stats, tap_messages.info),
            SettingsDoubt(live.stats, tap_messages.info),
            *[watched] * (not options.doctor),
            *notifiers,
        )
        at = f" at {settings.line}" if settings.line is not None else ""
        ports = ", ".join(options.ports or map(_port, taps))
        tap_messages.info(f"listening to {ports}{at}; nothing is sent; Ctrl-C stops")
        # The recording begins only when the ports are open, so that no empty file is left where
        # they fail.
        recording.open(opened)
        servers.open(opened)
        live.record(recording.core, servers.cores)
        limited = LimitedRun(live, options.count, lambda: stop_conditions.reached)
        try:
            with tap_messages.use_screen():
                outputs.pump(
                    limited,
                    lambda: (
                        stop_signals.received()
                        or stop_conditions.reached
                        or tap_messages.quit_requested
                    ),
                )
        finally:
            recording.close()
            servers.close()
            outputs.close()
            if watch is not None:
                watch.finish()
            stats, doctor = limited.stats(), limited.doctor()
            if not outputs.reader_gone:
                messages.statistics(stats, doctor)
                messages.summary(stats)
                for text in doubts(settings, stats):
                    messages.info(text)
                if options.doctor:
                    show_health(doctor, stdout())
                else:
                    messages.info(doctor["sentence"])
            if options.report is not None:
                from analyzer.cli.tap_report import write_report  # noqa: PLC0415 - not for all

                write_report(options.report, limited.document(), live.statuses(), settings)
    if any(getattr(sink, "failed", False) for sink in extra_sinks) and not outputs.status:
        messages.error("nothing was delivered to the MQTT broker")
        return SourceError.exit_status
    if options.strict and damaged(stats) and not max(outputs.status, recording.exit_status):
        return DAMAGED
    return max(outputs.status, recording.exit_status)


def _taps(options: argparse.Namespace) -> tuple[list[Tap], tuple[Binding, ...]]:
    """The buses to listen to, and profiles bound to single buses.

    Without ports on the command line the buses are those of the bus file.
    """
    if options.ports:
        return [parse_tap(port) for port in options.ports], ()
    if options.bus is None:
        raise UsageError("tap: no port given; modlens ports lists them, or use --bus FILE")
    buses, options.bus = choose_buses(options.bus), None
    taps = []
    for bus in buses:
        if bus.port is None:
            raise UsageError(f"tap: bus {bus.name} of the bus file has no port")
        mode = None if bus.mode == "auto" else bus.mode
        taps.append(replace(parse_tap(bus.port), bus=bus.name, line=bus.line, mode=mode))
    return taps, tuple(replace(one, bus=bus.name) for bus in buses for one in bus.profiles)


def _port(tap: Tap) -> str:
    at = "" if tap.line is None else f"@{tap.line}"
    return f"{tap.bus}={'+'.join(tap.ports)}{at}"


def _settings(options: argparse.Namespace, bound: tuple[Binding, ...]) -> Settings:
    """The settings from the options, with the tables that screens, triggers and feeds need."""
    settings = run_settings(options)
    settings = replace(
        settings,
        profiles=(*bound, *settings.profiles),
        functions=with_vendor_functions(settings.functions, bound),
    )
    for name in ("count", "around"):
        number = getattr(options, name)
        if number is not None and number < 1:
            raise UsageError(f"tap: --{name} {number}: write a number of 1 or more")
    if options.around is not None and (options.where is None or not options.outputs):
        raise UsageError("tap: --around needs --where EXPR and -o FILE")
    if options.view is not None and options.to is not None:
        raise UsageError("tap: --view and --to both write to standard output; leave one out")
    feed = ("home_assistant", *(name for name in vars(options) if name.startswith("mqtt_")))
    given = next((name for name in feed if getattr(options, name)), None)
    if given is not None and options.mqtt is None:
        raise UsageError(f"tap: --{given.replace('_', '-')} needs --mqtt URL")
    if options.doctor and (options.view is not None or options.to is not None):
        raise UsageError("tap: --doctor writes to standard output; leave --view and --to out")
    wanted = {*settings.tables, "transactions", "diagnoses"}
    return replace(
        settings,
        tables=tuple(sorted(wanted)),
        overview="all" if options.report is not None else "none",
    )


def _seconds(text: str | None) -> float | None:
    return None if text is None else parse_duration(text, "--duration") / 1e9
