"""The report in a real Chromium: it sorts, filters, opens a scene, shows the map, by keyboard too.

Skipped where Chromium, ChromeDriver or Selenium are not installed (Debian: chromium and
chromium-driver; PyPI: selenium).
"""

from __future__ import annotations

import re
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.results.records import Scored, read_scored
from tests.report.made import (
    HOSTILE,
    reconstruction_method,
    retrieval_method,
    run,
    write_methods,
    write_photo_results,
)
from tests.statistics.support import ERROR, HIT, made_result

webdriver = pytest.importorskip("selenium.webdriver", reason="Selenium is not installed")

BROWSER, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
pytestmark = pytest.mark.skipif(
    BROWSER is None or DRIVER is None, reason="Chromium or ChromeDriver is not installed"
)

SCROLLED = "return window.scrollY"
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
    made = [
        reconstruction_method("cloud", 0, scenes=5),
        retrieval_method("made", 0),
        far_method("far"),
    ]
    others = write_methods(folder, made)
    out = folder / "report.html"
    done = run("report", *results, *others, "--data", data, "-o", out)
    assert done.exit_code == 0, done.exception
    return out


def far_method(name: str) -> Scored:
    """Return a method whose median errors span decades, and of one group are infinite."""
    made = retrieval_method(name, 0, truth="f" * 64)
    by = {"sunny": 0.7, "rainy": np.inf, None: 300.0}
    errors = np.array([by[None if pd.isna(w) else w] for w in made.records["weather"]])
    rolls = np.where(np.arange(len(errors)) % 2, -1e-6, -0.5)
    records = made.records.assign(error_m=errors, altitude_m=50.0, roll_deg=rolls)
    settings = made.result.protocol.settings
    result = made_result(records, (HIT, ERROR), name, settings=settings, truth="f" * 64)
    return Scored(name, result, records)


