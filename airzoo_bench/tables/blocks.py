"""Wide tables in pieces: the leading columns are repeated, groups of columns stay whole."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import groupby

from airzoo_bench.tables.latex_text import PAGE, latex_width
from airzoo_bench.tables.model import Row, Table

__all__ = ["as_asked", "by_block", "by_count", "by_width", "leading_columns", "units"]

_WIDEST = 12  # columns of scores
_PAPERS = 2  # groups abreast that a paper shrinks to its page


def leading_columns(table: Table) -> int:
    """Count the columns that say what a row is, which every piece repeats."""
    if table.leading is not None:
        return table.leading
    for index, column in enumerate(table.columns):
        if column.higher_is_better is not None:
            return index
    return len(table.columns)


def units(table: Table) -> list[list[int]]:
    """Return the columns that stay together: neighbours of one group, else each by itself."""
    rest = range(leading_columns(table), len(table.columns))
    return [
        unit
        for group, indices in groupby(rest, key=lambda index: table.columns[index].group)
        for unit in ([list(indices)] if group else [[index] for index in indices])
    ]


def by_block(table: Table) -> list[Table]:
    """Split a table between columns of different blocks; leave any other whole."""
    runs = groupby(units(table), key=lambda unit: table.columns[unit[0]].block)
    return _pieces(table, [list(members) for _, members in runs])


def by_count(table: Table) -> list[Table]:
    """Split a table with groups into pieces of `groups_per_block` groups; leave any other whole."""
    return [piece for part in by_block(table) for piece in _counted(part)]


def _counted(table: Table) -> list[Table]:
    found = units(table)
    if not any(column.group for column in table.columns):
        return [table]
    step = table.groups_per_block
    if not table.fixed:
        step = max(1, min(step, _WIDEST // max(map(len, found))))
        while step > _PAPERS and max(map(latex_width, _abreast(table, found, step))) > PAGE:
            step -= 1
    return _abreast(table, found, step)


def _abreast(table: Table, found: list[list[int]], step: int) -> list[Table]:
    return _pieces(table, [found[at : at + step] for at in range(0, len(found), step)])


def as_asked(table: Table) -> list[Table]:
    """Split a table only where it must be: between blocks, and by a count that is fixed."""
    return by_count(table) if table.fixed else by_block(table)


def by_width(
    table: Table, measure: Callable[[list[int]], int], room: int, space: int
) -> list[Table]:
    """Split a table into pieces that fit a width, wherever a single score does."""
    taken = sum(measure([index]) + space for index in range(leading_columns(table)))
    # A very long name shall not put every score into a block of its own.
    left = max(room - taken, room // 2)
    pieces: list[list[list[int]]] = []
    used = 0
    for unit in _broken(units(table), measure, left):
        width = measure(unit)
        used += space + width
        if not pieces or used > left:
            pieces.append([])
            used = width
        pieces[-1].append(unit)
    return _pieces(table, pieces)


def _broken(
    found: list[list[int]], measure: Callable[[list[int]], int], left: int
) -> list[list[int]]:
    return [part for unit in found for part in _halved(unit, measure, left)]


def _halved(unit: list[int], measure: Callable[[list[int]], int], left: int) -> list[list[int]]:
    if len(unit) == 1 or measure(unit) <= left:
        return [unit]
    middle = (len(unit) + 1) // 2
    return [*_halved(unit[:middle], measure, left), *_halved(unit[middle:], measure, left)]


def _pieces(table: Table, pieces: list[list[list[int]]]) -> list[Table]:
    leading = list(range(leading_columns(table)))
    if len(pieces) < 2:
        return [table]
    return [_columns(table, [*leading, *(i for unit in piece for i in unit)]) for piece in pieces]


def _columns(table: Table, indices: list[int]) -> Table:
    def picked(row: Row) -> Row:
        return replace(row, cells=tuple(row.cells[i] for i in indices))

    columns = tuple(table.columns[i] for i in indices)
    rows = tuple(map(picked, table.rows))
    return replace(table, columns=columns, rows=_with_numbers(table, rows))


def _with_numbers(table: Table, rows: tuple[Row, ...]) -> tuple[Row, ...]:
    """Leave out the methods that have something, but nothing in this piece."""
    if not any(column.group for column in table.columns):
        return rows
    leading = leading_columns(table)

    def is_empty(row: Row) -> bool:
        return all(cell.value is None for cell in row.cells[leading:])

    pairs = zip(table.rows, rows, strict=True)
    return tuple(row for whole, row in pairs if is_empty(whole) or not is_empty(row)) or rows
