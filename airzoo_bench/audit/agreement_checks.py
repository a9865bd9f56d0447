"""One number printed in two tables, and rows that stand under another method's name."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from collections.abc import Set as AbstractSet
from fractions import Fraction
from itertools import combinations

from airzoo_bench.audit.findings import Finding, Grade, Outcome
from airzoo_bench.audit.queries import RowKey, row_of
from airzoo_bench.tables.printed_values import PrintedValue, Published, grouped

__all__ = ["check_agreement", "check_misplaced_rows", "overview"]

Row = list[PrintedValue]

_SUMMARY = "overall"
# Two scores may agree by chance; a whole row of fewer says nothing.
_FEWEST_SCORES = 3
# A number stands in few tables; of files made to take long not all pairs are made.
_MOST_PLACES = 8
_LEFT = "nothing is printed in two tables"


def _scene(cell: PrintedValue) -> str:
    return _SUMMARY if cell.is_summary and not cell.is_pooled else cell.scene


def check_agreement(published: Published, reported: AbstractSet[int]) -> Outcome:
    """Find numbers that two tables print differently."""
    pairs = _pairs(published)
    differing = [pair for pair in pairs if not _agree(*pair)]
    new = [pair for pair in differing if not reported & set(map(id, pair))]
    findings = tuple(_differ(*pair) for pair in new)
    known = len(differing) - len(new)
    said = f"{known} differ, each found by the check average" if known else ""
    what = "pairs of one number in two tables, whether both say the same"
    cells = tuple(cell for pair in pairs for cell in pair)
    left = "" if pairs else _LEFT
    return Outcome("agreement", len(pairs), what, left, findings, cells=cells, said=said)


def _pairs(published: Published) -> list[tuple[PrintedValue, PrintedValue]]:
    """Return one number in two tables each."""
    groups = published.by(lambda c: (*c.group, _scene(c), c.method, c.score.name))
    return [
        (first, second)
        for cells in groups.values()
        for first, second in _compared(cells)
        if first.table != second.table
    ]


def _compared(cells: Sequence[PrintedValue]) -> Iterable[tuple[PrintedValue, PrintedValue]]:
    """Pair all places of a number, or where these are many, the first with each other."""
    if len(cells) <= _MOST_PLACES:
        return combinations(cells, 2)
    return ((cells[0], other) for other in cells[1:])


def overview(published: Published, findings: Iterable[Finding]) -> list[str]:
    """Say of which two tables several numbers differ, and which findings that is."""
    tables = grouped(_pairs(published), lambda pair: (pair[0].table, pair[1].table))
    grave = [finding for finding in findings if finding.grade is Grade.INCONSISTENT]
    said = []
    for (one, other), pairs in tables.items():
        apart = [pair for pair in pairs if _difference(*pair) > 1]
        cells = {id(cell) for pair in apart for cell in pair}
        rows = {row_of(cell) for pair in apart for cell in pair}
        of_this = sum(
            id(f.cell) in cells
            if f.check in ("average", "agreement")
            else f.check == "row" and row_of(f.cell) in rows
            for f in grave
        )
        if len(apart) > 1 and of_this > 1:
            said.append(
                f"{len(apart)} of the {len(pairs)} numbers that both {one or 'one table'} and "
                f"{other or 'another'} print differ by more than the last digit: {of_this} of the "
                "inconsistencies are this one fact"
            )
    return said


def _difference(first: PrintedValue, second: PrintedValue) -> Fraction:
    """How far two numbers are apart, in last digits of the coarser one."""
    step = 2 * max(first.number.half, second.number.half)
    return abs(first.number.value - second.number.value) / step


def _agree(first: PrintedValue, second: PrintedValue) -> bool:
    """Whether they are the same digits, or the one with fewer rounds the other."""
    coarse, fine = sorted((first.number, second.number), key=lambda number: number.decimals)
    if coarse.decimals == fine.decimals:
        return coarse.value == fine.value
    return coarse.interval.meets(fine.interval)


def _differ(first: PrintedValue, second: PrintedValue) -> Finding:
    grade = Grade.ROUNDING if _difference(first, second) <= 1 else Grade.INCONSISTENT
    other = second.table or "another place"
    why = (
        f"the same number is printed {first.number.text} here and {second.number.text} in {other}, "
        f"line {second.line}"
    )
    return Finding(grade, "agreement", first, why)


def check_misplaced_rows(published: Published, reported: AbstractSet[int]) -> Outcome:
    """Find rows that another table prints, number for number, under another method's name."""
    rows = published.by(row_of)
    compared = [row for row in rows.values() if _is_telling(row)]
    findings = [
        _misplaced(row, other[0])
        for alike in grouped(compared, _content).values()
        for row in alike
        for other in alike[: _MOST_PLACES + 1]
        if row[0].table != other[0].table and _is_another(row, other[0], rows)
        if reported & set(map(id, row)) or not reported & set(map(id, other))
    ]
    tables = len({row[0].table for row in compared})
    left = _LEFT if tables < 2 else ""
    what = "rows, whether another table prints one under another method's name"
    cells = () if left else tuple(cell for row in compared for cell in row)
    tested = 0 if left else len(compared)
    return Outcome("row", tested, what, left, tuple(findings), cells=cells)


def _is_telling(row: Row) -> bool:
    return len(row) >= _FEWEST_SCORES and any(cell.number.value for cell in row)


def _content(row: Row) -> tuple[object, ...]:
    """Return what equal rows share, whosever they are: scene, scores and values."""
    values = frozenset((cell.score.name, cell.number.value) for cell in row)
    return row[0].group, _scene(row[0]), values


def _is_another(row: Row, other: PrintedValue, rows: dict[RowKey, Row]) -> bool:
    """Whether it is another's row: the other table prints other numbers under this name."""
    own = rows.get((other.table, *other.group, other.scene, row[0].method))
    if own is None or own[0].method == other.method:
        return False
    printed = {cell.score.name: cell.number.value for cell in own}
    return any(printed.get(c.score.name, c.number.value) != c.number.value for c in row)


def _misplaced(row: Row, other: PrintedValue) -> Finding:
    values = ", ".join(f"{cell.score.name} {cell.number.text}" for cell in row)
    why = (
        f"all {len(row)} numbers of this row ({values}) are those of {other.method} in "
        f"{other.table}, {other.scene}, so it may stand under the wrong name"
    )
    return Finding(Grade.INCONSISTENT, "row", row[0], why)
