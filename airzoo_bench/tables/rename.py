"""Other names for methods, scenes, benchmarks and scores: those that a paper gives them.

Methods of different tracks that get one name get one row.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.validation import nearest
from airzoo_bench.tables.model import Cell, Column, Row, Table

__all__ = ["rename"]

_NUMBER = re.compile(r" \(\d+\)$")  # of queries, behind a scene's title


def rename(table: Table, given: Sequence[str]) -> Table:
    """Give what a table names other names, in lists of names in its title and notes too."""
    known = _known(table)
    names: dict[str, str] = {}
    for text in given:
        old, new = _parsed(text, known)
        if names.setdefault(old, new) != new:
            raise UsageError(f"{old[:80]!r} has two new names", where=f"--rename {text[:80]}")
    return _merged(_renamed(table, names), set(names.values())) if names else table


def _known(table: Table) -> list[str]:
    rows = [str(row.cells[0].value) for row in table.rows]
    groups = [column.group for column in table.columns if column.group]
    bare = [_NUMBER.sub("", group) for group in groups]
    return list(dict.fromkeys([*rows, *groups, *bare, *(c.title for c in table.columns)]))


def _parsed(text: str, known: Sequence[str]) -> tuple[str, str]:
    # A name may itself hold the sign.
    splits = [(text[:i], text[i + 1 :].strip()) for i, c in enumerate(text) if c == "="]
    where = f"--rename {text[:80]}"
    if not splits:
        raise UsageError("there is no new name", where=where, expected="OLD=NEW")
    old, new = next((pair for pair in splits if pair[0] in known), splits[0])
    if old not in known:
        raise UsageError(
            f"nothing in the table is called {old[:80]!r}{nearest(old[:80], list(known))}",
            where=where,
            expected="one of " + ", ".join(known[:30]),
        )
    if not new:
        raise UsageError("the new name is empty", where=where, expected="OLD=NEW")
    return old, new


def _renamed(table: Table, names: Mapping[str, str]) -> Table:
    old = "|".join(map(re.escape, sorted(names, key=len, reverse=True)))
    # Only where it is one of a list of names: a method may be called like a word of a note.
    titles = (f"{column.group}: " for column in table.columns if column.group)
    ahead = dict.fromkeys([", ", "; ", "difference from ", *titles])
    before = "|".join(["^", *(f"(?<={re.escape(text)})" for text in ahead)])
    listed = re.compile(rf"(?:{before})(?:{old})(?=$|, |: | in | on )")

    def said(text: str) -> str:
        return listed.sub(lambda found: names[found[0]], text)

    return replace(
        table,
        title=said(table.title),
        columns=tuple(_column(column, names) for column in table.columns),
        rows=tuple(_row(row, names) for row in table.rows),
        notes=tuple(dict.fromkeys(map(said, table.notes))),
        legend=tuple(dict.fromkeys(map(said, table.legend))),
    )


def _column(column: Column, names: Mapping[str, str]) -> Column:
    bare = _NUMBER.sub("", column.group)
    number = column.group.removeprefix(bare)
    group = names.get(column.group) or names.get(bare, bare) + number
    return replace(column, title=names.get(column.title, column.title), group=group)


def _row(row: Row, names: Mapping[str, str]) -> Row:
    first = row.cells[0]
    value = names.get(str(first.value), first.value)
    return replace(row, cells=(replace(first, value=value), *row.cells[1:]))


def _merged(table: Table, names: set[str]) -> Table:
    """Make one row of those of one new name; reported ones and floors stay by themselves."""
    found: dict[object, list[Row]] = {}
    for number, row in enumerate(table.rows):
        name = str(row.cells[0].value)
        key = (name, bool(row.reported), row.floor) if name in names else number
        found.setdefault(key, []).append(row)
    return replace(table, rows=tuple(_one_row(table, rows) for rows in found.values()))


def _one_row(table: Table, rows: Sequence[Row]) -> Row:
    first = rows[0]
    if len(rows) == 1:
        return first
    keys = dict.fromkeys(row.cells[0].cite for row in rows if row.cells[0].cite)
    name = replace(first.cells[0], cite=",".join(keys))
    rest = (
        _one_cell(f"{first.cells[0].value}", column, [row.cells[place] for row in rows])
        for place, column in enumerate(table.columns)
        if place
    )
    sources = dict.fromkeys(part for row in rows for part in row.reported.split("; ") if part)
    return replace(
        first,
        cells=(name, *rest),
        highlighted=any(row.highlighted for row in rows),
        reported="; ".join(sources),
    )


def _one_cell(name: str, column: Column, cells: Sequence[Cell]) -> Cell:
    filled = [cell for cell in cells if cell.value is not None]
    if len(filled) > 1:
        where = f"{column.group}, {column.title}" if column.group else column.title
        raise UsageError(
            f"{len(filled)} rows that would become one, {name[:80]!r}, have {where}",
            where="--rename",
            expected="one name for methods of different benchmarks, which then share a row",
            fix="give them different names, or name one result of each benchmark",
        )
    return filled[0] if filled else cells[0]
