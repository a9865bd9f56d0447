"""Rows of a table of methods that were not scored here: published numbers, and floors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from airzoo_bench.results.result import Reference, Result
from airzoo_bench.tables.method_table import OVERALL, MethodRow, MethodTable, shown_values

if TYPE_CHECKING:
    from airzoo_bench.tables.published import PublishedTable

__all__ = ["shared_references", "with_floors", "with_published"]

_ROUNDING = 1e-9


def with_published(
    method_table: MethodTable,
    tables: Sequence[PublishedTable],
    *,
    by_scene: bool,
    average: bool = True,
    elsewhere: Sequence[str] = (),
) -> MethodTable:
    """Put the rows of published tables before those of the methods scored here."""
    scenic = [table for table in tables if table.has_scenes]
    plain = [table for table in tables if not table.has_scenes]
    chosen = scenic if by_scene else plain or scenic
    if not chosen:
        what = "by scene " if by_scene else ""
        note = f"nothing is published {what}on {method_table.benchmark} ({method_table.track})"
        others = [name for name in elsewhere if name != method_table.benchmark]
        return method_table.noted(note + (f", but on {', '.join(others)}" if others else ""))
    rows = tuple(row for table in chosen for row in _reported(method_table, table))
    if by_scene and average:
        rows = tuple(_with_average(method_table, row, plain) for row in rows)
    pairs = [(table, other) for table in chosen for other in tables] if average else []
    notes = [_disagreement(method_table, table, other) for table, other in pairs]
    method_table = replace(method_table, rows=(*rows, *method_table.rows))
    return method_table.noted(*filter(None, notes), legend=True)


def _with_average(
    method_table: MethodTable, row: MethodRow, tables: Sequence[PublishedTable]
) -> MethodRow:
    """Fill in an average that the tables by scene do not print, and say from where it is."""
    if OVERALL in row.values:
        return row
    others = (one for table in tables for one in _reported(method_table, table))
    found = next((one for one in others if one.method == row.method), None)
    if found is None:
        return row
    values = {**row.values, OVERALL: found.values[OVERALL]}
    return replace(row, values=values, reported=f"{row.reported}; average: {found.reported}")


def _reported(method_table: MethodTable, table: PublishedTable) -> list[MethodRow]:
    keys = {title: key for key, title in method_table.scenes.items()} | {OVERALL: OVERALL}
    known = {score.key for score in method_table.scores}
    return [
        MethodRow(
            method,
            {
                keys[title]: {key: value for key, value in values.items() if key in known}
                for title, values in scenes.items()
                if title in keys
            },
            reported=f"{table.source}, {table.label}",
        )
        for method, scenes in table.values.items()
    ]


def _disagreement(method_table: MethodTable, table: PublishedTable, other: PublishedTable) -> str:
    shown = [score.key for score in method_table.scores]
    differ = [
        method
        for method, scenes in table.values.items()
        for here, there in [(scenes.get(OVERALL, {}), other.average_of(method))]
        if any(key in here and there.get(key, here[key]) != here[key] for key in shown)
    ]
    if not differ:
        return ""
    return f"{other.label} of the same source prints another average of {', '.join(differ)}"


def with_floors(method_table: MethodTable, results: Sequence[Result]) -> MethodTable:
    """Put what scores without a method behind the rows of methods, and say what it is."""
    references, notes = shared_references(results)
    columns = [column for result in results for column in result.columns]
    rows = tuple(
        MethodRow(name, shown_values(columns, found), floor=True)
        for name, found in references.items()
    )
    meanings = [f"{name}: {found.meaning}" for name, found in references.items()]
    noted = method_table.noted(*notes).noted(*meanings, legend=True)
    return replace(noted, rows=(*method_table.rows, *rows))


def shared_references(results: Sequence[Result]) -> tuple[dict[str, Reference], list[str]]:
    """Return the references of results by name, the first of each name, and what must be said."""
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
