"""What is printed beside and around numbers: gains, and bold for the best."""

from __future__ import annotations

import re
from bisect import bisect_left, bisect_right
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from math import inf

from airzoo_bench.audit.findings import Conclusion, Finding, Grade, Outcome
from airzoo_bench.core.plurals import agreeing, counted
from airzoo_bench.tables.printed.cells import PrintedValue, Published, grouped
from airzoo_bench.tables.printed.numbers import Rounded, decimal_text

__all__ = ["check_bold", "check_gains"]

_GAIN = "gain"
# Instead of a method: the best of those that have no gains themselves.
_BEST = "the best of the others"
_MOST_NEAR = 50


@dataclass(frozen=True)
class _Gain:
    """A printed gain beside the number it is over, which is None where there is none."""

    cell: PrintedValue
    gain: Rounded
    base: PrintedValue | None

    @property
    def is_relative(self) -> bool:
        """Whether it may be the difference in percent of the other number, and is nearer to it."""
        return self._distance(relative=True) < self._distance(relative=False)

    def _distance(self, *, relative: bool) -> Fraction | float:
        """How far the gain is from the difference, by the sign that comes nearer to it."""
        scale = self._scale if relative else Fraction(1)
        if self.base is None or scale is None:
            return inf
        difference = scale * (self.cell.number.value - self.base.number.value)
        signs = (1, -1) if self.cell.score.higher_is_better is False else (1,)
        return min(abs(self.gain.value - sign * difference) for sign in signs)

    @property
    def _scale(self) -> Fraction | None:
        """What makes a difference one in percent, where the gain is printed with its sign."""
        if self.base is None or not self.base.number.value or not self.gain.text.endswith("%"):
            return None
        return 100 / abs(self.base.number.value)

    @property
    def off(self) -> Fraction | float:
        """How far the gain is from the difference, beyond its own rounding."""
        finer = max(c.number.decimals for c in (self.cell, self.base or self.cell))
        rounded = self.is_relative or self.gain.decimals < finer
        own = self.gain.half if rounded else Fraction(0)
        return max(Fraction(0), self._distance(relative=self.is_relative) - own)

    @property
    def slack(self) -> Fraction:
        """How far off it may be where all three were rounded, or cut off, from exact numbers."""
        if self.base is None:
            return self.cell.number.half + self.gain.half
        own, other = self.cell.number, self.base.number
        if not self.is_relative or self._scale is None:
            return own.half + self.gain.half + other.half
        return self.gain.half + self._scale * (own.half + other.half * abs(own.value / other.value))

    @property
    def is_explained(self) -> bool:
        return self.off <= self.slack


def check_gains(published: Published) -> Outcome:
    """Find printed gains that are not the difference of the printed values.

    Over which method a method's gains are is concluded: the one that explains most of them, of
    equals the one whose name it bears, such as ``X`` for ``X (Ours)``; or the best of the others in
    each column, where that explains more. One that explains no more than half, and is no namesake,
    is none.
    """
    findings: list[Finding] = []
    conclusions: list[Conclusion] = []
    columns = {
        key: _Rivals(cells) for key, cells in published.by(lambda c: (c.table, *_column(c))).items()
    }
    printed = [_Gain(cell, cell.gain, None) for cell in published.cells if cell.gain]
    unexplained = 0
    compared: list[PrintedValue] = []
    for (table, method), own in _by_method(printed).items():
        beside = [(gain, columns[table, *_column(gain.cell)]) for gain in own]
        base = _baseline(method, beside)
        gains = [_over(gain, column, base) for gain, column in beside]
        place = ", ".join(filter(None, (table, method)))
        conclusions.append(Conclusion(_GAIN, place, _gains_text(base, gains)))
        unexplained += len(gains) if base is None else 0
        compared += [cell for gain in gains for cell in (gain.cell, gain.base) if base and cell]
        findings.extend(finding for gain in gains if base and (finding := _judge(gain, base)))
    left = f"gains over no method of the table: {unexplained}" if unexplained else ""
    what = "printed gains, whether they are the difference of the printed values"
    if not printed:
        left = "no gain is printed"
    tested = len(printed) - unexplained
    return Outcome(_GAIN, tested, what, left, tuple(findings), tuple(conclusions), tuple(compared))


