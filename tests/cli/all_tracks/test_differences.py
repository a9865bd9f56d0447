"""`compare` and `breakdown` on results of every track, held against tables and records."""

from __future__ import annotations

import numpy as np
import pytest

from tests.cli.printed_results import (
    Run,
    as_shown,
    check_formats,
    conditions,
    number,
    plain,
    read_json,
    same,
    with_unit,
)
from tests.cli.results_of_all_tracks import (
    NAMES,
    TRACKS,
    Scored,
    ScoresOf,
)

# --- compare ---------------------------------------------------------------------------------


def test_intervals_stand_about_the_values_of_the_table(scored: Scored, run: Run) -> None:
    for path, result in zip(scored.paths, scored.results.values(), strict=True):
        table = read_json(run, "compare", path)
        titles = result.truth.scene_titles
        # The average over one scene is that scene, and said once.
        scene = (
            "Average"
            if len(titles) > 1 or scored.track == "reconstruction"
            else next(iter(titles.values()))
        )
        for column in scored.headline:
            value = as_shown(column, result.overall[column.key])
            assert same(table.one(Scene=scene, Score=with_unit(column))["Value"], value)


@pytest.mark.parametrize(
    ("count", "options"),
    [(2, ""), (3, ""), (3, "--scene"), (3, "--reference")],
)
def test_a_difference_is_that_of_the_tables(
    scored: Scored, run: Run, count: int, options: str
) -> None:
    chosen = {
        "": (),
        "--scene": ("--scene", scored.scene),
        "--reference": ("--reference", NAMES[1]),
    }[options]
    reference = NAMES[1] if options == "--reference" else NAMES[0]
    paths = scored.paths[:count]
    read = check_formats if count == 3 and not options else read_json
    found = read(run, "compare", *paths, *chosen)
    scene = chosen if options == "--scene" else ()
    layout = () if scene else ("--layout", "methods")
    table = read_json(run, "table", *paths, *layout, *scene)
    assert len(found.rows) == (count - 1) * len(scored.headline)
    for column in scored.headline:
        theirs = number(table.one(Method=reference)[column.title])
        for name in set(NAMES[:count]) - {reference}:
            mine = number(table.one(Method=name)[column.title])
            assert mine is not None
            assert theirs is not None
            row = found.one(Score=with_unit(column), Method=name)
            assert same(row["Value"], mine)
            if mine == theirs:
                assert number(row["Difference"]) == 0
            else:
                assert same(row["Difference"], mine - theirs)


def test_a_comparison_of_one_score_speaks_of_no_other(scored: Scored, run: Run) -> None:
    one, *others = scored.headline
    said = run("compare", *scored.paths, "--score", one.key, "--reference", "best")
    text = plain(said.out, "terminal")
    assert one.title in text
    assert not [column.title for column in others if f"{column.title} [" in text]
    assert all(name in text for name in NAMES)


# --- breakdown -------------------------------------------------------------------------------


def test_a_breakdown_by_each_condition_covers_every_query(scored: Scored, run: Run) -> None:
    assert len(conditions(scored)) == (3 if scored.track == "reconstruction" else 6)
    for by in conditions(scored):
        table = read_json(run, "breakdown", scored.paths[2], "--by", by)
        # The second column counts queries, or scenes.
        assert sum(table.column(table.columns[1])) == len(scored.records[NAMES[2]])
        assert len(table.columns) == 2 + len(scored.headline)


def test_a_breakdown_by_scene_is_that_of_the_result(scored: Scored, run: Run) -> None:
    column = scored.headline[-1]
    ask = ("breakdown", *scored.paths, "--by", "scene", "--score", column.key)
    table = check_formats(run, *ask)
    for name, result in scored.results.items():
        for scene, title in result.truth.scene_titles.items():
            value = as_shown(column, result.scenes[scene][column.key])
            heads = [head for head in table.columns if head.startswith(name)]
            assert same(table.one(scene=title)[heads[0]], value)


def test_bins_are_averages_of_their_queries(scored: Scored, run: Run) -> None:
    by = "points" if scored.track == "reconstruction" else "altitude_m"
    records = scored.records[NAMES[2]]
    edges = sorted({float(f"{e:.1f}") for e in records[by].quantile([0.3, 0.7])})
    bins = ",".join(map(str, edges))
    column = scored.headline[0]
    ask = ("breakdown", scored.paths[2], "--by", by, "--bins", bins, "--score", column.key)
    table = read_json(run, *ask)
    groups = np.searchsorted(edges, records[by], side="right")
    values = records.groupby(groups)[column.key]
    expected = values.median() if column.average == "median" else values.mean()
    counts = values.size().reindex(range(len(edges) + 1), fill_value=0).tolist()
    assert table.column(table.columns[1]) == counts
    shown = table.column(table.columns[2])
    assert [value is None for value in shown] == [count == 0 for count in counts]
    filled = [value for value in shown if value is not None]
    for found, value in zip(filled, expected, strict=True):
        assert same(found, as_shown(column, value))


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
