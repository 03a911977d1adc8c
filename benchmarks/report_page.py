"""What the report page of a run folder costs: seconds to write it, bytes, seconds until a browser can use it.

    python benchmarks/report_page.py results/latest

Not a test: wall-clock times depend on the machine and on what else it does; the seconds of the browser's main thread
depend on that least. Chromium and playwright are needed for both.
"""

import shutil
import statistics
import sys
import time

from tcbench.report.write_report import write_report

REPEATS = 5
READY = "() => document.documentElement.dataset.ready"


def opened(page_path):
    """(seconds from opening the page to an Overview that answers, seconds of the main thread) of fresh contexts."""
    from playwright.sync_api import sync_playwright

    program = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    found = []
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=program, args=["--no-sandbox", "--disable-gpu"])
        for _ in range(REPEATS):
            context = browser.new_context(viewport={"width": 1400, "height": 900})
            page = context.new_page()
            tools = context.new_cdp_session(page)
            tools.send("Performance.enable", {"timeDomain": "threadTicks"})
            begin = time.perf_counter()
            page.goto(page_path.resolve().as_uri())
            page.wait_for_function(READY)
            seconds = time.perf_counter() - begin
            metrics = {m["name"]: m["value"] for m in tools.send("Performance.getMetrics")["metrics"]}
            found.append((seconds, metrics["TaskDuration"]))
            context.close()
        browser.close()
    return found


def main(folder):
    begin, cpu = time.perf_counter(), time.process_time()
    path = write_report(folder)
    print(f"written in {time.perf_counter() - begin:.2f} s ({time.process_time() - cpu:.2f} s of CPU)")
    print(f"{path.stat().st_size / 1e6:.2f} MB")
    for what, seconds in zip(
        ("interactive after", "main thread busy for"), zip(*opened(path), strict=True), strict=True
    ):
        print(
            f"{what} {statistics.median(seconds):.2f} s (median of {REPEATS}, {min(seconds):.2f} to {max(seconds):.2f})"
        )


if __name__ == "__main__":
    main(*sys.argv[1:])
