"""The report in a real Chromium: it sorts, filters, opens a scene, shows the map, by keyboard too.

Skipped where Chromium, ChromeDriver or Selenium are not installed (Debian: chromium and
chromium-driver; PyPI: selenium).
"""

from __future__ import annotations

import pytest

from tests.report.browser import NEEDS_CHROMIUM, Opened, webdriver
from tests.report.made import (
    HOSTILE,
)

pytestmark = NEEDS_CHROMIUM


SCROLLED = "return window.scrollY"


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


def test_pictures_of_curves_load(opened: Opened) -> None:
    script = "return [...document.querySelectorAll('.figures img')].map((i) => i.naturalWidth)"
    sizes = opened.driver.execute_script(script)
    assert len(sizes) >= 5
    assert min(sizes) > 0


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
