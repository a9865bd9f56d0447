"""Printed gains against the differences of the printed values."""

from __future__ import annotations

import re
from bisect import bisect_left, bisect_right
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from math import inf

from airzoo_bench.audit.findings import Conclusion, Finding, Grade, Outcome
from airzoo_bench.core.errors import agreeing, counted
from airzoo_bench.tables.printed_numbers import Rounded, decimal_text
from airzoo_bench.tables.printed_values import PrintedValue, Published, grouped

__all__ = ["check_gains"]

_GAIN = "gain"
# Instead of a method: the best of those that have no gains themselves.
_BEST = "the best of the others"
_MOST_NEAR = 50


@dataclass(frozen=True)
class _Gain:
    """A printed gain, its value, and the value that it is over; None where there is none."""

    cell: PrintedValue
    gain: Rounded
    base: PrintedValue | None

    @property
    def off(self) -> Fraction | float:
        """How far the gain is from the difference, beyond its own rounding."""
        if self.base is None:
            return inf
        finer = max(self.cell.number.decimals, self.base.number.decimals)
        own = self.gain.half if self.gain.decimals < finer else Fraction(0)
        return max(Fraction(0), self._distance(self.base) - own)

    def _distance(self, base: PrintedValue) -> Fraction:
        """Return how far the gain is from the difference; what is better low counts either way."""
        difference = self.cell.number.value - base.number.value
        signs = (1, -1) if self.cell.score.higher_is_better is False else (1,)
        return min(abs(self.gain.value - sign * difference) for sign in signs)

    @property
    def slack(self) -> Fraction:
        """How far off it may be where all three were rounded, or cut off, from exact numbers."""
        other = self.base.number.half if self.base else Fraction(0)
        return self.cell.number.half + self.gain.half + other

    @property
    def is_explained(self) -> bool:
        """Whether it is the difference, up to rounding."""
        return self.off <= self.slack


class _Column:
    """The values of one column, in order, and what is asked of them for each gain."""

    def __init__(self, cells: Sequence[PrintedValue]) -> None:
        self.cells = sorted(cells, key=_value)
        self.half = max(cell.number.half for cell in cells)
        self.by_method = {cell.method: cell for cell in reversed(self.cells)}
        self.by_name = grouped(cells, lambda cell: cell.method.casefold())
        plain = [cell for cell in self.cells if cell.gain is None]
        pick = min if cells[0].score.higher_is_better is False else max
        self.best = pick(plain, key=_value, default=None)

    def base(self, method: str | None) -> PrintedValue | None:
        """Return the value of a method, or of the best of those that have no gains."""
        return self.best if method == _BEST else self.by_method.get(method or "")

    def near(self, value: Fraction, room: Fraction) -> list[PrintedValue]:
        """Return cells of about a value, and of these only so many: a column may be all alike."""
        first = bisect_left(self.cells, value - room, key=_value)
        last = bisect_right(self.cells, value + room, key=_value)
        return self.cells[first : min(last, first + _MOST_NEAR)]


_Pair = tuple[_Gain, _Column]


def _value(cell: PrintedValue) -> Fraction:
    return cell.number.value


def _column_key(cell: PrintedValue) -> tuple[str, ...]:
    return cell.table, *cell.group, cell.scene, cell.score.name


def check_gains(published: Published) -> Outcome:
    """Find printed gains that are not the difference of the printed values."""
    findings: list[Finding] = []
    conclusions: list[Conclusion] = []
    columns = {key: _Column(cells) for key, cells in published.by(_column_key).items()}
    printed = [
        (_Gain(cell, cell.gain, None), columns[_column_key(cell)])
        for cell in published.cells
        if cell.gain
    ]
    unexplained = 0
    compared: list[PrintedValue] = []
    by_method = grouped(printed, lambda pair: (pair[0].cell.table, pair[0].cell.method))
    for (table, method), pairs in by_method.items():
        base = _baseline(method, pairs)
        gains = [replace(gain, base=column.base(base)) for gain, column in pairs]
        place = ", ".join(filter(None, (table, method)))
        conclusions.append(Conclusion(_GAIN, place, _gains_text(base, gains)))
        if base is None:
            unexplained += len(gains)
            continue
        compared += [cell for gain in gains for cell in (gain.cell, gain.base) if cell]
        findings.extend(finding for gain in gains if (finding := _judge(gain, base)))
    left = f"gains over no method of the table: {unexplained}" if unexplained else ""
    what = "printed gains, whether they are the difference of the printed values"
    if not printed:
        left = "no gain is printed"
    tested = len(printed) - unexplained
    return Outcome(_GAIN, tested, what, left, tuple(findings), tuple(conclusions), tuple(compared))


