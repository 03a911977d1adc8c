"""The picture of the page on the first screen of the README: python benchmarks/page_picture.py results/latest

Writes docs/page.png from the folder's report.html, as a browser shows it. Chromium and playwright are needed.
"""

import io
import shutil
import sys
from pathlib import Path

ROOT = Path(__file__).parent.parent
PICTURE = ROOT / "docs" / "page.png"
SIZE = {"width": 1400, "height": 900}
READY = "() => document.documentElement.dataset.ready"


def taken(page_path):
    """The Overview as a picture in its own colours: of a palette, those of the methods are not the chart's."""
    from PIL import Image
    from playwright.sync_api import sync_playwright

    program = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=program, args=["--no-sandbox", "--disable-gpu"])
        page = browser.new_page(viewport=SIZE, color_scheme="light")
        page.goto(page_path.resolve().as_uri())
        page.wait_for_function(READY)
        page.wait_for_timeout(300)  # charts are drawn when their place has a width
        picture = Image.open(io.BytesIO(page.screenshot()))
        browser.close()
    return picture.convert("RGB")


if __name__ == "__main__":
    from tcbench.report.write_report import write_report

    taken(write_report(sys.argv[1])).save(PICTURE, optimize=True)
