"""`table`, `compare`, `breakdown` on results of every track: all formats agree with the results."""

from __future__ import annotations

import csv
import html
import io
import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, NoReturn

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.results.result import ScoreColumn
from tests.cli.results_of_all_tracks import NAMES, TRACKS, Scored, score_methods
from tests.support import run_main

FORMATS = ("latex", "csv", "markdown", "html", "terminal")
WIDE, NARROW = 250, 80
BASE = ("--baseline", NAMES[0])

ScoresOf = Callable[[str], Scored]
Run = Callable[..., str]


@pytest.fixture(scope="session")
def scores_of(tmp_path_factory: pytest.TempPathFactory) -> ScoresOf:
    """Return a function that makes a track's results when they are first asked for."""
    return cache(lambda track: score_methods(tmp_path_factory, track))


@pytest.fixture(params=TRACKS)
def scored(request: pytest.FixtureRequest, scores_of: ScoresOf) -> Scored:
    return scores_of(request.param)


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Run:
    """Return a function that runs a command and returns what it printed."""

    def call(*arguments: object, code: int = 0, width: int = WIDE) -> str:
        monkeypatch.setenv("COLUMNS", str(width))
        capsys.readouterr()
        found, said = run_main(*arguments), capsys.readouterr()
        assert found == code, said.err
        assert not re.search(r"\bnan\b", said.out, re.IGNORECASE)
        return said.err if code else said.out

    return call


@dataclass(frozen=True)
class Grid:
    """A printed table: cells by the column's name, group before title."""

    columns: list[str]
    rows: list[Mapping[str, Any]]

    def column(self, name: str) -> list[Any]:
        return [row[name] for row in self.rows]

    def one(self, **cells: Any) -> Mapping[str, Any]:
        (row,) = (row for row in self.rows if cells.items() <= row.items())
        return row


def strict_json(text: str) -> Any:
    """Read JSON as the standard has it: without NaN and Infinity."""

    def refuse(constant: str) -> NoReturn:
        raise AssertionError(f"{constant} is no JSON")

    return json.loads(text, parse_constant=refuse)


def read_json(run: Run, *ask: object) -> Grid:
    table = strict_json(run(*ask, "--format", "json"))
    names = [f"{c.get('group', '')} {c['title']}".strip() for c in table["columns"]]
    return Grid(names, [dict(zip(names, row, strict=True)) for row in table["rows"]])


def number(cell: Any) -> float | None:
    """Return a cell's number, infinite ones too, or None where it has none."""
    try:
        return None if isinstance(cell, bool) or cell is None else float(cell)
    except ValueError:
        return None


def plain(text: str, form: str) -> str:
    """Return a table's words without the marks and escapes of its format."""
    if form == "latex":
        text = text.replace(r"$-$", "-").replace(r"$^\circ$", "°").replace("{[}", "[")
        text = re.sub(r"\\(?:textbf|underline|multicolumn\{\d+\}\{\w\})\{([^{}]*)\}", r"\1", text)
    if form in ("latex", "markdown"):
        text = re.sub(r"\\(\W|_)", r"\1", text).replace("**", "")
    if form == "html":
        text = re.sub(r"<[^>]*>", " ", text)
    return " ".join((html.unescape(text) if form in ("html", "markdown") else text).split())


def count_numbers(text: str) -> pd.Series:
    """Count the numbers of two decimals, as all formats print scores."""
    return pd.Series(re.findall(r"(?<![\w.])-?\d+\.\d\d(?![\d%])", text)).value_counts()


def check_formats(run: Run, *ask: object) -> Grid:
    """Hold all formats to the JSON, which is returned."""
    exact = read_json(run, *ask)
    names, *shown = csv.reader(io.StringIO(run(*ask, "--format", "csv")))
    assert set(exact.columns) <= set(names)
    for row, cells in zip(exact.rows, shown, strict=True):
        for name, text in zip(names, cells, strict=True):
            value = number(row.get(name))
            if value is not None and float(text) != value:
                digits = len(text.partition(".")[2]) if "e" not in text else 17
                assert abs(float(text) - value) <= 0.5 * 10.0**-digits + 1e-9
    wanted = count_numbers(" ".join(cell for row in shown for cell in row))
    for form, width in (*((form, WIDE) for form in FORMATS), ("terminal", NARROW)):
        text = plain(run(*ask, "--format", form, width=width), form)
        found = count_numbers(text)
        assert (found.reindex(wanted.index, fill_value=0) >= wanted).all(), (form, text)
        for row in exact.rows:
            for cell in (row[name] for name in exact.columns[:2]):
                assert number(cell) is not None or not cell or " ".join(cell.split()) in text
    return exact


def as_shown(column: ScoreColumn, value: float) -> float:
    return value * 100 if column.unit == "share" else value


def with_unit(column: ScoreColumn) -> str:
    return f"{column.title} [{'%' if column.unit == 'share' else column.unit}]"


def same(one: Any, other: float) -> bool:
    found = number(one)
    return found is not None and (found == other or bool(np.isclose(found, other, rtol=1e-9)))


# --- table ---


