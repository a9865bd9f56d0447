"""Marks on a table: the best values, gains over a baseline, coloured rows, citations, names."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.validation import nearest, read_toml
from airzoo_bench.tables.model import Cell, Column, Row, Table

__all__ = [
    "BY_NAME",
    "add_citations",
    "add_gains",
    "best_texts",
    "cite",
    "highlight",
    "mark_best",
    "parse_baselines",
    "rename",
    "sort_rows",
    "with_decimals",
]

BY_NAME = "method"
"""What rows are sorted by instead of a score, to be in the order of their names."""

_KEYS = re.compile(r"[A-Za-z0-9][A-Za-z0-9:._/+-]*(,[A-Za-z0-9][A-Za-z0-9:._/+-]*)*")
_QUERIES = re.compile(r" \(\d+\)$")  # behind a scene's title


def mark_best(table: Table, *, second: bool = False) -> Table:
    """Mark the best cell of each score, and every cell that is shown with the same digits."""
    open_to_all = not any(row.is_own for row in table.rows)
    competes = [row.is_own or (open_to_all and not row.floor) for row in table.rows]
    rows = [list(row.cells) for row in table.rows]
    for index, column in enumerate(table.columns):
        if column.higher_is_better is None:
            continue
        racing = [row[index] for row, runs in zip(rows, competes, strict=True) if runs]
        several = sum(isinstance(cell.value, float) for cell in racing) > 1
        first, runner_up = [*(best_texts(column, racing) if several else []), None, None][:2]
        for row, runs in zip(rows, competes, strict=True):
            text = row[index].text(column.decimals)
            is_second = runs and second and text == runner_up
            row[index] = replace(row[index], best=runs and text == first, second=is_second)
    marked = [replace(row, cells=tuple(new)) for row, new in zip(table.rows, rows, strict=True)]
    return replace(table, rows=tuple(marked))


def best_texts(column: Column, cells: Sequence[Cell]) -> list[str]:
    """Return the different texts of a column's finite numbers, the best first."""
    numbers = [c for c in cells if isinstance(c.value, float) and math.isfinite(c.value)]
    better = bool(column.higher_is_better)
    ordered = sorted(numbers, key=lambda cell: float(cell.value or 0), reverse=better)
    return list(dict.fromkeys(cell.text(column.decimals) for cell in ordered))


def with_decimals(table: Table, decimals: int) -> Table:
    """Show so many digits behind the point of every score."""
    columns = (
        column if column.higher_is_better is None else replace(column, decimals=decimals)
        for column in table.columns
    )
    return replace(table, columns=tuple(columns))


def sort_rows(table: Table, title: str, average: str) -> Table:
    """Put the best rows of a score on top, or all in the order of their names; floors stay last."""
    if title == BY_NAME:
        rows = sorted(table.rows, key=lambda row: (row.floor, row.name.casefold()))
        return replace(table, rows=tuple(rows))
    places = [i for i, column in enumerate(table.columns) if column.title == title]
    place = min(places, key=lambda i: table.columns[i].group != average)
    sign = -1 if table.columns[place].higher_is_better else 1

    def rank(row: Row) -> tuple[bool, int, float]:
        value = row.cells[place].value
        if not isinstance(value, float):
            return row.floor, 2, 0.0
        return row.floor, int(math.isinf(value)), sign * value

    return replace(table, rows=tuple(sorted(table.rows, key=rank)))


def highlight(table: Table, methods: Sequence[str]) -> Table:
    """Set rows on a coloured ground."""
    chosen = {_row_named(table, name, "--highlight") for name in methods}
    rows = (replace(row, highlighted=i in chosen) for i, row in enumerate(table.rows))
    return replace(table, rows=tuple(rows))


def _row_named(table: Table, name: str, option: str) -> int:
    """Return the row of a method; one that was scored here goes before a reported one."""
    found = [i for i, row in enumerate(table.rows) if row.name == name]
    own = [i for i in found if not table.rows[i].reported] or found
    if not own:
        raise _unknown(name, [row.name for row in table.rows], option)
    if len(own) > 1:
        raise UsageError(
            f"{len(own)} rows are called {name[:80]!r}",
            where=option,
            expected="a name that one row has",
            fix="give results different names with `airzoo-bench eval ... --method NAME`",
        )
    return own[0]


