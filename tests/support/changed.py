"""What `make check` runs: the linters, and the tests of what changed since `main`.

The tests of a file are those of its crate, or those that bear its name or the name of its folder.
They are the first to fail; what else a change may break is for `make test`.
"""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

ROOT = Path(__file__).parent.parent.parent

TESTS_OF_CRATES = {
    "modlens-protocol": ("tests/border/test_checksums.py", "tests/dissectors/test_pdu.py"),
    "modlens-readers": ("tests/dissectors/importers", "tests/border/test_marks.py"),
    "modlens-profiles": ("tests/analyzer/test_profiles.py", "tests/dissectors/test_profile.py"),
    "modlens-engine": ("tests/border/test_decoder.py", "tests/captures/test_decode.py"),
    "modlens-diagnosis": ("tests/doctor", "tests/conformance/test_diagnoses.py"),
    "modlens-tables": (
        "tests/analyzer/test_filters.py",
        "tests/analyzer/test_columns.py",
        "tests/conformance/test_columns.py",
        "tests/conformance/test_ordinary_traffic.py",
    ),
    "modlens-filters": (
        "tests/analyzer/test_filters.py",
        "tests/analyzer/test_filters_people_type.py",
    ),
    "modlens-recording": ("tests/analyzer/sources", "tests/analyzer/page"),
    "modlens-report": ("tests/analyzer/report", "tests/analyzer/page/test_documents.py"),
    "modlens-web": ("tests/analyzer/page",),
    "modlens-watch": (
        "tests/analyzer/test_security.py",
        "tests/analyzer/test_baseline.py",
        "tests/analyzer/test_joining.py",
        "tests/analyzer/test_live_watch.py",
    ),
    "modlens-writers": (
        "tests/analyzer/exports/test_sink.py",
        "tests/analyzer/exports/test_types.py",
    ),
    "modlens-arrow": ("tests/analyzer/exports/test_types.py",),
    "modlens-pcapng": ("tests/analyzer/exports/test_recorder.py",),
    "modlens-recorder": ("tests/analyzer/exports/test_recorder.py", "tests/faults"),
    "modlens-py": ("tests/border",),
    "modlens-tap": ("tests/packaging/test_gateway_tap.py",),
    "modlens-bench": (),
}
"""Tests in Python that show what a crate does; its own are run as well."""

CRATES_OF_TABLES = {
    "analyzer/columns.toml": "modlens-tables",
    "analyzer/report/layout.toml": "modlens-report",
    "analyzer/report/learned.toml": "modlens-report",
    "analyzer/sources/dialects.toml": "modlens-readers",
    "dissectors/diagnoses.toml": "modlens-diagnosis",
    "dissectors/functions.toml": "modlens-protocol",
    "dissectors/vocabulary.toml": "modlens-protocol",
}
"""Tables that are compiled into a crate, whose tests a change of them needs."""

TESTS_OF_FILES = {
    "dissectors/diagnoses.toml": "tests/conformance/test_diagnoses.py",
    "Cargo.lock": "tests/packaging/test_third_party.py",
    "THIRD_PARTY.md": "tests/packaging/test_third_party.py",
    "_modlens.pyi": "tests/border/test_stub.py",
    "analyzer/cli/__init__.py": "tests/packaging/test_shell_files.py",
    "analyzer/row_types.py": "tests/conformance/test_columns.py",
    "README.md": "tests/docs/test_readme.py",
    "CONTRIBUTING.md": "tests/docs/test_contributing.py",
    "ARCHITECTURE.md": "tests/docs/test_contributing.py",
    "docs/figures.md": "tests/docs/test_figures.py",
    "docs/segmentation.md": "tests/docs/test_figures.py",
    "docs/speed.md": "tests/docs/test_figures.py",
}


def changed_files() -> list[str]:
    """Lists files, new ones included, that differ from the last commit shared with `main`.

    MODLENS_BASE names another branch or commit; the workflow for pull requests sets it.
    """
    base = git("merge-base", "HEAD", os.environ.get("MODLENS_BASE") or "main") or ["HEAD"]
    changed = git("diff", "--name-only", "--diff-filter=d", base[0])
    return sorted({*changed, *git("ls-files", "--others", "--exclude-standard")})


def git(*words: str) -> list[str]:
    """The lines that git prints; none if it fails, as where there is no branch `main`."""
    run = subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True, check=False)
    return run.stdout.splitlines() if run.returncode == 0 else []


