"""How often the doctor is right: kinds, near confusions, healthy lines.

    python -m tests.doctor.score
    python -m tests.doctor.score --kinds lockstep no_bias --seeds 1-3
    python -m tests.doctor.score --write cases --kinds lockstep --seeds 1

`--write` only writes the recordings, and prints the command that examines each. `cases.tsv` lists
them and some healthy lines for the example `ablation` of `modlens-diagnosis`.
"""

from __future__ import annotations

import argparse
import shlex
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from tests.conftest import CAPTURES
from tests.doctor.captured import TROUBLED, Capture, captures, healthy_captures
from tests.doctor.cases import COUNTER_CASES, KINDS, Case, make
from tests.doctor.examine import Outcome, diagnose, examine, written
from tests.doctor.healthy import LINES, healthy_line

__all__ = ["main"]

FIRST_BAR, THREE_BAR = 0.90, 0.97


@dataclass(slots=True)
class Tally:
    """The outcomes of one kind."""

    cases: int = 0
    first: int = 0
    three: int = 0
    fits: int = 0
    confused: Counter[str] = field(default_factory=Counter)
    misses: list[int] = field(default_factory=list)

    def count(self, seed: int, outcome: Outcome) -> None:
        """One more."""
        self.cases += 1
        self.first += outcome.place == 1
        self.three += outcome.place is not None and outcome.place <= 3
        self.fits += outcome.fits
        if outcome.place != 1:
            self.misses.append(seed)
            self.confused[outcome.confused[0] if outcome.confused else "nothing"] += 1

    def line(self, name: str) -> str:
        """For the table."""
        wrong = ", ".join(f"{code} ({number})" for code, number in self.confused.most_common())
        seeds = f"  seeds {' '.join(map(str, self.misses))}" if self.misses else ""
        first, three, fits = (f"{n:3}/{self.cases:<3}" for n in (self.first, self.three, self.fits))
        return f"{name:22} {first} {three} {fits} {wrong}{seeds}"


def _say(text: str) -> None:
    print(text, flush=True)  # noqa: T201 - the command line's own output


def _seeds(text: str) -> list[int]:
    first, _, last = text.partition("-")
    return list(range(int(first), int(last or first) + 1))


def _outcomes(
    jobs: Sequence[tuple[str, int]], workers: int
) -> Iterator[tuple[str, int, Outcome | Exception]]:
    def one(job: tuple[str, int]) -> tuple[str, int, Outcome | Exception]:
        try:
            return *job, examine(make(*job))
        except (RuntimeError, KeyError, TypeError, ValueError) as error:
            return *job, error

    with ThreadPoolExecutor(workers) as pool:
        yield from pool.map(one, jobs)


def score_kinds(kinds: Sequence[str], seeds: Sequence[int], workers: int) -> bool:
    """Print a line for each kind and the totals; whether both bars are met."""
    tallies = {name: Tally() for name in kinds}
    total, broken = Tally(), []
    for name, seed, outcome in _outcomes([(n, s) for n in kinds for s in seeds], workers):
        if isinstance(outcome, Exception):
            broken.append(f"{name} seed {seed}: {outcome}")
            continue
        tallies[name].count(seed, outcome)
        total.count(seed, outcome)
    _say(f"{'kind':22} {'first':>7} {'three':>7} {'subject':>7} confused with")
    for name, tally in tallies.items():
        _say(tally.line(name))
    total.misses = []
    _say(total.line("all"))
    for line in broken:
        _say(line)
    cases = max(1, total.cases)
    met = total.first / cases >= FIRST_BAR and total.three / cases >= THREE_BAR
    _say(f"first {total.first / cases:.1%} (bar 90%), among three {total.three / cases:.1%} (97%)")
    return met and not broken


def score_counter_cases(seeds: Sequence[int], workers: int) -> bool:
    """Near confusions: a line for each that went wrong."""
    jobs = [(name, seed) for name in COUNTER_CASES for seed in seeds]
    wrong = 0
    for name, seed, outcome in _outcomes(jobs, workers):
        good = isinstance(outcome, Outcome) and (
            outcome.place == 1 or _nothing_expected(name, seed, outcome)
        )
        if not good:
            wrong += 1
            said = outcome if isinstance(outcome, Exception) else [r["code"] for r in outcome.rows]
            _say(f"near confusion: {name}, seed {seed}: {said}")
    _say(f"near confusions: {len(jobs) - wrong} of {len(jobs)} right")
    return not wrong


