"""Pages by keyboard and screen reader, on a phone, on paper, with large text, and under attack."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.report.browser import NEEDS_CHROMIUM, Opened, webdriver

pytestmark = NEEDS_CHROMIUM
TABLE = "tables/airzoo-mini-retrieval/"
KINDS = [
    *("index.html", "reproduction.html", "downloads.html", "about.html"),
    *(f"{TABLE}{name}.html" for name in ("index", "ranks", "scores", "scenes", "scenes-2")),
    *(f"{TABLE}{name}.html" for name in ("scene-1", "conditions", "compare")),
    *(f"{TABLE}methods/{name}.html" for name in ("method-1", "reported-1", "floor-99")),
]
# The width of the page, and what sticks out of it at the right without a box to scroll in.
OUTSIDE = """
const wide = document.documentElement.clientWidth;
return [document.documentElement.scrollWidth, wide, [...document.querySelectorAll("main *")]
  .filter((n) => { const b = n.getBoundingClientRect();
    return b.width && (b.right > wide + 1 || b.left < -1) && !n.closest(".scroll, .spoken, pre"); })
  .map((n) => n.outerHTML.slice(0, 200))]
"""


@contextmanager
def screen(page: Opened, width: int, scheme: str = "light", media: str = "") -> Iterator[None]:
    metrics = {"width": width, "height": 844, "deviceScaleFactor": 1, "mobile": width < 500}
    page.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    features = [{"name": "prefers-color-scheme", "value": scheme}]
    page.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": media, "features": features})
    try:
        yield
    finally:
        page.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
        page.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "", "features": []})


def visit(page: Opened, address: Path) -> None:
    page.driver.get(address.as_uri())
    if address.name == "compare.html":
        page.until(lambda: page.all("#overall tbody tr"))


@pytest.fixture(scope="session")
def axe() -> str:
    places = [os.environ.get("AIRZOO_AXE"), "node_modules/axe-core/axe.min.js"]
    found = [Path(place) for place in places if place and Path(place).is_file()]
    if not found:
        pytest.skip("axe-core is not there: npm pack axe-core, and AIRZOO_AXE=.../axe.min.js")
    return found[0].read_text(encoding="utf-8")


def violations(page: Opened, axe: str) -> list[Any]:
    page.driver.execute_script(axe)
    found: list[Any] = page.driver.execute_async_script(
        "axe.run().then((r) => arguments[0](r.violations.map((v) =>"
        " [v.id, v.impact, v.nodes.map((n) => n.html.slice(0, 200))])))"
    )
    return found


@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (390, "dark")])
def test_axe_finds_nothing(
    opened: Opened, board: Path, axe: str, width: int, scheme: str
) -> None:
    with screen(opened, width, scheme):
        for kind in KINDS:
            visit(opened, board / kind)
            assert violations(opened, axe) == [], kind


def test_axe_would_find_a_table_without_names(opened: Opened, board: Path, axe: str) -> None:
    visit(opened, board / KINDS[4])
    opened.driver.execute_script(
        "for (const n of document.querySelectorAll('.pick input')) n.removeAttribute('aria-label')"
    )
    assert any(impact == "critical" for _, impact, _ in violations(opened, axe))


@pytest.mark.parametrize("width", [320, 390, 1440])
def test_no_page_is_wider_than_the_screen(
    opened: Opened, board: Path, hostile_board: Path, width: int
) -> None:
    with screen(opened, width):
        for kind in KINDS:
            for made in (board, hostile_board):
                visit(opened, made / kind)
                whole, wide, outside = opened.driver.execute_script(OUTSIDE)
                assert (whole, outside) == (wide, []), (kind, made.name)


def test_text_of_twice_the_size_fits(opened: Opened, board: Path) -> None:
    with screen(opened, 780):
        for kind in KINDS:
            visit(opened, board / kind)
            opened.driver.execute_script("document.documentElement.style.fontSize = '200%'")
            size = opened.driver.execute_script("return getComputedStyle(document.body).fontSize")
            assert size == "30px"
            whole, wide, outside = opened.driver.execute_script(OUTSIDE)
            assert (whole, outside) == (wide, []), kind


def test_the_column_of_names_stays_in_sight_on_a_phone(opened: Opened, board: Path) -> None:
    with screen(opened, 390):
        visit(opened, board / TABLE / "index.html")
        assert not opened.one("form.filters").is_displayed()
        place = opened.driver.execute_script(
            "const box = document.querySelector('.scroll'); box.scrollLeft = 200;"
            "const name = box.querySelector('tbody th').getBoundingClientRect();"
            "return [box.scrollLeft, name.left - box.getBoundingClientRect().left, name.width]"
        )
        assert place[0] == 200
        assert place[1] == pytest.approx(0, abs=1)
        assert place[2] < 200
        opened.one(".folded summary").click()
        small = opened.driver.execute_script(
            "return [...document.querySelectorAll('form select, form button, .masthead li a,"
            " form input:not([type=checkbox])')].filter((n) => n.offsetHeight &&"
            " n.getBoundingClientRect().height < 30).map((n) => n.outerHTML)"
        )
        assert small == []


def test_everything_is_reached_by_tab_and_what_has_the_focus_is_seen(
    opened: Opened, board: Path
) -> None:
    visit(opened, board / TABLE / "index.html")
    opened.press(webdriver.Keys.TAB)
    assert opened.driver.switch_to.active_element.text == "Skip to the content"
    opened.press(webdriver.Keys.ENTER)
    assert opened.driver.switch_to.active_element.get_attribute("id") == "content"
    reached = set()
    for _ in range(60):
        opened.press(webdriver.Keys.TAB)
        reached.add(
            opened.driver.execute_script(
                "const n = document.activeElement, s = getComputedStyle(n);"
                "return [n.tagName, n.className || n.name || '', s.outlineStyle !== 'none']"
                ".join(' ')"
            )
        )
    assert [found for found in reached if not found.endswith("true")] == []
    assert {"A mark true", "INPUT name true", "SELECT source true", "BUTTON  true"} <= reached
    assert "DIV scroll true" in reached


def test_a_note_is_a_link_to_what_it_says(opened: Opened, board: Path) -> None:
    visit(opened, board / TABLE / "index.html")
    mark = opened.one("td .mark")
    assert mark.get_attribute("aria-label").startswith("Note 2: Method 1, R@1, printed 61.20")
    opened.driver.execute_script("arguments[0].focus()", mark)
    opened.press(webdriver.Keys.ENTER)
    assert opened.one(":target").text.startswith("†2 Method 1, R@1, printed 61.20")


def test_on_paper_tables_fit_and_controls_are_gone(opened: Opened, board: Path) -> None:
    with screen(opened, 703, media="print"):
        for kind in KINDS:
            visit(opened, board / kind)
            wide = opened.driver.execute_script(
                "return [...document.querySelectorAll('main table, main svg, main p')]"
                ".filter((n) => n.getBoundingClientRect().right > 704)"
                ".map((n) => n.outerHTML.slice(0, 200))"
            )
            assert wide == [], kind
            assert not any(n.is_displayed() for n in opened.all("form, .tray, .tabs, .pick")), kind


def test_hostile_texts_run_nothing_and_load_nothing(opened: Opened, hostile_board: Path) -> None:
    pages = sorted(hostile_board.rglob("*.html"))
    assert len(pages) > 50
    for page in pages:
        visit(opened, page)
        found = opened.driver.execute_script(
            "return [window.caught || 0, performance.getEntriesByType('resource').map((e) => e.name),"
            " document.scripts.length, location.protocol]"
        )
        assert found[:2] == [0, []], page
        assert found[2] <= 20
        assert found[3] == "file:"
    visit(opened, hostile_board / TABLE / "index.html")
    opened.driver.execute_script(
        "for (const box of [...document.querySelectorAll('.pick input')].slice(0, 3)) box.click()"
    )
    assert opened.one(".tray").is_displayed()
    opened.one("input[name=name]").send_keys("<script>")
    for button in opened.all("thead button"):
        button.click()
    assert opened.driver.execute_script("return window.caught || 0") == 0
    high = opened.driver.execute_script(
        "return Math.max(...[...document.querySelectorAll('tbody tr')].map((n) => n.offsetHeight))"
    )
    assert high < 500  # thousands of letters are cut