def _baseline(method: str, pairs: Sequence[_Pair]) -> str | None:
    """Return the method that the gains are over, by merit, then name, then place in the file."""
    stem = re.sub(r"\s*\(.*\)$", "", method).casefold()
    explained: Counter[str] = Counter()
    rivals: dict[str, int] = {}
    for gain, column in pairs:
        candidates = (*column.by_name.get(stem, []), *_candidates(gain, column))
        cells = {c.method: c for c in candidates if c.method != method}
        rivals |= {name: cell.line for name, cell in cells.items()}
        explained.update(_explaining(gain, cells))
    merits = {
        name: (explained[name], name.casefold() == stem, -line) for name, line in rivals.items()
    }
    best = max(merits, key=lambda name: merits[name], default="")
    most, is_namesake, _ = merits.get(best, (0, False, 0))
    over_best = sum(replace(gain, base=column.best).is_explained for gain, column in pairs)
    if over_best > most and 2 * over_best > len(pairs):
        return _BEST
    return best if is_namesake or 2 * most > len(pairs) else None


def _explaining(gain: _Gain, cells: Mapping[str, PrintedValue]) -> list[str]:
    """Return the methods over whose values it is a gain; equal numbers are tried once."""
    tried: dict[tuple[Fraction, int], bool] = {}
    for cell in cells.values():
        number = (cell.number.value, cell.number.decimals)
        if number not in tried:
            tried[number] = replace(gain, base=cell).is_explained
    return [n for n, c in cells.items() if tried[c.number.value, c.number.decimals]]


def _candidates(gain: _Gain, column: _Column) -> list[PrintedValue]:
    """Return what a gain may be over, within rounding."""
    slack = gain.slack + gain.gain.half + column.half
    near: list[PrintedValue] = []
    for difference in (gain.gain.value, -gain.gain.value):
        own = gain.cell.number.value
        near += column.near(own - difference, slack)
    return near


def _gains_text(base: str | None, gains: Sequence[_Gain]) -> str:
    if base is None:
        return f"no method of the table explains more than half of {counted(len(gains), 'gain')}"
    explained = sum(gain.is_explained for gain in gains)
    are = agreeing(explained, "is", "are")
    return f"gains are over {base}: {explained} of {len(gains)} {are} right up to the last digit"


def _judge(gain: _Gain, base: str) -> Finding | None:
    if gain.off == 0:
        return None
    if gain.base is None:
        why = f"{base}, over which the gain {gain.gain.text} is, has no number here"
        return Finding(Grade.INCONSISTENT, _GAIN, gain.cell, why)
    why = _difference_text(gain, gain.base)
    if gain.is_explained:
        why += ": off by the last digit, as where it was computed before rounding"
        return Finding(Grade.ROUNDING, _GAIN, gain.cell, why)
    return Finding(Grade.INCONSISTENT, _GAIN, gain.cell, why)


def _difference_text(gain: _Gain, base: PrintedValue) -> str:
    value, other = gain.cell.number, base.number
    digits = max(value.decimals, other.decimals, gain.gain.decimals)
    difference = value.value - other.value
    sign = "+" if difference > 0 else ""
    return (
        f"{value.text} - {other.text} ({base.method}) = {sign}{decimal_text(difference, digits)}, "
        f"but the printed gain is {gain.gain.text}"
    )
