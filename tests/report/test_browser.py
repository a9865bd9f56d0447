"""The report in a real Chromium: it sorts, filters, opens a scene, shows the map, by keyboard too.

Skipped where Chromium, ChromeDriver or Selenium are not installed (Debian: chromium and
chromium-driver; PyPI: selenium).
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.report.made import (
    HOSTILE,
    reconstruction_method,
    retrieval_method,
    run,
    write_methods,
    write_photo_results,
)

webdriver = pytest.importorskip("selenium.webdriver", reason="Selenium is not installed")

BROWSER, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
pytestmark = pytest.mark.skipif(
    BROWSER is None or DRIVER is None, reason="Chromium or ChromeDriver is not installed"
)

NAMES = ["first", "second", HOSTILE]
FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--window-size=1280,900",
)


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("report")
    data, results = write_photo_results(folder, NAMES)
    made = [reconstruction_method("cloud", 0, scenes=5), retrieval_method("made", 0)]
    others = write_methods(folder, made)
    out = folder / "report.html"
    done = run("report", *results, *others, "--data", data, "-o", out)
    assert done.exit_code == 0, done.exception
    return out


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    options = webdriver.ChromeOptions()
    options.binary_location = BROWSER
    for flag in (*FLAGS, f"--user-data-dir={tmp_path_factory.mktemp('profile')}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(DRIVER))
    yield driver
    driver.quit()


class Opened:
    """A page in the browser, and short ways to ask it."""

    def __init__(self, driver: Any) -> None:
        self.driver = driver

    def all(self, selector: str) -> list[Any]:
        return list(self.driver.find_elements("css selector", selector))

    def one(self, selector: str) -> Any:
        return self.driver.find_element("css selector", selector)

    def button(self, inside: str, text: str) -> Any:
        return next(b for b in self.all(f"{inside} button") if b.text.startswith(text))

    def choose(self, inside: str, label: str, option: str) -> None:
        for node in self.all(f"{inside} label"):
            if node.text.startswith(label):
                found = node.find_elements("css selector", "option")
                next(o for o in found if o.text == option).click()
                return
        raise AssertionError(label)

    def until(self, asked: Callable[[], Any]) -> Any:
        end = time.monotonic() + 10
        while time.monotonic() < end:
            if found := asked():
                return found
            time.sleep(0.02)
        raise AssertionError("waited in vain")

    def column(self, inside: str, number: int) -> list[str]:
        cells = self.all(f"{inside} tbody tr > :nth-child({number})")
        return [cell.text.split("\n")[0] for cell in cells]

    def rows(self) -> list[str]:
        return [row.text for row in self.all("#part1-queries .grid-row > :first-child")]

    def status(self, inside: str) -> str:
        return str(self.one(f"{inside} [role=status]").text)

    def pixels(self) -> str:
        return str(
            self.driver.execute_script("return document.querySelector('canvas').toDataURL()")
        )

    def press(self, *keys: str) -> None:
        webdriver.ActionChains(self.driver).send_keys(*keys).perform()


@pytest.fixture
def opened(browser: Any, page: Path) -> Iterator[Opened]:
    browser.set_window_size(1280, 900)
    browser.get(page.as_uri())
    found = Opened(browser)
    found.until(lambda: found.status("#part1-queries") == "30 of 30 queries")
    found.until(lambda: "hits" in found.status("#part1-map"))
    yield found
    # A refused script, style or address would stand here, as would any error.
    assert browser.get_log("browser") == []


def test_the_summary_sorts_both_ways(opened: Opened) -> None:
    head = opened.button("#part1-summary", "R@1")
    head.click()
    values = [float(text.strip("★ ")) for text in opened.column("#part1-summary", 2)]
    assert values == sorted(values, reverse=True)
    head.click()
    values = [float(text.strip("★ ")) for text in opened.column("#part1-summary", 2)]
    assert values == sorted(values)
    sorts = [th.get_attribute("aria-sort") for th in opened.all("#part1-summary thead th")]
    assert sorts[1] == "ascending"
    assert set(sorts) == {"ascending", "none"}


def test_the_summary_filters_and_shows_all_scores(opened: Opened) -> None:
    columns = len(opened.all("#part1-summary thead th"))
    opened.one("#part1-summary input[type=checkbox]").click()
    assert len(opened.all("#part1-summary thead th")) > columns
    opened.one("#part1-summary input[type=search]").send_keys("SECO")
    assert opened.column("#part1-summary", 1) == ["second"]


def test_hostile_names_are_read_as_text(opened: Opened) -> None:
    assert " ".join(HOSTILE.split()) in opened.column("#part1-summary", 1)
    assert opened.driver.title == "Results"
    assert opened.all("img[src=x]") == []


def test_a_scene_opens_and_leads_to_its_queries(opened: Opened) -> None:
    opened.one("#part3-scenes tbody button").click()
    assert opened.one("#part3-scene h4").text == "East: 20 queries"
    opened.until(lambda: len(opened.all("#part3-scene table")) >= 3)
    opened.button("#part3-scene", "List its queries").send_keys(webdriver.Keys.ENTER)
    assert opened.driver.switch_to.active_element.get_attribute("id") == "part3-queries-h"
    opened.until(lambda: opened.status("#part3-queries") == "20 of 40 queries")
    opened.button("#part3-scene", "Close").send_keys(webdriver.Keys.ENTER)
    assert opened.all("#part3-scene") == []


def test_conditions_show_a_table_and_a_chart(opened: Opened) -> None:
    opened.choose("#part3-conditions", "Condition", "weather")
    opened.until(lambda: opened.column("#part3-conditions", 1) == ["rainy", "sunny", "unknown"])
    assert opened.all("#part3-conditions svg.chart path")
    before = opened.column("#part3-conditions", 3)
    opened.choose("#part3-conditions", "Scene", "West")
    opened.until(lambda: opened.column("#part3-conditions", 3) != before)


def test_the_map_shows_hits_misses_and_tiles(opened: Opened) -> None:
    seen = [opened.pixels()]
    opened.one("#part1-map label:nth-of-type(5) input").click()  # misses
    seen.append(opened.pixels())
    opened.one("#part1-map label:nth-of-type(6) input").click()  # all first tiles
    seen.append(opened.pixels())
    opened.button("#part1-map", "Zoom in").click()
    seen.append(opened.pixels())
    opened.choose("#part1-map", "Method", "second")
    assert opened.status("#part1-map").startswith("second: ")
    seen.append(opened.pixels())
    assert len(set(seen)) == len(seen)
    said = opened.status("#part1-map").split()
    assert int(said[1]) + int(said[4]) == 30


def test_a_query_is_found_on_the_map_by_keyboard(opened: Opened) -> None:
    keys = webdriver.Keys
    opened.driver.execute_script("document.querySelector('canvas').focus()")
    before = opened.pixels()
    opened.press("n")
    first = opened.until(lambda: [h.text for h in opened.all("#part1-map aside h4")])
    opened.press("n", "+", keys.ARROW_LEFT)
    opened.until(lambda: [h.text for h in opened.all("#part1-map aside h4")] not in ([], first))
    assert "First tile: " in opened.one("#part1-map aside").text
    assert opened.pixels() != before


def test_queries_sort_filter_and_open_by_keyboard(opened: Opened) -> None:
    keys = webdriver.Keys
    grid = opened.one("#part1-queries [role=grid]")
    names = opened.rows()
    assert names == sorted(names)
    opened.button("#part1-queries .grid-head", "Query").send_keys(keys.ENTER)
    opened.button("#part1-queries .grid-head", "Query").send_keys(keys.ENTER)
    assert opened.rows()[0] > opened.rows()[1]
    opened.choose("#part1-queries", "Outcome", "No method hits (R@1)")
    opened.until(lambda: not opened.status("#part1-queries").startswith("30 "))
    assert not any(
        "hit" in row.text.replace("✗", "") for row in opened.all("#part1-queries .grid-row")
    )
    opened.one("#part1-queries input[type=search]").send_keys("p1")
    opened.until(lambda: all("p1" in name for name in opened.rows()))
    grid.send_keys(keys.ARROW_DOWN, keys.ARROW_DOWN, keys.ENTER)
    title = opened.until(lambda: [h.text for h in opened.all("#part1-queries .drill h4")])
    assert title == [opened.rows()[1]]
    opened.button("#part1-queries .drill", "Show it on the map").click()
    assert opened.until(lambda: [h.text for h in opened.all("#part1-map aside h4")]) == title


def test_queries_filter_by_condition(opened: Opened) -> None:
    opened.one("#part3-queries summary").click()
    low, high = opened.all("#part3-queries details input[type=number]")
    low.send_keys("100")
    opened.until(lambda: opened.status("#part3-queries") == "20 of 40 queries")
    high.send_keys("120")
    opened.until(lambda: opened.status("#part3-queries") == "5 of 40 queries")
    opened.choose("#part3-queries details", "weather", "sunny")
    opened.until(lambda: opened.status("#part3-queries") == "2 of 40 queries")


def test_the_hardest_queries_have_pictures_that_load(opened: Opened) -> None:
    cards = opened.until(lambda: opened.all("#part1-hardest .card"))
    assert len(cards) == 12
    sizes = opened.driver.execute_script(
        "return [...document.querySelectorAll('#part1-hardest img')].map((i) => i.naturalWidth)"
    )
    assert len(sizes) == 36
    assert min(sizes) > 0


def test_pictures_of_curves_load(opened: Opened) -> None:
    script = "return [...document.querySelectorAll('.figures img')].map((i) => i.naturalWidth)"
    sizes = opened.driver.execute_script(script)
    assert len(sizes) >= 5
    assert min(sizes) > 0


def test_it_is_usable_at_400_pixels(opened: Opened) -> None:
    metrics = {"width": 400, "height": 800, "deviceScaleFactor": 1, "mobile": True}
    opened.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    try:
        width = opened.driver.execute_script("return document.documentElement.scrollWidth")
        assert width == 400
        outside = opened.driver.execute_script(
            "return [...document.querySelectorAll('button, select, input')].filter((n) => {"
            " const b = n.getBoundingClientRect();"
            " return b.width && (b.right > 401 || b.left < 0) && !n.closest('.scroll, .grid'); }"
            ").map((n) => n.outerHTML)"
        )
        assert outside == []
        opened.one("#part3-scenes tbody button").click()
        assert opened.one("#part3-scene").is_displayed()
    finally:
        opened.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_every_control_is_named_and_reached_by_tab(opened: Opened) -> None:
    names = opened.driver.execute_script(
        "return [...document.querySelectorAll('button, select, input, canvas, [role=grid]')].map("
        "(n) => [n.tabIndex, (n.getAttribute('aria-label') || n.textContent"
        " || (n.closest('label') || {}).textContent || '').trim()])"
    )
    assert len(names) > 30
    assert all(place >= 0 and name for place, name in names)
    opened.driver.execute_script("document.body.focus()")
    opened.press(webdriver.Keys.TAB)
    assert opened.driver.switch_to.active_element.text == "Skip to the results"


def test_a_part_without_queries_has_no_table_of_them(opened: Opened) -> None:
    assert opened.all("#part2-summary")
    assert opened.all("#part2-scenes")
    assert not opened.all("#part2-queries, #part2-map, #part2-hardest, #part2-conditions")
