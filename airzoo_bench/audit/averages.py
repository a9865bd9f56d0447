"""Averages against their scenes, and gains against the differences of the values."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from decimal import Decimal
from fractions import Fraction
from typing import NamedTuple

from airzoo_bench.audit.counts import Queries, narrow_span
from airzoo_bench.audit.values import (
    Finding,
    Grade,
    Key,
    Outcome,
    Span,
    Value,
    count_decimals,
    decimal_text,
    group_by,
)
from airzoo_bench.core.errors import counted

_MOST = Fraction(3, 4)  # of averages over scenes, from which on the others are wrong


class _Average(NamedTuple):
    """A printed average with the scenes' values, and the mean of their exact values.

    That lies `over_scenes`, or `over_queries`: between the least and the greatest scene where it is
    not known how many queries these have (not `is_weighed`).
    """

    value: Value
    scenes: list[Value]
    over_scenes: Span
    over_queries: Span
    is_weighed: bool


def check_averages(
    values: Sequence[Value], queries: Mapping[Key, Queries], precise: Collection[Key]
) -> Outcome:
    """Tell over what a table averages, and find the averages that the scenes do not give."""
    # Of a cell that is printed twice the first counts.
    scenes: dict[Key, dict[str, dict[str, Value]]] = {}
    for value in values:
        if not value.cell.is_summary:
            by_scene = scenes.setdefault(value.score_key, {}).setdefault(value.cell.scene, {})
            by_scene.setdefault(value.cell.method, value)
    findings, tested = list[Finding](), 0
    summaries = [value for value in values if value.cell.is_summary]
    for cells in group_by(summaries, lambda v: (v.cell.table, *v.scene_key)).values():
        made = [_average(v, scenes.get(v.score_key, {}), queries, precise) for v in cells]
        known = [one for one in made if one is not None]
        pooled = False
        for is_weighed in (True, False):
            kind = [one for one in known if one.is_weighed is is_weighed]
            fitting = sum(one.value.span.meets(one.over_scenes) for one in kind)
            if any(one.value.cell.scene.casefold() == "pooled" for one in kind):
                pooled = True
            elif is_weighed:
                pooled = sum(one.value.span.meets(one.over_queries) for one in kind) > fitting
            else:  # what shares show to be averaged over queries, no other need be over scenes
                pooled = pooled or fitting < _MOST * len(kind)
            tested += len(kind)
            findings += filter(None, (_judge_average(one, pooled=pooled) for one in kind))
    return Outcome("average", tested, findings)


def _average(
    value: Value,
    scenes: Mapping[str, Mapping[str, Value]],
    queries: Mapping[Key, Queries],
    precise: Collection[Key],
) -> _Average | None:
    method = value.cell.method
    parts = [by_method[method] for by_method in scenes.values() if method in by_method]
    if len(parts) < 2 or len(parts) < len(scenes):
        return None
    is_count = value.score.kind == "hits" or value.score_key in precise
    spans = [narrow_span(v, queries.get(v.scene_key) if is_count else None) for v in parts]
    counts = [queries[part.scene_key].number for part in parts if part.scene_key in queries]
    is_weighed = value.score.kind in ("hits", "ap") and len(counts) == len(parts)
    # Whatever the weights, a mean or a median of all lies between those of the parts.
    over_queries = Span(min(span.low for span in spans), max(span.high for span in spans))
    if is_weighed:
        over_queries = _mean(spans, counts)
    return _Average(value, parts, _mean(spans, [1] * len(spans)), over_queries, is_weighed)


def _mean(parts: Sequence[Span], weights: Sequence[int]) -> Span:
    """Return where the weighted mean of numbers lies, each known by an interval."""
    ends = ([part[end] * n for part, n in zip(parts, weights, strict=True)] for end in (0, 1))
    low, high = (sum(end, Fraction(0)) / sum(weights) for end in ends)
    return Span(low, high)


def _judge_average(average: _Average, *, pooled: bool) -> Finding | None:
    value, cell = average.value, average.value.cell
    mean = average.over_queries if pooled else average.over_scenes
    if value.span.meets(mean):
        return None
    low, high = (decimal_text(end, value.decimals + 2) for end in mean)
    shown = low if low == high else f"{low} to {high}"
    over = " over all queries" * pooled
    why = f"the mean{over} of {counted(len(average.scenes), 'scene')} is {shown}, "
    why += f"printed is {cell.value}"
    of_rounded = sum((part.number for part in average.scenes), Fraction(0)) / len(average.scenes)
    if not pooled and abs(value.number - of_rounded) <= value.half:
        why += ", the mean of the scenes' values as printed"
    elif not value.span.widen(2 * value.half).meets(mean):
        return Finding(Grade.INCONSISTENT, "average", cell, why)
    return Finding(Grade.ROUNDING, "average", cell, why + ": off by the last digit")


class _Gain(NamedTuple):
    """A value with a printed gain, and the value that it is over."""

    value: Value
    gain: Decimal
    base: Value

    def is_off(self, most: Fraction) -> bool:
        """Whether the gain is further from the difference; of errors, either way counts as one."""
        signs = (1, -1) if self.value.score.better is False else (1,)
        difference, gain = self.value.number - self.base.number, Fraction(self.gain)
        return min(abs(gain - sign * difference) for sign in signs) > most

    @property
    def half(self) -> Fraction:
        """Half a step of its last digit."""
        return Fraction(1, 2 * 10 ** count_decimals(self.gain))

    @property
    def is_explained(self) -> bool:
        """Whether it is the difference, where all three were rounded, or cut off."""
        reach = self.value.half + self.slack + self.half + self.base.half
        return not self.is_off(reach)

    @property
    def slack(self) -> Fraction:
        """How far the gain may be off where it has fewer digits than the values."""
        most = max(self.value.decimals, self.base.decimals)
        return self.half if count_decimals(self.gain) < most else Fraction(0)


def check_gains(values: Sequence[Value]) -> Outcome:
    """Find printed gains that are not the difference of the printed values."""
    findings, tested = list[Finding](), 0
    columns = group_by(values, lambda value: value.column)
    printed = [value for value in values if value.cell.gain is not None]
    for gained in group_by(printed, lambda v: (v.cell.table, v.cell.method)).values():
        gains = _find_baseline(gained, columns)
        tested += len(gains)
        findings += filter(None, map(_judge_gain, gains))
    return Outcome("gain", tested, findings)


def _find_baseline(
    gained: Sequence[Value], columns: Mapping[tuple[str, ...], Sequence[Value]]
) -> list[_Gain]:
    """Find the method that the gains are over, by merit, then name, then place in the file."""
    method = gained[0].cell.method
    stem = re.sub(r"\s*\(.*\)$", "", method).casefold()
    explained: Counter[str] = Counter()
    best = []
    for value in gained:
        gain = value.cell.gain or Decimal(0)
        for other in columns[value.column]:
            if other.cell.method != method:
                explained[other.cell.method] += _Gain(value, gain, other).is_explained
        plain = [other for other in columns[value.column] if other.cell.gain is None]
        pick = min if value.score.better is False else max
        if plain:
            best.append(_Gain(value, gain, pick(plain, key=lambda v: v.number)))
    over_best = sum(gain.is_explained for gain in best)
    # The first of equals in the file, unless one has the method's name.
    over = max(explained, key=lambda n: (explained[n], n.casefold() == stem), default="")
    if over_best > explained[over] and 2 * over_best > len(gained):
        return best
    if not over or not (over.casefold() == stem or 2 * explained[over] > len(gained)):
        return []
    return [
        _Gain(value, value.cell.gain or Decimal(0), other)
        for value in gained
        for other in columns[value.column]
        if other.cell.method == over
    ]


def _judge_gain(gain: _Gain) -> Finding | None:
    if not gain.is_off(gain.slack):
        return None
    cell, other = gain.value.cell, gain.base.cell
    why = (
        f"{cell.value} - {other.value} ({other.method}) = {cell.value - other.value:+}, "
        f"but the printed gain is {gain.gain:+}"
    )
    grade = Grade.ROUNDING if gain.is_explained else Grade.INCONSISTENT
    why += ": off by the last digit, as where it was computed before rounding" * gain.is_explained
    return Finding(grade, "gain", cell, why)