@pytest.fixture(scope="module")
def crowded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a report of twenty methods, two of the same name and two of long ones."""
    folder = tmp_path_factory.mktemp("crowded")
    names = ["same", "same", "a name of many words that goes on and on", "x" * 70]
    names += [f"method {number}" for number in range(16)]
    methods = [retrieval_method(name, number) for number, name in enumerate(names)]
    noted = [
        Scored(m.name, m.result.model_copy(update={"notes": (f"note {n}",)}).sealed(), m.records)
        for n, m in enumerate(methods)
    ]
    out = folder / "report.html"
    assert run("report", *write_methods(folder, noted), "-o", out).exit_code == 0
    return out


@pytest.fixture(scope="module")
def records(page: Path) -> list[Any]:
    results = sorted((page.parent / "results").glob("*/result.json"))
    return [method.records for method in read_scored(results)]


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
        cells = self.all(f"{inside} tbody tr:not(.floor) > :nth-child({number})")
        return [cell.text.split("\n")[0].removesuffix(" (best)") for cell in cells]

    def rows(self) -> list[str]:
        return [row.text for row in self.all("#part1-queries .grid-row > :first-child")]

    def status(self, inside: str) -> str:
        return str(self.one(f"{inside} [role=status]").text)

    def pixels(self) -> str:
        return str(
            self.driver.execute_script("return document.querySelector('canvas').toDataURL()")
        )

    def titles(self, inside: str) -> list[str]:
        return [head.text for head in self.all(f"{inside} h4")[:1]]

    def go(self, address: str) -> None:
        self.driver.execute_script("location.hash = arguments[0]", address)

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
    values = [float(text) for text in opened.column("#part1-summary", 2)]
    assert values == sorted(values, reverse=True)
    head.click()
    values = [float(text) for text in opened.column("#part1-summary", 2)]
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
    opened.one("#part1-summary input[type=search]").send_keys("x")
    assert [row.text for row in opened.all("#part1-summary tbody tr")] == ["no method matches"]


def test_titles_of_scores_are_explained(opened: Opened) -> None:
    said = "share of queries whose first tile answers"
    assert opened.button("#part1-summary", "R@1").get_attribute("title").endswith(f": {said}")
    opened.one("#part1-summary .glossary summary").click()
    terms = [term.text for term in opened.all("#part1-summary .glossary dt")]
    assert terms == ["R@1", "R@3", "R@5", "AP@5"]
    assert opened.one("#part1-summary .glossary dd").text == said
    opened.one("#part1-summary input[type=checkbox]").click()
    assert len(opened.all("#part1-summary .glossary dt")) > len(terms)


def test_an_overview_of_the_parts_stands_on_top(opened: Opened) -> None:
    rows = [row.text.split("\n") for row in opened.all("#overview tbody tr")]
    heads = [link.text for link in opened.all("#overview tbody th a")]
    assert [head.split(" (")[0] for head in heads] == [
        "park, retrieval",
        *["made, retrieval"] * 2,
        "made, reconstruction",
    ]
    assert len(set(heads)) == 4  # parts of the same benchmark and track are told apart
    values = [max(map(float, opened.column(f"#part{n}-summary", 2))) for n in (1, 2)]
    for row, value in zip(rows, values, strict=False):
        assert f"{value:.2f}" in " ".join(row)
    assert " to " in opened.one("#overview tbody tr .interval").text
    opened.all("#overview tbody a")[2].click()
    top = "return document.getElementById('part3').getBoundingClientRect().top"
    opened.until(lambda: 0 <= opened.driver.execute_script(top) < 100)
    assert opened.driver.current_url.endswith("#part3")


def test_a_line_in_sight_says_which_part_it_is_and_leads_to_others(opened: Opened) -> None:
    opened.go("#part2-queries")
    name = opened.one("#part2 .parts summary")
    opened.until(lambda: 0 <= name.location["y"] - opened.driver.execute_script(SCROLLED) < 30)
    assert name.text.startswith("made, retrieval")
    name.send_keys(webdriver.Keys.ENTER)
    links = opened.until(lambda: [a for a in opened.all("#part2 .parts a") if a.is_displayed()])
    current = [link.get_attribute("aria-current") for link in links]
    assert current == [None, None, "true", None, None]
    opened.press(webdriver.Keys.ESCAPE)
    opened.until(lambda: not links[0].is_displayed())
    assert opened.driver.switch_to.active_element == name
    name.click()
    links[4].click()
    opened.until(lambda: opened.driver.current_url.endswith("#part4"))
    assert not links[0].is_displayed()


def test_back_leads_to_where_the_page_was_left(opened: Opened) -> None:
    place = "return document.querySelector('#part1-hardest .card:nth-child(5)')"
    opened.driver.execute_script(f"{place}.scrollIntoView({{block: 'center'}})")
    left = opened.driver.execute_script(SCROLLED)
    assert "#" not in opened.driver.current_url
    opened.button("#part1-hardest .card:nth-child(5)", "Show it on the map").click()
    opened.until(lambda: opened.all("#part1-map aside h4"))
    assert opened.driver.execute_script(SCROLLED) < left - 500
    at_map = opened.driver.execute_script(SCROLLED)
    opened.driver.back()
    opened.until(lambda: opened.driver.execute_script(SCROLLED) == pytest.approx(left, abs=2))
    assert "#" not in opened.driver.current_url
    assert opened.all("#part1-map aside h4") == []
    opened.driver.forward()
    opened.until(lambda: opened.driver.execute_script(SCROLLED) == pytest.approx(at_map, abs=2))
    opened.until(lambda: opened.all("#part1-map aside h4"))


def test_back_from_another_part_leads_to_the_same_place_with_an_address(opened: Opened) -> None:
    opened.go("#part2-scenes")
    opened.until(lambda: opened.driver.execute_script(SCROLLED) > 100)
    opened.driver.execute_script("window.scrollBy(0, 567)")
    left = opened.driver.execute_script(SCROLLED)
    # The link is in sight whatever the place: it stands in the line of the part.
    opened.one("#part2 .views a[href$=settings]").click()
    opened.until(lambda: opened.driver.execute_script(SCROLLED) > left + 500)
    opened.driver.back()
    opened.until(lambda: opened.driver.execute_script(SCROLLED) == pytest.approx(left, abs=2))
    assert opened.driver.current_url.endswith("#part2-scenes")
    opened.driver.refresh()
    opened.until(lambda: opened.status("#part1-queries") == "30 of 30 queries")
    opened.until(lambda: opened.driver.execute_script(SCROLLED) == pytest.approx(left, abs=2))


def test_a_value_that_rounds_to_zero_has_no_sign(opened: Opened) -> None:
    opened.go("#part3-queries")
    opened.until(lambda: opened.all("#part3-queries .grid-row"))
    heads = [head.text for head in opened.all("#part3-queries .grid-head button")]
    place = heads.index("roll [°]") + 1
    cells = opened.all(f"#part3-queries .grid-row > :nth-child({place})")
    assert {cell.text for cell in cells} == {"0.0000", "-0.5000"}


def test_hostile_names_are_read_as_text(opened: Opened) -> None:
    assert " ".join(HOSTILE.split()) in opened.column("#part1-summary", 1)
    assert opened.driver.title == "Results"
    assert opened.all("img[src=x]") == []


def test_a_scene_opens_and_leads_to_its_queries(opened: Opened) -> None:
    opened.one("#part2-scenes tbody button").click()
    assert opened.one("#part2-scene h4").text == "East: 20 queries"
    opened.until(lambda: len(opened.all("#part2-scene table")) >= 3)
    opened.button("#part2-scene", "List its queries").send_keys(webdriver.Keys.ENTER)
    assert opened.driver.switch_to.active_element.get_attribute("id") == "part2-queries-h"
    opened.until(lambda: opened.status("#part2-queries") == "20 of 40 queries")
    opened.button("#part2-scene", "Close").send_keys(webdriver.Keys.ENTER)
    assert opened.all("#part2-scene") == []


def test_conditions_show_a_table_and_a_chart(opened: Opened) -> None:
    opened.choose("#part2-conditions", "Condition", "weather")
    opened.until(lambda: opened.column("#part2-conditions", 1) == ["rainy", "sunny", "unknown"])
    assert opened.all("#part2-conditions svg.chart path")
    before = opened.column("#part2-conditions", 3)
    opened.choose("#part2-conditions", "Scene", "West")
    opened.until(lambda: opened.column("#part2-conditions", 3) != before)


def test_the_map_shows_hits_misses_and_tiles(opened: Opened) -> None:
    seen = [opened.pixels()]
    _, misses, tiles = opened.all("#part1-map label.tick input")
    misses.click()
    seen.append(opened.pixels())
    tiles.click()
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
    assert opened.pixels() != before
    assert "#part1-map=" in opened.driver.current_url
    opened.press(keys.ESCAPE)
    opened.until(lambda: opened.all("#part1-map aside h4") == [])


def test_the_tiles_of_a_query_are_listed_by_rank_with_hits_and_misses(
    opened: Opened, records: list[Any]
) -> None:
    query = records[1].loc[records[1]["first_hit_rank"] > 0, "query"].iloc[0]
    row = records[1].set_index("query").loc[query]
    opened.go(f"#part1-map={quote(query, safe='')}&by=second")
    listed = opened.until(lambda: opened.all("#part1-map .tiles tbody tr"))
    cells = [[td.text for td in tr.find_elements("css selector", "td")] for tr in listed]
    assert [cell[:2] for cell in cells] == [[str(k), row[f"tile@{k}"]] for k in range(1, 6)]
    hits = [cell[2] for cell in cells].index("✓ hit") + 1
    assert hits == row["first_hit_rank"]
    assert cells[0][2] == ("✓ hit" if row["recall@1"] else "✗ miss")
    spoken = opened.one("#part1-map [role=status].sr").get_attribute("textContent")
    assert spoken.startswith(f"{query}: ")
    assert f"Tile {row['first_hit_rank']} hits." in spoken
    before = opened.pixels()
    opened.button("#part1-map .tiles", row["tile@5"]).click()
    assert opened.pixels() != before
    # Another method's tiles are others, and are drawn as such.
    opened.choose("#part1-map", "Method", "first")
    first = records[0].set_index("query").loc[query, "tile@1"]
    opened.until(lambda: opened.one("#part1-map .tiles button").text == first)
    assert "&by=" not in opened.driver.current_url


def test_an_address_opens_what_it_names_and_back_and_escape_close_it(opened: Opened) -> None:
    keys = webdriver.Keys
    name = opened.rows()[3]
    opened.all("#part1-queries .grid-row")[3].click()
    opened.until(lambda: opened.titles("#part1-query") == [name])
    address = opened.driver.current_url
    assert opened.driver.switch_to.active_element.text == name
    opened.one("#part2-scenes tbody button").click()
    assert opened.driver.current_url.endswith("#part2-scene=east")
    opened.driver.back()
    opened.until(lambda: not opened.all("#part2-scene"))
    opened.until(lambda: opened.titles("#part1-query") == [name])
    opened.driver.back()
    opened.until(lambda: not opened.all("#part1-query"))
    opened.go(address[address.index("#") :])
    opened.until(lambda: opened.titles("#part1-query") == [name])
    opened.press(keys.ESCAPE)
    opened.until(lambda: not opened.all("#part1-query"))
    assert opened.driver.switch_to.active_element.get_attribute("role") == "grid"
    opened.one("#part2-scenes tbody button").send_keys(keys.ENTER)
    opened.until(lambda: opened.all("#part2-scene"))
    opened.press(keys.ESCAPE)
    assert opened.all("#part2-scene") == []
    assert opened.driver.switch_to.active_element.text == "East"


def test_an_address_of_a_view_is_in_sight_and_one_of_nothing_says_so(
    opened: Opened, page: Path, records: list[Any]
) -> None:
    top = "return document.getElementById('part1-map').getBoundingClientRect().top"
    opened.go("#part1-map")
    opened.until(lambda: 0 <= opened.driver.execute_script(top) < 200)
    # A page that is opened with an address scrolls there once all has its height.
    opened.driver.get("about:blank")
    opened.driver.get(f"{page.as_uri()}#part1-query={quote(records[0]['query'].iloc[5], safe='')}")
    opened.until(lambda: opened.all("#part1-query"))
    opened.go("#part1-query=nothing%20%3Cb%3E")
    alert = opened.until(lambda: opened.all("#part1-queries [role=alert]"))
    assert alert[0].text == "This part has no query nothing <b>."
    opened.go("#part1-map=x%E0%A4")
    opened.go("#part9-map=x")
    opened.go("#part1-map=p00&by=nobody")
    alert = opened.until(lambda: opened.all("#part1-map [role=alert]"))
    assert alert[0].text == "This map has no method nobody."


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
    title = opened.until(lambda: [h.text for h in opened.all("#part1-query h4")])
    assert title == [opened.rows()[1]]
    opened.button("#part1-query", "Show it on the map").click()
    assert opened.until(lambda: [h.text for h in opened.all("#part1-map aside h4")]) == title


def test_queries_filter_by_condition(opened: Opened) -> None:
    opened.one("#part2-queries summary").click()
    low, high = opened.all("#part2-queries details input[type=number]")
    low.send_keys("100")
    opened.until(lambda: opened.status("#part2-queries") == "20 of 40 queries")
    high.send_keys("120")
    opened.until(lambda: opened.status("#part2-queries") == "5 of 40 queries")
    opened.choose("#part2-queries details", "weather", "sunny")
    opened.until(lambda: opened.status("#part2-queries") == "2 of 40 queries")


def test_the_hardest_queries_have_pictures_that_load(opened: Opened) -> None:
    cards = opened.until(lambda: opened.all("#part1-hardest .card"))
    assert len(cards) == 12
    sizes = opened.driver.execute_script(
        "return [...document.querySelectorAll('#part1-hardest img')].map((i) => i.naturalWidth)"
    )
    assert len(sizes) == 12 * 7
    assert min(sizes) > 0
    frames = opened.all("#part1-hardest .card:first-child .frames li")
    assert [frame.text.split()[0] for frame in frames] == ["1", "2", "3", "4", "5"]
    for frame in opened.all("#part1-hardest .frames li"):
        style = frame.find_element("css selector", "img").value_of_css_property("border-top-style")
        assert style == ("solid" if "✓ hit" in frame.text else "dashed")


def test_values_of_the_hardest_queries_are_named(opened: Opened) -> None:
    opened.until(lambda: opened.all("#part1-hardest .card"))
    named = opened.all("#part1-hardest .card:first-child .values li span")
    assert sorted(n.text for n in named) == sorted(["first", "second", " ".join(HOSTILE.split())])


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
        # The map stands high enough for the panel of the chosen query to be in sight with it.
        high = opened.driver.execute_script(
            "const top = (s) => document.querySelector(s).getBoundingClientRect().top;"
            "return ['canvas', 'aside'].map((s) => top('#part1-map ' + s) - top('#part1-map'))"
        )
        assert high[0] < 240
        assert high[1] < 640
        assert not opened.one("#part1-map .narrow label").is_displayed()
        places = [field.rect for field in opened.all("#part1-queries .controls > label")[:2]]
        assert places[0]["y"] == places[1]["y"]
        cut = opened.driver.execute_script(
            "return [...document.querySelectorAll('.views a')].filter((n) => {"
            " const b = n.getBoundingClientRect(); return b.right > 400 || b.left < 0; }).length"
        )
        assert cut == 0
        outside = opened.driver.execute_script(
            "return [...document.querySelectorAll('button, select, input')].filter((n) => {"
            " const b = n.getBoundingClientRect();"
            " return b.width && (b.right > 401 || b.left < 0) && !n.closest('.scroll, .grid'); }"
            ").map((n) => n.outerHTML)"
        )
        assert outside == []
        opened.one("#part2-scenes tbody button").click()
        assert opened.one("#part2-scene").is_displayed()
        low = opened.driver.execute_script(
            "return [...document.querySelectorAll('main button, main select, main summary,"
            " main input:not([type=checkbox]), main label.tick, nav a')].filter((n) => {"
            " const b = n.getBoundingClientRect(); return b.height && b.height < 34; }"
            ").map((n) => n.outerHTML)"
        )
        assert low == []
        first = opened.driver.execute_script(
            "const at = (s) => document.querySelector('#part2-queries ' + s)"
            ".getBoundingClientRect().left; const grid = document.querySelector('#part2-queries"
            " .grid'); const was = [at('.grid-row > *'), at('.grid-head > *')];"
            " grid.scrollLeft = 150; return [grid.scrollLeft, ...was, at('.grid-row > *'),"
            " at('.grid-head > *'), at('.grid-row > :nth-child(2)')];"
        )
        assert first[0] == 150
        assert first[1:3] == pytest.approx(first[3:5])
        assert first[5] < first[1] + 150
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


def test_infinite_medians_are_drawn_and_errors_over_decades_are_logarithmic(
    opened: Opened,
) -> None:
    opened.choose("#part2-conditions", "Condition", "weather")
    opened.choose("#part2-conditions", "Score", "Median [m] ↓")
    opened.until(lambda: "Median" in opened.one("#part2-conditions caption").text)
    shown = opened.column("#part2-conditions", 3)
    marks = opened.all("#part2-conditions svg.chart path")
    assert len(marks) == len(shown) == 3
    opened.choose("#part3-conditions", "Score", "Median [m] ↓")
    opened.until(lambda: "inf" in opened.column("#part3-conditions", 3))
    values = opened.column("#part3-conditions", 3)
    tops = opened.driver.execute_script(
        "return [...document.querySelectorAll('#part3-conditions svg.chart path')].map((n) =>"
        " n.getBoundingClientRect().top)"
    )
    assert len(tops) == len(values)
    assert values[tops.index(min(tops))] == "inf"
    texts = [text.text for text in opened.all("#part3-conditions svg.chart text")]
    assert "infinite" in texts
    assert {"1", "10", "100"} <= set(texts)
    assert any(text.endswith(", log") for text in texts)


@pytest.mark.parametrize("methods", [3, 20])
def test_on_paper_no_table_is_wider_than_the_page(
    opened: Opened, crowded: Path, methods: int
) -> None:
    if methods == 20:
        opened.driver.get(crowded.as_uri())
        opened.until(lambda: opened.all("#part1-conditions svg.chart"))
    opened.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    opened.driver.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride",
        {"width": 703, "height": 1000, "deviceScaleFactor": 1, "mobile": False},
    )
    try:
        wide = opened.driver.execute_script(
            "return [...document.querySelectorAll('main table, main svg, main img, canvas')]"
            ".filter((n) => n.getBoundingClientRect().right > 704).map((n) => n.outerHTML)"
        )
        assert wide == []
        cut = opened.driver.execute_script(
            "return [...document.querySelectorAll('main td:not(.text)')].filter((n) => {"
            " const r = document.createRange(); r.selectNodeContents(n.firstChild || n);"
            " const [a, b] = [r.getBoundingClientRect(), n.getBoundingClientRect()];"
            " return a.width && (a.left < b.left - 1 || a.right > b.right + 1 || b.right > 704); }"
            ").map((n) => n.outerHTML)"
        )
        assert cut == []
        assert not opened.one("#part1-queries .grid").is_displayed()
        assert opened.one("#part1-queries .only-print").is_displayed()
    finally:
        opened.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
        opened.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})


def test_many_methods_fold_what_is_long_and_fit_a_phone(opened: Opened, crowded: Path) -> None:
    opened.driver.get(crowded.as_uri())
    opened.until(lambda: opened.all("#part1-hardest .card"))
    names = opened.column("#part1-summary", 1)
    assert len(set(names)) == 20
    assert {"same (retrieval0)", "same (retrieval1)"} < set(names)
    assert (
        opened.one("#part1-summary details:not(.glossary) summary").text == "Notes on methods (20)"
    )
    assert not opened.one("#part1-summary .notes").is_displayed()
    metrics = {"width": 400, "height": 800, "deviceScaleFactor": 1, "mobile": True}
    opened.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    try:
        width = opened.driver.execute_script("return document.documentElement.scrollWidth")
    finally:
        opened.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    assert width == 400


def test_dark_where_the_reader_wants_it_so(opened: Opened) -> None:
    colours = "const s = getComputedStyle(document.body); return [s.color, s.backgroundColor]"
    light = opened.driver.execute_script(colours)
    features = [{"name": "prefers-color-scheme", "value": "dark"}]
    opened.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
    try:
        dark = opened.driver.execute_script(colours)
    finally:
        opened.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})
    assert brightness(light[0]) < 60 < 200 < brightness(light[1])
    assert brightness(dark[1]) < 60 < 200 < brightness(dark[0])


def brightness(colour: str) -> float:
    return sum(map(int, re.findall(r"\d+", colour)[:3])) / 3


def test_the_best_is_told_to_screen_readers_too(opened: Opened) -> None:
    best = opened.all("#part1-summary td.best")
    assert best
    assert all("(best)" in cell.get_attribute("textContent") for cell in best)
    tied = opened.all("#part1-summary td.tied")
    assert all("(cannot be told from the best)" in c.get_attribute("textContent") for c in tied)
    marked = "★ marks the best" + ", ≈ what cannot be told from it" * bool(tied)
    assert opened.one("#part1-summary caption").text.endswith(marked)


def test_two_methods_are_compared(opened: Opened) -> None:
    names = opened.column("#part1-summary", 1)
    heads = [head.text for head in opened.all("#part1-pairs thead th")]
    assert heads[:4] == ["Score", names[0], names[1], "Difference"]
    opened.choose("#part1-pairs", "with", names[2])
    opened.until(lambda: opened.all("#part1-pairs thead th")[2].text == names[2])
    assert len(opened.column("#part1-pairs", 1)) == len(opened.all("#part1-pairs li"))
    values = [opened.column("#part1-pairs", place)[0] for place in (2, 3, 4)]
    best, other, difference = map(float, values)
    assert difference == pytest.approx(other - best, abs=0.011)
    assert values[0] == opened.column("#part1-summary", 2)[0]
    opened.choose("#part1-pairs", "Compare", names[2])
    opened.until(lambda: "Pick two different methods" in opened.one("#part1-pairs").text)


def test_a_part_without_queries_has_no_table_of_them(opened: Opened) -> None:
    assert opened.all("#part4-summary")
    assert opened.all("#part4-scenes")
    assert not opened.all("#part4-queries, #part4-map, #part4-hardest, #part4-conditions")
