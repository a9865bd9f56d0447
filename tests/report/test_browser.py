"""The report in a real Chromium: each of its views once; the rest, as `-m slow`, in more detail.

Skipped where Chromium, ChromeDriver or Selenium are not installed (Debian: chromium and
chromium-driver; PyPI: selenium).
"""

from __future__ import annotations

import re
from urllib.parse import quote

import pytest

from airzoo_bench.results.records import Method
from tests.report.browser import NEEDS_CHROMIUM, Opened, webdriver
from tests.report.made import HOSTILE

pytestmark = NEEDS_CHROMIUM


def unfold(opened: Opened, fold: str) -> None:
    opened.driver.execute_script("document.getElementById(arguments[0]).open = true", fold)


def test_every_view_is_shown_without_an_error(opened: Opened, shown: list[Method]) -> None:
    for fold in opened.all("details.fold"):
        opened.driver.execute_script("arguments[0].open = true", fold)
    opened.until(lambda: all(s.text for s in opened.all(".counted")))
    sizes = opened.driver.execute_script(
        "return [...document.querySelectorAll('main img[src]')].map((i) => i.naturalWidth)"
    )
    assert len(sizes) > 20
    assert min(sizes) > 0
    assert len(opened.all("#part1-hardest .card")) == 12
    counts = re.search(r"(\d+) hits and (\d+) misses", opened.status("#part1-queries"))
    assert counts
    assert int(counts[1]) + int(counts[2]) == 30 == len(shown[0].records)
    assert " ".join(HOSTILE.split()) in opened.column("#part1-summary", 1)
    assert opened.driver.title == "Results"
    assert opened.all("img[src=x]") == []
    assert not opened.all("#part4-queries, #part4-hardest, #part4-conditions")


def test_tables_sort_and_panes_are_chosen(opened: Opened) -> None:
    summary = "#part1-summary .pane:not([hidden])"
    for order in ("descending", "ascending"):
        opened.button(summary, "R@1").click()
        values = [float(re.sub("[★≈ ]", "", text)) for text in opened.column(summary, 2)]
        assert values == sorted(values, reverse=order == "descending")
    columns = len([c for c in opened.all(f"{summary} thead th") if c.is_displayed()])
    opened.one("#part1-summary .every").click()
    assert len([c for c in opened.all(f"{summary} thead th") if c.is_displayed()]) > columns
    unfold(opened, "part1-pairs")
    names = opened.column(summary, 1)
    opened.choose("#part1-pairs", "with", names[2])
    assert names[2] in opened.one("#part1-pairs .pane:not([hidden])").text
    unfold(opened, "part2-conditions")
    opened.choose("#part2-conditions", "Condition", "weather")
    shown = opened.one("#part2-conditions .pane:not([hidden]):not([data-starts])")
    assert "by weather" in shown.text


def test_an_address_opens_its_query_with_its_tiles(opened: Opened, shown: list[Method]) -> None:
    first = opened.column("#part1-summary .pane:not([hidden])", 1)[0]
    mine = next(one.records for one in shown if one.name == first).set_index("query")
    query = mine.index[mine["first_hit_rank"] > 0][0]
    opened.go(f"#part1-query={quote(query, safe='')}")
    opened.until(lambda: opened.titles("#part1-queries .chosen") == [query])
    listed = [item.text.split() for item in opened.all("#part1-queries .tiles li")]
    assert [item[:2] for item in listed] == [
        [str(rank), mine.loc[query, f"tile@{rank}"]] for rank in range(1, 6)
    ]
    assert [item[-1] for item in listed].index("hit") + 1 == mine.loc[query, "first_hit_rank"]
    opened.go("#part1-query=park%2Fp00")
    chosen = opened.one("#part1-queries .chosen")
    opened.until(lambda: "✗ miss, no answer" in chosen.text)
    assert opened.column("#part1-queries .listed", 2)[:1] == ["✗ miss, no answer"]
    assert not opened.all("#part1-queries .tiles li")
    opened.go("#part1-query=nothing%20%3Cb%3E")
    opened.until(lambda: "no query nothing <b>" in chosen.text)
    opened.go("#part1-query=x%E0%A4")
    opened.go("#part9-query=x")


@pytest.mark.slow
def test_queries_are_found_sorted_and_shown_on_the_map(opened: Opened) -> None:
    unfold(opened, "part1-queries")
    opened.until(lambda: opened.status("#part1-queries").startswith("30 of 30"))
    names = opened.rows()
    assert names == sorted(names)
    opened.button("#part1-queries .listed", "Query").click()
    opened.button("#part1-queries .listed", "Query").click()
    assert opened.rows() == names[::-1]
    seen = [opened.pixels()]
    opened.choose("#part1-queries", "Outcome", "No method hits")
    opened.until(lambda: not opened.status("#part1-queries").startswith("30 "))
    assert not any("✓" in row.text for row in opened.all("#part1-queries .listed tbody tr"))
    seen.append(opened.pixels())
    opened.one("#part1-queries input[type=search]").send_keys("p1")
    opened.until(lambda: all("p1" in name for name in opened.rows()))
    opened.driver.execute_script("document.querySelector('canvas').focus()")
    opened.press(webdriver.Keys.ESCAPE, "n")
    title = opened.until(lambda: opened.titles("#part1-queries .chosen"))
    assert title == [opened.rows()[0]]
    assert "#part1-query=" in opened.driver.current_url
    seen.append(opened.pixels())
    opened.press("+", webdriver.Keys.ARROW_LEFT)
    seen.append(opened.pixels())
    assert len(set(seen)) == len(seen)
    opened.press(webdriver.Keys.ESCAPE)
    opened.until(lambda: not opened.titles("#part1-queries .chosen"))


@pytest.mark.slow
def test_a_phone_is_enough(opened: Opened) -> None:
    metrics = {"width": 390, "height": 800, "deviceScaleFactor": 1, "mobile": True}
    opened.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    try:
        opened.driver.refresh()
        size = "const e = document.documentElement; return [e.scrollWidth, e.scrollHeight]"
        width, height = opened.driver.execute_script(size)
        assert width == 390
        assert height < 5500  # of four parts
        for fold in opened.all("details.fold"):
            opened.driver.execute_script("arguments[0].open = true", fold)
        opened.until(lambda: all(s.text for s in opened.all(".counted")))
        assert opened.driver.execute_script(size)[0] == 390
        low = opened.driver.execute_script(
            "const all = [...document.querySelectorAll('main button, main select, main summary')];"
            "const height = (n) => n.getBoundingClientRect().height;"
            "return all.filter((n) => height(n) && height(n) < 34).map((n) => n.outerHTML)"
        )
        assert low == []
    finally:
        opened.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


@pytest.mark.slow
def test_dark_where_the_reader_wants_it_and_named_for_screen_readers(opened: Opened) -> None:
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
    names = opened.driver.execute_script(
        "return [...document.querySelectorAll('button, select, input, canvas')].map("
        "(n) => [n.tabIndex, (n.getAttribute('aria-label') || n.textContent"
        " || (n.closest('label') || {}).textContent || '').trim()])"
    )
    assert all(place >= 0 and name for place, name in names)
    best = opened.all("#part1-summary td.best")
    assert best
    assert all("(best)" in str(cell.get_attribute("textContent")) for cell in best)


def brightness(colour: str) -> float:
    return sum(map(int, re.findall(r"\d+", colour)[:3])) / 3
