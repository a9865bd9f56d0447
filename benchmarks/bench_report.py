"""The report of many methods on many queries, as a process; and how fast its page is, in Chromium.

Usage: ``python benchmarks/bench_report.py [--methods 20] [--queries 100000]``

The page is opened where Chromium, ChromeDriver and Selenium are installed; times are the
browser's own, from the click to the end of the work it starts.
"""

from __future__ import annotations

import argparse
import importlib.util
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from airzoo_bench.protocol.lookup import load_protocol, shipped_protocols
from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import ScoreColumn, score_columns
from airzoo_bench.retrieval.scoring import retrieval_scores
from airzoo_bench.retrieval.settings import RetrievalProtocol
from tests.statistics.support import made_result, write_method

SORT = """
const button = [...document.querySelectorAll('.listed th button')].at(arguments[0]);
const start = performance.now(); button.click(); return performance.now() - start;"""


def columns() -> tuple[RetrievalProtocol, tuple[ScoreColumn, ...]]:
    """Return the protocol of UAV-VisLoc and all its scores."""
    protocol = load_protocol(shipped_protocols()["uav-visloc-retrieval"])
    if not isinstance(protocol, RetrievalProtocol):
        raise TypeError(protocol)
    return protocol, score_columns(retrieval_scores(protocol.scores))


def queries(count: int) -> pd.DataFrame:
    """Return queries of eleven scenes with conditions."""
    random = np.random.default_rng(0)
    scenes = [f"{number:02d}" for number in np.sort(random.integers(1, 12, count))]
    return pd.DataFrame(
        {
            "scene": scenes,
            "query": [f"{scene}/DJI_{row:06d}" for row, scene in enumerate(scenes)],
            "altitude_m": random.uniform(50, 600, count).round(3),
            "pitch_deg": random.uniform(30, 90, count).round(3),
            "weather": random.choice(["sunny", "rainy", "foggy", "night"], count),
        }
    )


def retrieved(scenes: pd.Series[str], random: np.random.Generator) -> list[str]:
    """Return a random tile of 3,000 for each query."""
    numbers = random.integers(0, 3_000, len(scenes))
    return [f"{scene}/512_{tile:05d}" for scene, tile in zip(scenes, numbers, strict=True)]


def method(number: int, asked: pd.DataFrame) -> Scored:
    """Return a method with random scores of every kind."""
    random = np.random.default_rng(number)
    protocol, scores = columns()
    ranks = random.integers(0, 12, len(asked))
    tiles = {f"tile@{rank}": retrieved(asked["scene"], random) for rank in range(1, 6)}
    values = {score.key: random.random(len(asked)) for score in scores}
    values |= {f"recall@{k}": ((ranks > 0) & (ranks <= k)) * 1.0 for k in (1, 3, 5)}
    values |= {"ap@5": random.integers(0, 6, len(asked)) / 5}
    values |= {"distance_m": random.exponential(60, len(asked))}
    records = asked.assign(first_hit_rank=ranks, ranked=20, **tiles, **values)
    result = made_result(records, scores, f"method{number:02d}", settings=protocol.settings())
    return Scored("", result, records)


def in_browser(page: Path) -> dict[str, float]:
    """Open the page and time it; milliseconds."""
    from selenium import webdriver

    options = webdriver.ChromeOptions()
    for flag in (
        "--headless=new",
        "--no-sandbox",
        "--disable-gpu",
        "--disable-background-networking",
    ):
        options.add_argument(flag)
    options.binary_location = str(shutil.which("chromium"))
    service = webdriver.ChromeService(shutil.which("chromedriver"))
    driver = webdriver.Chrome(options=options, service=service)
    try:
        return _timed(driver, page)
    finally:
        driver.quit()


def _timed(driver: Any, page: Path) -> dict[str, float]:
    start = time.perf_counter()
    driver.get(page.as_uri() + "#part1-queries")
    while not driver.execute_script("return document.querySelectorAll('.listed td').length"):
        time.sleep(0.01)
    times = {"open, until queries are listed": 1e3 * (time.perf_counter() - start)}
    for name, place in (("a score", 1), ("an id", 0), ("a text", -1), ("a number", -3)):
        times[f"sort by {name}"] = driver.execute_script(SORT, place)
    return times


def main() -> None:
    """Make results, report them, and print seconds and megabytes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--methods", type=int, default=20)
    parser.add_argument("--queries", type=int, default=100_000)
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder, page = Path(name), Path(name) / "report.html"
        asked = queries(chosen.queries)
        made = (method(number, asked) for number in range(chosen.methods))
        files = [str(write_method(folder / str(n), one)) for n, one in enumerate(made)]
        call = [sys.executable, "-m", "airzoo_bench", "report", *files, "-o", str(page)]
        start = time.perf_counter()
        subprocess.run(call, check=True, capture_output=True)
        seconds, megabytes = time.perf_counter() - start, page.stat().st_size / 1e6
        print(f"{chosen.methods} methods, {chosen.queries:,} queries")
        print(f"report made in {seconds:.1f} s, {megabytes:.1f} MB")
        if importlib.util.find_spec("selenium") and shutil.which("chromium"):
            for what, milliseconds in in_browser(page).items():
                print(f"{what:32}{milliseconds:8.0f} ms")


if __name__ == "__main__":
    main()
