"""Hostile texts in every place of a board, in Chromium."""

from __future__ import annotations

from pathlib import Path

from tests.leaderboard.site.pages.visiting import KINDS, TABLE, visit
from tests.report.browser import NEEDS_CHROMIUM, Opened

pytestmark = NEEDS_CHROMIUM


def test_hostile_texts_run_nothing_and_load_nothing(opened: Opened, hostile_board: Path) -> None:
    methods = sorted(hostile_board.rglob("methods/*.html"))[::3]
    assert len(methods) >= 8
    for page in [*(hostile_board / kind for kind in KINDS), *methods]:
        visit(opened, page)
        found = opened.driver.execute_script(
            "return [window.caught || 0,"
            " performance.getEntriesByType('resource').map((e) => e.name),"
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
    opened.driver.execute_script(
        "for (const button of document.querySelectorAll('thead button')) button.click()"
    )
    assert opened.driver.execute_script("return window.caught || 0") == 0
    high = opened.driver.execute_script(
        "return Math.max(...[...document.querySelectorAll('tbody tr')].map((n) => n.offsetHeight))"
    )
    assert high < 500  # thousands of letters are cut
