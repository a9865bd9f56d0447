"""All commands that read results, on results of every track, made up and real.

What is held is what commands mean: formats agree with each other, tables with results, differences
with tables, pictures and pages are whole. Layouts have tests of their own.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from tests.cli.results_of_all_tracks import (
    FORMATS,
    NAMES,
    TRACKS,
    Grid,
    Said,
    Scored,
    as_shown,
    check_cell,
    check_picture,
    check_section,
    conditions,
    csv_grid,
    json_grid,
    number,
    plain,
    real_scene,
    same,
    says_not_a_number,
    score_methods,
    shown_numbers,
    sparse_mini,
    strict_json,
    with_unit,
)
from tests.support import BRIGHTON, run_main

BENCHMARKS = ("airzoo-mini", "brighton")
WIDE, NARROW = 250, 80
FEW = ("--resamples", "500")

ScoresOf = Callable[[str, str], Scored]


Run = Callable[..., Said]


@pytest.fixture(scope="module")
def scores_of(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> ScoresOf:
    """Return a function that makes a benchmark, and its results, when they are first asked for."""
    root = tmp_path_factory.mktemp("data")

    @cache
    def prepared(name: str) -> Path:
        if name == "airzoo-mini":
            return sparse_mini(root)
        if not (BRIGHTON / "poses.json").is_file():
            pytest.skip("the real scene Brighton Beach is not beside the checkout")
        return real_scene(root, BRIGHTON)

    @cache
    def scored(benchmark: str, track: str) -> Scored:
        home = tmp_path_factory.mktemp(f"{benchmark}-{track}")
        return score_methods(prepared(benchmark), track, home)

    return scored


@pytest.fixture(params=list(product(BENCHMARKS, TRACKS)), ids="-".join)
def scored(request: pytest.FixtureRequest, scores_of: ScoresOf) -> Scored:
    return scores_of(*request.param)


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Run:
    """Return a function that runs a command, holds its exit code, and returns what it printed."""

    def call(*arguments: object, code: int = 0, width: int = WIDE) -> Said:
        monkeypatch.setenv("COLUMNS", str(width))
        capsys.readouterr()
        found = run_main(*arguments)
        said = Said(*capsys.readouterr())
        assert found == code, said.err
        assert not says_not_a_number(said.out), said.out
        return said

    return call


def check_formats(run: Run, *ask: object) -> Grid:
    """Hold all formats to the JSON, which is returned."""
    exact = json_grid(run(*ask, "--format", "json").out)
    shown = csv_grid(run(*ask, "--format", "csv").out)
    assert set(exact.columns) <= set(shown.columns)
    assert len(exact.rows) == len(shown.rows)
    for exact_row, shown_row in zip(exact.rows, shown.rows, strict=True):
        for name in exact.columns:
            check_cell(exact_row[name], shown_row[name])
    numbers = [text for row in shown.rows for cell in row.values() for text in shown_numbers(cell)]
    for form, width in [*((form, WIDE) for form in FORMATS), ("terminal", NARROW)]:
        text = plain(run(*ask, "--format", form, width=width).out, form)
        if form != "json":
            missing = pd.Series(shown_numbers(text)).value_counts()
            wanted = pd.Series(numbers).value_counts()
            assert (missing.reindex(wanted.index, fill_value=0) >= wanted).all(), (form, text)
        for row in exact.rows:
            for name in exact.columns[:2]:
                if number(row[name]) is None and row[name]:
                    assert " ".join(row[name].split()) in text, (form, width)
    return exact


# --- table -----------------------------------------------------------------------------------

BASE = ("--baseline", NAMES[0])
TABLES: dict[str, tuple[str, ...]] = {
    "methods": (),
    "scenes": ("--layout", "scenes", "--queries"),
    "no average": ("--layout", "scenes", "--no-average", "--per-block", "1", "--all"),
    "benchmarks": ("--layout", "benchmarks"),
    "published": ("--published", "--mark-published"),
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
        table = check_formats(run, "table", path)
        titles = result.truth.scene_titles
        for scene, title in titles.items():
            for column in scored.headline:
                value = as_shown(column, result.scenes[scene][column.key])
                assert same(table.one(Scene=title)[column.title], value)
        assert "Average" in table.column("Scene")


def test_scores_and_layouts_go_together(scored: Scored, run: Run) -> None:
    first, second = scored.headline[:2]
    ask = ("table", *scored.paths, "--score", second.title, "--score", first.key)
    table = check_formats(run, *ask, "--layout", "scenes")
    assert len(table.columns) == 1 + 2 * (len(scored.results[NAMES[0]].scenes) + 1)
    said = run(*ask, "--format", "latex", "--standalone", "--siunitx", "--cite", f"{NAMES[0]}=key")
    assert r"\begin{document}" in said.out
    assert r"weak\_1 \& co~\cite{key}" in said.out
    printed = csv_grid(run(*ask, *BASE, "--format", "csv").out)
    for column in (first, second):
        check_gains(printed, column.title)


def check_gains(printed: Grid, title: str) -> None:
    """Hold gains over the first row to the difference of the printed values."""
    baseline, *values = (float(cell) for cell in printed.column(title))
    if not np.isfinite(baseline):
        assert f"{title} gain" not in printed.columns
        return
    _, *gains = printed.column(f"{title} gain")
    for value, gain in zip(values, gains, strict=True):
        assert float(gain) == pytest.approx(value - baseline, abs=1e-9)


@pytest.mark.parametrize("benchmark", BENCHMARKS)
def test_results_of_all_tracks_stand_in_one_table(
    scores_of: ScoresOf, run: Run, benchmark: str
) -> None:
    every = [scores_of(benchmark, track) for track in TRACKS]
    paths = [path for one in every for path in one.paths]
    table = check_formats(run, "table", *paths, "--layout", "benchmarks")
    for one in every:
        for column in one.headline:
            name = next(n for n in table.columns if one.track in n and n.endswith(column.title))
            for method, result in one.results.items():
                value = as_shown(column, result.overall[column.key])
                rows = table.where(Method=method).rows
                assert any(same(row[name], value) for row in rows)


# --- compare ---------------------------------------------------------------------------------


def test_intervals_stand_about_the_values_of_the_table(scored: Scored, run: Run) -> None:
    for path, result in zip(scored.paths, scored.results.values(), strict=True):
        table = check_formats(run, "compare", path, *FEW)
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
    [(2, ""), (2, "--interval"), (3, ""), (3, "--scene"), (3, "--reference")],
)
def test_a_difference_is_that_of_the_tables(
    scored: Scored, run: Run, count: int, options: str
) -> None:
    chosen = {
        "": (),
        "--scene": ("--scene", scored.scene),
        "--reference": ("--reference", NAMES[1]),
        "--interval": ("--interval", "percentile"),
    }[options]
    reference = NAMES[1] if options == "--reference" else NAMES[0]
    paths = scored.paths[:count]
    found = check_formats(run, "compare", *paths, *chosen, *FEW)
    scene = chosen if options == "--scene" else ()
    layout = () if scene else ("--layout", "methods")
    table = json_grid(run("table", *paths, *layout, *scene, "--format", "json").out)
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


def test_most_different_queries_differ_so(scored: Scored, run: Run) -> None:
    column = scored.headline[0]
    ask = ("compare", *scored.paths[1:], "--most-different", "4", "--score", column.key)
    table = check_formats(run, *ask)
    first, second = (
        frame.set_index("scene" if scored.track == "reconstruction" else "query")[column.key]
        for frame in list(scored.records.values())[1:]
    )
    apart = (second - first).where(first != second, 0).abs().sort_values(ascending=False)
    listed = apart[[row[table.columns[0]] for row in table.rows]]
    assert listed.tolist() == apart.head(len(listed)).tolist()
    assert len(listed) == min(4, (apart > 0).sum())


# --- breakdown -------------------------------------------------------------------------------


def test_a_breakdown_by_each_condition_covers_every_query(scored: Scored, run: Run) -> None:
    assert (
        scored.benchmark.name == "brighton"
        or scored.track == "reconstruction"
        or (len(conditions(scored)) == 6)
    )
    for by in conditions(scored):
        table = check_formats(run, "breakdown", scored.paths[2], "--by", by, *FEW)
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
    table = check_formats(run, *ask)
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
    by = ("--by", conditions(scored)[1]) if kind == "condition" else ()
    if scored.track not in KINDS[kind]:
        said = run("plot", kind, *scored.paths, "-o", tmp_path / "x.png", code=2)
        assert f"results of the {KINDS[kind][0]} track" in said.err
        assert list(tmp_path.iterdir()) == []
        return
    # How a file is written does not depend on the benchmark.
    for ending in ("png", "svg", "pdf") if scored.benchmark.name == "airzoo-mini" else ("png",):
        out = tmp_path / f"x.{ending}"
        run("plot", kind, *scored.paths, *by, "-o", out)
        check_picture(out)


# --- report ----------------------------------------------------------------------------------


@pytest.mark.parametrize("benchmark", BENCHMARKS)
def test_a_report_has_a_section_a_protocol(
    scores_of: ScoresOf, run: Run, tmp_path: Path, benchmark: str
) -> None:
    every = [scores_of(benchmark, track) for track in TRACKS]
    paths = [path for one in every for path in one.paths]
    out = tmp_path / "report.html"
    said = run("report", *paths, "--data", every[0].benchmark, "-o", out)
    assert "no maps" not in said.err
    page = out.read_text(encoding="utf-8")
    found = re.search(r'<script type="application/json" id="page-data">(.*?)</script>', page, re.S)
    assert found
    sections = strict_json(found[1])["sections"]
    assert [section["protocol"]["name"] for section in sections] == [
        f"{benchmark}-{track}" for track in TRACKS
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
    paths = [scores_of("airzoo-mini", track).paths[0] for track in TRACKS[:2]]
    before, after = (part.split() for part in ask.split("{}"))
    said = run(*before, *paths, *after, code=2)
    assert "protocol" in said.err
