"""From results to tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from airzoo_bench.results.result import Reference, Result, ScoreColumn
from airzoo_bench.tables.best_marks import mark_best
from airzoo_bench.tables.layouts import AVERAGE, methods_layout
from airzoo_bench.tables.method_table import OVERALL, as_shown, identity, method_table, score_column
from airzoo_bench.tables.model import Cell, Column, Row, Table, Uncertainty

__all__ = ["POOLED", "methods_table", "scenes_table"]

POOLED = "Pooled"
"""The row of means over all queries, whatever their scene."""


def scenes_table(
    result: Result,
    *,
    every_score: bool = False,
    scores: Sequence[ScoreColumn] | None = None,
    uncertainties: Mapping[str, Mapping[str, Uncertainty]] | None = None,
    floors: bool = False,
) -> Table:
    """Lay out one result: a row a scene, the average over scenes, the mean over all queries.

    Parameters
    ----------
    result : Result
    every_score : bool
        Show all scores instead of the headline ones.
    scores : sequence of ScoreColumn, optional
        Show these.
    uncertainties : mapping of str to mapping of str to Between or PlusMinus, optional
        By scene, with `OVERALL` for the average, then by score.
    floors : bool
        Show what scores without a method below, where the result holds it.
    """
    if scores is None:
        scores = [c for c in result.columns if every_score or c.headline]
    beside = uncertainties or {}
    # Where a scene is one query, their number says nothing.
    counted = "points" if result.unit == "scene" else "queries"
    rows = []
    for scene, values in result.scenes.items():
        cells = _cells(scores, values, beside.get(scene))
        title = result.truth.scene_titles[scene]
        rows.append(Row((Cell(title), Cell(result.counts[scene].get(counted)), *cells)))
    total = sum(counts["queries"] for counts in result.counts.values())
    average = _cells(scores, result.overall, beside.get(OVERALL))
    rows.append(Row((Cell(AVERAGE), Cell(None), *average), summary=True))
    if total > len(result.scenes):
        pooled = _cells(scores, result.pooled)
        rows.append(Row((Cell(POOLED), Cell(total), *pooled), summary=True))
    references = result.references if floors else {}
    for name, reference in references.items():
        rows += _floor_rows(name, reference, result, scores)
    meanings = [f"{name}: {reference.meaning}" for name, reference in references.items()]
    return Table(
        f"{result.predictions.method} on {result.protocol.name} v{result.protocol.version}",
        (Column("Scene"), Column(counted.capitalize()), *map(score_column, scores)),
        tuple(rows),
        (*meanings, *result.notes, identity(result)),
        legend=tuple(meanings),
    )


def _floor_rows(
    name: str, reference: Reference, result: Result, scores: Sequence[ScoreColumn]
) -> list[Row]:
    # The average first: the name alone is short, and of one scene it is all there is to say.
    parts = {name: reference.overall}
    if len(reference.scenes) > 1:
        titles = result.truth.scene_titles
        parts |= {f"in {titles[scene]}": reference.scenes[scene] for scene in result.scenes}
    return [
        Row((Cell(title), Cell(None), *_cells(scores, values)), summary=True, floor=True)
        for title, values in parts.items()
    ]


def methods_table(
    results: Sequence[Result], *, every_score: bool = False, scene: str | None = None
) -> Table:
    """Lay out several results of one protocol: a row a method, the best marked.

    Parameters
    ----------
    results : sequence of Result
    every_score : bool
        Show all scores instead of the headline ones.
    scene : str, optional
        Show this scene instead of the average over scenes.

    Raises
    ------
    ResultError
        The results are not of one protocol and one truth, or have no such scene.
    """
    return mark_best(methods_layout(method_table(results, every_score=every_score), scene))


def _cells(
    scores: Sequence[ScoreColumn],
    values: Mapping[str, float],
    beside: Mapping[str, Uncertainty] | None = None,
) -> list[Cell]:
    spans = beside or {}
    return [
        Cell(as_shown(score, values[score.key]), uncertainty=spans.get(score.key))
        if score.key in values
        else Cell(None)
        for score in scores
    ]
