"""Scores every file of a corpus that is not part of the project: `make corpus CORPUS=folder`.

A kind of file is a folder of the corpus and a module here; `KINDS` is their registry. Each module
has `score(folder) -> Iterator[Score]`. One line a file; the exit status is 1 if one is not whole.
"""

from __future__ import annotations

import importlib
import sys
from dataclasses import dataclass
from pathlib import Path

__all__ = ["KINDS", "Score", "main"]

KINDS = {
    "logs": "tests.corpus.score_logs",
    "pcap": "tests.corpus.score_captures",
    "sigrok": "tests.corpus.score_sigrok",
}
"""Folder of the corpus -> module that scores what is in it."""


@dataclass(frozen=True, slots=True)
class Score:
    """How one file fared.

    `found` of `wanted` expectations hold; `notes` say how it was read, `wrong` what does not hold.
    """

    name: str
    wanted: int
    found: int
    notes: str
    wrong: tuple[str, ...] = ()

    @property
    def whole(self) -> bool:
        """Whether nothing is missing."""
        return not self.wrong and self.found == self.wanted

    def __str__(self) -> str:
        mark = "ok  " if self.whole else "MISS"
        lines = [f"{mark} {self.name}: {self.found} of {self.wanted}; {self.notes}"]
        return "\n".join([*lines, *(f"       {text}" for text in self.wrong)])


def main(corpus: str, only: tuple[str, ...] = ()) -> int:
    """Score all kinds, or those named; gives the exit status."""
    missed = 0
    for kind, module in KINDS.items():
        folder = Path(corpus) / kind
        if (only and kind not in only) or not folder.is_dir():
            continue
        scores = list(importlib.import_module(module).score(folder))
        for score in scores:
            print(score)  # noqa: T201 - a report
        whole = sum(score.whole for score in scores)
        missed += len(scores) - whole
        print(f"{kind}: {whole} of {len(scores)} files")  # noqa: T201 - a report
    return 1 if missed else 0


if __name__ == "__main__":
    if len(sys.argv) == 1 or not Path(sys.argv[1]).is_dir():
        raise SystemExit("usage: python -m tests.corpus.score FOLDER [KIND...]")
    raise SystemExit(main(sys.argv[1], tuple(sys.argv[2:])))
