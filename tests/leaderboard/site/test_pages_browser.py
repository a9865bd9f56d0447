"""Pages in Chromium: tables that sort, filter and compare; screens, paper, hostile texts, axe."""

from __future__ import annotations

import base64
import os
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.leaderboard.site.sample import TABLE, spoilt, written
from tests.report.browser import NEEDS_CHROMIUM, Opened

pytestmark = NEEDS_CHROMIUM
PAGES = [
    *("index.html", "about.html", f"{TABLE}index.html", f"{TABLE}index.html#part=0&more=yes"),
    *(f"{TABLE}compare.html#a=method-1&b=method-3", f"{TABLE}method-2.html", f"{TABLE}failed.html"),
]


@pytest.fixture(scope="module")
def board(sample: dict[str, Any], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("board"), sample)


@pytest.fixture(scope="module")
def hostile(sample: dict[str, Any], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("hostile"), spoilt(sample))


def visit(page: Opened, folder: Path, name: str) -> None:
    path, mark, fragment = name.partition("#")
    page.driver.get("about:blank")  # the same file with another fragment is not opened anew
    page.driver.get((folder / path).as_uri() + mark + fragment)
    if path.endswith("compare.html"):
        page.until(lambda: page.all("#overall tbody tr"))


@pytest.fixture
def table(opened: Opened, board: Path) -> Opened:
    visit(opened, board, f"{TABLE}index.html")
    return opened


def ids(page: Opened) -> list[str]:
    rows = page.all("#results tbody:first-of-type tr:not([hidden])")
    return [row.get_attribute("data-id") for row in rows]


def column(page: Opened, name: str) -> list[str]:
    """Return what the cells of a column are sorted by, as they stand."""
    found: list[str] = page.driver.execute_script(
        "const heads = [...document.querySelectorAll('#results thead th')];"
        "const at = heads.findIndex((h) => h.dataset.name === arguments[0]);"
        "return [...document.querySelectorAll('#results tbody:first-of-type tr')]"
        ".filter((r) => !r.hidden).map((r) => r.cells[at].dataset.v)",
        name,
    )
    return found


def sort(page: Opened, name: str) -> None:
    page.button(f'th[data-name="{name}"]', "").click()


def test_numbers_sort_both_ways_and_what_is_infinite_or_missing_stands_last(table: Opened) -> None:
    before = ids(table)
    for way in ("descending", "ascending", "descending"):
        sort(table, "R@5")
        assert table.one('th[data-name="R@5"]').get_attribute("aria-sort") == way
        assert len(table.all("#results th[aria-sort]")) == 1
        values = column(table, "R@5")
        assert values[-2:] == ["inf", ""]
        numbers = [float(value) for value in values[:-2]]
        assert numbers == sorted(numbers, reverse=way == "descending")
        assert f"sorted by R@5, {way}" in table.one("#said").text
    assert sorted(ids(table)) == sorted(before)
    sort(table, "rank")
    ranked = [name for name in before if name.startswith("method")]
    assert ids(table)[: len(ranked)] == ranked


def test_filters_hide_rows_say_how_many_are_left_and_stay_in_the_address(table: Opened) -> None:
    whole = len(ids(table))
    table.choose("#filters", "Rows", "reported, not re-scored")
    assert len(ids(table)) == 2
    assert table.one("#said").text == "2 of 15 methods shown."
    table.one("#filters button").click()
    table.until(lambda: len(ids(table)) == whole)
    table.choose("#filters", "Training data", "without gta-uav")
    assert len(ids(table)) == 8  # who says nothing is not without it
    table.one("input[name=code]").click()
    table.one("input[name=name]").send_keys("MÉTHOD")
    left = ids(table)
    assert 0 < len(left) < 8
    address = table.driver.current_url
    assert "training=-gta-uav" in address
    table.driver.get("about:blank")
    table.driver.get(address)
    assert ids(table) == left


def test_a_scene_or_a_group_is_shown_instead_of_the_average(
    table: Opened, sample: dict[str, Any]
) -> None:
    rows = {row["id"]: row for row in sample["tables"]["made"]["rows"]}
    average = column(table, "R@1")
    table.choose("#filters", "Numbers", "East (30 queries)")
    shown = dict(zip(ids(table), column(table, "R@1"), strict=True))
    for name in ("method-0", "method-5"):
        assert float(shown[name]) == round(100 * rows[name]["scenes"]["east"]["recall@1"][0], 2)
    table.choose("#filters", "Numbers", "fog (12 queries), few")
    assert "few" in table.one("#results").get_attribute("class")
    fog = 100 * rows["method-0"]["conditions"]["weather"]["recall@1"][0]
    assert float(column(table, "R@1")[ids(table).index("method-0")]) == round(fog, 2)
    table.choose("#filters", "Numbers", "average over scenes")
    assert sorted(column(table, "R@1")) == sorted(average)


def unpacked(text: str) -> Any:
    return np.frombuffer(zlib.decompress(base64.b64decode(text)), "<f4")


