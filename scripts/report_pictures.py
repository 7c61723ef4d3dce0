"""Write the pictures of the report in docs/images, from the report of ``posefuse demo``: ``report_pictures.py``.

Needs Chromium and playwright.
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

IMAGES = Path(__file__).parent.parent / "docs" / "images"
_GRAPHICS = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")


def main() -> None:
    """Make the demo and take the pictures."""
    browser = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as driver:
        output = Path(folder) / "demo"
        subprocess.run([sys.executable, "-m", "posefuse", "demo", "--output", str(output)], check=True)
        opened = driver.chromium.launch(executable_path=browser, args=list(_GRAPHICS))
        page = opened.new_page(viewport={"width": 1200, "height": 1000})
        page.goto(next(output.rglob("report.html")).as_uri())
        page.wait_for_function("document.querySelector('#keypoint-errors .js-plotly-plot')", timeout=120_000)
        page.add_style_tag(content="#sections { position: static !important; }")
        page.select_option("#follow", "0")
        _show(page, 62)
        page.screenshot(path=IMAGES / "report.png")
        page.select_option("#view", "1")
        page.check("#side-by-side")
        page.select_option("#follow", "-1")
        page.select_option("#follow", "0")
        page.wait_for_timeout(1000)
        page.locator("#scene").screenshot(path=IMAGES / "report_cameras.png")
        page.select_option("#follow", "-1")
        page.uncheck("#side-by-side")
        page.locator("#heat td").nth(21).click()
        page.locator("#heat-map-section").screenshot(path=IMAGES / "report_cells.png")
        opened.close()


def _show(page: Page, frame: int) -> None:
    page.evaluate(f"scrub.value = {frame}; scrub.dispatchEvent(new Event('input'))")
    page.wait_for_timeout(1000)


if __name__ == "__main__":
    main()
