"""Pictures of pages for the documentation, taken by Chromium.

    python docs/make_pictures.py RUN.html [MATRIX.html [SPACE.html]]
    python docs/make_pictures.py cases NAME.html=TIME ...

The first command takes the page of the built-in OWC, that of `annual_power` and that of
`jaxsph run hull --set dx=0.05 --t1 0.4`, light and dark. The second takes, for the gallery, the section and
the three-dimensional view of each case NAME at a time (s). Pictures go to docs/pictures; those of pages not
given stay as they are.
"""

import shutil
import sys
from pathlib import Path
from typing import Literal

from PIL import Image
from playwright.sync_api import sync_playwright

TO = Path(__file__).parent / "pictures"
VIEWS: dict[str, tuple[int, Literal["light", "dark"], int, int, str, float | None]] = {
    # name: (page, colours, width, height, what stands at the top, time of the particles)
    "report_run_light": (0, "light", 1280, 1000, "body", 20.05),
    "report_run_dark": (0, "dark", 1280, 1000, "body", 20.65),
    "report_charts_light": (0, "light", 1280, 1000, "section:has(.chart) h2", 20.05),
    "report_results_light": (0, "light", 1280, 1000, "section:has(td.meaning) h2", 20.05),
    "report_narrow_dark": (0, "dark", 390, 844, "body", 20.05),
    "report_matrix_light": (1, "light", 1280, 760, "body", None),
    "report_space_light": (2, "light", 1280, 560, ".player", 0.4),
    "report_matrix_dark": (1, "dark", 1280, 760, "body", None),
}


View = tuple[str, Literal["light", "dark"], int, int, str, str]
"""Page, colours, width and height (pixels), element at the top, and script that prepares the page."""


def views(pages: list[str]) -> dict[str, View]:
    """Views of the given pages, by the name of the picture."""
    if pages[:1] == ["cases"]:
        given = [one.rpartition("=") for one in pages[1:]]
        return {Path(page).stem: (page, "light", 1280, 560, ".player", f"seek({t})") for page, _, t in given}
    found = {}
    for name, (number, colours, width, height, top, t) in VIEWS.items():
        if number < len(pages):
            fit = "jaxsph.players.forEach((water) => water.fit('device'))"
            script = "" if t is None else f"{fit}; seek({t})"
            found[name] = (pages[number], colours, width, height, top, script)
    return found


def main(pages: list[str]) -> None:
    """Takes every view of the pages."""
    chromium = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    with sync_playwright() as library:
        browser = library.chromium.launch(executable_path=chromium, args=["--no-sandbox", "--disable-gpu"])
        for name, (given, colours, width, height, top, script) in views(pages).items():
            page = browser.new_page(viewport={"width": width, "height": height}, color_scheme=colours)
            page.goto(f"file://{Path(given).resolve()}")
            page.evaluate("jaxsph.ready")
            if script:
                page.evaluate(script)
            page.evaluate(f"document.querySelector({top!r}).scrollIntoView()")
            page.wait_for_timeout(300)
            path = TO / f"{name}.png"
            page.screenshot(path=path)
            with Image.open(path) as picture:  # a fifth of the bytes
                picture.convert("RGB").quantize(160).save(path, optimize=True)
            page.close()
        browser.close()


if __name__ == "__main__":
    main(sys.argv[1:])
