"""`modlens wireshark-setup`: a Wireshark profile with columns and colours for Modbus."""

from __future__ import annotations

import argparse
import os
import shutil
from pathlib import Path

from analyzer.cli.standard_streams import print_text
from dissectors.errors import SourceError

__all__ = ["add_arguments", "run"]

EPILOG = """\
examples:
  modlens wireshark-setup            then choose the profile Modbus in Wireshark
  tshark -C Modbus -r bus.pcapng     the same columns in tshark
  modlens wireshark-setup --remove
"""

MARK = "# made by modlens wireshark-setup\n"

COLUMNS = (
    ("No.", "%m"),
    ("Time", "%t"),
    ("Bus", "%Cus:frame.interface_name:0:R"),
    ("Unit", "%Cus:mbtcp.unit_id || mbrtu.unit_id:0:R"),
    ("Protocol", "%p"),
    ("Function", "%Cus:modbus.func_code:0:R"),
    ("Address", "%Cus:modbus.reference_num:0:R"),
    ("Request", "%Cus:modbus.request_frame:0:R"),
    ("Response time", "%Cus:modbus.response_time:0:R"),
    ("Info", "%i"),
    ("Findings", "%Cus:frame.comment:0:R"),
)

RED, ORANGE, YELLOW, GREY = (
    "[65535,51400,51400]",
    "[65535,57500,44000]",
    "[65535,65000,46000]",
    "[60000,60000,60000]",
)
BLACK = "[0,0,0]"

COLOURS = (
    ("Modbus: checksum error", "frame.packet_flags_crc_error == 1 || mbrtu.crc16.incorrect", RED),
    ("Modbus: no response", 'frame.comment contains "no_response"', RED),
    ("Modbus: exception", "modbus.exception_code", ORANGE),
    ("Modbus: late response", 'frame.comment contains "late_response"', YELLOW),
    ("Modbus: retry", 'frame.comment contains "retry"', YELLOW),
    ("Modbus: noise", 'exported_pdu.prot_name == "data"', GREY),
)
"""Name, display filter, background colour; Wireshark applies the first rule that matches."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of the command."""
    parser.add_argument(
        "--profile",
        metavar="NAME",
        default="Modbus",
        help="name of the Wireshark profile (default: Modbus)",
    )
    parser.add_argument("--remove", action="store_true", help="remove the profile")
    parser.epilog = EPILOG


def run(options: argparse.Namespace) -> int:
    """Write the profile, or take it away; gives the exit status."""
    folder = _profiles() / options.profile
    if os.sep in options.profile or options.profile in ("", ".", ".."):
        raise SourceError(f"--profile {options.profile}: a name without folders")
    _check_ours(folder)
    try:
        if options.remove:
            shutil.rmtree(folder)
        else:
            folder.mkdir(parents=True, exist_ok=True)
            (folder / "preferences").write_text(_preferences(), encoding="utf-8")
            (folder / "colorfilters").write_text(_colours(), encoding="utf-8")
    except OSError as error:
        raise SourceError(f"{folder}: {error.strerror}") from error
    done = (
        "removed" if options.remove else "written; choose it in Wireshark's status bar, or with -C"
    )
    print_text(f"{folder}: {done}\n")
    return 0


def _profiles() -> Path:
    if os.name == "nt":
        return Path(os.environ.get("APPDATA", "")) / "Wireshark" / "profiles"
    config = os.environ.get("XDG_CONFIG_HOME") or str(Path.home() / ".config")
    return Path(config) / "wireshark" / "profiles"


def _check_ours(folder: Path) -> None:
    """`SourceError` if the folder is a profile that modlens has not made."""
    if not folder.exists():
        return
    try:
        ours = (folder / "colorfilters").read_text(encoding="utf-8").startswith(MARK)
    except OSError:
        ours = False
    if not ours:
        raise SourceError(f"{folder}: a profile of yours; choose another name with --profile")


def _preferences() -> str:
    columns = ",\n\t".join(f'"{title}", "{form}"' for title, form in COLUMNS)
    return (
        f"{MARK}gui.column.format: \n\t{columns}\n"
        "mbrtu.crc_verification: TRUE\n"
        "frame.generate_epoch_time: TRUE\n"
    )


def _colours() -> str:
    lines = [f"@{name}@{rule}@{back}{BLACK}\n" for name, rule, back in COLOURS]
    return MARK + "".join(lines)