def _unknown(name: str, names: Sequence[str], where: str) -> UsageError:
    return UsageError(
        f"no row is called {name[:80]!r}{nearest(name[:80], list(names))}",
        where=where,
        expected="one of " + ", ".join(names[:20]),
    )


def parse_baselines(table: Table, given: Sequence[str]) -> dict[int, int]:
    """Find whose gain over whom is asked for: the row of each baseline by the method's row."""
    found: dict[int, int] = {}
    for text in given:
        for row, baseline in _baseline_pairs(table, text):
            if found.setdefault(row, baseline) != baseline:
                name = table.rows[row].name
                raise UsageError(f"{name} has two baselines", where=f"--baseline {text[:80]}")
    return found


def _baseline_pairs(table: Table, text: str) -> list[tuple[int, int]]:
    names = {row.name for row in table.rows}
    fitting = [pair for pair in _splits(text) if names.issuperset(pair)]
    if text not in names and fitting:
        method, baseline = (_row_named(table, name, "--baseline") for name in fitting[0])
        return [(method, baseline)]
    baseline = _row_named(table, text, "--baseline")
    chosen = [i for i, row in enumerate(table.rows) if row.highlighted]
    own = [i for i, row in enumerate(table.rows) if row.is_own]
    return [(row, baseline) for row in chosen or own or range(len(table.rows)) if row != baseline]


def _splits(text: str) -> list[tuple[str, str]]:
    """Cut a text at each of its equals signs: a name may itself hold one."""
    return [(text[:i], text[i + 1 :]) for i, c in enumerate(text) if c == "="]


def add_gains(table: Table, baselines: Mapping[int, int]) -> Table:
    """Write the gains of rows over their baselines next to the values."""
    rows, notes = list(table.rows), dict[str, None]()
    for number, place in baselines.items():
        baseline = table.rows[place]
        cells = [
            cell
            if column.higher_is_better is None
            else replace(cell, gain=_gain(cell, other, column.decimals))
            for cell, other, column in zip(
                rows[number].cells, baseline.cells, table.columns, strict=True
            )
        ]
        rows[number] = replace(rows[number], cells=tuple(cells))
        reported = ", whose numbers are reported, not re-scored" * bool(baseline.reported)
        note = f"difference from {baseline.name}{reported}, of the values as printed"
        notes[f"in brackets: {note}"] = None
    return replace(
        table,
        rows=tuple(rows),
        notes=(*table.notes, *notes),
        legend=(*table.legend, *notes),
    )


def _gain(cell: Cell, baseline: Cell, decimals: int) -> float | None:
    for one in (cell, baseline):
        if not isinstance(one.value, float) or not math.isfinite(one.value) or one.is_too_small:
            return None
    difference = float(cell.text(decimals)) - float(baseline.text(decimals))
    return round(difference, decimals) + 0.0


def cite(table: Table, keys: Mapping[str, str], *, names_must_exist: bool = False) -> Table:
    """Attach citations to the rows of methods; LaTeX prints them."""
    names = [row.name for row in table.rows]
    keys = {name: ",".join(map(str.strip, key.split(","))) for name, key in keys.items()}
    for name, key in keys.items():
        if not _KEYS.fullmatch(key):
            raise UsageError(
                f"{key[:80]!r} is no citation key",
                where=f"--cite, {name[:80]}",
                expected="letters a to z, digits, and behind the first any of : . _ / + -",
            )
        if names_must_exist and name not in names:
            raise _unknown(name, names, "--cite")
    rows = (
        replace(row, cells=(replace(row.cells[0], cite=keys.get(row.name, "")), *row.cells[1:]))
        for row in table.rows
    )
    return replace(table, rows=tuple(rows))


