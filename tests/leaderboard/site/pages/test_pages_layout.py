"""Pages on a phone, on paper and with large text, in Chromium."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.leaderboard.site.make_sample import sample
from tests.leaderboard.site.pages.conftest import written
from tests.leaderboard.site.pages.visiting import KINDS, TABLE, screen, visit
from tests.report.browser import NEEDS_CHROMIUM, Opened

pytestmark = NEEDS_CHROMIUM
# The width of the page, and what sticks out of it at the right without a box to scroll in.
OUTSIDE = """
const wide = document.documentElement.clientWidth;
return [document.documentElement.scrollWidth, wide, [...document.querySelectorAll("main *")]
  .filter((n) => { const b = n.getBoundingClientRect();
    return b.width && (b.right > wide + 1 || b.left < -1) && !n.closest(".scroll, .spoken, pre"); })
  .map((n) => n.outerHTML.slice(0, 200))]
"""


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


def test_long_names_and_lists_make_no_long_rows_and_no_column_is_cut_on_a_desk(
    opened: Opened, tmp_path: Path
) -> None:
    files = sample()
    for row in files["tables/airzoo-mini-retrieval/table.json"]["rows"]:
        if row["kind"] == "re-scored":
            row["method"] = "Hierarchical Cross-View Geo-Localisation with Optimal Transport"
            row["training_data"] = [f"dataset-{number}" for number in range(60)]
            row["hardware"] = "8 x H200, 141 GB"
    board = written(tmp_path, files)
    with screen(opened, 1280):
        for name in ("index", "methods/method-1"):
            visit(opened, board / TABLE / f"{name}.html")
            cut = opened.driver.execute_script(
                "return [...document.querySelectorAll('.scroll')]"
                ".filter((n) => n.scrollWidth > n.clientWidth).map((n) => n.innerText)"
            )
            assert cut == [], name
            tall = opened.driver.execute_script(
                "return Math.max(...[...document.querySelectorAll('.wide tr')]"
                ".map((n) => n.offsetHeight))"
            )
            assert name != "index" or tall < 150
            assert name == "index" or "dataset-59" in opened.one(".keys").text


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
