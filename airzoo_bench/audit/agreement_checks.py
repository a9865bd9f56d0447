"""One number printed in two tables, and rows that stand under another method's name."""

from __future__ import annotations

from collections.abc import Iterable
from collections.abc import Set as AbstractSet
from itertools import combinations, permutations

from airzoo_bench.audit.findings import Finding, Grade
from airzoo_bench.audit.published import Printed, Published

__all__ = ["check_agreement", "check_misplaced_rows"]

Row = list[Printed]

_SUMMARY = "overall"
# Two scores may agree by chance; a whole row of fewer says nothing.
_FEWEST_SCORES = 3


def _scene(cell: Printed) -> str:
    return _SUMMARY if cell.is_summary else cell.scene


def check_agreement(published: Published, reported: AbstractSet[int]) -> list[Finding]:
    """Find numbers that two tables print differently.

    Parameters
    ----------
    published : Published
    reported : set of int
        Lines of which it is already known that they are wrong: not said again.
    """
    findings = []
    groups = published.by(lambda c: (*c.group, _scene(c), c.method, c.score.name))
    for cells in groups.values():
        for first, second in combinations(cells, 2):
            same = first.table == second.table or first.number.value == second.number.value
            if same or reported & {first.line, second.line}:
                continue
            findings.append(_differ(first, second))
    return findings


def _differ(first: Printed, second: Printed) -> Finding:
    gap = abs(first.number.value - second.number.value)
    step = 2 * max(first.number.half, second.number.half)
    grade = Grade.ROUNDING if gap <= step else Grade.INCONSISTENT
    other = second.table or "another place"
    why = (
        f"printed {first.number.text} here and {second.number.text} in {other}, line {second.line}"
    )
    return Finding(grade, "agreement", first, why)


def check_misplaced_rows(published: Published, reported: AbstractSet[int]) -> list[Finding]:
    """Find rows that another table prints, number for number, under another method's name.

    Parameters
    ----------
    published : Published
    reported : set of int
        Lines of which it is already known that they are wrong: of two such rows, the one that
        holds none is right.
    """
    alike = [(row, other) for rows in _alike(published) for row, other in permutations(rows, 2)]
    own = {(c.table, *c.group, c.scene, c.method) for c in published.cells}
    return [
        _misplaced(row, other[0])
        for row, other in alike
        if _is_elsewhere(row[0], other[0])
        and (other[0].table, *other[0].group, other[0].scene, row[0].method) in own
        and (reported & _lines(row) or not reported & _lines(other))
    ]


def _alike(published: Published) -> Iterable[list[Row]]:
    """Group rows of equal scores and values, whosever they are."""
    groups: dict[object, list[Row]] = {}
    for row in published.by(lambda c: (c.table, *c.group, c.scene, c.method)).values():
        if len(row) >= _FEWEST_SCORES and any(cell.number.value for cell in row):
            values = frozenset((cell.score.name, cell.number.value) for cell in row)
            groups.setdefault((row[0].group, _scene(row[0]), values), []).append(row)
    return groups.values()


def _is_elsewhere(first: Printed, second: Printed) -> bool:
    return first.table != second.table and first.method != second.method


def _lines(row: Row) -> set[int]:
    return {cell.line for cell in row}


def _misplaced(row: Row, other: Printed) -> Finding:
    values = ", ".join(f"{cell.score.name} {cell.number.text}" for cell in row)
    why = f"the whole row ({values}) is that of {other.method} in {other.table}, {other.scene}"
    return Finding(Grade.INCONSISTENT, "row", row[0], why)
