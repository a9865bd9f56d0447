"""From results to tables."""

from __future__ import annotations

from collections.abc import Sequence

from airzoo_bench.errors import ResultError
from airzoo_bench.result import Result, ScoreColumn
from airzoo_bench.tables.model import Cell, Column, Row, Table, mark_best, share_to_percent

__all__ = ["methods_table", "scenes_table"]

# What is counted beside the scores: the heading, and the key of a result's counts.
_COUNTED = {"reconstruction": ("Points", "points")}
_UNITS = {"share": "%", "m": "m", "deg": "deg"}


def scenes_table(result: Result, *, every_score: bool = False) -> Table:
    """Lay out one result: a row a scene, the average over scenes, the mean over all queries.

    Parameters
    ----------
    result : Result
    every_score : bool
        Show all scores instead of the headline ones.
    """
    scores = _shown(result, every_score)
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
        (Column("Scene"), Column(heading), *map(_column, scores)),
        tuple(rows),
        (*result.notes, _identity(result)),
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
    _check_comparable(results)
    scores = _shown_of_all(results, every_score)
    rows = tuple(
        Row((Cell(result.predictions.method), *_cells(scores, _values(result, scene))))
        for result in results
    )
    first = results[0]
    title = f"{first.protocol.name} v{first.protocol.version}, {scene or 'average over scenes'}"
    columns = (Column("Method"), *map(_column, scores))
    notes = tuple(f"{r.predictions.method}: {note}" for r in results for note in r.notes)
    return mark_best(Table(title, columns, rows, (*notes, _identity(first))))


def _check_comparable(results: Sequence[Result]) -> None:
    for what in ("protocol", "truth"):
        prints = {getattr(result, what).fingerprint for result in results}
        if len(prints) > 1:
            found = ", ".join(
                f"{r.predictions.method}: {getattr(r, what).fingerprint[:12]}" for r in results
            )
            raise ResultError(
                f"the results were made with different fingerprints of the {what} ({found})",
                expected=f"one {what}: other numbers cannot stand in one table",
                mend="score all predictions again with the same protocol and benchmark folder",
            )


def _values(result: Result, scene: str | None) -> dict[str, float]:
    if scene is None:
        return result.overall
    by_title = {title: key for key, title in result.truth.scene_titles.items()}
    key = by_title.get(scene, scene)
    if key not in result.scenes:
        raise ResultError(
            f"there is no scene {scene!r} in the results",
            expected="one of " + ", ".join(result.scenes),
        )
    return result.scenes[key]


def _shown(result: Result, every_score: bool) -> list[ScoreColumn]:
    return [column for column in result.columns if every_score or column.headline]


def _shown_of_all(results: Sequence[Result], every_score: bool) -> list[ScoreColumn]:
    """Return the columns of all results; one that a method has no score for stays empty."""
    columns = [column for result in results for column in _shown(result, every_score)]
    return list({column.key: column for column in columns}.values())


def _column(score: ScoreColumn) -> Column:
    return Column(score.title, _UNITS[score.unit], score.higher_is_better)


def _cells(scores: list[ScoreColumn], values: dict[str, float]) -> list[Cell]:
    return [_cell(score, values.get(score.key)) for score in scores]


def _cell(score: ScoreColumn, value: float | None) -> Cell:
    if value is None or score.unit != "share":
        return Cell(value)
    return Cell(share_to_percent(value))


def _identity(result: Result) -> str:
    return (
        f"protocol {result.protocol.fingerprint[:12]}, truth {result.truth.fingerprint[:12]}, "
        f"airzoo-bench {result.versions['airzoo-bench']}"
    )
