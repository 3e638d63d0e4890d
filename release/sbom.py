"""Writes release/modlens.cyclonedx.json: the list of what is compiled into the extension (SBOM).

    python -m release.sbom            # writes the file
    python -m release.sbom --check    # exit status 1 where it is not what it would write

The wheel holds this file. The one that maturin makes names the folder it was built in, and has the
time in it, so that no two are alike.
"""

from __future__ import annotations

import json
import sys
import tomllib
from typing import Any

from release.licences import ROOT, SYSTEMS, cargo, write_or_check

OUTPUT = ROOT / "release" / "modlens.cyclonedx.json"
PACKAGE = "modlens-py"


def _purl(crate: dict[str, Any]) -> str:
    """A crate by its name in the registry (github.com/package-url/purl-spec)."""
    return f"pkg:cargo/{crate['name']}@{crate['version']}"


def _reached(metadata: dict[str, Any]) -> dict[str, list[str]]:
    """What each crate of the extension needs at build or run time, by identifier, itself first."""
    nodes = {node["id"]: node for node in metadata["resolve"]["nodes"]}
    waiting = [one["id"] for one in metadata["packages"] if one["name"] == PACKAGE]
    found: dict[str, list[str]] = {}
    while waiting:
        crate = waiting.pop()
        needed = [
            dep["pkg"]
            for dep in nodes[crate]["deps"]
            if any(kind["kind"] != "dev" for kind in dep["dep_kinds"])
        ]
        found[crate] = needed
        waiting += [one for one in needed if one not in found]
    return found


def _component(crate: dict[str, Any], checksums: dict[tuple[str, str], str]) -> dict[str, Any]:
    purl = _purl(crate)
    checksum = checksums.get((crate["name"], crate["version"]))
    return {
        "type": "library",
        "bom-ref": purl,
        "name": crate["name"],
        "version": crate["version"],
        **({"description": crate["description"].strip()} if crate["description"] else {}),
        "scope": "required",
        **({"hashes": [{"alg": "SHA-256", "content": checksum}]} if checksum else {}),
        "licenses": [{"expression": (crate["license"] or "MIT").replace("/", " OR ")}],
        "purl": purl,
    }


def document() -> str:
    """The document in CycloneDX 1.5, of the crates that any of the systems needs."""
    words = [word for system in SYSTEMS for word in ("--filter-platform", system)]
    metadata = json.loads(cargo("metadata", "--locked", "--format-version", "1", *words))
    lock = tomllib.loads((ROOT / "Cargo.lock").read_text("utf-8"))["package"]
    checksums = {
        (one["name"], one["version"]): one["checksum"] for one in lock if "checksum" in one
    }
    reached = _reached(metadata)
    crates = {one["id"]: one for one in metadata["packages"] if one["id"] in reached}
    parts = sorted(crates.values(), key=lambda one: (one["name"], one["version"]))
    main = next(one for one in parts if one["name"] == PACKAGE)
    content = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": {"component": _component(main, checksums)},
        "components": [_component(one, checksums) for one in parts if one is not main],
        "dependencies": [
            {
                "ref": _purl(one),
                "dependsOn": sorted({_purl(crates[need]) for need in reached[one["id"]]}),
            }
            for one in parts
        ],
    }
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    sys.exit(write_or_check(OUTPUT, document, __doc__))