@pytest.mark.parametrize(("a", "b"), [(0, 1), (7, 2), (11, 0)])
def test_a_comparison_shows_the_pairs_of_the_board(
    opened: Opened, board: Path, sample: dict[str, Any], a: int, b: int
) -> None:
    made = sample["tables"]["made"]
    pairs, rows = made["pairs"]["recall@1"], {row["id"]: row for row in made["rows"]}
    names = pairs["ids"]
    every = [(i, j) for i in range(len(names)) for j in range(i + 1, len(names))]
    at = every.index((min(a, b), max(a, b)))
    low, high, p, holm = (float(unpacked(pairs[k])[at]) for k in ("low", "high", "p", "p_holm"))
    if a > b:
        low, high = -high, -low
    visit(opened, board, f"{TABLE}compare.html#a={names[a]}&b={names[b]}")
    cells = [cell.text for cell in opened.all("#overall tbody tr:first-child td")]
    one, other = (rows[names[n]]["scores"]["recall@1"]["value"] for n in (a, b))
    difference = f"{100 * (one - other):+.2f}".replace("-", "−")
    assert cells[:3] == [f"{100 * one:.2f}", f"{100 * other:.2f}", difference]
    assert cells[3] == f"{100 * low:+.2f} to {100 * high:+.2f}".replace("-", "−")
    assert cells[5:7] == ["< 0.0001" if v < 0.00005 else f"{v:.4f}" for v in (p, holm)]
    better = "A is better" if one > other else "B is better"
    assert cells[7] == (better if holm <= 0.05 else "cannot be told apart")
    runs = [f"runs/made/retrieval/{names[n]}/{rows[names[n]]['version']}" for n in (a, b)]
    command = f"airzoo-bench compare {' '.join(runs)} --scene east"
    assert opened.one("#command code:last-child").text == command
    opened.one("#swap").click()
    opened.until(lambda: opened.one("#overall tbody td:nth-child(2)").text == f"{100 * other:.2f}")


@contextmanager
def screen(page: Opened, width: int, scheme: str = "light", media: str = "") -> Iterator[None]:
    metrics = {"width": width, "height": 844, "deviceScaleFactor": 1, "mobile": width < 500}
    page.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    features = [{"name": "prefers-color-scheme", "value": scheme}]
    setting = {"media": media, "features": features}
    page.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", setting)
    try:
        yield
    finally:
        page.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
        page.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "", "features": []})


# The width of the page, and what sticks out of it at the right without a box to scroll in.
OUTSIDE = """
const wide = document.documentElement.clientWidth;
return [document.documentElement.scrollWidth - wide, [...document.querySelectorAll("main *")]
  .filter((n) => { const b = n.getBoundingClientRect();
    return b.width && (b.right > wide + 1 || b.left < -1) && !n.closest(".scroll, .sr, pre"); })
  .map((n) => n.outerHTML.slice(0, 200))]
"""


@pytest.mark.parametrize(("width", "media"), [(320, ""), (390, ""), (1440, ""), (703, "print")])
def test_no_page_is_wider_than_the_screen_or_the_paper(
    opened: Opened, board: Path, hostile: Path, width: int, media: str
) -> None:
    with screen(opened, width, media=media):
        for name in PAGES:
            for folder in (board, hostile)[: 1 if media else 2]:
                visit(opened, folder, name)
                assert opened.driver.execute_script(OUTSIDE) == [0, []], (name, folder.name)


def test_hostile_texts_run_nothing_and_load_nothing(opened: Opened, hostile: Path) -> None:
    for path in [*PAGES, *(f"{TABLE}method-{n}.html" for n in range(0, 12, 3))]:
        visit(opened, hostile, path)
        found = opened.driver.execute_script(
            "return [window.caught || 0, location.protocol,"
            " performance.getEntriesByType('resource').map((e) => e.name)]"
        )
        assert found == [0, "file:", []], path
    visit(opened, hostile, f"{TABLE}index.html")
    opened.one("input[name=name]").send_keys("<script>")
    opened.driver.execute_script(
        "for (const b of document.querySelectorAll('thead button, .pick input')) b.click()"
    )
    assert opened.driver.execute_script("return window.caught || 0") == 0


@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (390, "dark")])
def test_axe_finds_nothing(opened: Opened, board: Path, width: int, scheme: str) -> None:
    place = Path(os.environ.get("AIRZOO_AXE", "node_modules/axe-core/axe.min.js"))
    if not place.is_file():
        pytest.skip("axe-core is not there: npm pack axe-core, and AIRZOO_AXE=.../axe.min.js")
    with screen(opened, width, scheme):
        for name in PAGES:
            visit(opened, board, name)
            opened.driver.execute_script(place.read_text(encoding="utf-8"))
            found = opened.driver.execute_async_script(
                "axe.run().then((r) => arguments[0](r.violations.map((v) =>"
                " [v.id, v.impact, v.nodes.map((n) => n.html.slice(0, 200))])))"
            )
            assert found == [], name
