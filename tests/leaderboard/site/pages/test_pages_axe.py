"""What axe-core says of every kind of page, and pages by keyboard, in Chromium."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest

from tests.leaderboard.site.pages.visiting import KINDS, TABLE, screen, visit
from tests.report.browser import NEEDS_CHROMIUM, Opened, webdriver

pytestmark = NEEDS_CHROMIUM


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
def test_axe_finds_nothing(opened: Opened, board: Path, axe: str, width: int, scheme: str) -> None:
    with screen(opened, width, scheme):
        for kind in KINDS:
            visit(opened, board / kind)
            assert violations(opened, axe) == [], kind


def test_axe_would_find_a_table_without_names(opened: Opened, board: Path, axe: str) -> None:
    visit(opened, board / TABLE / "index.html")
    opened.driver.execute_script(
        "for (const n of document.querySelectorAll('.pick input')) n.removeAttribute('aria-label')"
    )
    assert any(impact == "critical" for _, impact, _ in violations(opened, axe))


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
    assert mark.get_attribute("aria-label").startswith("†2, note: Method 1, R@1, printed 61.20")
    opened.driver.execute_script("arguments[0].focus()", mark)
    opened.press(webdriver.Keys.ENTER)
    assert opened.one(":target").text.startswith("†2 Method 1, R@1, printed 61.20")
