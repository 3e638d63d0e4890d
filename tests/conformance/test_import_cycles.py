"""No circle of imports between files, nor between folders of a crate."""

from __future__ import annotations

from pathlib import Path

import grimp
import pytest

from tests.conftest import ROOT
from tests.support.cycles import cycles
from tests.support.rust_imports import crate_imports, describe_cycles

SOURCES = sorted(ROOT.glob("crates/*/src"))


@pytest.mark.parametrize("packages", [("analyzer", "dissectors"), ("tests",)])
def test_python_files_do_not_import_each_other(packages: tuple[str, ...]) -> None:
    """Imports inside functions count, and so do those for type checkers."""
    graph = grimp.build_graph(*packages, cache_dir=None)
    imports = {name: graph.find_modules_directly_imported_by(name) for name in graph.modules}
    tied = [
        [
            f"{detail['importer']}:{detail['line_number']}: {detail['line_contents']}"
            for name in group
            for target in sorted(imports[name].intersection(group))
            for detail in graph.get_import_details(importer=name, imported=target)
        ]
        for group in cycles(imports)
    ]
    assert not tied, "\n\n".join("\n".join(lines) for lines in tied)


@pytest.mark.parametrize("source", SOURCES, ids=[source.parent.name for source in SOURCES])
def test_rust_files_do_not_import_each_other(source: Path) -> None:
    """Files of one crate do not import each other; Cargo permits no circles between crates."""
    imports = crate_imports(source)
    assert any(imports.values()), "nothing was read"
    circles = describe_cycles(imports)
    assert not circles, "\n\n".join(circles)


@pytest.mark.parametrize("source", SOURCES, ids=[source.parent.name for source in SOURCES])
def test_rust_folders_do_not_import_each_other(source: Path) -> None:
    """Folders of one crate import each other one way only."""
    pairs = {
        (Path(file).parts[0], Path(target).parts[0])
        for file, targets in crate_imports(source).items()
        for target in targets
        if len(Path(file).parts) > 1 and len(Path(target).parts) > 1
    }
    assert not {(one, other) for one, other in pairs if one < other and (other, one) in pairs}
