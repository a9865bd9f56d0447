"""Averages against their scenes, and gains against the differences of the values."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

from airzoo_bench.audit.counts import Key, Queries, counted_share, key_of, score_of
from airzoo_bench.audit.findings import Finding, Grade, Outcome
from airzoo_bench.audit.values import Family, Span, Value, decimal_text
from airzoo_bench.core.errors import agreeing, counted
from airzoo_bench.tables.published import Rounded, grouped

_BEST = "the best of the others"
_MOST = Fraction(3, 4)  # of averages over scenes, from which on the others are wrong


@dataclass(frozen=True)
class _Averaged:
    """A printed average with the scenes' values it should be made of.

    The exact values' mean lies `over_scenes`, or `over_queries`: between the least and the greatest
    scene for medians, and where it is not known how many queries these have (not `is_weighed`).
    """

    cell: Value
    scenes: tuple[Value, ...]
    over_scenes: Span
    over_queries: Span
    is_weighed: bool

    @property
    def kind(self) -> tuple[bool, bool]:
        """How its weights are known, medians last; averages of one kind are judged together."""
        return not self.is_weighed, self.cell.score.family is Family.MEDIAN

    @property
    def fits_scenes(self) -> bool:
        """Whether it rounds the unweighted mean over scenes."""
        return self.cell.span.meets(self.over_scenes)

    @property
    def fits_queries(self) -> bool:
        """Whether it rounds a mean over all queries."""
        return self.cell.span.meets(self.over_queries)


def check_averages(
    values: Sequence[Value], queries: Mapping[Key, Queries], precise: Collection[Key]
) -> Outcome:
    """Tell over what a table averages, and find the averages that the scenes do not give."""
    scenes: dict[Key, dict[str, dict[str, Value]]] = {}
    for value in values:
        if not value.is_summary:
            by_scene = scenes.setdefault(score_of(value), {})
            # Of a cell that is printed twice the first counts; another check compares them.
            by_scene.setdefault(value.scene, {}).setdefault(value.method, value)
    summaries = [value for value in values if value.is_summary]
    same = grouped(summaries, _identity)
    findings, conclusions, compared = list[Finding](), list[str](), list[Value]()
    tested = loose = 0
    for place, cells in grouped(summaries, lambda c: (c.table, *c.group, c.scene)).items():
        made = [_averaged(cell, scenes, queries, precise) for cell in cells]
        known = sorted((one for one in made if one), key=lambda one: one.kind)
        if known:
            where = ", ".join(filter(None, place))
            conclusions.append(f"average of {where}: {_conclusion(known)}")
        pooled = False
        for kind in grouped(known, lambda one: one.kind).values():
            # What one kind shows to be averaged over queries, no other need be over scenes.
            is_loose = not kind[0].is_weighed
            pooled = _is_pooled(kind) or (pooled and is_loose)
            compared += [cell for one in kind for cell in (one.cell, *one.scenes)]
            found = [_judge(one, same[_identity(one.cell)], pooled=pooled) for one in kind]
            findings += filter(None, found)
            free = found.count(None) if pooled and is_loose else 0
            tested, loose = tested + len(kind) - free, loose + free
    left = {
        "may be over all queries, whose numbers are not known (--counts)": loose,
        "whose scenes are not all in the file": len(summaries) - tested - loose,
    }
    why = "; ".join(f"{number} {reason}" for reason, number in left.items() if number)
    none = "nothing is printed for several scenes"
    what, left_out = "averages against the scenes they are of", why if summaries else none
    all_found = (tuple(findings), tuple(conclusions), tuple(compared))
    return Outcome("average", tested, what, left_out, *all_found)


def _identity(cell: Value) -> tuple[object, ...]:
    return cell.group, cell.method, cell.metric


def _averaged(
    cell: Value,
    scenes: Mapping[Key, Mapping[str, Mapping[str, Value]]],
    queries: Mapping[Key, Queries],
    precise: Collection[Key],
) -> _Averaged | None:
    by_scene = scenes.get(score_of(cell), {})
    parts = [by_method[cell.method] for by_method in by_scene.values() if cell.method in by_method]
    if len(parts) < 2 or len(parts) < len(by_scene):
        return None
    spans = [_exact(part, queries, precise) for part in parts]
    counts = [queries[key_of(part)].number for part in parts if key_of(part) in queries]
    is_of_queries = cell.score.family in (Family.HITS, Family.AVERAGE_PRECISION)
    is_weighed = is_of_queries and len(counts) == len(parts)
    # Whatever the weights, a mean or a median of all lies between those of the parts.
    between = Span(min(span.low for span in spans), max(span.high for span in spans))
    over_queries = _mean(spans, counts) if is_weighed else between
    return _Averaged(cell, tuple(parts), _mean(spans, [1] * len(spans)), over_queries, is_weighed)


def _exact(cell: Value, queries: Mapping[Key, Queries], precise: Collection[Key]) -> Span:
    """Return where the true value lies: at a count, where it is one and counts are known."""
    is_hits = cell.score.family is Family.HITS
    places = 1 if is_hits else cell.score.cutoff if score_of(cell) in precise else 0
    known = queries.get(key_of(cell))
    if known is None or not places:
        return cell.span
    return counted_share(cell.number, known.number * places, cell.full)


def _mean(parts: Sequence[Span], weights: Sequence[int]) -> Span:
    """Return where the weighted mean of numbers lies, each known by an interval."""
    weighed = list(zip(parts, weights, strict=True))
    low = sum((part.low * n for part, n in weighed), Fraction(0))
    high = sum((part.high * n for part, n in weighed), Fraction(0))
    return Span(low / sum(weights), high / sum(weights))


def _is_pooled(known: Sequence[_Averaged]) -> bool:
    """Whether averages of one place and kind are rather over all queries than over scenes."""
    over_scenes = sum(average.fits_scenes for average in known)
    if known[0].cell.is_pooled:
        return True
    if known[0].is_weighed:
        return sum(average.fits_queries for average in known) > over_scenes
    return over_scenes < _MOST * len(known)


def _conclusion(known: Sequence[_Averaged]) -> str:
    exact = sum(average.fits_scenes for average in known)
    weighed = [average for average in known if average.is_weighed]
    are = agreeing(exact, "is an unweighted mean", "are unweighted means")
    text = f"of {counted(len(known), 'average')}, {exact} {are} over scenes"
    if weighed:
        pooled = sum(average.fits_queries for average in weighed)
        are = agreeing(pooled, "is a mean", "are means")
        text += f"; {pooled} of {len(weighed)} {are} over all queries"
    return text


def _judge(average: _Averaged, same: Sequence[Value], *, pooled: bool) -> Finding | None:
    cell, number = average.cell, average.cell.number
    mean = average.over_queries if pooled else average.over_scenes
    if cell.span.meets(mean):
        return None
    low, high = (decimal_text(end, number.decimals + 2) for end in (mean.low, mean.high))
    of = counted(len(average.scenes), "scene")
    if pooled and not average.is_weighed:
        why = f"no average of {of} whose values lie between {low} and {high}"
    else:
        kind = f"mean over all queries of {of}" if pooled else f"mean of {of}"
        shown = low if low == high else f"{low} to {high}"
        why = f"the {kind} is {shown}, which rounds to {decimal_text(mean.low, number.decimals)}"
    why += f"; printed here is {number.text}"
    others = [c for c in same if c.table != cell.table and c.number.value != number.value]
    why += "".join(f", in {other.table} {other.number.text}" for other in others)
    parts = [part.number.value for part in average.scenes]
    of_rounded = sum(parts, Fraction(0)) / len(parts)
    if not pooled and abs(number.value - of_rounded) <= number.half:
        twice = decimal_text(of_rounded, number.decimals + 2)
        why += f"; the scenes' values as printed have the mean {twice}, so it was rounded twice"
        return Finding(Grade.ROUNDING, "average", cell, why)
    if cell.span.widened(2 * number.half).meets(mean):
        return Finding(Grade.ROUNDING, "average", cell, why + ": off by the last digit")
    return Finding(Grade.INCONSISTENT, "average", cell, why)


@dataclass(frozen=True)
class _Gain:
    """A printed gain, its value, and the value that it is over; None where there is none."""

    cell: Value
    gain: Rounded
    base: Value | None = None

    @property
    def off(self) -> Fraction | float:
        """How far the gain is from the difference; of errors, either way counts as one."""
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


def check_gains(values: Sequence[Value]) -> Outcome:
    """Find printed gains that are not the difference of the printed values."""
    findings, conclusions, compared = list[Finding](), list[str](), list[Value]()
    columns = grouped(values, _column)
    printed = [_Gain(value, value.gain) for value in values if value.gain]
    unexplained = 0
    for place, gains in grouped(printed, lambda g: (g.cell.table, g.cell.method)).items():
        base, based = _baseline(gains, columns)
        text = f"no method of the table explains more than half of {counted(len(gains), 'gain')}"
        if base:
            explained = sum(gain.is_explained for gain in based)
            are = agreeing(explained, "is", "are")
            right = f"{explained} of {len(gains)} {are} right up to the last digit"
            text = f"gains are over {base}: {right}"
        unexplained += 0 if base else len(gains)
        compared += [cell for gain in based for cell in (gain.cell, gain.base) if cell]
        findings += filter(None, (_judge_gain(gain, base) for gain in based))
        conclusions.append(f"gain of {', '.join(filter(None, place))}: {text}")
    left = f"gains over no method of the table: {unexplained}" if unexplained else ""
    left, what = left if printed else "no gain is printed", "printed gains, whether they are the "
    what += "difference of the printed values"
    tested, found = len(printed) - unexplained, tuple(findings)
    return Outcome("gain", tested, what, left, found, tuple(conclusions), tuple(compared))


def _column(cell: Value) -> tuple[str, ...]:
    return cell.table, *cell.group, cell.scene, cell.metric


def _baseline(
    gains: Sequence[_Gain], columns: Mapping[tuple[str, ...], Sequence[Value]]
) -> tuple[str, list[_Gain]]:
    """Return the method that the gains are over, by merit, then name, then place in the file."""
    method = gains[0].cell.method
    stem = re.sub(r"\s*\(.*\)$", "", method).casefold()
    explained: Counter[str] = Counter()
    best, named = list[_Gain](), list[dict[str, Value]]()
    for gain in gains:
        others = [cell for cell in columns[_column(gain.cell)] if cell.method != method]
        named.append({cell.method: cell for cell in others})
        for cell in others:
            explained[cell.method] += replace(gain, base=cell).is_explained
        plain = [cell for cell in columns[_column(gain.cell)] if cell.gain is None]
        pick = min if gain.cell.score.higher_is_better is False else max
        best.append(replace(gain, base=pick(plain, key=lambda c: c.number.value, default=None)))
    over_best = sum(gain.is_explained for gain in best)
    # The first of equals in the file, unless one has the method's name.
    over = max(explained, key=lambda n: (explained[n], n.casefold() == stem), default="")
    if over_best > explained[over] and 2 * over_best > len(gains):
        return _BEST, best
    if not over or not (over.casefold() == stem or 2 * explained[over] > len(gains)):
        return "", []
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
