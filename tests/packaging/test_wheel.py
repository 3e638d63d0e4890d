"""The wheel works where there is no Rust, and wheel and sdist hold what they have to.

People in the field have no compiler: they install the wheel. It is built once for all tests here,
with the checkout's own build folder, as `make wheel` does.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tarfile
import venv
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePosixPath

import pytest

from release.shell_files import files
from tests.conftest import CAPTURES, ROOT, Modlens, environment, without

RECORDING = CAPTURES / "pymodbus_disturbed" / "recording.jsonl"
LINE = ("--line", "19200-8E1")
PACKAGES = ("modlens", "analyzer", "dissectors")
TIMEOUT_S = 600
INDEX_IS_AWAY = ("No matching distribution", "ConnectionError", "Failed to establish")


def run(words: Sequence[str | Path], *, cwd: Path, env: Mapping[str, str]) -> str:
    """What a command printed; a failure shows what it said."""
    done = subprocess.run(
        [str(word) for word in words],
        capture_output=True, text=True, timeout=TIMEOUT_S, env=env, cwd=cwd, check=False,
    )  # fmt: skip
    if any(sign in done.stderr for sign in INDEX_IS_AWAY):
        without("a package index")
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="session")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of this checkout."""
    folder = tmp_path_factory.mktemp("wheel")
    words = ["pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(folder), str(ROOT)]
    run([sys.executable, "-m", *words], cwd=folder, env=environment())
    (found,) = folder.glob("*.whl")
    return found


@pytest.fixture(scope="session")
def bare() -> dict[str, str]:
    """An environment in which no compiler is to be found, nor this checkout."""
    env = environment(PATH="")
    env.pop("PYTHONPATH", None)
    return env


@pytest.fixture(scope="session")
def installed(
    wheel: Path, bare: dict[str, str], tmp_path_factory: pytest.TempPathFactory
) -> dict[str, str]:
    """An environment in which `modlens` is the one of the wheel."""
    home = tmp_path_factory.mktemp("venv")
    venv.create(home, with_pip=True, symlinks=True)
    binaries = home / "bin"
    env = {**bare, "PATH": str(binaries), "VIRTUAL_ENV": str(home)}
    for tool in ("cargo", "rustc", "cc"):
        assert shutil.which(tool, path=env["PATH"]) is None
    words = ["pip", "install", "--quiet", "--disable-pip-version-check", str(wheel)]
    run([binaries / "python", "-m", *words], cwd=home, env=env)
    return env


def command(env: Mapping[str, str], name: str = "modlens") -> Path:
    """A program of the environment."""
    return Path(env["PATH"]) / name


def test_the_wheel_decodes_a_recording(
    installed: dict[str, str], tmp_path: Path, modlens: Modlens
) -> None:
    """Elsewhere, without Rust, and with the very bytes that this checkout gives."""
    words: list[str | Path] = ["decode", RECORDING, *LINE, "--to", "csv"]
    out = run([command(installed), *words], cwd=tmp_path, env=installed)
    rows = out.splitlines()
    assert rows[0].startswith("txn,time,elapsed_us,bus,")
    assert [row.split(",")[0] for row in rows[1:]] == [str(n) for n in range(1, len(rows))]
    assert rows == modlens(*words).out.splitlines()


def test_what_runs_is_the_installed_one(installed: dict[str, str], tmp_path: Path) -> None:
    """The core and both packages come from the environment of the test."""
    names = ("_modlens", *PACKAGES)
    code = f"import {', '.join(names)}; print(*(one.__file__ for one in ({', '.join(names)})))"
    found = run([command(installed, "python"), "-c", code], cwd=tmp_path, env=installed)
    home = installed["VIRTUAL_ENV"]
    assert all(path.startswith(home) for path in found.split()), found


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["explain", "3"], "Read Holding Registers"),
        (["craft", "3", "unit=17", "address=107", "quantity=3"], "11 03 00 6B 00 03 76 87"),
        (["show", "11 03 00 6B 00 03 76 87"], "107"),
        (["explain", "--functions", "pace", "0x45"], "PACE"),
    ],
)
def test_the_tables_are_in_the_wheel(
    words: list[str], expected: str, installed: dict[str, str], tmp_path: Path
) -> None:
    """Commands that read the tables of functions and words, a vendor's rows among them."""
    assert expected in run([command(installed), *words], cwd=tmp_path, env=installed)


def contents(wheel: Path) -> set[str]:
    return set(zipfile.ZipFile(wheel).namelist())


def of_the_tree(*patterns: str) -> set[str]:
    """Files of the two packages, as a wheel names them."""
    found = (path for name in PACKAGES for one in patterns for path in (ROOT / name).rglob(one))
    return {path.relative_to(ROOT).as_posix() for path in found}


