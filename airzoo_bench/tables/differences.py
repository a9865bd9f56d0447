"""The queries on which methods differ most."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import agreeing, counted
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.results.sampling import make_sample
from airzoo_bench.statistics.samples import difference
from airzoo_bench.tables.breakdown import condition_names, condition_title, number_texts
from airzoo_bench.tables.method_table import UNITS
from airzoo_bench.tables.model import Cell, Column, Row, Table
from airzoo_bench.tables.wording import score_cell

__all__ = ["differences_table"]

_Filled = tuple[Column, list[Cell]]


def differences_table(
    methods: Sequence[Scored],
    scores: Sequence[ScoreColumn],
    count: int,
    scene: str | None = None,
    *,
    base: int = 0,
) -> Table:
    """List the queries on which methods differ most by the first score."""
    sample = make_sample(methods, scores, scene)
    by_score = np.concatenate(sample.values, axis=1).reshape(len(scores), len(methods), -1)
    spread = difference(by_score.max(axis=1), by_score.min(axis=1))
    rows = _rows_in_order(methods[0], scene, by_query=sample.unit == "query")
    ids = methods[0].records["query"].to_numpy(str)[rows]
    order = np.lexsort([ids, *(-spread[::-1])])
    chosen = order[: min(count, int((spread[0] > 0).sum()))]
    score, two = scores[0], len(methods) == 2
    shown = _shown(methods, score, by_score[0][:, chosen], base)
    named = [(Column(sample.unit.capitalize()), [Cell(name) for name in ids[chosen].tolist()])]
    columns = named + shown
    if two:
        columns += [
            (Column(condition_title(name)), _cells(methods[0], name, rows[chosen]))
            for name in condition_names(methods[0])
        ]
    notes = [_how_many(spread[0], score, sample.unit)]
    if two:
        notes.append(f"difference: {methods[1 - base].name} minus {methods[base].name}")
    return Table(
        f"Where the methods differ most on {score.title}",
        tuple(column for column, _ in columns),
        tuple(Row(cells) for cells in zip(*(cells for _, cells in columns), strict=True)),
        tuple(notes),
        leading=1,
    )


def _shown(
    methods: Sequence[Scored], score: ScoreColumn, values: Floats, base: int
) -> list[_Filled]:
    """Return the columns of every method and of their difference, which of many stands first."""
    unit, two = UNITS[score.unit], len(methods) == 2
    amounts = (
        difference(values[1 - base], values[base])
        if two
        else difference(values.max(0), values.min(0))
    )
    titles = [Column(method.name, unit, score.higher_is_better) for method in methods]
    titles.insert(2 if two else 0, Column("Difference" if two else "Best to worst", unit))
    numbers = np.insert(values, 2 if two else 0, amounts, axis=0).tolist()
    return [
        (column, [score_cell(score, number) for number in row])
        for column, row in zip(titles, numbers, strict=True)
    ]


def _how_many(spread: Floats, score: ScoreColumn, unit: str) -> str:
    found = int((spread > 0).sum())
    differ = agreeing(found, "differs", "differ")
    return f"{found} of {counted(len(spread), unit)} {differ} on {score.title}"


def _rows_in_order(method: Scored, scene: str | None, *, by_query: bool) -> NDArray[np.intp]:
    """Return the rows of the records in the order of a sample's units."""
    of_row = method.records["scene"].to_numpy(str)
    scenes = [name for name in method.result.scenes if scene in (None, name)]
    if not by_query:
        return np.flatnonzero(np.isin(of_row, scenes))
    return np.concatenate([np.flatnonzero(of_row == name) for name in scenes])


def _cells(method: Scored, name: str, rows: NDArray[np.intp]) -> list[Cell]:
    column = method.records[name].iloc[rows]
    if column.dtype.kind not in "iuf":
        missing = column.isna().to_numpy(bool)
        texts = column.astype(str).tolist()
        return [Cell(None if no else text) for no, text in zip(missing, texts, strict=True)]
    known = column[column.notna()].tolist()
    texts_of = dict(zip(known, number_texts(known), strict=True))
    return [Cell(texts_of.get(number)) for number in column.tolist()]
