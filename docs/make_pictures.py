"""Pictures of pages for the documentation, taken by Chromium: light and dark, of a run and of a power matrix.

    python docs/make_pictures.py RUN.html [MATRIX.html [SPACE.html]]

The first is the page of the built-in OWC, the second that of `annual_power`, the third that of
`jaxsph run hull --set dx=0.05 --t1 0.4`. They go to docs/pictures; those of pages not given stay as they are.
"""

import shutil
import sys
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright

TO = Path(__file__).parent / "pictures"
VIEWS = {
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


def main(pages: list[str]) -> None:
    """Takes every view of the pages."""
    chromium = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    with sync_playwright() as library:
        browser = library.chromium.launch(executable_path=chromium, args=["--no-sandbox", "--disable-gpu"])
        for name, (number, colours, width, height, top, t) in VIEWS.items():
            if number >= len(pages):
                continue
            page = browser.new_page(viewport={"width": width, "height": height}, color_scheme=colours)
            page.goto(f"file://{Path(pages[number]).resolve()}")
            page.evaluate("jaxsph.ready")
            if t is not None:
                page.evaluate(f"jaxsph.players.forEach((water) => water.fit('device')); seek({t})")
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
