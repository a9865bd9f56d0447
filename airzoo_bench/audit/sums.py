"""Averages against their scenes, and gains against the differences of the values."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
from scipy.optimize import linprog

from airzoo_bench.audit.counts import (
    Key,
    Queries,
    counted_share,
    decimal_text,
    key_of,
    score_of,
)
from airzoo_bench.audit.findings import Conclusion, Finding, Grade, Outcome
from airzoo_bench.core.errors import agreeing, counted
from airzoo_bench.tables.printed import Family, Rounded, Span
from airzoo_bench.tables.published import PrintedValue, Published, grouped

__all__ = ["check_averages", "check_gains"]

_BEST = "the best of the others"


@dataclass(frozen=True)
class _Averaged:
    """A printed average with the scenes' values it should be made of.

    The exact values' mean lies `over_scenes`, or `over_queries`: between the least and the greatest
    scene for medians, and where it is not known how many queries these have (not `is_weighed`).
    """

    cell: PrintedValue
    scenes: tuple[PrintedValue, ...]
    over_scenes: Span
    over_queries: Span
    of_rounded: Fraction
    is_weighed: bool

    @property
    def is_median(self) -> bool:
        """Whether it averages medians."""
        return self.cell.score.family is Family.MEDIAN

    @property
    def fits_scenes(self) -> bool:
        """Whether it rounds the unweighted mean over scenes."""
        return self.cell.number.span.meets(self.over_scenes)

    @property
    def fits_queries(self) -> bool:
        """Whether it rounds a mean over all queries."""
        return self.cell.number.span.meets(self.over_queries)

    @property
    def fits_rounded(self) -> bool:
        """Whether it rounds the mean of the values as printed."""
        return abs(self.cell.number.value - self.of_rounded) <= self.cell.number.half


def check_averages(
    published: Published, queries: Mapping[Key, Queries], precise: Collection[Key]
) -> Outcome:
    """Tell over what a table averages, and find the averages that the scenes do not give."""
    scenes: dict[tuple[str, ...], dict[str, dict[str, PrintedValue]]] = {}
    for cell in published.cells:
        if not cell.is_summary:
            by_scene = scenes.setdefault((*cell.group, cell.score.name), {})
            # Of a cell that is printed twice the first counts; another check compares them.
            by_scene.setdefault(cell.scene, {}).setdefault(cell.method, cell)
    summaries = [cell for cell in published.cells if cell.is_summary]
    same = grouped(summaries, _identity)
    findings: list[Finding] = []
    conclusions: list[Conclusion] = []
    compared: list[PrintedValue] = []
    tested = loose = 0
    for place, cells in grouped(summaries, lambda c: (c.table, *c.group, c.scene)).items():
        made = [_averaged(cell, scenes, queries, precise) for cell in cells]
        known = [average for average in made if average is not None]
        if not known:
            continue
        where = ", ".join(filter(None, place))
        conclusions.append(Conclusion("average", where, _conclusion(known)))
        pooled = False
        # Judged together: by what is known of their weights, medians last.
        ordered = sorted(known, key=lambda a: (not a.is_weighed, a.is_median))
        for kind in grouped(ordered, lambda a: (a.is_weighed, a.is_median)).values():
            # What one kind shows to be averaged over queries, no other need be over scenes.
            pooled = _is_pooled(kind) or (pooled and not kind[0].is_weighed)
            compared += [cell for a in kind for cell in (a.cell, *a.scenes)]
            judged = [_judge(a, same[_identity(a.cell)], pooled=pooled) for a in kind]
            found = [finding for finding in judged if finding]
            findings += found
            free = len(kind) - len(found) if pooled and not kind[0].is_weighed else 0
            tested, loose = tested + len(kind) - free, loose + free
    left = {
        "may be over all queries, whose numbers are not known (--counts), so that only lying "
        "between the scenes' values was checked": loose,
        "whose scenes are not all, or not at all, in the file": len(summaries) - tested - loose,
    }
    why = "; ".join(f"{number} {reason}" for reason, number in left.items() if number)
    return Outcome(
        "average",
        tested,
        "averages against the scenes they are of",
        why if summaries else "nothing is printed for several scenes",
        tuple(findings),
        tuple(conclusions),
        tuple(compared),
        unchecked=loose,
    )


def _identity(cell: PrintedValue) -> tuple[object, ...]:
    return cell.group, cell.method, cell.score.name


def _averaged(
    cell: PrintedValue,
    scenes: Mapping[tuple[str, ...], Mapping[str, Mapping[str, PrintedValue]]],
    queries: Mapping[Key, Queries],
    precise: Collection[Key],
) -> _Averaged | None:
    by_scene = scenes.get((*cell.group, cell.score.name), {})
    parts = [by_method[cell.method] for by_method in by_scene.values() if cell.method in by_method]
    if len(parts) < 2 or len(parts) < len(by_scene):
        return None
    values = [_exact(part, queries, precise) for part in parts]
    counts = [queries[key_of(part)].number for part in parts if key_of(part) in queries]
    is_of_queries = cell.score.family in (Family.HITS, Family.AVERAGE_PRECISION)
    is_weighed = is_of_queries and len(counts) == len(parts)
    # Whatever the weights, a mean or a median of all lies between those of the parts.
    between = Span(min(v.low for v in values), max(v.high for v in values))
    return _Averaged(
        cell,
        tuple(parts),
        mean_span(values, [1] * len(values)),
        mean_span(values, counts) if is_weighed else between,
        sum((part.number.value for part in parts), Fraction(0)) / len(parts),
        is_weighed,
    )


def _exact(cell: PrintedValue, queries: Mapping[Key, Queries], precise: Collection[Key]) -> Span:
    """Return where the true value lies: at a count, where it is one and counts are known."""
    known = queries.get(key_of(cell))
    if known is not None and cell.score.family is Family.HITS:
        return counted_share(cell.number, known.number, cell.full)
    if known is not None and score_of(cell) in precise:
        return counted_share(cell.number, known.number * cell.score.cutoff, cell.full)
    return cell.number.span


def mean_span(parts: Sequence[Span], weights: Sequence[int]) -> Span:
    """Return where the weighted mean of numbers lies, each known by an interval."""
    total = sum(weights)
    low, high = (
        sum((getattr(part, end) * n for part, n in zip(parts, weights, strict=True)), Fraction(0))
        for end in ("low", "high")
    )
    return Span(low / total, high / total)


def _is_pooled(known: Sequence[_Averaged]) -> bool:
    """Whether averages of one place and kind are rather over all queries than over scenes."""
    if known[0].cell.is_pooled:
        return True
    over_scenes = sum(average.fits_scenes for average in known)
    if known[0].is_weighed:
        return sum(average.fits_queries for average in known) > over_scenes
    if known[0].is_median:
        # A median of all queries is no mean of medians by any weights.
        return 3 * over_scenes < 2 * len(known)
    return 2 * over_scenes <= len(known) or (over_scenes < len(known) and has_common_weights(known))


def has_common_weights(averages: Sequence[_Averaged]) -> bool:
    """Whether some weights of the scenes, alike for all methods and scores, explain all averages.

    A linear program: with values v between l and h, and an average between a and b, weights w are
    to satisfy sum w (l - b) <= 0 <= sum w (h - a).
    """
    scenes = dict.fromkeys(part.scene for average in averages for part in average.scenes)
    columns = {scene: index for index, scene in enumerate(scenes)}
    bounds = np.zeros((2 * len(averages), len(columns)))
    for row, average in enumerate(averages):
        printed = average.cell.number.span
        for part in average.scenes:
            value, column = part.number.span, columns[part.scene]
            bounds[2 * row, column] = float(value.low - printed.high)
            bounds[2 * row + 1, column] = float(printed.low - value.high)
    nothing, limits = np.zeros(len(columns)), np.zeros(len(bounds))
    whole = np.ones((1, len(columns)))
    found = linprog(nothing, bounds, limits, whole, [1.0], bounds=(1e-6, None))
    return bool(found.status == 0)


def _conclusion(known: Sequence[_Averaged]) -> str:
    exact = sum(average.fits_scenes for average in known)
    rounded = sum(average.fits_rounded and not average.fits_scenes for average in known)
    weighed = [average for average in known if average.is_weighed]
    medians = [average for average in known if average.is_median]
    are = agreeing(exact, "is an unweighted mean", "are unweighted means")
    text = f"of {counted(len(known), 'average')}, {exact} {are} over scenes"
    if medians:
        fitting = sum(average.fits_scenes for average in medians)
        text += f" (of {counted(len(medians), 'median')} {fitting})"
    if rounded:
        text += f", {rounded} more {agreeing(rounded, 'is', 'are')} so of the rounded values only"
    if weighed:
        pooled = sum(average.fits_queries for average in weighed)
        are = agreeing(pooled, "is a mean", "are means")
        text += f"; {pooled} of {len(weighed)} {are} over all queries"
    fitting_both = [average for average in weighed if average.fits_scenes]
    if not fitting_both:
        return text
    # The method whose averages tell the two ways apart most.
    most = max(fitting_both, key=lambda a: abs(a.over_scenes.low - a.over_queries.low))
    shown = []
    for average in (a for a in fitting_both if a.cell.method == most.cell.method):
        ways, digits = (average.over_scenes, average.over_queries), average.cell.number.decimals
        scenes, queries = (decimal_text((way.low + way.high) / 2, digits) for way in ways)
        shown.append(f"{average.cell.score.name} {scenes} and {queries}")
    return f"{text}; {most.cell.method}, over scenes and over all queries: {', '.join(shown)}"


def _judge(average: _Averaged, same: Sequence[PrintedValue], *, pooled: bool) -> Finding | None:
    cell, number = average.cell, average.cell.number
    mean = average.over_queries if pooled else average.over_scenes
    if number.span.meets(mean):
        return None
    low, high = (decimal_text(end, number.decimals + 2) for end in (mean.low, mean.high))
    of = counted(len(average.scenes), "scene")
    if pooled and not average.is_weighed:
        why = f"no average of {of} whose values lie between {low} and {high}"
    else:
        kind = f"mean over all queries of {of}" if pooled else f"mean of {of}"
        shown = low if low == high else f"{low} to {high}"
        rounded = decimal_text(mean.low, number.decimals)
        why = f"the {kind} is {shown}, which rounds to {rounded}"
    why += f"; printed here is {number.text}"
    others = [c for c in same if c.table != cell.table and c.number.value != number.value]
    why += "".join(f", in {other.table} {other.number.text}" for other in others)
    if not pooled and average.fits_rounded:
        twice = decimal_text(average.of_rounded, number.decimals + 2)
        why += f"; the scenes' values as printed have the mean {twice}, so it was rounded twice"
        return Finding(Grade.ROUNDING, "average", cell, why)
    if number.span.widened(2 * number.half).meets(mean):
        return Finding(Grade.ROUNDING, "average", cell, why + ": off by the last digit")
    return Finding(Grade.INCONSISTENT, "average", cell, why)


@dataclass(frozen=True)
class _Gain:
    """A printed gain, its value, and the value that it is over; None where there is none."""

    cell: PrintedValue
    gain: Rounded
    base: PrintedValue | None = None

    @property
    def off(self) -> Fraction | float:
        """How far the gain is from the difference, beyond its own rounding.

        What is better low counts either way.
        """
        if self.base is None:
            return math.inf
        value, base = self.cell.number, self.base.number
        own = self.gain.half if self.gain.decimals < max(value.decimals, base.decimals) else 0
        signs = (1, -1) if self.cell.score.higher_is_better is False else (1,)
        away = min(abs(self.gain.value - sign * (value.value - base.value)) for sign in signs)
        return max(Fraction(0), away - own)

    @property
    def is_explained(self) -> bool:
        """Whether it is the difference, where all three were rounded, or cut off."""
        other = self.base.number.half if self.base else 0
        return self.off <= self.cell.number.half + self.gain.half + other


def check_gains(published: Published) -> Outcome:
    """Find printed gains that are not the difference of the printed values."""
    findings: list[Finding] = []
    conclusions: list[Conclusion] = []
    compared: list[PrintedValue] = []
    columns = published.by(_column)
    printed = [_Gain(cell, cell.gain) for cell in published.cells if cell.gain]
    unexplained = 0
    for place, gains in grouped(printed, lambda g: (g.cell.table, g.cell.method)).items():
        base, based = _baseline(gains, columns)
        if base is None:
            number = counted(len(gains), "gain")
            text = f"no method of the table explains more than half of {number}"
            unexplained += len(gains)
        else:
            explained = sum(gain.is_explained for gain in based)
            are = agreeing(explained, "is", "are")
            text = f"gains are over {base}: {explained} of {len(gains)} {are} right up to the last "
            text += "digit"
            compared += [cell for gain in based for cell in (gain.cell, gain.base) if cell]
            findings += [found for gain in based if (found := _judge_gain(gain, base))]
        conclusions.append(Conclusion("gain", ", ".join(filter(None, place)), text))
    left = f"gains over no method of the table: {unexplained}" if unexplained else ""
    return Outcome(
        "gain",
        len(printed) - unexplained,
        "printed gains, whether they are the difference of the printed values",
        left if printed else "no gain is printed",
        tuple(findings),
        tuple(conclusions),
        tuple(compared),
    )


def _column(cell: PrintedValue) -> tuple[str, ...]:
    return cell.table, *cell.group, cell.scene, cell.score.name


def _baseline(
    gains: Sequence[_Gain], columns: Mapping[tuple[str, ...], Sequence[PrintedValue]]
) -> tuple[str | None, list[_Gain]]:
    """Return the method that the gains are over, by merit, then name, then place in the file."""
    method = gains[0].cell.method
    stem = re.sub(r"\s*\(.*\)$", "", method).casefold()
    explained: Counter[str] = Counter()
    lines: dict[str, int] = {}
    best = []
    for gain in gains:
        column = columns[_column(gain.cell)]
        for cell in column:
            if cell.method != method:
                lines.setdefault(cell.method, cell.line)
                explained[cell.method] += replace(gain, base=cell).is_explained
        plain = [cell for cell in column if cell.gain is None]
        pick = min if gain.cell.score.higher_is_better is False else max
        best.append(replace(gain, base=pick(plain, key=lambda c: c.number.value, default=None)))

    def merit(name: str) -> tuple[int, bool, int]:
        return explained[name], name.casefold() == stem, -lines[name]

    over = max(lines, key=merit, default=None)
    over_best = sum(gain.is_explained for gain in best)
    if over_best > explained[over or ""] and 2 * over_best > len(gains):
        return _BEST, best
    if over is None or not (over.casefold() == stem or 2 * explained[over] > len(gains)):
        return None, []
    named = [{c.method: c for c in reversed(columns[_column(g.cell)])} for g in gains]
    return over, [replace(g, base=cells.get(over)) for g, cells in zip(gains, named, strict=True)]


def _judge_gain(gain: _Gain, base: str) -> Finding | None:
    if gain.off == 0:
        return None
    if gain.base is None:
        why = f"{base}, over which the gain {gain.gain.text} is, has no number here"
        return Finding(Grade.INCONSISTENT, "gain", gain.cell, why)
    value, other = gain.cell.number, gain.base.number
    digits = max(value.decimals, other.decimals, gain.gain.decimals)
    difference = value.value - other.value
    sign = "+" if difference > 0 else ""
    why = (
        f"{value.text} - {other.text} ({gain.base.method}) = {sign}"
        f"{decimal_text(difference, digits)}, but the printed gain is {gain.gain.text}"
    )
    if gain.is_explained:
        why += ": off by the last digit, as where it was computed before rounding"
        return Finding(Grade.ROUNDING, "gain", gain.cell, why)
    return Finding(Grade.INCONSISTENT, "gain", gain.cell, why)
