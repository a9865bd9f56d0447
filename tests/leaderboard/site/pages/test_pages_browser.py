"""Tables that sort, filter and compare, in Chromium; from a server, without JavaScript."""

from __future__ import annotations

import base64
import functools
import http.server
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.leaderboard.site.make_sample import sample
from tests.report.browser import NEEDS_CHROMIUM, Opened, webdriver

pytestmark = NEEDS_CHROMIUM
TABLE = "tables/airzoo-mini-retrieval/"


@pytest.fixture
def table(opened: Opened, board: Path) -> Opened:
    opened.driver.get("about:blank")  # the same file with another fragment is not opened anew
    opened.driver.get((board / TABLE / "index.html").as_uri())
    return opened


def column(page: Opened, title: str) -> list[str]:
    """Return what the cells of a column are sorted by, as they stand."""
    found: list[str] = page.driver.execute_script(
        "const heads = [...document.querySelectorAll('#results thead th')];"
        "const at = heads.findIndex((h) => h.dataset.name === arguments[0]);"
        "return [...document.querySelectorAll('#results tbody:first-of-type tr')]"
        ".filter((r) => !r.hidden).map((r) => r.cells[at].dataset.v ?? r.cells[at].textContent)",
        title,
    )
    return found


def ids(page: Opened) -> list[str]:
    return [row.get_attribute("data-id") for row in page.all("#results tbody tr:not([hidden])")]


def sort(page: Opened, title: str) -> None:
    page.button(f'th[data-name="{title}"]', "").click()


def test_numbers_sort_both_ways_and_what_is_infinite_or_missing_stands_last(table: Opened) -> None:
    before = ids(table)
    for way in ("descending", "ascending", "descending"):
        sort(table, "R@5")
        assert table.one('th[data-name="R@5"]').get_attribute("aria-sort") == way
        assert len(table.all("#results th[aria-sort]")) == 1
        values = column(table, "R@5")
        assert values[-3:] == ["inf", "", ""]
        numbers = [float(value) for value in values[:-3]]
        assert numbers == sorted(numbers, reverse=way == "descending")
        assert f"sorted by R@5, {way}" in table.one("#said").text
    assert ids(table)[-1] == "floor-99"  # it is of no method and stays below
    assert sorted(ids(table)) == sorted(before)


def test_equal_values_keep_their_order(table: Opened) -> None:
    sort(table, "method")
    names = ids(table)
    sort(table, "R@5")
    found = column(table, "R@5")
    equal = [v for v in found if found.count(v) > 1 and v]
    assert equal
    pairs = [i for i, v in zip(ids(table), found, strict=False) if v == equal[0]]
    assert [i for i in names if i in pairs] == pairs
    sort(table, "R@5")
    assert [i for i in ids(table) if i in pairs] == pairs


def test_texts_and_ranks_sort_too_and_by_keyboard(table: Opened) -> None:
    before = ids(table)
    button = table.button('th[data-name="training data"]', "")
    table.driver.execute_script("arguments[0].focus()", button)
    table.press(webdriver.Keys.ENTER)
    values = column(table, "training data")
    assert values[-4:] == [""] * 4  # reported ones do not say
    assert values[:-4] == sorted(values[:-4])
    sort(table, "rank")
    ranked = [i for i in before if i.startswith("method")]
    assert ids(table)[: len(ranked)] == ranked


def test_filters_hide_rows_say_how_many_are_left_and_stay_in_the_address(table: Opened) -> None:
    whole = len(ids(table))
    table.choose("form.filters", "Numbers", "reported, not re-scored")
    assert [i[:8] for i in ids(table)[:-1]] == ["reported"] * 4
    assert table.one("#said").text == "4 of 16 methods shown."
    table.one("form.filters button").click()
    table.until(lambda: len(ids(table)) == whole)
    table.choose("form.filters", "Training data", "without gta-uav")
    assert table.one("#said").text == "8 of 16 methods shown."  # who says nothing is not without it
    table.one("input[name=code]").click()
    table.one("input[name=name]").send_keys("METHOD")
    left = ids(table)
    assert 0 < len(left) < 9
    address = table.driver.current_url
    assert "training=-gta-uav" in address
    table.driver.get("about:blank")
    table.driver.get(address)
    assert ids(table) == left
    assert table.one("input[name=name]").get_attribute("value") == "METHOD"


def test_search_finds_names_whatever_their_case_and_accents(table: Opened) -> None:
    table.one("input[name=name]").send_keys("<B>nét")
    assert ids(table)[:-1] == ["method-1"]
    table.one("input[name=name]").send_keys("zzz")
    assert table.one("#said").text == "0 of 16 methods shown."


def test_a_date_leaves_out_what_is_older_or_has_none(table: Opened) -> None:
    table.driver.execute_script(
        "const f = document.querySelector('[name=since]'); f.value = '2026-06-01';"
        "f.dispatchEvent(new Event('input', { bubbles: true }))"
    )
    dates = [row.get_attribute("data-date") for row in table.all("#results tbody tr:not([hidden])")]
    assert dates[:-1]
    assert all(date >= "2026-06-01" for date in dates[:-1])


def test_two_chosen_methods_are_compared_and_more_are_shown_alone(table: Opened) -> None:
    assert not table.one(".tray").is_displayed()
    boxes = table.all("#results .pick input")
    for box in boxes[1:4]:
        box.click()
    assert not table.one(".tray a").is_displayed()
    table.one(".tray .only").click()
    assert ids(table)[:-1] == ["method-1", "method-2", "method-3"]
    boxes[2].click()
    assert table.one(".tray p").text.startswith("2 chosen: <b>Net</b>")
    table.one(".tray a").click()
    table.until(lambda: table.all("#overall tbody tr"))
    assert table.driver.current_url.endswith("compare.html#a=method-1&b=method-3")
    assert [table.one(f"#name-{side}").text for side in "ab"] == ['<b>Net</b> & "co"', "MegaLoc 龍"]