def _by_method(gains: Sequence[_Gain]) -> dict[tuple[str, str], list[_Gain]]:
    groups: dict[tuple[str, str], list[_Gain]] = {}
    for gain in gains:
        groups.setdefault((gain.cell.table, gain.cell.method), []).append(gain)
    return groups


def _value(cell: PrintedValue) -> Fraction:
    return cell.number.value


def _column(cell: PrintedValue) -> tuple[str, ...]:
    return *cell.group, cell.scene, cell.measure


class _Rivals:
    """The cells of one column, sorted by value, and what of them is asked for each gain."""

    def __init__(self, cells: Sequence[PrintedValue]) -> None:
        self.cells = sorted(cells, key=_value)
        self.half = max(cell.number.half for cell in cells)
        self.by_method = {cell.method: cell for cell in reversed(self.cells)}
        self.by_name = grouped(cells, lambda cell: cell.method.casefold())
        plain = [cell for cell in self.cells if cell.gain is None]
        pick = min if cells[0].score.higher_is_better is False else max
        self.best = pick(plain, key=_value, default=None)

    def near(self, value: Fraction, room: Fraction) -> list[PrintedValue]:
        """Return cells of about a value; of files made to take long not all."""
        first = bisect_left(self.cells, value - room, key=_value)
        last = bisect_right(self.cells, value + room, key=_value)
        return self.cells[first : min(last, first + _MOST_NEAR)]


def _over(gain: _Gain, column: _Rivals, base: str | None) -> _Gain:
    if base == _BEST:
        return replace(gain, base=column.best)
    return replace(gain, base=column.by_method.get(base or ""))


def _baseline(method: str, beside: Sequence[tuple[_Gain, _Rivals]]) -> str | None:
    """Return the method that the gains are over, by merit, then name, then place in the file."""
    stem = re.sub(r"\s*\(.*\)$", "", method).casefold()
    explained: Counter[str] = Counter()
    rivals: dict[str, int] = {}
    for gain, column in beside:
        namesakes = column.by_name.get(stem, [])
        cells = {c.method: c for c in (*namesakes, *_about(gain, column)) if c.method != method}
        rivals |= {name: cell.line for name, cell in cells.items()}
        explained.update(n for n, c in cells.items() if replace(gain, base=c).is_explained)
    merits = {
        name: (explained[name], name.casefold() == stem, -line) for name, line in rivals.items()
    }
    best = max(merits, key=lambda name: merits[name], default="")
    most, is_namesake, _ = merits.get(best, (0, False, 0))
    over_best = sum(_over(gain, column, _BEST).is_explained for gain, column in beside)
    if over_best > most and 2 * over_best > len(beside):
        return _BEST
    return best if is_namesake or 2 * most > len(beside) else None


def _about(gain: _Gain, column: _Rivals) -> list[PrintedValue]:
    """Return what a gain may be over, within rounding."""
    slack = gain.slack + gain.gain.half + column.half
    near: list[PrintedValue] = []
    for difference in (gain.gain.value, -gain.gain.value):
        own = gain.cell.number.value
        near += column.near(own - difference, slack)
        if gain.gain.text.endswith("%") and difference > -100:
            # Of a difference in percent of the other; its slack by the slopes, and amply.
            factor = 100 / (100 + difference)
            near += column.near(own * factor, 4 * slack * factor * (1 + abs(own) * factor / 100))
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


