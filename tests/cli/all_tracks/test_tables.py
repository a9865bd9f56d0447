"""`table` on results of every track: formats agree with each other, tables with results.

Layouts have tests of their own.
"""

from __future__ import annotations

import pytest

from tests.cli.printed_results import (
    Run,
    as_shown,
    check_formats,
    check_gains,
    csv_grid,
    json_grid,
    read_json,
    same,
)
from tests.cli.results_of_all_tracks import (
    NAMES,
    TRACKS,
    Scored,
    ScoresOf,
)

BASE = ("--baseline", NAMES[0])
TABLES: dict[str, tuple[str, ...]] = {
    "methods": (),
    "scenes": ("--layout", "scenes"),
    "every score": ("--layout", "scenes", "--all"),
    "benchmarks": ("--layout", "benchmarks"),
    "published": ("--published",),
    "scenes with intervals": ("--layout", "scenes", "--intervals", *BASE),
    "marks": (*BASE, "--highlight", NAMES[2], "--second"),
    "gains of each": ("--baseline", f"{NAMES[2]}={NAMES[1]}", "--layout", "scenes"),
}


@pytest.mark.parametrize("options", TABLES.values(), ids=TABLES)
def test_a_table_says_the_same_in_every_format(
    scored: Scored, run: Run, options: tuple[str, ...]
) -> None:
    table = check_formats(run, "table", *scored.paths, *options)
    assert set(table.column("Method")) == set(NAMES)
    for column in scored.headline:
        assert any(column.title in name for name in table.columns)


def test_a_table_of_methods_holds_the_results(scored: Scored, run: Run) -> None:
    for options, part in ((), "overall"), (("--scene", scored.scene), "scenes"):
        said = run("table", *scored.paths, "--all", "--format", "json", *options)
        table = json_grid(said.out)
        for name, result in scored.results.items():
            values = result.overall if part == "overall" else result.scenes[scored.scene]
            row = table.one(Method=name)
            for column in result.columns:
                assert same(row[column.title], as_shown(column, values[column.key]))


def test_a_table_of_one_result_holds_every_scene(scored: Scored, run: Run) -> None:
    for path, result in zip(scored.paths, scored.results.values(), strict=True):
        table = read_json(run, "table", path)
        titles = result.truth.scene_titles
        for scene, title in titles.items():
            for column in scored.headline:
                value = as_shown(column, result.scenes[scene][column.key])
                assert same(table.one(Scene=title)[column.title], value)
        assert "Average" in table.column("Scene")


def test_scores_and_layouts_go_together(scored: Scored, run: Run) -> None:
    first, second = scored.headline[:2]
    ask = ("table", *scored.paths, "--score", second.title, "--score", first.key)
    table = read_json(run, *ask, "--layout", "scenes")
    assert len(table.columns) == 1 + 2 * (len(scored.results[NAMES[0]].scenes) + 1)
    said = run(*ask, "--format", "latex", "--cite", f"{NAMES[0]}=key")
    assert r"weak\_1 \& co" in said.out
    assert r"~\cite{key}" in said.out
    printed = csv_grid(run(*ask, *BASE, "--format", "csv").out)
    for column in (first, second):
        check_gains(printed, column.title)


def test_results_of_all_tracks_stand_in_one_table(scores_of: ScoresOf, run: Run) -> None:
    every = [scores_of(track) for track in TRACKS]
    paths = [path for one in every for path in one.paths]
    table = check_formats(run, "table", *paths, "--layout", "benchmarks")
    for one in every:
        for column in one.headline:
            name = next(n for n in table.columns if one.track in n and n.endswith(column.title))
            for method, result in one.results.items():
                value = as_shown(column, result.overall[column.key])
                rows = table.where(Method=method).rows
                assert any(same(row[name], value) for row in rows)