TABLES: dict[str, tuple[str, ...]] = {
    "methods": (),
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


def test_tables_hold_the_results(scored: Scored, run: Run) -> None:
    for options, scene in ((), None), (("--scene", scored.scene), scored.scene):
        table = read_json(run, "table", *scored.paths, "--all", *options)
        for name, result in scored.results.items():
            values, row = result.scenes.get(scene or "", result.overall), table.one(Method=name)
            assert all(same(row[c.title], as_shown(c, values[c.key])) for c in result.columns)
    result = scored.results[NAMES[0]]
    table = read_json(run, "table", scored.paths[0])
    assert "Average" in table.column("Scene")
    for scene, title in result.truth.scene_titles.items():
        for column in scored.headline:
            value = as_shown(column, result.scenes[scene][column.key])
            assert same(table.one(Scene=title)[column.title], value)


def test_scores_gains_and_citations(scored: Scored, run: Run) -> None:
    first, second = scored.headline[:2]
    ask = ("table", *scored.paths, "--score", second.title, "--score", first.key)
    table = read_json(run, *ask, "--layout", "scenes")
    assert len(table.columns) == 1 + 2 * (len(scored.results[NAMES[0]].scenes) + 1)
    text = run(*ask, "--format", "latex", "--cite", f"{NAMES[0]}=key")
    assert r"weak\_1 \& co" in text
    assert r"~\cite{key}" in text
    printed = pd.read_csv(io.StringIO(run(*ask, *BASE, "--format", "csv")))
    for title in (first.title, second.title):
        values = printed[title].to_numpy()
        if np.isfinite(values[0]):
            gains = printed[f"{title} gain"].to_numpy()[1:]
            np.testing.assert_allclose(gains, values[1:] - values[0], atol=1e-9)


def test_results_of_all_tracks_stand_in_one_table(scores_of: ScoresOf, run: Run) -> None:
    every = [scores_of(track) for track in TRACKS]
    paths = [path for one in every for path in one.paths]
    table = check_formats(run, "table", *paths, "--layout", "benchmarks")
    for one in every:
        for column in one.headline:
            name = next(n for n in table.columns if one.track in n and n.endswith(column.title))
            for method, result in one.results.items():
                value = as_shown(column, result.overall[column.key])
                rows = [row for row in table.rows if row["Method"] == method]
                assert any(same(row[name], value) for row in rows)


# --- compare and breakdown ---


@pytest.mark.parametrize("option", ["", "--scene", "--reference"])
def test_a_difference_is_that_of_the_tables(scored: Scored, run: Run, option: str) -> None:
    value = {"--scene": scored.scene, "--reference": NAMES[1]}.get(option)
    chosen = (option, value) if option else ()
    reference = NAMES[1] if option == "--reference" else NAMES[0]
    read = read_json if option else check_formats
    found = read(run, "compare", *scored.paths, *chosen)
    table = read_json(run, "table", *scored.paths, *(chosen if option == "--scene" else ()))
    assert len(found.rows) == 2 * len(scored.headline)
    for column in scored.headline:
        theirs = float(table.one(Method=reference)[column.title])
        for name in set(NAMES) - {reference}:
            mine = float(table.one(Method=name)[column.title])
            row = found.one(Score=with_unit(column), Method=name)
            assert same(row["Value"], mine)
            assert same(row["Difference"], 0.0 if mine == theirs else mine - theirs)


def test_intervals_stand_about_the_values_of_the_table(scored: Scored, run: Run) -> None:
    result, table = scored.results[NAMES[2]], read_json(run, "compare", scored.paths[2])
    titles = [*result.truth.scene_titles.values()]
    # The average over one scene is that scene, and said once.
    several = len(titles) > 1 or scored.track == "reconstruction"
    for column in scored.headline:
        row = table.one(Scene="Average" if several else titles[0], Score=with_unit(column))
        assert same(row["Value"], as_shown(column, result.overall[column.key]))


def test_a_breakdown_covers_every_query(scored: Scored, run: Run) -> None:
    known = ("altitude_m", "pitch_deg", "weather", "time_of_day", "sequence", "answered", "points")
    conditions = ["scene", *(name for name in known if name in scored.records.columns)]
    assert len(conditions) >= 3
    for by in conditions:
        table = read_json(run, "breakdown", scored.paths[2], "--by", by)
        # The second column counts queries, or scenes.
        assert sum(table.column(table.columns[1])) == len(scored.records)
        assert len(table.columns) == 2 + len(scored.headline)
    column = scored.headline[-1]
    ask = ("breakdown", *scored.paths, "--by", "scene", "--score", column.key)
    table = check_formats(run, *ask)
    for name, result in scored.results.items():
        head = next(head for head in table.columns if head.startswith(name))
        for scene, title in result.truth.scene_titles.items():
            value = as_shown(column, result.scenes[scene][column.key])
            assert same(table.one(scene=title)[head], value)


def test_bins_are_averages_of_their_queries(scored: Scored, run: Run) -> None:
    by = "points" if scored.track == "reconstruction" else "altitude_m"
    records, column = scored.records, scored.headline[0]
    edges = sorted({float(f"{e:.1f}") for e in records[by].quantile([0.3, 0.7])})
    bins = ("--bins", ",".join(map(str, edges)), "--score", column.key)
    table = read_json(run, "breakdown", scored.paths[2], "--by", by, *bins)
    groups = np.searchsorted(edges, records[by], side="right")
    values = records.groupby(groups)[column.key]
    expected = values.median() if column.average == "median" else values.mean()
    counts = values.size().reindex(range(len(edges) + 1), fill_value=0).tolist()
    assert table.column(table.columns[1]) == counts
    filled = [value for value in table.column(table.columns[2]) if value is not None]
    for found, value in zip(filled, expected, strict=True):
        assert same(found, as_shown(column, value))


@pytest.mark.parametrize(
    "ask",
    [
        "compare {}",
        "plot errors {} -o x.png",
        "breakdown {} --by scene",
        "table {} --layout methods",
    ],
)
def test_tracks_are_not_mixed(scores_of: ScoresOf, run: Run, ask: str) -> None:
    paths = [scores_of(track).paths[0] for track in TRACKS[:2]]
    before, after = (part.split() for part in ask.split("{}"))
    assert "protocol" in run(*before, *paths, *after, code=2)
