"""`modlens extcap`: serial lines and recordings in Wireshark's own list of interfaces.

`install` puts a file of three lines into Wireshark's personal folders; Wireshark runs it as
`modlens extcap --extcap-interfaces` and so on (https://www.wireshark.org/docs/man-pages/extcap.html).
Wireshark asks every such program at its start, so nothing is loaded here before it is needed.
"""

from __future__ import annotations

import argparse
import os
import stat
import sys
from pathlib import Path

from analyzer.cli.standard_streams import STDOUT, print_text
from dissectors.errors import SourceError, UsageError

__all__ = ["add_arguments", "run"]

EPILOG = """\
examples:
  modlens extcap install      then start Wireshark: the ports are in its list
  modlens extcap status
  modlens extcap uninstall

Click the gear icon of an interface for its line settings.
"""

NAME = "modlens"
ACTIONS = ("install", "uninstall", "status")
ANY_PORT, REPLAY = "modlens-port", "modlens-replay"
LINK = "dlt {number=252}{name=WIRESHARK_UPPER_PDU}{display=Modbus, as modlens decodes it}\n"

BAUDS = (1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200)
FORMATS = ("8E1", "8N1", "8N2", "8O1", "7E1", "7O1", "7N2")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command; those that Wireshark uses are not shown."""
    parser.add_argument(
        "action",
        nargs="?",
        choices=ACTIONS,
        help="install, uninstall, or show the installation status",
    )
    for name in ("--extcap-interfaces", "--extcap-dlts", "--extcap-config", "--capture"):
        parser.add_argument(name, action="store_true", help=argparse.SUPPRESS)
    for name in ("--extcap-interface", "--extcap-version", "--extcap-capture-filter", "--fifo"):
        parser.add_argument(name, default="", help=argparse.SUPPRESS)
    parser.add_argument("--baud", default="19200", help=argparse.SUPPRESS)
    parser.add_argument("--format", default="8E1", help=argparse.SUPPRESS)
    parser.add_argument("--mode", default="auto", help=argparse.SUPPRESS)
    parser.add_argument("--style", default="udp", help=argparse.SUPPRESS)
    parser.add_argument("--port", default="", help=argparse.SUPPRESS)
    parser.add_argument("--file", default="", help=argparse.SUPPRESS)
    parser.epilog = EPILOG


def run(options: argparse.Namespace) -> int:
    """Do what the user or Wireshark asks; gives the exit status."""
    if options.extcap_interfaces:
        print_text(_interfaces())
    elif options.extcap_dlts:
        print_text(LINK)
    elif options.extcap_config:
        print_text(_settings(options.extcap_interface))
    elif options.capture:
        return _capture(options)
    elif options.action is None:
        raise UsageError(f"extcap: name an action: {', '.join(ACTIONS)}")
    else:
        for folder in _folders():
            print_text(_ACTIONS[options.action](folder) + "\n")
    return 0


def _interfaces() -> str:
    import _modlens  # noqa: PLC0415

    lines = [f"extcap {{version={_modlens.__version__}}}{{display=Modbus, by modlens}}"]
    for port in _ports():
        lines.append(f"interface {{value={_interface(port)}}}{{display=Modbus on {port}}}")
    lines.append(f"interface {{value={ANY_PORT}}}{{display=Modbus on another port or URL}}")
    lines.append(f"interface {{value={REPLAY}}}{{display=Modbus from a recording}}")
    return "\n".join(lines) + "\n"


def _ports() -> list[str]:
    from analyzer.sources.serial import devices  # noqa: PLC0415

    return devices()


def _interface(port: str) -> str:
    """A port's name with the characters that Wireshark allows: letters, digits, `.` and `-`."""
    plain = port.removeprefix("/dev/").replace("/", "-")
    return f"modlens-{plain}"


def _settings(interface: str) -> str:
    """The options dialog of an interface in extcap's configuration syntax."""
    lines: list[str] = []

    def ask(
        option: str, text: str, kind: str, more: str = "", choices: tuple[str, ...] = ()
    ) -> None:
        number = sum(line.startswith("arg") for line in lines)
        lines.append(
            f"arg {{number={number}}}{{call=--{option}}}{{display={text}}}{{type={kind}}}{more}"
        )
        for at, choice in enumerate(choices):
            usual = "{default=true}" if at == 0 else ""
            lines.append(f"value {{arg={number}}}{{value={choice}}}{{display={choice}}}{usual}")

    if interface == REPLAY:
        ask("file", "Recording", "fileselect", "{mustexist=true}{required=true}")
    elif interface == ANY_PORT:
        ask(
            "port",
            "Port or URL",
            "string",
            "{required=true}{placeholder=socket://192.168.1.50:4001}",
        )
    first = ("19200", *(str(baud) for baud in BAUDS if baud != 19200))  # noqa: PLR2004
    ask("baud", "Baud rate", "selector", choices=first)
    ask("format", "Data bits, parity, stop bits", "selector", choices=FORMATS)
    ask("mode", "Framing", "selector", choices=("auto", "rtu", "ascii"))
    ask("style", "Shown as", "selector", choices=("udp", "rtu"))
    return "\n".join(lines) + "\n"


