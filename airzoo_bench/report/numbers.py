"""The tables of a report: every number, text and mark is decided here, and only placed by pages."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from importlib import resources

import numpy as np

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.report.figures import heading
from airzoo_bench.report.sections import Section
from airzoo_bench.results.comparison import (
    FLOOR_MARK,
    Pair,
    compare,
    floor_note,
    is_share,
    make_sample,
    notes_of,
    tied_with_best,
)
from airzoo_bench.results.result import Reference, Result, ScoreColumn
from airzoo_bench.statistics.intervals import Interval, sample_intervals
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.statistics.significance import LEVEL, holm
from airzoo_bench.tables.breakdown import breakdown_table, condition_title, group_records
from airzoo_bench.tables.comparison import LEAST_P, differences_table, sentence, verdict
from airzoo_bench.tables.intervals import (
    intervals_made,
    resampled,
    score_cell,
    score_texts,
    score_title,
)
from airzoo_bench.tables.marks import best_texts
from airzoo_bench.tables.method_table import as_shown, score_column, shared_references
from airzoo_bench.tables.model import Cell, Column, Table, share_to_percent, show_number

OVERALL, POOLED = "overall", "pooled"
_BEST, _TIED = "best", "tied"
_RESAMPLES, _FEWEST = 10_000, 1_000
_WORK = 2.5e9  # values whose signs are drawn for tests: some seconds
_DRAWN = 1e9  # values drawn for medians: as long
_FINEST = 40  # resamples a comparison, so that a corrected p can still be a finding
_MOST_PAIRED = 12  # methods of which every two are compared
_DIFFERING = 10  # queries that are listed of a pair

Limits = list[list[float] | None]
_Row = Sequence[float | None]


@dataclass(frozen=True)
class Head:
    """A column's heading; ``best`` says which end of it is better, ``more`` hides it at first."""

    text: str
    words: bool = False
    hint: str = ""
    best: str = ""
    more: bool = False


@dataclass(frozen=True)
class Datum:
    """A cell: its text, its value for sorting, its mark, and its interval."""

    text: str
    order: float | None = None
    mark: str = ""
    interval: str = ""


@dataclass(frozen=True)
class Line:
    """A row; a floor scores without a method, and stays below all others."""

    cells: list[Datum]
    floor: bool = False


@dataclass(frozen=True)
class Grid:
    """A table of the page; the first cell of each row heads it."""

    caption: str
    heads: list[Head]
    rows: list[Line]
    notes: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Pane:
    """Grids that the page shows, one below the other, when their title is chosen."""

    key: str
    title: str
    grids: list[Grid]
    about: str = ""


@dataclass(frozen=True)
class Findings:
    """Intervals by scope and score, tests against the best by scope, and how both were made."""

    limits: Mapping[str, Mapping[str, Limits]]
    tests: Mapping[str, Mapping[str, list[bool]]]
    notes: list[str]


def find(section: Section) -> Findings:
    """Compute intervals and tests as `compare` does, if they take seconds only."""
    limits, about_limits = _intervals(section)
    tests, about_tests = _tests(section)
    return Findings(limits, tests, [note for note in (about_limits, about_tests) if note])


def _intervals(section: Section) -> tuple[dict[str, dict[str, Limits]], str]:
    """Take the intervals of headline scores: shares by formula, others where it takes seconds."""
    scores, drawn = section.headline, [s for s in section.headline if not is_share(s)]
    values = len(section.methods) * len(section.methods[0].records) * max(1, len(drawn))
    plan = _limited_plan(_DRAWN / values)
    if plan is None:
        plan, scores = ResamplingConfig(), [score for score in scores if is_share(score)]
    if not scores:
        return {}, "no intervals: there are too many queries and methods"
    found, count = (
        sample_intervals(make_sample(section.methods, scores), plan),
        len(section.methods),
    )
    parts = {OVERALL: found.overall} | (found.groups if section.by_query else {})
    limits = {
        scope: {
            score.key: [_ends(one) for one in part[place * count : (place + 1) * count]]
            for place, score in enumerate(scores)
        }
        for scope, part in parts.items()
    }
    every = [interval for part in parts.values() for interval in part]
    names = ", ".join(score.title for score in scores)
    made = intervals_made(every, plan, resampled(section.first.unit), f"intervals of {names}")
    why = " / ".join(sorted({interval.reason for interval in every if interval.reason}))
    said = [made or "no intervals", f"none where {why}" * bool(why)]
    if len(scores) < len(section.headline):
        said.append("of the other scores they would take too long")
    return limits, "; ".join(filter(None, said))


