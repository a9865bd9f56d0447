"""Averages: over scenes or over queries, of exact or of rounded values, and which do not agree."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial

import numpy as np

from airzoo_bench.audit.findings import Conclusion, Finding, Grade, Outcome
from airzoo_bench.audit.queries import Key, Queries, key_of
from airzoo_bench.core.errors import agreeing, counted
from airzoo_bench.tables.printed_numbers import (
    Interval,
    Rounded,
    counted_share,
    decimal_text,
    mean_interval,
)
from airzoo_bench.tables.printed_scores import Family
from airzoo_bench.tables.printed_values import PrintedValue, Published, grouped

__all__ = ["Averaged", "check_averages", "has_common_weights"]

_CHECK = "average"
_WHAT = "averages against the scenes they are of"
Scenes = Mapping[tuple[str, ...], Mapping[str, Mapping[str, PrintedValue]]]


@dataclass(frozen=True)
class Averaged:
    """A printed average with the scenes' values it should be made of.

    Attributes
    ----------
    over_scenes : Interval
        Where the unweighted mean of the exact values lies.
    over_queries : Interval
        Where the mean over all queries lies; between the least and the greatest scene where it is
        not known how many queries these have, and for medians.
    of_rounded : Fraction
        The unweighted mean of the values as printed.
    is_weighed : bool
        Whether it is known how many queries the scenes have.
    """

    cell: PrintedValue
    scenes: tuple[PrintedValue, ...]
    over_scenes: Interval
    over_queries: Interval
    of_rounded: Fraction
    is_weighed: bool

    @property
    def is_median(self) -> bool:
        """Whether it is of medians."""
        return self.cell.score.family is Family.MEDIAN

    @property
    def fits_scenes(self) -> bool:
        """Whether it rounds the unweighted mean over scenes."""
        return self.cell.number.interval.meets(self.over_scenes)

    @property
    def fits_queries(self) -> bool:
        """Whether it rounds a mean over all queries."""
        return self.cell.number.interval.meets(self.over_queries)

    @property
    def fits_rounded(self) -> bool:
        """Whether it rounds the mean of the values as printed."""
        return abs(self.cell.number.value - self.of_rounded) <= self.cell.number.half


def has_common_weights(averages: Sequence[Averaged]) -> bool:
    """Whether some weights of the scenes, alike for all methods and scores, explain all averages.

    A linear program: with values v between l and h, and an average between a and b, weights w are
    to satisfy sum w (l - b) <= 0 <= sum w (h - a).
    """
    from scipy.optimize import linprog

    scenes = {part.scene: None for average in averages for part in average.scenes}
    columns = {scene: index for index, scene in enumerate(scenes)}
    bounds = np.zeros((2 * len(averages), len(columns)))
    for row, average in enumerate(averages):
        printed = average.cell.number.interval
        for part in average.scenes:
            value, column = part.number.interval, columns[part.scene]
            bounds[2 * row, column] = float(value.low - printed.high)
            bounds[2 * row + 1, column] = float(printed.low - value.high)
    nothing, limits = np.zeros(len(columns)), np.zeros(len(bounds))
    whole = np.ones((1, len(columns)))
    found = linprog(nothing, bounds, limits, whole, [1.0], bounds=(1e-6, None))
    return bool(found.status == 0)


def _shown_mean(mean: Interval, number: Rounded) -> str:
    """Write a mean with two digits more than printed, or as far as it is known."""
    low, high = (decimal_text(end, number.decimals + 2) for end in (mean.low, mean.high))
    return low if low == high else f"{low} to {high}"


def _example_text(weighed: Sequence[Averaged]) -> str:
    """Show the method whose averages tell the two ways apart most."""
    fitting = [average for average in weighed if average.fits_scenes]
    if not fitting:
        return ""
    most = max(fitting, key=lambda a: abs(a.over_scenes.low - a.over_queries.low))
    shown = []
    for average in (a for a in fitting if a.cell.method == most.cell.method):
        ways = (average.over_scenes, average.over_queries)
        digits = average.cell.number.decimals
        scenes, pooled = (decimal_text((way.low + way.high) / 2, digits) for way in ways)
        shown.append(f"{average.cell.score.name} {scenes} and {pooled}")
    return f"; {most.cell.method}, over scenes and over all queries: {', '.join(shown)}"


def check_averages(
    published: Published, queries: Mapping[Key, Queries], variants: Mapping[Key, str]
) -> Outcome:
    """Tell over what a table averages, and find the averages that the scenes do not give."""
    scenes = _scenes(published)
    exact = partial(_exact, queries=queries, variants=variants)
    findings: list[Finding] = []
    conclusions: list[Conclusion] = []
    summaries = [cell for cell in published.cells if cell.is_summary]
    same = grouped(summaries, _identity)
    compared: list[PrintedValue] = []
    tested = loose = 0
    for place, cells in grouped(summaries, lambda c: (c.table, *c.group, c.scene)).items():
        made = [_averaged(cell, scenes, queries, exact) for cell in cells]
        known = [average for average in made if average is not None]
        if not known:
            continue
        conclusions.append(Conclusion(_CHECK, ", ".join(filter(None, place)), _conclusion(known)))
        pooled = False
        for kind in _kinds(known):
            # What one kind shows to be averaged over queries, no other need be over scenes.
            pooled = _is_pooled(kind) or (pooled and not kind[0].is_weighed)
            compared += [cell for a in kind for cell in (a.cell, *a.scenes)]
            judged = (_judge(a, same[_identity(a.cell)], pooled=pooled) for a in kind)
            found = [finding for finding in judged if finding]
            findings += found
            free = len(kind) - len(found) if pooled and not kind[0].is_weighed else 0
            tested, loose = tested + len(kind) - free, loose + free
    left = _left(len(summaries), tested, loose)
    outcome = Outcome(_CHECK, tested, _WHAT, left, tuple(findings), tuple(conclusions))
    return replace(outcome, cells=tuple(compared), unchecked=loose)


def _left(summaries: int, tested: int, loose: int) -> str:
    if not summaries:
        return "nothing is printed for several scenes"
    counts = {
        "may be over all queries, whose numbers are not known (--counts), so that only lying "
        "between the scenes' values was checked": loose,
        "whose scenes are not all, or not at all, in the file": summaries - tested - loose,
    }
    return "; ".join(f"{number} {why}" for why, number in counts.items() if number)


def _scenes(published: Published) -> Scenes:
    """Return the scenes' cells: by benchmark, track and score, then scene, then method."""
    scenes: dict[tuple[str, ...], dict[str, dict[str, PrintedValue]]] = {}
    for cell in published.cells:
        if not cell.is_summary:
            by_scene = scenes.setdefault((*cell.group, cell.score.name), {})
            # Of a cell that is printed twice the first counts; another check compares them.
            by_scene.setdefault(cell.scene, {}).setdefault(cell.method, cell)
    return scenes


