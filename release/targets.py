"""The systems that get a wheel or the tap for gateways, and how each is called by others."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["GATEWAYS", "MACHINES", "TARGETS", "Gateway", "Machine", "Target"]


_MAX_BYTES = 10_000_000
_MAX_BYTES_OF_APPLE = 11_000_000
"""For each processor that a wheel is for. The first ones had 4.1 to 4.4 MB for Linux, 7.3
for Windows and 9.1 for macOS; the core of the page, which came later, is 1.0 MB in each. One for
another processor that is not optimised, for a trial, had 8.0."""


@dataclass(frozen=True, slots=True)
class Target:
    """One wheel: the triples of Rust that are in it, its standard, and the tag that it must have.

    `compatibility` is maturin's word for the standard; `platforms` are the tags of the wheel, of
    which a name may have several with a dot between them.
    """

    triples: tuple[str, ...]
    compatibility: str
    platforms: frozenset[str]

    @property
    def max_bytes(self) -> int:
        """More than these is a mistake: debugging symbols, or something twice."""
        return sum(_MAX_BYTES_OF_APPLE if "apple" in one else _MAX_BYTES for one in self.triples)

    @property
    def build_triple(self) -> str:
        """The triple that maturin builds; a universal wheel of macOS is built of two."""
        return self.triples[0] if len(self.triples) == 1 else "universal2-apple-darwin"


def _manylinux(triple: str, machine: str) -> Target:
    tags = frozenset({f"manylinux2014_{machine}", f"manylinux_2_17_{machine}"})
    return Target((triple,), "manylinux2014", tags)


def _musllinux(triple: str, machine: str) -> Target:
    return Target((triple,), "musllinux_1_2", frozenset({f"musllinux_1_2_{machine}"}))


TARGETS = {
    "manylinux-x86_64": _manylinux("x86_64-unknown-linux-gnu", "x86_64"),
    "manylinux-aarch64": _manylinux("aarch64-unknown-linux-gnu", "aarch64"),
    "manylinux-armv7l": _manylinux("armv7-unknown-linux-gnueabihf", "armv7l"),
    "musllinux-x86_64": _musllinux("x86_64-unknown-linux-musl", "x86_64"),
    "musllinux-aarch64": _musllinux("aarch64-unknown-linux-musl", "aarch64"),
    "musllinux-armv7l": _musllinux("armv7-unknown-linux-musleabihf", "armv7l"),
    "windows-amd64": Target(("x86_64-pc-windows-gnu",), "pypi", frozenset({"win_amd64"})),
    "macos-universal2": Target(
        ("x86_64-apple-darwin", "aarch64-apple-darwin"),
        "pypi",
        frozenset(
            {"macosx_10_12_x86_64", "macosx_11_0_arm64", "macosx_10_12_universal2"},
        ),
    ),
}
"""By the names that `make wheels TARGETS=...` takes."""


@dataclass(frozen=True, slots=True)
class Machine:
    """A processor: what Debian calls it, and the emulator that runs its programs elsewhere."""

    debian: str
    emulator: str


MACHINES = {
    "x86_64": Machine("amd64", "qemu-x86_64-static"),
    "aarch64": Machine("arm64", "qemu-aarch64-static"),
    "armv7l": Machine("armhf", "qemu-arm-static"),
}
"""By the names that Linux has for them (`uname -m`)."""


@dataclass(frozen=True, slots=True)
class Gateway:
    """A static binary of the tap: the triple of Rust, what `uname -m` says, its ELF machine."""

    triple: str
    machine: str
    elf: str


GATEWAYS = {
    "x86_64": Gateway("x86_64-unknown-linux-musl", "x86_64", "EM_X86_64"),
    "aarch64": Gateway("aarch64-unknown-linux-musl", "aarch64", "EM_AARCH64"),
    "armv7": Gateway("armv7-unknown-linux-musleabihf", "armv7l", "EM_ARM"),
}
"""By the names that `make gateway MACHINES=...` takes."""