def _limited_plan(resamples: float) -> ResamplingConfig | None:
    return ResamplingConfig(min(_RESAMPLES, int(resamples))) if resamples >= _FEWEST else None


def _ends(interval: Interval) -> list[float] | None:
    return None if interval.low is None or interval.high is None else [interval.low, interval.high]


def plan_groups(section: Section) -> ResamplingConfig | None:
    """Return a plan of intervals within groups by every condition; None if they take too long."""
    if is_share(section.headline[0]):  # by a formula
        return ResamplingConfig()
    groupings = max(1, len(section.conditions))
    return _limited_plan(
        _DRAWN / (len(section.methods) * len(section.methods[0].records) * groupings)
    )


def _plan(section: Section, comparisons: int) -> ResamplingConfig | None:
    """Return a plan with enough resamples for some comparisons of a score."""
    count = len(section.methods)
    resamples = max(_RESAMPLES, _FINEST * count * (count - 1) // 2)
    values = comparisons * len(section.headline) * len(section.methods[0].records)
    return ResamplingConfig(resamples) if values * resamples <= _WORK else None


def _tests(section: Section) -> tuple[dict[str, Mapping[str, list[bool]]], str]:
    methods, scores = section.methods, section.headline
    if len(methods) < 2:
        return {}, ""
    plan = _plan(section, 2 * len(methods))
    if plan is None:
        return {}, "no tests against the best: there are too many queries and methods"
    found: dict[str, Mapping[str, list[bool]]] = {OVERALL: tied_with_best(methods, scores, plan)}
    for scene in section.first.scenes if section.by_query else ():
        found[scene] = tied_with_best(methods, scores, plan, scene)
    return found, (
        f"≈ marks what a paired test does not tell from the best (p above "
        f"{share_to_percent(LEVEL):g} % after Holm's correction for all pairs of methods, "
        f"{plan.resamples} resamples, seed {plan.seed}), of the paper's scores; pooled values are "
        "not tested" + ("" if section.by_query else ", nor are single scenes")
    )


def marks_of(score: ScoreColumn, values: _Row, ties: list[bool] | None = None) -> list[str]:
    """Mark a score's values by method: the best by the digits shown, and who ties with them.

    One method by itself has no mark.
    """
    column = score_column(score)
    cells = [score_cell(score, value) for value in values]
    best = best_texts(column, cells)[:1]
    if not best or len(values) < 2:
        return [""] * len(values)
    tied = ties or [False] * len(values)
    return [
        _BEST if cell.text(column.decimals) == best[0] else _TIED if is_tied else ""
        for cell, is_tied in zip(cells, tied, strict=True)
    ]


def _legend(found: Findings, marks: Sequence[str], scope: str) -> str:
    if not any(marks):
        return ""
    if not found.tests.get(scope):
        return "; ★ marks the best, which is not tested"
    return "; ★ marks the best" + ", ≈ what cannot be told from it" * (_TIED in marks)


def _data(
    score: ScoreColumn, values: _Row, marks: Sequence[str] = (), limits: Limits | None = None
) -> list[Datum]:
    texts, none = score_texts(score, values), [None] * len(values)
    return [
        Datum(text, value, mark, " to ".join(score_texts(score, ends or ())))
        for text, value, mark, ends in zip(
            texts, values, marks or [""] * len(texts), limits or none, strict=True
        )
    ]


def _head(section: Section, score: ScoreColumn) -> Head:
    best = "descending" if score.higher_is_better else "ascending"
    hint = meaning(section.track, score)
    return Head(heading(score), False, hint, best, not score.headline)


def summary_panes(section: Section, found: Findings) -> list[Pane]:
    """Return every score by method: over scenes, pooled, and by scene."""
    titles = section.first.truth.scene_titles
    if len(titles) == 1:
        return [_scores_pane(section, found, OVERALL, *titles.values())]
    scopes = {OVERALL: "Average over scenes"}
    scopes |= {POOLED: "All queries pooled"} if section.by_query else {}
    return [
        _scores_pane(section, found, scope, title) for scope, title in (scopes | titles).items()
    ]


def _by_scope(numbers: Result | Reference) -> dict[str, dict[str, float]]:
    return {OVERALL: numbers.overall, POOLED: numbers.pooled, **numbers.scenes}


def _scores_pane(section: Section, found: Findings, scope: str, title: str) -> Pane:
    references, _ = shared_references([method.result for method in section.methods])
    columns: list[list[Datum]] = []
    tests, limits = found.tests.get(scope, {}), found.limits.get(scope, {})
    for score in section.scores:
        values = [_by_scope(m.result)[scope][score.key] for m in section.methods]
        marks = marks_of(score, values, tests.get(score.key))
        floors = [_by_scope(one)[scope].get(score.key) for one in references.values()]
        data = _data(score, values, marks, limits.get(score.key))
        columns.append([*data, *_data(score, floors)])
    names = [m.name + f" {FLOOR_MARK}" * bool(floor_note(m.result)) for m in section.methods]
    rows = [
        Line([Datum(name), *cells], number >= len(names))
        for number, (name, *cells) in enumerate(zip([*names, *references], *columns, strict=True))
    ]
    marks = [cell.mark for column in columns for cell in column]
    heads = [Head("Method", True), *(_head(section, score) for score in section.scores)]
    caption = f"{title}{_legend(found, marks, scope)}"
    return Pane(scope, title, [Grid(caption, heads, rows)])


def scene_panes(section: Section, found: Findings) -> list[Pane]:
    """Return a table a headline score, of scenes and methods."""
    result, panes = section.first, []
    for score in section.headline:
        rows, every = [], []
        for scene, title in result.truth.scene_titles.items():
            values = [method.result.scenes[scene][score.key] for method in section.methods]
            marks = marks_of(score, values, found.tests.get(scene, {}).get(score.key))
            every += marks
            count = result.counts[scene]["queries"]
            counts = [Datum(f"{count}", count)] if section.by_query else []
            rows.append(Line([Datum(title), *counts, *_data(score, values, marks)]))
        queries = [Head("Queries", best="descending")] if section.by_query else []
        methods = [
            Head(m.name, best="descending" if score.higher_is_better else "ascending")
            for m in section.methods
        ]
        scope = next(iter(result.scenes))
        caption = f"{heading(score)} by scene and method{_legend(found, every, scope)}"
        grid = Grid(caption, [Head("Scene", True), *queries, *methods], rows)
        panes.append(Pane(score.key, heading(score), [grid]))
    return panes


def grid_of(table: Table, caption: str = "") -> Grid:
    """Turn a table of the command line into one of the page."""
    best = {True: "descending", False: "ascending", None: ""}
    heads = [
        Head(column.heading, table.is_text(n), best=best[column.higher_is_better])
        for n, column in enumerate(table.columns)
    ]

    def datum(cell: Cell, column: Column) -> Datum:
        order = cell.value if isinstance(cell.value, int | float) else None
        return Datum(cell.text(column.decimals), order, _BEST * cell.best)

    rows = [Line([*map(datum, row.cells, table.columns)]) for row in table.rows]
    return Grid(caption or table.title, heads, rows, list(table.all_notes))


def breakdown_panes(section: Section) -> list[Pane]:
    """Return scores by each condition: a pane a condition and score, keyed by both."""
    if not section.by_query:
        return []
    panes = []
    for by in section.conditions:
        grouping = group_records(section.methods[0].records, by)
        for score in section.query_scores:
            table = breakdown_table(section.methods, [score], by, grouping=grouping)
            caption = f"{heading(score)} by {condition_title(by)}, all scenes"
            if any(cell.best for row in table.rows for cell in row.cells):
                caption += "; ★ marks the best, which is not tested"
            panes.append(Pane(f"{by} {score.key}", condition_title(by), [grid_of(table, caption)]))
    return panes


def pair_panes(section: Section) -> list[Pane]:
    """Compare every two of the best methods by the paper's scores; empty with one method."""
    count = min(len(section.methods), _MOST_PAIRED)
    while count > 1 and _plan(section, count * count) is None:
        count -= 1
    plan = _plan(section, count * count)
    if count < 2 or plan is None:
        return []
    about = (
        f"Paired by {section.first.unit}, of the average over scenes; p corrected: after Holm for "
        f"all pairs of methods; {plan.resamples} resamples."
    )
    panes = []
    for one, other, pairs in _corrected(section, count, plan):
        first, second = section.methods[one], section.methods[other]
        caption = f"{second.name} minus {first.name}; the verdict is that on {second.name}"
        heads = [Head("Score", True), Head(first.name), Head(second.name), Head("Difference")]
        heads += [Head("95 % interval"), Head("p"), Head("p corrected"), Head("Verdict", True)]
        rows = [Line([Datum(text) for text in _pair_texts(pair)]) for pair in pairs]
        grid = Grid(caption, heads, rows, [sentence(pair, plan) for pair in pairs])
        scores = section.headline[:1]
        differing = grid_of(differences_table([first, second], scores, _DIFFERING))
        title = f"{first.name} and {second.name}"
        panes.append(Pane(f"{one} {other}", title, [grid, differing], about))
    return panes


def _corrected(
    section: Section, count: int, plan: ResamplingConfig
) -> Iterator[tuple[int, int, list[Pair]]]:
    """Yield every two methods with their pairs, by score.

    p of a pair is corrected among those of its better method, as `compare` does for the best.
    """
    methods, scores = section.methods[:count], section.headline
    family = len(section.methods) * (len(section.methods) - 1) // 2
    pairs: dict[tuple[int, int], list[Pair]] = {}
    p_values: Floats = np.ones((len(scores), count, count))
    for one in range(count - 1):
        made = compare(methods[one:], scores, reference=methods[one].name, resampling=plan).pairs
        for place, pair in enumerate(made):
            score, step = divmod(place, count - 1 - one)
            other = one + 1 + step
            pairs.setdefault((one, other), []).append(pair)
            p_values[score, one, other] = p_values[score, other, one] = pair.test.p_value
    for (one, other), of_pair in pairs.items():
        corrected = []
        for score, pair in enumerate(of_pair):
            better, worse = (other, one) if pair.is_better else (one, other)
            row = holm(np.delete(p_values[score, better], better), family)
            corrected.append(replace(pair, p_holm=float(row[worse - (worse > better)])))
        yield one, other, corrected


def _pair_texts(pair: Pair) -> list[str]:
    score, difference, ends = pair.score, pair.difference, _ends(pair.interval)
    shown = [show_number(as_shown(score, end), 2, "+") for end in ends or ()]
    return [
        score_title(score),
        *(score_cell(score, value).text(2) for value in (pair.reference_value, pair.value)),
        "–" if difference is None else show_number(as_shown(score, difference), 2, "+"),
        " to ".join(shown) or f"none: {pair.interval.reason}",
        *(Cell(p, least=LEAST_P).text(4) for p in (pair.test.p_value, pair.p_holm)),
        verdict(pair),
    ]


def notes_by_method(section: Section) -> list[str]:
    """Return the notes of all results, each once, with the methods that have it."""
    names: dict[str, list[str]] = {}
    for method in section.methods:
        for note in notes_of(method.result):
            names.setdefault(note, []).append(method.name)
    every = len(section.methods)
    said = [
        f"{'All methods' if len(who) == every > 1 else ', '.join(who)}: {note}"
        for note, who in names.items()
    ]
    return [*said, *section.notes]


@cache
def _meanings() -> dict[str, dict[str, str]]:
    text = resources.files("airzoo_bench.report").joinpath("meanings.toml").read_text("utf-8")
    return tomllib.loads(text)


def meaning(track: str, score: ScoreColumn) -> str:
    """Explain a score in a few words; empty for a score that is not known here."""
    for pattern, words in _meanings().get(track, {}).items():
        if found := re.fullmatch(pattern, score.key):
            return words.format(*found.groups())
    return ""