def _capture(options: argparse.Namespace) -> int:
    """Write a capture into Wireshark's pipe until Wireshark closes it."""
    from analyzer.cli import main  # noqa: PLC0415

    # The pipe is opened before anything can fail: tshark blocks until both ends are open, and would
    # wait forever if we ended with an error first.
    pipe = _pipe(options.fifo)
    words = ["--line", f"{options.baud}-{options.format}", "--mode", options.mode]
    words += ["--to", "pcapng", "--style", options.style]
    if options.extcap_interface == REPLAY:
        words = ["export", _said(options.file, "a recording"), *words]
    elif options.extcap_interface == ANY_PORT:
        words = ["tap", _said(options.port, "a port"), *words]
    else:
        ports = {_interface(port): port for port in _ports()}
        if options.extcap_interface not in ports:
            raise SourceError(f"{options.extcap_interface}: no such interface; is it plugged in?")
        words = ["tap", ports[options.extcap_interface], *words]
    os.dup2(pipe, STDOUT)
    os.close(pipe)
    # Python's standard output has remembered whether it can seek: a file can, the pipe cannot.
    sys.stdout = os.fdopen(STDOUT, "w", encoding="utf-8", closefd=False)
    return main(words)


def _pipe(path: str) -> int:
    """Open the named pipe that Wireshark reads from, or a file; gives the file descriptor."""
    if not path:
        raise UsageError("extcap: --capture needs --fifo")
    try:
        pipe = os.open(path, os.O_WRONLY | os.O_CREAT, 0o666)
        if stat.S_ISREG(os.fstat(pipe).st_mode) and not path.startswith("/dev/"):
            os.ftruncate(pipe, 0)
        return pipe
    except OSError as error:
        raise SourceError(f"{path}: cannot be written: {error.strerror}") from error


def _said(text: str, what: str) -> str:
    if not text:
        raise UsageError(f"name {what} in the settings of the interface (its gear icon)")
    return text


def _folders() -> list[Path]:
    """Wireshark's personal extcap folders: the one of version 4.0 and the one of later versions."""
    if os.name == "nt":
        return [Path(os.environ.get("APPDATA", "")) / "Wireshark" / "extcap"]
    config = os.environ.get("XDG_CONFIG_HOME") or str(Path.home() / ".config")
    local = Path.home() / ".local" / "lib"
    return [Path(config) / "wireshark" / "extcap", local / "wireshark" / "extcap"]


def _file(folder: Path) -> Path:
    return folder / (f"{NAME}.bat" if os.name == "nt" else NAME)


def _content() -> str:
    """The script that Wireshark runs; it starts this very Python installation."""
    if os.name == "nt":
        return f'@echo off\n"{sys.executable}" -m analyzer extcap %*\n'
    quoted = "'" + sys.executable.replace("'", "'\\''") + "'"
    return f'#!/bin/sh\n# made by modlens extcap install\nexec {quoted} -m analyzer extcap "$@"\n'


def _install(folder: Path) -> str:
    path = _file(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        path.write_text(_content(), encoding="utf-8")
        path.chmod(path.stat().st_mode | stat.S_IXUSR | stat.S_IXGRP | stat.S_IXOTH)
    except OSError as error:
        raise SourceError(f"{path}: cannot be written: {error.strerror}") from error
    return f"{path}: installed"


def _uninstall(folder: Path) -> str:
    path = _file(folder)
    try:
        path.unlink()
    except FileNotFoundError:
        return f"{path}: was not installed"
    except OSError as error:
        raise SourceError(f"{path}: cannot be removed: {error.strerror}") from error
    return f"{path}: removed"


def _status(folder: Path) -> str:
    path = _file(folder)
    try:
        same = path.read_text(encoding="utf-8") == _content()
    except OSError:
        return f"{path}: not installed"
    return f"{path}: installed" + ("" if same else ", but for another Python; install it again")


_ACTIONS = {"install": _install, "uninstall": _uninstall, "status": _status}
