"""F1 against precision and recall, Chamfer distance against accuracy and completeness."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction

from airzoo_bench.audit.findings import Conclusion, Finding, Grade, Outcome
from airzoo_bench.core.errors import counted
from airzoo_bench.tables.printed_numbers import Interval, decimal_text
from airzoo_bench.tables.printed_scores import Family
from airzoo_bench.tables.printed_values import PrintedValue, Published

__all__ = ["check_chamfer", "check_f1", "f1_of"]

Row = dict[Family, PrintedValue]
_ZERO = Fraction(0)


def f1_of(precision: Fraction, recall: Fraction) -> Fraction:
    """Return the harmonic mean, 0 where both are 0; it grows with either."""
    total = precision + recall
    return 2 * precision * recall / total if total else _ZERO


def _rows(published: Published, *needed: Family) -> list[Row]:
    rows = published.by(lambda c: (c.table, *c.group, c.scene, c.method, c.score.thresholds))
    by_family = [{cell.score.family: cell for cell in row} for row in rows.values()]
    return [row for row in by_family if set(needed) <= row.keys()]


def _cells(rows: Iterable[Row], *families: Family) -> tuple[PrintedValue, ...]:
    return tuple(row[family] for row in rows for family in families)


def check_f1(published: Published) -> Outcome:
    """Find F1 that the precision and recall of its row do not give."""
    needed = (Family.PRECISION, Family.RECALL, Family.F1)
    rows = _rows(published, *needed)
    findings = [finding for row in rows if (finding := _judge_f1(row))]
    left = "" if rows else "no row has precision, recall and F1"
    what = "F1 against precision and recall next to them"
    cells = _cells(rows, *needed)
    return Outcome("F1", len(rows), what, left, tuple(findings), cells=cells)


def _judge_f1(row: Row) -> Finding | None:
    cell, precision, recall = row[Family.F1], row[Family.PRECISION], row[Family.RECALL]
    possible = _possible_f1(precision, recall, averaged=cell.is_summary)
    if cell.share.meets(possible):
        return None
    why = _f1_text(cell, precision, recall, possible)
    # Where all three digits were cut off, or two were rounded before.
    slack = sum((c.number.half / c.full for c in (cell, precision, recall)), _ZERO)
    if cell.share.widened(slack).meets(possible):
        return Finding(Grade.ROUNDING, "F1", cell, why + ": off by the last digit")
    return Finding(Grade.IMPOSSIBLE, "F1", cell, why)


def _possible_f1(precision: PrintedValue, recall: PrintedValue, *, averaged: bool) -> Interval:
    low_p, high_p = (max(_ZERO, end) for end in (precision.share.low, precision.share.high))
    low_r, high_r = (max(_ZERO, end) for end in (recall.share.low, recall.share.high))
    low = max(_ZERO, low_p + low_r - 1) if averaged else f1_of(low_p, low_r)
    return Interval(low, f1_of(high_p, high_r))


def _f1_text(
    cell: PrintedValue, precision: PrintedValue, recall: PrintedValue, possible: Interval
) -> str:
    digits = cell.number.decimals
    p, r = precision.number.text, recall.number.text
    if cell.is_summary:
        low, high = (decimal_text(end * cell.full, digits) for end in (possible.low, possible.high))
        return (
            f"with mean precision {p} and mean recall {r} a mean F1 lies between P + R - 1 and the "
            f"F1 of the means, which is {low} to {high}; printed is {cell.number.text}"
        )
    middle = f1_of(precision.number.value / precision.full, recall.number.value / recall.full)
    exact = decimal_text(middle * cell.full, digits)
    return f"F1 = 2 x {p} x {r} / ({p} + {r}) = {exact}, printed is {cell.number.text}"


def check_chamfer(published: Published) -> Outcome:
    """Find Chamfer distances that are not the mean, or the sum, of accuracy and completeness."""
    needed = (Family.CHAMFER, Family.ACCURACY, Family.COMPLETENESS)
    rows = _rows(published, *needed)
    what = "Chamfer distances against accuracy and completeness next to them"
    if not rows:
        left = "no row has accuracy, completeness and Chamfer distance"
        return Outcome("Chamfer", 0, what, left)
    fits = {parts: sum(_is_chamfer(row, parts) for row in rows) for parts in (2, 1)}
    parts = max(fits, key=lambda key: fits[key])
    name = {2: "mean", 1: "sum"}[parts]
    text = (
        f"Chamfer distance is the {name} of accuracy and completeness in {fits[parts]} of "
        f"{counted(len(rows), 'row')}"
    )
    said = (Conclusion("Chamfer", "", text),)
    if 2 * fits[parts] <= len(rows):
        left = (
            f"it is neither mean nor sum of both in more than half of {counted(len(rows), 'row')}"
        )
        return Outcome("Chamfer", 0, what, left, (), said)
    wrong = [_chamfer_finding(row, parts) for row in rows if not _is_chamfer(row, parts)]
    return Outcome("Chamfer", len(rows), what, "", tuple(wrong), said, _cells(rows, *needed))


def _sum(row: Row) -> Interval:
    return row[Family.ACCURACY].number.interval.plus(row[Family.COMPLETENESS].number.interval)


def _is_chamfer(row: Row, parts: int) -> bool:
    expected = _sum(row).times(Fraction(1, parts))
    return row[Family.CHAMFER].number.interval.meets(expected)


def _chamfer_finding(row: Row, parts: int) -> Finding:
    cell, accuracy, completeness = (
        row[family] for family in (Family.CHAMFER, Family.ACCURACY, Family.COMPLETENESS)
    )
    exact = (accuracy.number.value + completeness.number.value) / parts
    total = f"{accuracy.number.text} + {completeness.number.text}"
    formula = f"({total}) / 2" if parts == 2 else total
    why = f"{formula} = {decimal_text(exact, cell.number.decimals)}, printed is {cell.number.text}"
    # Where all three digits were cut off, or two were rounded before.
    slack = cell.number.half + (accuracy.number.half + completeness.number.half) / parts
    if cell.number.interval.widened(slack).meets(_sum(row).times(Fraction(1, parts))):
        return Finding(Grade.ROUNDING, "Chamfer", cell, why + ": off by the last digit")
    return Finding(Grade.INCONSISTENT, "Chamfer", cell, why)
