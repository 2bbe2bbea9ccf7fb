"""Size of pages for the browser, time to their first frame, frames per second; time of a coarse run."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import jaxsph as js
from experiments.common import Report, solved

FLAGS = ["--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking"]
DRAW = """() => {
    const began = performance.now();
    for (let k = 0; k < 60; k++) seek(k % 7 * 0.41);
    return 60000 / (performance.now() - began);
}"""
"""Script that measures frames per second of drawing alone, at changing times of the run."""


def main(fine: float = 0.008, t1: float = 3.0, seconds: float = 4.0) -> None:
    """Measures pages of the built-in OWC, and of an OWC with the spacing `fine` (m) that runs to `t1` (s).

    Each page is played for `seconds`.
    """
    case = js.load_case("owc")
    files = {
        "built-in OWC": solved(case, "bench_report"),
        f"OWC at dx = {fine:g} m": solved(case.replace({"dx": fine}), "bench_report_fine", t1),
    }
    with Report("bench_report", "Pages of runs in Chromium, without a graphics card") as report:
        whole = _coarse_run()
        report.row(
            "jaxsph run owc --quick: time from command to page", whole, "s", bar="60 s", passes=whole < 60
        )
        for (name, run), bar in zip(files.items(), (30, 10), strict=True):
            began = time.perf_counter()
            page = js.report(run.path)
            report.row(f"{name}: time to write the page", time.perf_counter() - began, "s")
            size = page.stat().st_size / 1e6
            report.row(f"{name}: size of the page", size, "MB", bar="under 8 MB", passes=size < 8)
            found = _seen(page, seconds)
            report.row(f"{name}: particles", found["particles"])
            first = found["first"]
            report.row(f"{name}: time to the first frame", first, "s", bar="under 2 s", passes=first < 2)
            played = found["played"]
            report.row(f"{name}: frames per second", played, bar=f"at least {bar}", passes=played >= bar)
            report.row(f"{name}: frames per second, drawing only", found["drawn"])


def _coarse_run() -> float:
    """Wall time (s) of a run with `--quick` in a separate process, which compiles everything."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "owc.h5"
        began = time.perf_counter()
        command = [sys.executable, "-m", "jaxsph", "run", "owc", "--quick", "--quiet", "--out", str(out)]
        subprocess.run(command, check=True)
        if not out.with_suffix(".html").exists():
            raise FileNotFoundError("the coarse run has written no page")
        return time.perf_counter() - began


def _seen(page: Path, seconds: float) -> dict[str, Any]:
    """Number of particles, time to the first frame (s) and frames per second of a page in a browser.

    The page shows the whole tank.
    """
    from playwright.sync_api import sync_playwright

    chromium = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if chromium is None:
        raise FileNotFoundError("Chromium was not found: install it from the system's packages")
    with sync_playwright() as library:
        browser = library.chromium.launch(executable_path=chromium, args=FLAGS)
        opened = browser.new_page(viewport={"width": 1280, "height": 900})
        opened.goto(f"file://{page.resolve()}")
        opened.evaluate("jaxsph.ready")
        opened.click("button[aria-label='Show the whole tank']")
        opened.evaluate("jaxsph.pictures = 0; seek(0); play(true)")
        opened.wait_for_timeout(1000 * min(seconds, opened.evaluate("span()[1]")))
        took = opened.evaluate("jaxsph.t")
        found = {
            "particles": opened.evaluate("jaxsph.players[0].player.count"),
            "first": opened.evaluate("jaxsph.firstPicture") / 1000,
            "played": opened.evaluate("jaxsph.pictures") / max(took, 1e-3),
            "drawn": opened.evaluate(DRAW),
        }
        browser.close()
    return found