def _nothing_expected(name: str, seed: int, outcome: Outcome) -> bool:
    return make(name, seed).expected is None and not outcome.confused


def score_captures() -> bool:
    """Recordings of one trouble each from real masters and units."""
    wrong = 0
    for capture in captures():
        expected = TROUBLED.get(capture.name)
        if expected is None:
            continue
        said = [str(row["code"]) for row in diagnose(capture.file, capture.words, CAPTURES)]
        if said[:1] != [expected.code]:
            wrong += 1
            _say(f"captures/{capture.name}: {expected.code} expected, {said}")
    _say(f"captures of one trouble: {len(TROUBLED) - wrong} of {len(TROUBLED)} right")
    return not wrong


def score_healthy(workers: int) -> bool:
    """Healthy lines and captures: a line for each that is called ill."""
    jobs: dict[str, Callable[[], list[str]]] = {}
    for number in range(1, LINES + 1):
        jobs[f"healthy line {number}"] = partial(_errors_of_case, healthy_line, number)
    for capture in healthy_captures():
        jobs[capture.name] = partial(_errors_of_capture, capture)
    with ThreadPoolExecutor(workers) as pool:
        found = dict(zip(jobs, pool.map(_called, jobs.values()), strict=True))
    for name, errors in found.items():
        if errors:
            _say(f"{name}: {', '.join(errors)}")
    wrong = sum(bool(errors) for errors in found.values())
    _say(f"healthy with a diagnosis of severity error: {wrong} of {len(found)}")
    return not wrong


def _called(job: Callable[[], list[str]]) -> list[str]:
    return job()


def _errors_of_case(maker: Callable[[int], Case], number: int) -> list[str]:
    return list(examine(maker(number)).errors)


def _errors_of_capture(capture: Capture) -> list[str]:
    rows = diagnose(capture.file, capture.words, CAPTURES)
    return [str(row["code"]) for row in rows if row["severity"] == "error"]


def write_cases(kinds: Sequence[str], seeds: Sequence[int], into: Path) -> None:
    """Recordings for a look at them, and as many healthy lines as there are kinds."""
    rows = []
    cases = [(name, make(name, seed), seed) for name in kinds for seed in seeds]
    numbers = range(1, len(kinds) + 1)
    healthy = [("healthy line", healthy_line(number), number) for number in numbers]
    for name, case, number in [*cases, *healthy]:
        folder = written(case, into / f"{name.replace(' ', '_')}_{number}")
        _say(f"cd {folder}; modlens doctor {case.main} {shlex.join(case.words)}  # {case.expected}")
        line, code = _line_of(case.words), case.expected.code if case.expected else ""
        if line is not None:
            rows.append(f"{(folder / case.main).resolve()}\t{line}\t{code}\n")
    (into / "cases.tsv").write_text("".join(rows), "utf-8")


def _line_of(words: Sequence[str]) -> str | None:
    """The line settings, or none; nothing where other options are needed."""
    match list(words):
        case []:
            return ""
        case ["--line", line]:
            return line
    return None


def main(arguments: Sequence[str] | None = None) -> int:
    """Score what the command line names; 1 where a bar is not met."""
    parser = argparse.ArgumentParser(prog="python -m tests.doctor.score", description=__doc__)
    parser.add_argument("--kinds", nargs="*", default=list(KINDS), metavar="KIND")
    parser.add_argument("--seeds", type=_seeds, default=_seeds("1-5"), metavar="1-5")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--only", choices=["kinds", "confusions", "captures", "healthy"])
    parser.add_argument("--write", type=Path, metavar="FOLDER")
    options = parser.parse_args(arguments)
    if options.write:
        write_cases(options.kinds, options.seeds, options.write)
        return 0
    parts: dict[str, Callable[[], bool]] = {
        "kinds": lambda: score_kinds(options.kinds, options.seeds, options.workers),
        "confusions": lambda: score_counter_cases(options.seeds, options.workers),
        "captures": score_captures,
        "healthy": lambda: score_healthy(options.workers),
    }
    met = [part() for name, part in parts.items() if options.only in (None, name)]
    return 0 if all(met) else 1


if __name__ == "__main__":
    sys.exit(main())
