"""The tables of a report, as the commands make them; pages only place them."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from importlib import resources

from airzoo_bench.reconstruction.track import describe_alignments
from airzoo_bench.report.sections import Section
from airzoo_bench.results.comparison import (
    FLOOR_MARK,
    compare,
    floor_note,
    make_sample,
    tied_with_best,
)
from airzoo_bench.results.result import Reference, Result, ScoreColumn
from airzoo_bench.statistics.intervals import FEWEST, Interval, sample_intervals
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.statistics.significance import LEVEL
from airzoo_bench.tables.breakdown import breakdown_table
from airzoo_bench.tables.comparison import comparison_table, describe_intervals, differences_table
from airzoo_bench.tables.layouts import score_cell, score_column, share_notes, shared_references
from airzoo_bench.tables.marks import mark_cells
from airzoo_bench.tables.model import Cell, Column, Row, Table

OVERALL, POOLED = "overall", "pooled"
TIED = "≈"
"""The mark of a value that a paired test does not tell from the best."""

_MOST = 1_000_000  # queries by pairs of methods that are resampled in some seconds
_MOST_PAIRED, _DIFFERING = 8, 10


@dataclass(frozen=True)
class Pane:
    """Tables that the page shows, one below the other, when their title is chosen."""

    key: str
    title: str
    tables: list[Table]


@dataclass(frozen=True)
class Findings:
    """Intervals and what ties with the best, by scope and score, and how both were made."""

    limits: Mapping[str, Mapping[str, Sequence[Interval]]] = field(default_factory=dict)
    ties: Mapping[str, Mapping[str, list[bool]]] = field(default_factory=dict)
    notes: Sequence[str] = ()


def plan_of(section: Section) -> ResamplingConfig | None:
    """Return how to resample; None where queries and methods are too many."""
    count = len(section.methods)
    size = max(1, count * (count - 1) // 2) * len(section.methods[0].records)
    return ResamplingConfig() if size <= _MOST else None


def find(section: Section) -> Findings:
    """Compute intervals and tests of headline scores as `compare` does."""
    plan, methods, scores = plan_of(section), section.methods, section.headline
    if plan is None:
        many = "no intervals and tests: queries and methods are too many; `compare` makes them"
        return Findings(notes=[many])
    found = sample_intervals(make_sample(methods, scores), plan)
    parts = {OVERALL: found.overall} | (found.groups if section.by_query else {})
    count = len(methods)
    limits = {
        scope: {s.key: part[n * count : (n + 1) * count] for n, s in enumerate(scores)}
        for scope, part in parts.items()
    }
    every = [interval for part in parts.values() for interval in part]
    named = f"intervals of {', '.join(score.title for score in scores)}"
    notes = describe_intervals(every, plan, section.first.unit, lead="", what=named)
    if count < 2:
        return Findings(limits, notes=notes)
    scopes = {OVERALL: None} | {one: one for one in section.first.scenes if section.by_query}
    ties = {scope: tied_with_best(methods, scores, plan, scene) for scope, scene in scopes.items()}
    tested = (
        f"{TIED} what a paired test of the two alone does not tell from it (p above "
        f"{100 * LEVEL:g} %, {plan.resamples} resamples, seed {plan.seed}); tested are the "
        "headline scores, not pooled" + ("" if section.by_query else ", nor of single scenes")
    )
    few = f"no test is possible of fewer than {FEWEST} scenes or queries"
    notes.append(f"★ marks the best; {few if len(methods[0].records) < FEWEST else tested}")
    return Findings(limits, ties, notes)


def summary_panes(section: Section, found: Findings) -> list[Pane]:
    """Return every score by method: over scenes, pooled, and by scene; headline scores first."""
    titles = section.first.truth.scene_titles
    scopes = {OVERALL: "Average over scenes"}
    scopes |= {POOLED: "All queries pooled"} if section.by_query else {}
    scopes = {OVERALL: next(iter(titles.values()))} if len(titles) == 1 else scopes | titles
    return [
        Pane(scope, title, [_scores_table(section, found, scope, title)])
        for scope, title in scopes.items()
    ]


def _by_scope(numbers: Result | Reference) -> dict[str, dict[str, float]]:
    return {OVERALL: numbers.overall, POOLED: numbers.pooled, **numbers.scenes}


def _scores_table(section: Section, found: Findings, scope: str, title: str) -> Table:
    references = shared_references([method.result for method in section.methods])
    count, ties = len(section.methods), found.ties.get(scope, {})
    limits = found.limits.get(scope, {})
    no_better = [(method.name, floor_note(method.result)) for method in section.methods]
    names = [Cell(name, mark=FLOOR_MARK * bool(note)) for name, note in no_better]
    columns = [[*names, *map(Cell, references)]]
    for score in section.scores:
        values = [_by_scope(m.result)[scope][score.key] for m in section.methods]
        spans = limits.get(score.key, [None] * count)
        pairs = zip(values, spans, strict=True)
        cells = mark_cells(score_column(score), [score_cell(score, *pair) for pair in pairs])
        for place, tied in enumerate(ties.get(score.key, ())):
            if tied and not cells[place].best:
                cells[place] = replace(cells[place], mark=TIED)
        floors = [_by_scope(one)[scope].get(score.key) for one in references.values()]
        columns.append([*cells, *(score_cell(score, value) for value in floors)])
    rows = [Row(cells, floor=n >= count) for n, cells in enumerate(zip(*columns, strict=True))]
    # Doubts about the truth stand with the numbers that they concern.
    notes = [(m.name, note) for m in section.methods for note in m.result.notes]
    doubts = [pair for pair in notes if re.search("all alike|prepare warned", pair[1])]
    said = tuple(share_notes([*(pair for pair in no_better if pair[1]), *doubts]))
    return Table(title, (Column("Method"), *map(score_column, section.scores)), tuple(rows), said)


def scene_panes(section: Section, summary: Sequence[Pane]) -> list[Pane]:
    """Return a table a headline score, of scenes and methods, with the cells of the summary."""
    panes, tables = [], {pane.key: pane.tables[0] for pane in summary}
    for place, score in enumerate(section.scores, 1):
        if not score.headline or len(section.first.scenes) < 2:
            continue
        column, rows = score_column(score), []
        for scene, title in section.first.truth.scene_titles.items():
            cells = [row.cells[place] for row in tables[scene].rows if not row.floor]
            rows.append(Row((Cell(title), *cells)))
        heads = [Column("Scene"), *(replace(column, title=n, unit="") for n in section.names)]
        title = f"{column.heading} by scene and method"
        panes.append(Pane(score.key, column.heading, [Table(title, tuple(heads), tuple(rows))]))
    return panes


def breakdown_panes(section: Section) -> list[Pane]:
    """Return scores by each condition: a pane a condition and score, keyed by both."""
    return [
        Pane(f"{by} {score.key}", "", [breakdown_table(section.methods, [score], by)])
        for by in section.conditions
        for score in section.query_scores
    ]


def pair_panes(section: Section) -> list[Pane]:
    """Compare every two of the best methods by the headline scores; empty with one method."""
    few, plan, panes = section.methods[:_MOST_PAIRED], plan_of(section), list[Pane]()
    if plan is None:
        return []
    for one, better in enumerate(few[:-1]):
        for two, other in enumerate(few[one + 1 :], one + 1):
            found = compare([better, other], section.headline, resampling=plan)
            tables = [comparison_table(replace(found, notes=()))]
            tables.append(differences_table([better, other], section.headline[0], _DIFFERING))
            panes.append(Pane(f"{one} {two}", f"{better.name} and {other.name}", tables))
    return panes


def counts_table(section: Section) -> Table:
    """Return what was counted, by method and scene."""
    names = list(next(iter(section.first.counts.values())))
    rows = [
        Row((Cell(m.name), Cell(title), *(Cell(m.result.counts[scene].get(n)) for n in names)))
        for m in section.methods
        for scene, title in section.first.truth.scene_titles.items()
    ]
    heads = ("Method", "Scene", *(name.replace("_", " ") for name in names))
    return Table("What was counted", tuple(map(Column, heads)), tuple(rows))


def notes_by_method(section: Section) -> list[str]:
    """Return the notes of all results, and how they were aligned, with the methods."""
    notes = [(m.name, note) for m in section.methods for note in m.result.notes]
    every = [(m.name, said) for m in section.methods for said in describe_alignments(m)]
    return share_notes([*notes, *every])


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
