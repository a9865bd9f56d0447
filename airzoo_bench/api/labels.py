"""Labels of tables: rows that are pairs, columns that are pairs, ranks, coordinates by name."""

from __future__ import annotations

import re
from collections.abc import Mapping
from itertools import combinations
from typing import Any

from airzoo_bench.core.errors import ArgumentError, first_of

__all__ = ["in_axis_order", "ranks_in_order", "same_columns", "same_index"]

_AXES = (
    *map(tuple, ("xyz", "xy", "uv", "rgb", "enu")),
    ("easting", "northing"),
    *(("easting", "northing", up) for up in ("up", "z", "height", "altitude", "elevation")),
)


def same_index(arguments: Mapping[str, Any]) -> None:
    """Refuse arguments of pandas, by name, whose rows are pairs but whose labels differ."""
    labels = {name: rows.index for name, rows in arguments.items() if hasattr(rows, "iloc")}
    for (name, index), (other, second) in combinations(labels.items(), 2):
        if len(index) == len(second) and not index.equals(second):
            raise ArgumentError(
                "have different indexes, and rows would be paired by position",
                where=f"{name}, {other}",
                expected="the same labels in the same order",
                fix="give one the index of the other: b.reindex(a.index), or pass .to_numpy()",
            )


def same_columns(arguments: Mapping[str, Any], *, may_be_renamed: bool = False) -> None:
    """Refuse tables, by name, whose columns are pairs but whose labels differ."""
    labels = {
        name: list((in_axis_order(table) if may_be_renamed else table).columns)
        for name, table in arguments.items()
        if hasattr(table, "columns")
    }
    for (name, one), (other, second) in combinations(labels.items(), 2):
        are_others = may_be_renamed and set(one) != set(second)
        if len(one) == len(second) and one != second and not are_others:
            raise ArgumentError(
                "have different columns, and would be paired by position",
                where=f"{name}, {other}",
                expected="the same labels in the same order",
                fix="give one the columns of the other: b[a.columns], or pass .to_numpy()",
            )


def ranks_in_order(name: str, values: Any) -> None:
    """Refuse a table whose columns are numbered ranks in another order, such as 1, 10, 2."""
    found = [re.fullmatch(r"(.*?)([0-9]+)", str(label)) for label in getattr(values, "columns", ())]
    numbered = [(match[1], int(match[2])) for match in found if match]
    is_one_series = len(numbered) == len(found) and len({stem for stem, _ in numbered}) == 1
    if is_one_series and numbered != sorted(numbered):
        raise ArgumentError(
            f"has the columns {first_of(list(map(str, values.columns)))}",
            where=name,
            expected="ranks from the best on, from left to right",
            fix="put the columns in order, or pass .to_numpy() where they are",
        )


def in_axis_order(table: Any) -> Any:
    """Return a table of coordinates with its columns in the order of the axes."""
    by_name = {str(label).casefold(): label for label in table.columns}
    for order in _AXES:
        if len(table.columns) == len(order) and set(by_name) == set(order):
            return table[[by_name[axis] for axis in order]]
    return table
