"""The queries on which methods differ most."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.breakdown import condition_names, condition_title
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.records import Scored
from airzoo_bench.result import ScoreColumn
from airzoo_bench.statistics.comparison import make_sample
from airzoo_bench.statistics.samples import gap
from airzoo_bench.statistics.wording import counted, score_cell
from airzoo_bench.tables.entries import UNITS
from airzoo_bench.tables.model import Cell, Column, Row, Table

__all__ = ["differences_table"]


def differences_table(
    methods: Sequence[Scored],
    scores: Sequence[ScoreColumn],
    count: int,
    scene: str | None = None,
    *,
    base: int = 0,
) -> Table:
    """List the queries on which methods differ most by the first score.

    Equal differences are ordered by the other scores, then by id. Of two methods the difference
    is that from the reference, and the conditions of each query stand beside; of more it is that
    of the best and the worst.

    Parameters
    ----------
    methods : sequence of Scored
        On the same queries.
    scores : sequence of ScoreColumn
    count : int
        How many queries; those without a difference are left out.
    scene : str, optional
    base : int
        The place of the reference, where there are two methods.
    """
    sample = make_sample(methods, scores, scene)
    by_score = np.concatenate(sample.values, axis=1).reshape(len(scores), len(methods), -1)
    spread = gap(by_score.max(axis=1), by_score.min(axis=1))
    rows = _rows_in_order(methods[0], scene, by_query=sample.unit == "query")
    ids = methods[0].records["query"].to_numpy(str)[rows]
    order = np.lexsort([ids, *(-spread[::-1])])
    chosen = [place for place in order[:count].tolist() if spread[0, place] > 0]
    score, two = scores[0], len(methods) == 2
    values = by_score[0][:, chosen]
    amounts = gap(values[1 - base], values[base]) if two else spread[0, chosen]
    conditions = condition_names(methods[0]) if two else []
    further = [_cells(methods[0], name, rows[chosen]) for name in conditions]
    of_methods = [Column(m.name, UNITS[score.unit], score.higher_is_better) for m in methods]
    amount = Column("Difference" if two else "Best to worst", UNITS[score.unit])
    heads = (
        Column(sample.unit.capitalize()),
        *([*of_methods, amount] if two else [amount, *of_methods]),
        *(Column(condition_title(name)) for name in conditions),
    )
    shown = [*values, amounts] if two else [amounts, *values]
    table_rows = tuple(
        Row(
            (
                Cell(str(ids[place])),
                *(score_cell(score, float(row[number])) for row in shown),
                *(cells[number] for cells in further),
            )
        )
        for number, place in enumerate(chosen)
    )
    found = int((spread[0] > 0).sum())
    verb = "differs" if found == 1 else "differ"
    notes = [f"{found} of {counted(len(ids), sample.unit)} {verb} on {score.title}"]
    if two:
        notes.append(f"difference: {methods[1 - base].name} minus {methods[base].name}")
    title = f"Where the methods differ most on {score.title}"
    return Table(title, heads, table_rows, tuple(notes), leading=1)


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
    numbers: Floats = column.to_numpy(np.float64)
    return [Cell(None if np.isnan(number) else f"{number:g}") for number in numbers.tolist()]
