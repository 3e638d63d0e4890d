"""How fast the page is in Chromium: reading, jumping, cancelling, and the memory of its rows.

`make bench-page`, or `python -m bench.page_speed`. The page is opened from the disk and driven
as people use it; times are taken in the page, from the choice of a file on. Traffic is that of
`bench/support/workload.py`. The load of the machine is printed with the figures.
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import tempfile
from pathlib import Path

from analyzer.page import page
from bench.support.workload import Workload
from tests.support.browser import Browser, running

LOG_MB, CAPTURE_MB, MANY_ROWS, JUMPS, RUNS = 20, 230, 3_000_000, 40, 3
WATCH = """
window.seen = [];
window.slowest = 0;
const began = performance.now(), root = document.documentElement;
const note = (what) => window.seen.push([what, performance.now() - began]);
new MutationObserver(() => note(root.dataset.state)).observe(
  root, { attributes: true, attributeFilter: ['data-state'] });
const results = document.getElementById('results');
new MutationObserver(() => results.hidden || note('causes')).observe(
  results, { attributes: true, attributeFilter: ['hidden'] });
new PerformanceObserver((list) => list.getEntries().forEach((one) => {
  window.slowest = Math.max(window.slowest, one.duration);
})).observe({ entryTypes: ['longtask'] });
"""
JUMP = """(async () => {
  const grid = document.querySelector('.grid'), times = [];
  for (let turn = 0; turn < arguments[0]; turn++) {
    const before = grid.dataset.first, began = performance.now();
    const drawn = new Promise((done) => new MutationObserver((_, it) => {
      if (grid.dataset.first !== before) { it.disconnect(); requestAnimationFrame(done); }
    }).observe(grid, { attributes: true, attributeFilter: ['data-first'] }));
    grid.scrollTop = Math.random() * (grid.scrollHeight - grid.clientHeight);
    await drawn;
    times.push(performance.now() - began);
  }
  return times;
})()"""
CANCEL = """(async () => {
  const began = performance.now(), root = document.documentElement;
  document.getElementById('cancel').click();
  while (root.dataset.state !== 'refused') await new Promise((done) => setTimeout(done, 1));
  return performance.now() - began;
})()"""
MEMORY = """Page.request('decode', { blob: Page.recording.blob,
  settings: { name: 'capture', purpose: 'large' },
}).then((it) => [it.rows, it.megabytes, it.needed])"""
ENDED = "['shown', 'refused'].includes(document.documentElement.dataset.state)"


def of_size(write: object, workload: Workload, path: Path, megabytes: int) -> Path:
    """A recording of at least so many megabytes."""
    assert callable(write)
    one = write(workload, path, 1).stat().st_size
    return Path(write(workload, path, -(-megabytes * 1_000_000 // one)))


def opened(browser: Browser, written: Path, path: Path) -> dict[str, float]:
    """The milliseconds until causes and rows of a file are shown."""
    browser.open(written, "ready")
    browser.run(WATCH)
    browser.send_file("#file", path)
    browser.wait(f"window.seen.length > 1 && {ENDED}", 300)
    found = {what: float(at) for what, at in browser.run("return window.seen")}
    browser.wait("document.documentElement.dataset.report === 'drawn'", 60)
    return found | {"pause": float(browser.run("return window.slowest"))}


def cancelled(browser: Browser, written: Path, path: Path) -> float:
    """The milliseconds from the click on Cancel until the page says so."""
    browser.open(written, "ready")
    browser.send_file("#file", path)
    browser.wait("document.getElementById('bar').value > 0", 60)
    return float(browser.ask(CANCEL))


def main() -> None:
    """Prints the figures."""
    argparse.ArgumentParser(description=__doc__.split("\n", 1)[0] if __doc__ else "").parse_args()
    out = sys.stdout
    with tempfile.TemporaryDirectory() as name, running(Path(name)) as browser:
        folder = Path(name)
        written = folder / "modlens.html"
        written.write_bytes(page())
        workload = Workload()
        log = of_size(Workload.write_log, workload, folder / "polls.log", LOG_MB)
        capture = of_size(Workload.write_capture, workload, folder / "polls.pcap", CAPTURE_MB)
        out.write(f"load of the machine: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores\n")
        for path, unit in ((log, "log"), (capture, "capture")):
            runs = [opened(browser, written, path) for _ in range(RUNS)]
            for what in ("causes", "shown", "pause"):
                times = sorted(run[what] for run in runs)
                size = path.stat().st_size / 1e6
                title = {"shown": "rows", "pause": "longest pause of the page"}.get(what, what)
                out.write(
                    f"{unit} of {size:.0f} MB, {title}: {times[0]:,.0f} to {times[-1]:,.0f} ms\n"
                )
        waits = sorted(cancelled(browser, written, capture) for _ in range(RUNS))
        out.write(f"cancel: {waits[0]:.0f} to {waits[-1]:.0f} ms\n")
        rows = len(workload.exchanges)
        workload.write_capture(capture, -(-MANY_ROWS // rows))
        opened(browser, written, capture)
        shown = browser.run("return document.querySelector('.grid').getAttribute('aria-rowcount')")
        jumps = sorted(browser.ask(JUMP, JUMPS))
        out.write(
            f"jump in {int(shown) - 1:,} rows: {statistics.median(jumps):.0f} ms, worst"
            f" {jumps[-1]:.0f} ms\n"
        )
        count, megabytes, is_cut = browser.ask(MEMORY)
        out.write(f"memory of {count:,} rows: {megabytes} MB{', cut' if is_cut else ''}\n")
        out.write(f"load of the machine: {os.getloadavg()[0]:.1f}\n")


if __name__ == "__main__":
    main()