def _averaged(
    cell: PrintedValue,
    scenes: Scenes,
    queries: Mapping[Key, Queries],
    exact: Callable[[PrintedValue], Interval],
) -> Averaged | None:
    by_scene = scenes.get((*cell.group, cell.score.name), {})
    parts = [by_method[cell.method] for by_method in by_scene.values() if cell.method in by_method]
    if len(parts) < 2 or len(parts) < len(by_scene):
        return None
    values = [exact(part) for part in parts]
    counts = [queries[key_of(part)].number for part in parts if key_of(part) in queries]
    is_of_queries = cell.score.family in (Family.HITS, Family.AVERAGE_PRECISION)
    is_weighed = is_of_queries and len(counts) == len(parts)
    # Whatever the weights, a mean or a median of all lies between those of the parts.
    between = Interval(min(v.low for v in values), max(v.high for v in values))
    return Averaged(
        cell,
        tuple(parts),
        mean_interval(values),
        mean_interval(values, counts) if is_weighed else between,
        sum((part.number.value for part in parts), Fraction(0)) / len(parts),
        is_weighed,
    )


def _exact(
    cell: PrintedValue, queries: Mapping[Key, Queries], variants: Mapping[Key, str]
) -> Interval:
    """Return where the true value lies: at a count, where it is one and counts are known."""
    known = queries.get(key_of(cell))
    if known is not None and cell.score.family is Family.HITS:
        return counted_share(cell.number, known.number, cell.full)
    variant = variants.get((*cell.group, cell.score.name))
    if known is not None and variant == "precision":
        return counted_share(cell.number, known.number * cell.score.cutoff, cell.full)
    return cell.number.interval


def _is_pooled(known: Sequence[Averaged]) -> bool:
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


def _kinds(known: Sequence[Averaged]) -> list[list[Averaged]]:
    """Group averages that are judged together: by what is known of their weights, medians last."""
    ordered = sorted(known, key=lambda a: (not a.is_weighed, a.is_median))
    return list(grouped(ordered, lambda a: (a.is_weighed, a.is_median)).values())


def _conclusion(known: Sequence[Averaged]) -> str:
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
    return text + _example_text(weighed)


def _judge(average: Averaged, same: Sequence[PrintedValue], *, pooled: bool) -> Finding | None:
    cell, number = average.cell, average.cell.number
    mean = average.over_queries if pooled else average.over_scenes
    if number.interval.meets(mean):
        return None
    shown, rounded = _shown_mean(mean, number), decimal_text(mean.low, number.decimals)
    of = counted(len(average.scenes), "scene")
    if pooled and not average.is_weighed:
        why = f"no average of {of} whose values lie between {shown.replace(' to ', ' and ')}"
    else:
        kind = f"mean over all queries of {of}" if pooled else f"mean of {of}"
        why = f"the {kind} is {shown}, which rounds to {rounded}"
    why += f"; printed here is {number.text}"
    others = [c for c in same if c.table != cell.table and c.number.value != number.value]
    why += "".join(f", in {other.table} {other.number.text}" for other in others)
    if not pooled and average.fits_rounded:
        twice = decimal_text(average.of_rounded, number.decimals + 2)
        why += f"; the scenes' values as printed have the mean {twice}, so it was rounded twice"
        return Finding(Grade.ROUNDING, _CHECK, cell, why)
    if number.interval.widened(2 * number.half).meets(mean):
        return Finding(Grade.ROUNDING, _CHECK, cell, why + ": off by the last digit")
    return Finding(Grade.INCONSISTENT, _CHECK, cell, why)


def _identity(cell: PrintedValue) -> tuple[object, ...]:
    return cell.group, cell.method, cell.score.name
