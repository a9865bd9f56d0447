"""A printed average beside the two means that it may be."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from airzoo_bench.tables.printed.cells import PrintedValue
from airzoo_bench.tables.printed.numbers import Interval, Rounded, decimal_text
from airzoo_bench.tables.printed.scores import Family

__all__ = ["Averaged", "example_text", "has_common_weights", "shown_mean"]


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
        Whether the mean over all queries was computed.
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
    whole = np.ones((1, len(columns)))
    found = linprog(
        np.zeros(len(columns)), bounds, np.zeros(len(bounds)), whole, [1.0], bounds=(1e-6, None)
    )
    return bool(found.status == 0)


def shown_mean(mean: Interval, number: Rounded) -> str:
    """Write a mean with two digits more than printed, or as far as it is known."""
    low, high = (decimal_text(end, number.decimals + 2) for end in (mean.low, mean.high))
    return low if low == high else f"{low} to {high}"


def example_text(weighed: Sequence[Averaged]) -> str:
    """Show the method whose averages tell the two ways apart most."""
    fitting = [average for average in weighed if average.fits_scenes]
    if not fitting:
        return ""
    most = max(fitting, key=lambda a: abs(a.over_scenes.low - a.over_queries.low))
    shown = [_both(a) for a in fitting if a.cell.method == most.cell.method]
    return f"; {most.cell.method}, over scenes and over all queries: {', '.join(shown)}"


def _both(average: Averaged) -> str:
    digits = average.cell.number.decimals
    ways = (average.over_scenes, average.over_queries)
    scenes, pooled = (decimal_text((way.low + way.high) / 2, digits) for way in ways)
    return f"{average.cell.score.name} {scenes} and {pooled}"
