"""The pages of a board with many methods: made, opened from disk in Chromium, sorted, filtered.

Usage: ``python benchmarks/bench_leaderboard_pages.py [--methods 500]``; needs Chromium,
ChromeDriver and Selenium. Times of the browser are those of its own clock (performance.now), each
the median of several; a sort ends when the next frame has been laid out and painted. Beside them
stands what the page's thread spent of the processor, which a busy machine changes less.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from airzoo_bench.leaderboard.site.pages import render_pages
from tests.leaderboard.site.make_sample import sample
from tests.report.browser import BROWSER, DRIVER, FLAGS, webdriver

TABLE = "tables/airzoo-mini-retrieval"
PAGES = ("index", "ranks", "scenes", "conditions", "compare")
# Until the frame after the next one begins, all of what was done has been painted.
PAINTED = """
const done = arguments[arguments.length - 1], start = performance.now();
{ACTION}
requestAnimationFrame(() => requestAnimationFrame(() => done(performance.now() - start)));
"""
SORT = "document.querySelector(`th[data-name='R@5'] button`).click();"
SEARCH = """
const field = document.querySelector("[name=name]");
field.value = field.value ? "" : "Method 4";
field.dispatchEvent(new Event("input", { bubbles: true }));
"""
OPENED = "return performance.getEntriesByType('navigation')[0].loadEventEnd"


def started() -> Any:
    """Return a browser without a window."""
    options = webdriver.ChromeOptions()
    options.binary_location = BROWSER
    for flag in FLAGS:
        options.add_argument(flag)
    return webdriver.Chrome(options=options, service=webdriver.ChromeService(DRIVER))


def spent(driver: Any) -> float:
    """Return the milliseconds of processor time that the page's thread has spent."""
    found = driver.execute_cdp_cmd("Performance.getMetrics", {})["metrics"]
    return 1000 * next(one["value"] for one in found if one["name"] == "TaskDuration")


def opening(driver: Any, page: Path, times: int) -> str:
    """Return what passes from the start of opening a page to the end of its load."""
    walls, thread = [], []
    for _ in range(times):
        driver.get("about:blank")
        before = spent(driver)
        driver.get(page.as_uri())
        walls.append(driver.execute_script(OPENED))
        thread.append(spent(driver) - before)
    return said(walls, thread)


def doing(driver: Any, action: str, times: int) -> str:
    """Return what passes until what an action does has been painted."""
    script, walls, thread = PAINTED.replace("{ACTION}", action), [], []
    for _ in range(times):
        before = spent(driver)
        walls.append(driver.execute_async_script(script))
        thread.append(spent(driver) - before)
    return said(walls, thread)


def said(walls: list[float], thread: list[float]) -> str:
    """Return the medians as text."""
    return f"{statistics.median(walls):5.0f} ms, CPU {statistics.median(thread):4.0f} ms"


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--methods", type=int, default=500)
    parser.add_argument("--times", type=int, default=9)
    given = parser.parse_args()
    files = sample(given.methods)
    start = time.process_time()
    pages = render_pages(files)
    took = time.process_time() - start
    size = sum(map(len, pages.values())) / 1e6
    print(f"{len(pages)} pages of {given.methods} methods: CPU {took:.2f} s, {size:.1f} MB")
    with tempfile.TemporaryDirectory() as folder:
        for path, page in pages.items():
            target = Path(folder, path)
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(page)
        driver = started()
        driver.execute_cdp_cmd("Performance.enable", {"timeDomain": "threadTicks"})
        try:
            for name in PAGES:
                page = Path(folder, TABLE, f"{name}.html")
                kilobytes = page.stat().st_size / 1000
                print(f"{name:10} {kilobytes:5.0f} kB {opening(driver, page, given.times)}")
            opening(driver, Path(folder, TABLE, "index.html"), 1)
            print(f"a sort              {doing(driver, SORT, given.times)}")
            print(f"a search            {doing(driver, SEARCH, given.times)}")
        finally:
            driver.quit()


if __name__ == "__main__":
    main()