def add_citations(
    table: Table, given: Sequence[str], sources: Mapping[str, Mapping[str, str]]
) -> Table:
    """Attach citations; what is given later goes before what was given earlier."""
    keys: dict[str, str] = {}
    named: dict[str, str] = {}
    for text in given:
        method, sign, key = text.rpartition("=")
        if text.endswith(".toml"):
            keys |= _read_citations(Path(text))
        elif text in sources:
            keys |= sources[text]
        elif sign and method:
            named[method] = key
        else:
            raise UsageError(
                f"--cite {text[:80]!r} is no citation",
                expected="METHOD=KEY, a .toml file, or one of " + ", ".join(sources),
            )
    cite(table, named, names_must_exist=True)
    return cite(table, keys | named)


def _read_citations(path: Path) -> dict[str, str]:
    content = read_toml(path, UsageError, "file of citations")
    found = content.get("citations", content)
    if not isinstance(found, dict) or not all(isinstance(key, str) for key in found.values()):
        raise UsageError(
            "holds something else than citation keys",
            where=path,
            expected='a line such as "MegaLoc" = "berton2025megaloc" for each method',
        )
    return found


def rename(table: Table, given: Sequence[str]) -> Table:
    """Give methods, scenes, benchmarks and scores other names, in title and notes too.

    Methods of different tracks that get one name get one row.
    """
    groups = [column.group for column in table.columns if column.group]
    bare = [_QUERIES.sub("", group) for group in groups]
    known = [*(r.name for r in table.rows), *groups, *bare, *(c.title for c in table.columns)]
    names: dict[str, str] = {}
    for text in given:
        old, new = _parse_name(text, list(dict.fromkeys(known)))
        if names.setdefault(old, new) != new:
            raise UsageError(f"{old[:80]!r} has two new names", where=f"--rename {text[:80]}")
    return _merged(_renamed(table, names), set(names.values())) if names else table


def _parse_name(text: str, known: Sequence[str]) -> tuple[str, str]:
    where, splits = f"--rename {text[:80]}", [(old, new.strip()) for old, new in _splits(text)]
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

    def with_new_names(text: str) -> str:
        return listed.sub(lambda found: names[found[0]], text)

    columns = []
    for column in table.columns:
        bare = _QUERIES.sub("", column.group)
        group = names.get(column.group) or names.get(bare, bare) + column.group.removeprefix(bare)
        columns.append(replace(column, title=names.get(column.title, column.title), group=group))
    rows = []
    for row in table.rows:
        first = replace(row.cells[0], value=names.get(row.name, row.cells[0].value))
        rows.append(replace(row, cells=(first, *row.cells[1:])))
    return replace(
        table,
        title=with_new_names(table.title),
        columns=tuple(columns),
        rows=tuple(rows),
        notes=tuple(dict.fromkeys(map(with_new_names, table.notes))),
        legend=tuple(dict.fromkeys(map(with_new_names, table.legend))),
    )


def _merged(table: Table, names: set[str]) -> Table:
    """Make one row of those of one new name; reported ones and floors stay by themselves."""
    found: dict[object, list[Row]] = {}
    for number, row in enumerate(table.rows):
        key = (row.name, bool(row.reported), row.floor) if row.name in names else number
        found.setdefault(key, []).append(row)
    return replace(table, rows=tuple(_one_row(table, rows) for rows in found.values()))


def _one_row(table: Table, rows: Sequence[Row]) -> Row:
    first = rows[0]
    if len(rows) == 1:
        return first
    keys = dict.fromkeys(row.cells[0].cite for row in rows if row.cells[0].cite)
    cells = [replace(first.cells[0], cite=",".join(keys))]
    for place, column in enumerate(table.columns[1:], 1):
        filled = [row.cells[place] for row in rows if row.cells[place].value is not None]
        if len(filled) > 1:
            what = f"{column.group}, {column.title}" if column.group else column.title
            raise UsageError(
                f"{len(filled)} rows that would become one, {first.name[:80]!r}, have {what}",
                where="--rename",
                expected="one name for methods of different benchmarks, which then share a row",
                fix="give them different names, or name one result of each benchmark",
            )
        cells.append(filled[0] if filled else first.cells[place])
    sources = dict.fromkeys(part for row in rows for part in row.reported.split("; ") if part)
    return replace(
        first,
        cells=tuple(cells),
        highlighted=any(row.highlighted for row in rows),
        reported="; ".join(sources),
    )