def check_bold(published: Published) -> Outcome:
    """Find bold values that are not the best of their column, and best ones that are not bold.

    Only in columns that print something bold, since averages alone may be marked, and for scores
    whose better direction is known. Of several that share the best printed value, one is to be bold
    at least: which is best before rounding, the table does not say.
    """
    what = "columns, whether the best is bold and nothing else"
    if not published.has_bold:
        return Outcome("bold", 0, what, "the file does not say what is bold")
    columns = published.by(lambda c: (c.table, *_column(c))).values()
    races = [
        race
        for column in columns
        if _is_race(race := [cell for cell in column if cell.competes or cell.bold])
    ]
    judged = [column for column in races if any(cell.bold for cell in column)]
    plain = [column for column in races if column not in judged]
    left = []
    if plain:
        places = list(dict.fromkeys(f"{c[0].score.name} of {c[0].place}" for c in plain))
        shown = ", ".join(places[:3]) + (" ..." if len(places) > 3 else "")
        left.append(f"{counted(len(plain), 'column')} in which nothing is bold ({shown})")
    if len(races) < len(columns):
        left.append(
            f"{counted(len(columns) - len(races), 'column')} of one method or an unknown score"
        )
    findings: list[Finding] = []
    conclusions: list[Conclusion] = []
    tables: dict[str, list[list[PrintedValue]]] = {}
    for column in judged:
        tables.setdefault(column[0].table, []).append(column)
    for table, own in tables.items():
        found, by_section = _judge_table(own)
        findings += found
        if by_section:
            text = "the best of each part of the table, between rules or titles, is bold"
            conclusions.append(Conclusion("bold", table, text))
    cells = tuple(cell for column in judged for cell in column)
    said, not_judged = tuple(conclusions), " and ".join(left)
    return Outcome("bold", len(judged), what, not_judged, tuple(findings), said, cells)


def _judge_table(columns: Sequence[Sequence[PrintedValue]]) -> tuple[list[Finding], bool]:
    """Judge whole columns, or the parts of these, by what explains more of a table's bold."""
    whole = [finding for column in columns for finding in _judge_column(column)]
    parts = [
        part
        for column in columns
        for part in grouped(column, lambda cell: cell.section).values()
        if any(cell.bold for cell in part)
    ]
    apart = [finding for part in parts for finding in _judge_column(part)]
    # A part that has nothing bold says nothing; several that have, each of their own, do.
    by_section = len(parts) > len(columns) and len(apart) < len(whole)
    return (apart, True) if by_section else (whole, False)


def _is_race(column: Sequence[PrintedValue]) -> bool:
    return bool(column) and column[0].score.higher_is_better is not None and len(column) > 1


def _judge_column(column: Sequence[PrintedValue]) -> list[Finding]:
    pick = max if column[0].score.higher_is_better else min
    best = pick(cell.number.value for cell in column)
    leaders = [cell for cell in column if cell.number.value == best]
    findings = []
    for cell in column:
        if cell.bold and cell not in leaders:
            names = " and ".join(leader.method for leader in leaders)
            better = "higher" if cell.score.higher_is_better else "lower"
            why = (
                f"{cell.number.text} is bold, but {names} has {leaders[0].number.text}, and "
                f"{better} is better"
            )
            findings.append(Finding(Grade.INCONSISTENT, "bold", cell, why))
        elif not cell.bold and cell in leaders:
            findings.append(_not_bold(cell, leaders, column))
    return findings


def _not_bold(
    cell: PrintedValue, leaders: Sequence[PrintedValue], column: Sequence[PrintedValue]
) -> Finding:
    marked = [leader for leader in leaders if leader.bold]
    if marked:
        names = " and ".join(leader.method for leader in marked)
        why = f"{cell.number.text} is not bold, but the same number of {names} is"
        return Finding(Grade.ROUNDING, "bold", cell, why)
    others = " and ".join(c.method for c in column if c.bold)
    why = f"{cell.number.text} is the best of {len(column)} methods, but {others} is bold"
    return Finding(Grade.INCONSISTENT, "bold", cell, why)
