"""The report on a phone, on paper, in the dark and by screen reader, in Chromium."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.report.browser import NEEDS_CHROMIUM, Opened, webdriver

pytestmark = NEEDS_CHROMIUM


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
