"""From results to tables."""

from __future__ import annotations

from collections.abc import Sequence

from airzoo_bench.result import Result, ScoreColumn
from airzoo_bench.tables.entries import board_of, identity, score_cell, score_column
from airzoo_bench.tables.layouts import methods_layout
from airzoo_bench.tables.model import Cell, Column, Row, Table, mark_best

__all__ = ["methods_table", "scenes_table"]

# What is counted beside the scores: the heading, and the key of a result's counts.
_COUNTED = {"reconstruction": ("Points", "points")}


def scenes_table(result: Result, *, every_score: bool = False) -> Table:
    """Lay out one result: a row a scene, the average over scenes, the mean over all queries.

    Parameters
    ----------
    result : Result
    every_score : bool
        Show all scores instead of the headline ones.
    """
    scores = [c for c in result.columns if every_score or c.headline]
    heading, key = _COUNTED.get(result.track, ("Queries", "queries"))
    rows = [
        Row((Cell(title), Cell(result.counts[scene][key]), *_cells(scores, values)))
        for scene, values in result.scenes.items()
        for title in [result.truth.scene_titles[scene]]
    ]
    total = sum(counts["queries"] for counts in result.counts.values())
    rows.append(Row((Cell("Average"), Cell(None), *_cells(scores, result.overall)), summary=True))
    if total > len(result.scenes):
        pooled = _cells(scores, result.pooled)
        rows.append(Row((Cell("Pooled"), Cell(total), *pooled), summary=True))
    return Table(
        f"{result.predictions.method} on {result.protocol.name} v{result.protocol.version}",
        (Column("Scene"), Column(heading), *map(score_column, scores)),
        tuple(rows),
        (*result.notes, identity(result)),
    )


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
    return mark_best(methods_layout(board_of(results, every_score=every_score), scene))


def _cells(scores: list[ScoreColumn], values: dict[str, float]) -> list[Cell]:
    return [score_cell(score, values.get(score.key)) for score in scores]