def unpacked(text: str) -> Any:
    return np.frombuffer(base64.b64decode(text), "<f4")


@pytest.mark.parametrize(("a", "b"), [(0, 1), (7, 2), (10, 11), (11, 0)])
def test_a_comparison_shows_what_the_file_of_pairs_has(
    opened: Opened, board: Path, a: int, b: int
) -> None:
    files = sample()
    pairs = files[f"{TABLE}pairs/1.json"]
    names = pairs["ids"]
    every = [(i, j) for i in range(len(names)) for j in range(i + 1, len(names))]
    at = every.index((min(a, b), max(a, b)))
    low, high = float(unpacked(pairs["low"])[at]), float(unpacked(pairs["high"])[at])
    if a > b:
        low, high = -high, -low
    p, holm = (float(unpacked(pairs[key])[at]) for key in ("p", "p_holm"))
    opened.driver.get("about:blank")
    opened.driver.get(f"{(board / TABLE / 'compare.html').as_uri()}#a={names[a]}&b={names[b]}")
    opened.until(lambda: opened.all("#overall tbody tr"))
    cells = [cell.text for cell in opened.all("#overall tbody tr:nth-child(2) td")]
    values = pairs["values"]
    difference = f"{100 * (values[a] - values[b]):+.2f}".replace("-", "−")
    assert cells[:3] == [f"{100 * values[a]:.2f}", f"{100 * values[b]:.2f}", difference]
    assert cells[3] == f"{100 * low:+.2f} to {100 * high:+.2f}".replace("-", "−")
    assert cells[5] == ("< 0.0001" if p < 0.00005 else f"{p:.4f}")
    assert cells[6] == ("< 0.0001" if holm < 0.00005 else f"{holm:.4f}")
    better = "A is better" if values[a] > values[b] else "B is better"
    assert cells[7] == (better if holm <= 0.05 else "cannot be told apart")
    assert len(opened.all("#scenes tbody tr")) == 2
    runs = [f"runs/airzoo-mini/retrieval/{names[n]}/{1 + n % 3}" for n in (a, b)]
    command = f"airzoo-bench compare {' '.join(runs)} --scene city"
    assert opened.one("#command code:last-child").text == command


def test_the_compared_methods_are_changed_and_swapped(opened: Opened, board: Path) -> None:
    opened.driver.get("about:blank")
    opened.driver.get(f"{(board / TABLE / 'compare.html').as_uri()}#a=method-5&b=method-0")
    opened.until(lambda: opened.all("#overall tbody tr"))
    first = opened.one("#overall tbody tr td:nth-child(4)").text
    opened.one("#swap").click()
    opened.until(lambda: opened.one("#overall tbody tr td:nth-child(4)").text != first)
    assert opened.one("#overall tbody tr td:nth-child(4)").text == first.replace("−", "+")
    assert opened.driver.current_url.endswith("#a=method-0&b=method-5")
    opened.choose("main form", "B", "SALAD")
    opened.until(lambda: opened.one("#said").text == "Choose two different methods.")
    assert not opened.one("#overall").is_displayed()


def test_bibtex_is_copied(opened: Opened, board: Path) -> None:
    opened.driver.get((board / TABLE / "methods/method-1.html").as_uri())
    opened.one("button[data-copy]").click()
    opened.until(lambda: opened.one("#copied").text)
    assert opened.one("#copied").text.startswith(("Copied", "Selected"))


@pytest.fixture
def server(board: Path) -> Iterator[tuple[str, list[str]]]:
    """Serve the board below a path of its own."""
    asked: list[str] = []

    class Handler(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *args: Any) -> None:
            asked.append(self.path)

    made = functools.partial(Handler, directory=str(board.parent))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), made) as serving:
        threading.Thread(target=serving.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{serving.server_port}/{board.name}/", asked
        serving.shutdown()


def test_from_a_server_under_a_path_nothing_but_the_pages_is_asked_for(
    opened: Opened, server: tuple[str, list[str]]
) -> None:
    address, asked = server
    opened.driver.get(f"{address}index.html")
    opened.driver.find_element("link text", "Aerial image retrieval").click()
    sort(opened, "R@5")
    opened.driver.find_element("link text", "SALAD").click()
    opened.driver.find_element("link text", "Compare with another method").click()
    opened.until(lambda: opened.all("#overall tbody tr"))
    opened.driver.find_element("link text", "About").click()
    assert opened.one("h1").text == "About this board"
    assert [path.rsplit("/", 1)[1] for path in asked] == [
        *("index.html", "index.html", "method-0.html", "compare.html", "about.html"),
    ]


def test_without_javascript_tables_read_in_order_and_no_control_is_in_the_way(
    opened: Opened, board: Path
) -> None:
    opened.driver.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": True})
    try:
        opened.driver.get((board / TABLE / "index.html").as_uri())
        names = [link.text for link in opened.all("#results tbody tr.re-scored th a:first-child")]
        assert names[:3] == ["SALAD", '<b>Net</b> & "co"', "=cmd()"]
        assert not any(node.is_displayed() for node in opened.all(".scripted, thead button, input"))
        opened.driver.get((board / TABLE / "compare.html").as_uri())
        assert "needs JavaScript" in opened.one("noscript").text
    finally:
        opened.driver.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": False})