def crates(files: Iterable[str]) -> list[str]:
    """The crates of the files, and those that embed them."""
    files = list(files)
    own = {Path(file).parts[1] for file in files if file.startswith("crates/")}
    return sorted(own | {CRATES_OF_TABLES[file] for file in files if file in CRATES_OF_TABLES})


def python_tests(files: Iterable[str]) -> list[str]:
    """What pytest is to collect."""
    files = list(files)
    found = {test for crate in crates(files) for test in TESTS_OF_CRATES[crate]}
    for file in files:
        found.update(tests_of(file))
    return sorted(found)


def tests_of(file: str) -> Iterator[str]:
    """The tests of a file outside of the crates, and that a recipe which changes it still can."""
    path = Path(file)
    if is_changed_by_recipe(file):
        yield "tests/docs/test_contributing.py::test_a_step_has_its_place"
    if file in TESTS_OF_FILES:
        yield TESTS_OF_FILES[file]
        if path.suffix == ".py":
            yield file  # Its doctests.
        if file == "README.md":
            yield TESTS_OF_FILES["docs/figures.md"]  # It quotes them.
    elif path.parts[0] == "tests" and path.name.startswith("test_"):
        yield file
    elif path.parts[0] in ("modlens", "analyzer", "dissectors"):
        if path.is_relative_to("analyzer/cli"):
            yield TESTS_OF_FILES["analyzer/cli/__init__.py"]
        if path.suffix == ".py":
            yield file  # Its doctests.
        yield from nearest_tests(path)


def is_changed_by_recipe(file: str) -> bool:
    """Whether CONTRIBUTING.md names a line of the file as the place of a step."""
    recipes = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    return any(f"\n`{file}`, {place} `" in recipes for place in ("after", "in front of"))


def nearest_tests(path: Path) -> list[str]:
    """The tests that bear the name of the file; else those of its folder, or of the next above."""
    folder = ROOT / "tests" / path.parent
    named = sorted(folder.glob(f"test_{path.stem.lstrip('_')}*.py")) if folder.is_dir() else []
    while not named:
        if folder.is_dir() and folder != ROOT / "tests":
            named = sorted(folder.glob("test_*.py"))
        elif folder == ROOT / "tests":
            break
        folder = folder.parent
    return [test.relative_to(ROOT).as_posix() for test in named]


def commands(files: list[str]) -> Iterator[list[str]]:
    """The commands in their order: the quick ones come first."""
    rust = any(
        file in CRATES_OF_TABLES or (file.endswith((".rs", ".toml")) and file.startswith("crates/"))
        for file in files
    )
    yield [sys.executable, "-m", "ruff", "check"]
    yield [sys.executable, "-m", "ruff", "format", "--check"]
    if rust:
        yield ["cargo", "fmt", "--check"]
        packages = [word for crate in crates(files) for word in ("--package", crate)]
        yield [*CLIPPY, *packages, "--all-targets", "--", "-D", "warnings"]
        # What the others make of a changed interface.
        yield [*CLIPPY, "--package", "modlens-py", "--", "-D", "warnings"]
        # With the extension, which has no tests: its features are those that it was built with.
        yield [*CARGO_TEST, *packages, "--package", "modlens-py"]
    if any(file.endswith((".py", ".pyi")) for file in files):
        yield [sys.executable, "-m", "mypy"]
        yield [str(Path(sys.executable).parent / "lint-imports")]
    if tests := python_tests(files):
        yield [sys.executable, "-m", "pytest", "--quiet", *tests]


CARGO_TEST = ("cargo", "test", "--release", "--locked", "--quiet", "--tests")
CLIPPY = ("cargo", "clippy", "--release", "--locked", "--quiet")


def cargo_environment() -> dict[str, str]:
    """The environment with what maturin shows pyo3.

    Without it Cargo sees another pyo3 than maturin did, and each of the two builds pyo3 and the
    border again after the other.
    """
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    name = f"pyo3-config-{platform.machine()}-*-{version}-abi3.txt"
    configs = sorted((ROOT / "target" / "maturin").glob(name))
    if len(configs) != 1:
        return dict(os.environ)
    return {**os.environ, "PYO3_BUILD_EXTENSION_MODULE": "1", "PYO3_CONFIG_FILE": str(configs[0])}


def main() -> None:
    """Runs the commands until one fails."""
    for command in commands(changed_files()):
        sys.stdout.write(f"== {' '.join(command)}\n")
        sys.stdout.flush()
        environment = cargo_environment() if command[0] == "cargo" else None
        if status := subprocess.run(command, cwd=ROOT, env=environment, check=False).returncode:
            raise SystemExit(status)


if __name__ == "__main__":
    main()
