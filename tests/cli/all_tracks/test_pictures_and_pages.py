"""`plot` and `report` on results of every track are whole; and tracks are not mixed."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.cli.printed_results import (
    Run,
    check_picture,
    check_section,
    conditions,
    plain,
    strict_json,
)
from tests.cli.results_of_all_tracks import (
    TRACKS,
    Scored,
    ScoresOf,
)

# --- plot ------------------------------------------------------------------------------------

KINDS = {
    "recall": ("retrieval",),
    "errors": TRACKS,
    "thresholds": ("reconstruction",),
    "intervals": TRACKS,
    "scenes": TRACKS,
    "condition": TRACKS,
}


@pytest.mark.parametrize("kind", KINDS)
def test_a_plot_is_drawn_or_refused(scored: Scored, run: Run, tmp_path: Path, kind: str) -> None:
    # A reconstruction's own counts differ between methods, and make no groups for all.
    shared = conditions(scored)[0 if scored.track == "reconstruction" else 1]
    by = ("--by", shared) if kind == "condition" else ()
    if scored.track not in KINDS[kind]:
        said = run("plot", kind, *scored.paths, "-o", tmp_path / "x.png", code=2)
        assert f"results of the {KINDS[kind][0]} track" in said.err
        assert list(tmp_path.iterdir()) == []
        return
    # How a file is written does not depend on the track.
    for ending in ("png", "svg", "pdf") if scored.track == "retrieval" else ("png",):
        out = tmp_path / f"x.{ending}"
        run("plot", kind, *scored.paths, *by, "-o", out)
        check_picture(out)


# --- report ----------------------------------------------------------------------------------


def test_a_report_has_a_section_a_protocol(scores_of: ScoresOf, run: Run, tmp_path: Path) -> None:
    every = [scores_of(track) for track in TRACKS]
    paths = [path for one in every for path in one.paths]
    out = tmp_path / "report.html"
    said = run("report", *paths, "-o", out)
    assert "no maps" not in said.err
    page = out.read_text(encoding="utf-8")
    found = re.search(r'<script type="application/json" id="page-data">(.*?)</script>', page, re.S)
    assert found
    sections = strict_json(found[1])["sections"]
    assert [section["protocol"]["name"] for section in sections] == [
        f"airzoo-demo-{track}" for track in TRACKS
    ]
    tables = re.findall(r"<table>.*?</table>", page, re.S)
    for one, section, table in zip(every, sections, tables, strict=True):
        check_section(one, section, plain(table, "html"))


# --- what does not go together ---------------------------------------------------------------


@pytest.mark.parametrize(
    "ask",
    [
        "compare {}",
        "plot scenes {} -o x.png",
        "breakdown {} --by scene",
        "table {} --layout methods",
    ],
)
def test_tracks_are_not_mixed(scores_of: ScoresOf, run: Run, ask: str) -> None:
    paths = [scores_of(track).paths[0] for track in TRACKS[:2]]
    before, after = (part.split() for part in ask.split("{}"))
    said = run(*before, *paths, *after, code=2)
    assert "protocol" in said.err
