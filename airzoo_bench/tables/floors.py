"""Floors: what scores without a method, such as chance or the prior pose, as rows of tables."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from airzoo_bench.results.result import Reference, Result, ScoreColumn
from airzoo_bench.tables.method_table import OVERALL, MethodRow, MethodTable, as_shown

__all__ = ["shared_references", "with_floors"]

_ROUNDING = 1e-9


def with_floors(board: MethodTable, results: Sequence[Result]) -> MethodTable:
    """Put what scores without a method behind a board's entries, and say what it is.

    Parameters
    ----------
    board : MethodTable
    results : sequence of Result
        Of one protocol and truth, so that all should hold the same references.
    """
    references, notes = shared_references(results)
    columns = {column.key: column for result in results for column in result.columns}
    entries = tuple(_floor(name, found, columns) for name, found in references.items())
    board = replace(board, entries=(*board.entries, *entries)).noted(*notes)
    return board.noted(*(f"{n}: {found.meaning}" for n, found in references.items()), legend=True)


def shared_references(results: Sequence[Result]) -> tuple[dict[str, Reference], list[str]]:
    """Return the references of results by name, the first of each name, and what must be said.

    That is which results hold none, or others: they depend on protocol and truth alone, so the
    results were then made by different versions.
    """
    found: dict[str, Reference] = {}
    for result in results:
        for name, reference in result.references.items():
            found.setdefault(name, reference)
    if not found:
        return {}, ["no floors: these results hold none, as those of older versions"]
    odd = [
        f"{name} of {result.predictions.method} differs from the one that is shown"
        for name, reference in found.items()
        for result in results
        if name in result.references and not _alike(result.references[name], reference)
    ]
    return found, list(dict.fromkeys(odd))


def _alike(one: Reference, other: Reference) -> bool:
    parts = [{OVERALL: r.overall, "pooled": r.pooled} | r.scenes for r in (one, other)]
    return parts[0].keys() == parts[1].keys() and all(
        part.keys() == parts[1][scene].keys()
        and all(math.isclose(v, parts[1][scene][k], rel_tol=_ROUNDING) for k, v in part.items())
        for scene, part in parts[0].items()
    )


def _floor(name: str, reference: Reference, columns: Mapping[str, ScoreColumn]) -> MethodRow:
    parts = {OVERALL: reference.overall} | reference.scenes
    values = {
        scene: {key: as_shown(columns[key], value) for key, value in part.items()}
        for scene, part in parts.items()
    }
    return MethodRow(name, values, floor=True)