def test_the_wheel_holds_code_tables_and_types(wheel: Path) -> None:
    """Every module, every table of the packages, and what type checkers look for."""
    names = contents(wheel)
    assert of_the_tree("*.py", "*.toml", "py.typed") <= names
    tables = {"functions.toml", "vocabulary.toml", "vendor/huawei.toml"}
    assert {f"dissectors/{table}" for table in tables} <= names
    assert "analyzer/columns.toml" in names
    assert {f"{name}/py.typed" for name in PACKAGES} <= names


def test_the_wheel_brings_the_border_with_its_stub(wheel: Path) -> None:
    """The extension is made a package, with the stub of the tree."""
    with zipfile.ZipFile(wheel) as archive:
        assert archive.read("_modlens/__init__.pyi") == (ROOT / "_modlens.pyi").read_bytes()
    extensions = [name for name in contents(wheel) if name.endswith((".so", ".pyd"))]
    assert [PurePosixPath(name).parent.name for name in extensions] == ["_modlens"]


def test_one_wheel_serves_all_versions_of_python(wheel: Path) -> None:
    """The wheel uses the stable ABI of Python 3.11 and later."""
    assert "-cp311-abi3-" in wheel.name


def test_the_wheel_holds_nothing_else(wheel: Path) -> None:
    """The wheel has no tests, no recordings, and no sources of the core."""
    tops = {name.split("/")[0] for name in contents(wheel)}
    info = {top for top in tops if top.endswith((".dist-info", ".data"))}
    assert tops == {"_modlens", *PACKAGES, *info}
    data = {name.split("/", 1)[1] for name in contents(wheel) if ".data/" in name}
    assert data == {f"data/share/{name}" for name in files()}


def test_the_wheel_holds_the_licences_of_what_is_in_it(wheel: Path) -> None:
    """The licence of modlens, and those of everything that is compiled in."""
    with zipfile.ZipFile(wheel) as archive:
        for name in ("LICENSE", "THIRD_PARTY.md", "THIRD_PARTY_LICENSES.txt"):
            (found,) = (one for one in archive.namelist() if one.endswith(f"/licenses/{name}"))
            assert archive.read(found) == (ROOT / name).read_bytes()


def test_the_wheel_holds_the_list_of_what_is_compiled_in(wheel: Path) -> None:
    """And no other one, in which folders of the machine that built it are named."""
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (one for one in archive.namelist() if "/sboms/" in one)
        found = archive.read(name)
    assert found == (ROOT / "release" / "modlens.cyclonedx.json").read_bytes()


def test_nothing_under_the_gpl_is_in_the_wheel(wheel: Path) -> None:
    """Scapy (GPL-2.0) is installed beside modlens; no file of it is in the wheel."""
    names = contents(wheel)
    assert not [name for name in names if "scapy" in name.lower()]


def test_the_wheel_brings_completion_and_manual_pages(installed: dict[str, str]) -> None:
    """Under `share/` of the environment, where a shell and man look for them."""
    share = Path(installed["VIRTUAL_ENV"]) / "share"
    for name, text in files().items():
        assert (share / name).read_text(encoding="utf-8") == text


@pytest.fixture(scope="session")
def sdist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sdist, unpacked."""
    folder = tmp_path_factory.mktemp("sdist")
    maturin = Path(sys.executable).with_name("maturin")
    if not maturin.exists():
        without("maturin")
    run([maturin, "sdist", "--out", folder], cwd=ROOT, env=environment())
    (found,) = folder.glob("*.tar.gz")
    with tarfile.open(found) as archive:
        archive.extractall(folder, filter="data")
    return folder / found.name.removesuffix(".tar.gz")


def test_the_sdist_holds_both_packages_and_the_border(sdist: Path) -> None:
    """The sdist has all that the wheel has, and the documents."""
    papers = {"pyproject.toml", "README.md", "LICENSE", "_modlens.pyi", "Cargo.toml", "Cargo.lock"}
    for name in papers | of_the_tree("*.py", "*.toml", "py.typed"):
        assert (sdist / name).is_file(), name


def test_the_sdist_holds_what_the_core_embeds(sdist: Path) -> None:
    """Every source of the crates that are shipped, and every file that one of them takes in."""
    not_shipped = {ROOT / "crates/modlens-bench", ROOT / "crates/modlens-tap"}
    crates = {path.parent for path in ROOT.glob("crates/*/Cargo.toml")} - not_shipped
    sources = [path for crate in crates for path in (crate / "src").rglob("*.rs")]
    assert len(crates) > 1
    assert sources
    for path in sources:
        there = sdist / path.relative_to(ROOT)
        assert there.is_file(), there
        for name in re.findall(r'include_(?:str|bytes)!\("([^"]+)"\)', path.read_text("utf-8")):
            assert (there.parent / name).is_file(), name


def test_the_sdist_resolves_to_the_locked_crates(sdist: Path) -> None:
    """`--locked` is what its build says: a lock file that does not fit would end it."""
    words = ["cargo", "metadata", "--locked", "--format-version", "1"]
    assert "modlens-engine" in run(words, cwd=sdist, env=environment())
