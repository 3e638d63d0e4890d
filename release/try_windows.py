"""Tries the wheel for Windows in a Python for Windows, under wine: `make try-windows`.

    python -m release.try_windows

The Python is that of JavaCPP's presets, from Maven Central: python.org's own needs their site. Two
libraries are added to it, compiled by zig: `python3.dll`, which passes the stable interface on to
`python313.dll` and is not part of the preset, and `bcryptprimitives.dll`, which wine has from
version 9 on. The demo and exports of a recording have to give what they give on this machine.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import urllib.request
import zipfile
from pathlib import Path

from release.rust import ROOT
from release.try_wheel import Trial, common_environment, try_recording
from release.wheels import DIST, QUICK_DIST

VERSION, PYTHON = "3.13.5-1.5.12", "313"
JAR = (
    "https://repo1.maven.org/maven2/org/bytedeco/cpython/"
    f"{VERSION}/cpython-{VERSION}-windows-x86_64.jar"
)
FOLDER = ROOT / "target" / "windows"
HOME = FOLDER / "org" / "bytedeco" / "cpython" / "windows-x86_64"
RANDOM = """
#include <windows.h>
BOOLEAN NTAPI SystemFunction036(PVOID, ULONG);
__declspec(dllexport) BOOL WINAPI ProcessPrng(PBYTE data, SIZE_T size)
{
    return SystemFunction036(data, (ULONG)size);
}
"""


class WineTrial(Trial):
    """The wheel in a Python for Windows."""

    def __init__(self, wheel: Path, folder: Path) -> None:
        self._site = folder / "site"
        self.is_emulated = True
        subprocess.run(
            [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check",
             "--target", str(self._site), "--only-binary=:all:", "--python-version", PYTHON,
             "--implementation", "cp", "--abi", f"cp{PYTHON}", "--abi", "abi3", "--abi", "none",
             "--platform", "win_amd64", str(wheel)],
            check=True,
        )  # fmt: skip

    def command(self, *words: str | Path) -> list[str]:
        """The words that start `modlens`. Paths of this machine are those of drive Z."""
        return ["wine", str(HOME / "python.exe"), "-m", "analyzer", *map(str, words)]

    def environment(self) -> dict[str, str]:
        """Nothing but the wheel and what it depends on is found."""
        site = "Z:" + str(self._site).replace("/", "\\")
        return {
            **common_environment(),
            "PYTHONPATH": site,
            "WINEPREFIX": str(FOLDER / "prefix"),
            "WINEDEBUG": "-all",
        }


def library(name: str, *words: str | Path) -> None:
    """Compile a library for Windows beside Python."""
    zig = [sys.executable, "-m", "ziglang", "cc", "-target", "x86_64-windows-gnu", "-shared"]
    subprocess.run([*zig, "-o", str(HOME / name), *map(str, words)], check=True)


def get_python() -> None:
    """Fetch the Python, once, and add what it lacks."""
    if (HOME / "bcryptprimitives.dll").exists():
        return
    shutil.rmtree(FOLDER, ignore_errors=True)
    FOLDER.mkdir(parents=True)
    jar, _ = urllib.request.urlretrieve(JAR)
    with zipfile.ZipFile(jar) as opened:
        opened.extractall(FOLDER)
    os.unlink(jar)
    # platform.uname() asks WMI, for which wine 8 lacks a function and ends the program.
    (HOME / "lib" / "_wmi.pyd").unlink()
    empty, code = FOLDER / "empty.c", FOLDER / "random.c"
    empty.write_text("int modlens_has_no_code;\n")
    code.write_text(RANDOM)
    names = sorted(names_of(HOME / f"python{PYTHON}.dll"))
    table = FOLDER / "python3.def"
    rows = "".join(f"  {name}=python{PYTHON}.{name}\n" for name in names)
    table.write_text(f"LIBRARY python3.dll\nEXPORTS\n{rows}")
    library("python3.dll", empty, table)
    library("bcryptprimitives.dll", code, "-ladvapi32")


def names_of(dll: Path) -> set[str]:
    """The names that Python's library exports, the stable interface among them."""
    return {name.decode() for name in re.findall(rb"\0(_?Py\w+)(?=\0)", dll.read_bytes())}


def main() -> int:
    """Try the wheel in dist/, or the one of `python -m release.wheels --quick windows-amd64`."""
    wheels = [path for folder in (DIST, QUICK_DIST) for path in folder.glob("*-win_amd64.whl")]
    if not wheels:
        raise SystemExit("no wheel; make wheels TARGETS=windows-amd64 builds it")
    start = time.monotonic()
    get_python()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        try_recording(WineTrial(wheels[0], folder), folder, quick=False)
    sys.stdout.write(f"windows-amd64: demo, exports, {time.monotonic() - start:.0f} s\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
