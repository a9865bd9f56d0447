"""What is printed beside and around numbers: gains, and bold for the best."""

from __future__ import annotations

import re
from bisect import bisect_left, bisect_right
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

from airzoo_bench.audit.findings import Conclusion, Finding, Grade
from airzoo_bench.audit.published import Printed, Published, grouped
from airzoo_bench.audit.rounding import Rounded, decimal_text

__all__ = ["check_bold", "check_gains"]

_GAIN = "gain"


@dataclass(frozen=True)
class _Gain:
    """A printed gain beside the number it is over, which is None where there is none."""

    cell: Printed
    gain: Rounded
    base: Printed | None

    @property
    def off(self) -> Fraction | None:
        """How far the gain is from the difference of the printed values."""
        if self.base is None:
            return None
        difference = self.cell.number.value - self.base.number.value
        signs = (1, -1) if self.cell.score.higher_is_better is False else (1,)
        return min(abs(self.gain.value - sign * difference) for sign in signs)

    @property
    def slack(self) -> Fraction:
        """How far off it may be where all three were rounded from exact numbers."""
        halves = self.cell.number.half + self.gain.half
        return halves + (self.base.number.half if self.base else 0)

    @property
    def is_explained(self) -> bool:
        return self.off is not None and self.off <= self.slack


def check_gains(published: Published) -> tuple[list[Finding], list[Conclusion]]:
    """Find printed gains that are not the difference of the printed values.

    Over which method a method's gains are is concluded: the one that explains most of them, of
    equals the one whose name it bears, such as ``X`` for ``X (Ours)``.
    """
    findings: list[Finding] = []
    conclusions: list[Conclusion] = []
    columns = {
        key: sorted(cells, key=_value)
        for key, cells in published.by(lambda c: (c.table, *_column(c))).items()
    }
    printed = [_Gain(cell, cell.gain, None) for cell in published.cells if cell.gain]
    for (table, method), own in _by_method(printed).items():
        beside = [(gain, columns[table, *_column(gain.cell)]) for gain in own]
        base = _baseline(method, beside)
        gains = [_over(gain, column, base) for gain, column in beside]
        place = ", ".join(filter(None, (table, method)))
        conclusions.append(Conclusion(_GAIN, place, _gains_text(base, gains)))
        findings.extend(finding for gain in gains if (finding := _judge(gain, base)))
    return findings, conclusions


def _by_method(gains: Sequence[_Gain]) -> dict[tuple[str, str], list[_Gain]]:
    groups: dict[tuple[str, str], list[_Gain]] = {}
    for gain in gains:
        groups.setdefault((gain.cell.table, gain.cell.method), []).append(gain)
    return groups


def _value(cell: Printed) -> Fraction:
    return cell.number.value


def _column(cell: Printed) -> tuple[str, ...]:
    return *cell.group, cell.scene, cell.score.name


def _over(gain: _Gain, column: Sequence[Printed], base: str | None) -> _Gain:
    return replace(gain, base=next((cell for cell in column if cell.method == base), None))


def _baseline(method: str, beside: Sequence[tuple[_Gain, Sequence[Printed]]]) -> str | None:
    """Return the method that the gains are over, by merit, then name, then place in the file."""
    explained = Counter(name for gain, column in beside for name in _explaining(gain, column))
    stem = re.sub(r"\s*\(.*\)$", "", method).casefold()
    rivals = {c.method: c.line for _, column in beside for c in column if c.method != method}
    merits = {
        name: (explained[name], name.casefold() == stem, -line) for name, line in rivals.items()
    }
    best = max(merits, key=lambda name: merits[name], default=None)
    return best if best is not None and any(merits[best][:2]) else None


def _explaining(gain: _Gain, column: Sequence[Printed]) -> set[str]:
    """Return the methods of a column, sorted by value, that a gain is over within rounding."""
    slack = gain.slack + max(cell.number.half for cell in column)
    near: list[Printed] = []
    for difference in (gain.gain.value, -gain.gain.value):
        target = gain.cell.number.value - difference
        first = bisect_left(column, target - slack, key=_value)
        near += column[first : bisect_right(column, target + slack, key=_value)]
    return {cell.method for cell in near if replace(gain, base=cell).is_explained}


def _gains_text(base: str | None, gains: Sequence[_Gain]) -> str:
    if base is None:
        return f"no method of the table explains any of {len(gains)} gains"
    explained = sum(gain.is_explained for gain in gains)
    return f"gains are over {base}, which explains {explained} of {len(gains)}"


def _judge(gain: _Gain, base: str | None) -> Finding | None:
    if gain.off == 0:
        return None
    if gain.base is None:
        why = f"gain {gain.gain.text} over {base or 'no method of the table'}: there is no number"
        return Finding(Grade.INCONSISTENT, _GAIN, gain.cell, why)
    value, other = gain.cell.number, gain.base.number
    digits = max(value.decimals, other.decimals, gain.gain.decimals)
    difference = decimal_text(value.value - other.value, digits)
    why = f"{value.text} - {other.text} ({base}) = {difference}, printed {gain.gain.text}"
    if gain.is_explained:
        why += ": off by the last digit, as of values before rounding"
        return Finding(Grade.ROUNDING, _GAIN, gain.cell, why)
    return Finding(Grade.INCONSISTENT, _GAIN, gain.cell, why)


def check_bold(published: Published) -> list[Finding]:
    """Find bold values that are not the best of their column, and best ones that are not bold.

    Only in tables that print something bold, and for scores whose better direction is known. All
    that share the best printed value are to be bold.
    """
    if not published.has_bold:
        return []
    bold_tables = {cell.table for cell in published.cells if cell.bold}
    cells = [c for c in published.cells if c.table in bold_tables]
    columns = grouped(cells, lambda c: (c.table, *_column(c)))
    return [finding for column in columns.values() for finding in _judge_column(column)]


def _judge_column(column: Sequence[Printed]) -> list[Finding]:
    direction = column[0].score.higher_is_better
    if direction is None or len(column) < 2:
        return []
    pick = max if direction else min
    best = pick(cell.number.value for cell in column)
    leaders = [cell for cell in column if cell.number.value == best]
    names = " and ".join(cell.method for cell in leaders)
    findings = []
    for cell in column:
        if cell.bold and cell not in leaders:
            why = f"{cell.number.text} is bold, but the best is {leaders[0].number.text} of {names}"
            findings.append(Finding(Grade.INCONSISTENT, "bold", cell, why))
        elif not cell.bold and cell in leaders:
            bold = " and ".join(c.method for c in column if c.bold)
            marked = f"bold is {bold}" if bold else "nothing is bold"
            why = f"{cell.number.text} is the best of {len(column)}, but {marked}"
            findings.append(Finding(Grade.INCONSISTENT, "bold", cell, why))
    return findings
