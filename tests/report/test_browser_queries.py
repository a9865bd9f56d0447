"""Queries in the report as Chromium shows it: map, tiles, table, by keyboard too."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from urllib.parse import quote

from tests.report.browser import NEEDS_CHROMIUM, Opened, webdriver
from tests.report.made import (
    HOSTILE,
)

pytestmark = NEEDS_CHROMIUM


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


def test_a_part_without_queries_has_no_table_of_them(opened: Opened) -> None:
    assert opened.all("#part4-summary")
    assert opened.all("#part4-scenes")
    assert not opened.all("#part4-queries, #part4-map, #part4-hardest, #part4-conditions")
