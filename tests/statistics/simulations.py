"""Simulated coverage of intervals and false findings of tests, as coverage.md has them.

``python -m tests.statistics.simulations`` prints all figures of the page, in some three minutes.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from itertools import chain, product
from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.statistics.samples import ResamplingConfig, Sample
from airzoo_bench.statistics.significance import paired_tests
from tests.statistics.coverage import (
    AGREEMENT,
    DESIGNS,
    SATURATED,
    coverage_of_ranks,
    coverage_of_rates,
    coverage_of_shares,
    coverage_over_scenes,
)


class Errors(NamedTuple):
    """Log-normal errors of two methods with equal medians, on scenes of so many queries.

    `spreads` are standard deviations of the methods' logarithms, which correlate; `failures` are
    shares of queries that are infinite: the medians are equal all the same.
    """

    queries: tuple[int, ...]
    spreads: tuple[float, float]
    correlation: float = 0.0
    failures: tuple[float, float] = (0.0, 0.0)

    def drawn(self, count: int, shift: float, seed: int) -> Sample:
        """Draw data sets, the first methods and then the second ones, those shifted."""
        random = np.random.default_rng(seed)
        values = [self._scene(random, count, queries, shift) for queries in self.queries]
        names = tuple(f"s{number}" for number in range(len(values)))
        return Sample("query", names, tuple(values), np.ones(2 * count, bool))

    def _scene(self, random: np.random.Generator, count: int, queries: int, shift: float) -> Floats:
        shared, own = random.standard_normal((2, count, queries))
        mixed = self.correlation * shared + np.sqrt(1 - self.correlation**2) * own
        sides = []
        for logs, spread, share in zip((shared, mixed), self.spreads, self.failures, strict=True):
            errors = np.exp(spread * (logs - ndtri(0.5 / (1 - share))))
            sides.append(np.where(random.random(errors.shape) < share, np.inf, errors))
        return np.concatenate([sides[0], sides[1] * np.exp(shift)])


STATED = {
    "161 queries, spreads 0.5 and 1.5": (Errors((161,), (0.5, 1.5)), 0.25),
    "the same, correlated by 0.6": (Errors((161,), (0.5, 1.5), 0.6), 0.25),
    "100 queries, spreads 0.3 and 2": (Errors((100,), (0.3, 2.0)), 0.4),
}
WITH_FAILURES = {
    "161 queries, 20 and 10 % fail": (Errors((161,), (0.5, 1.5), 0.3, (0.2, 0.1)), 0.3),
    "100 queries, 40 and 10 % fail": (Errors((100,), (0.5, 1.5), 0.3, (0.4, 0.1)), 0.35),
    "161 queries, 30 and 30 % fail": (Errors((161,), (1.0, 1.0), 0.3, (0.3, 0.3)), 0.3),
}
OTHERS = {
    "scenes of 161 and 190": (Errors((161, 190), (0.5, 1.5), 0.6), 0.25),
    "scenes of 18 and 190": (Errors((18, 190), (0.5, 1.5), 0.6), 0.5),
    "18 queries": (Errors((18,), (0.5, 1.5), 0.3), 0.8),
    "6 queries, alike except 0.9": (Errors((6,), (1.0, 1.0), 0.9), 0.6),
    "161 queries, alike except 0.95": (Errors((161,), (1.0, 1.0), 0.95), 0.1),
}


def findings(errors: Errors, count: int, resampling: ResamplingConfig, shift: float = 0.0) -> float:
    """Return the share of data sets in which `compare` finds a difference of medians."""
    pairs = [(row, count + row) for row in range(count)]
    _, tests = paired_tests(errors.drawn(count, shift, 1), resampling, pairs)
    return float(np.mean([test.p_value <= 0.05 for test in tests]))


def _figures_of_ranks(count: int) -> Iterator[str]:
    yield "rank ranges of 12 methods: all true ranks held, and mean width of a range"
    for kind in ("hits", "graded", "errors", "medians"):
        held, width = coverage_of_ranks(kind, count)
        yield f"{kind:10} {100 * held:6.1f} %  {width:.1f}"


def _figures_of_shares(count: int) -> Iterator[str]:
    yield "coverage: average; differences, and how many queries differ, by agreement"
    for soft, (name, scenes) in product((False, True), DESIGNS.items()):
        found = [coverage_of_shares(scenes, count, agree, soft=soft) for agree in AGREEMENT]
        shown = [f"{100 * one.difference:.1f} % ({one.differ:.1f})" for one in found]
        average = f"{100 * found[0].average:.1f} %"
        yield f"| {' | '.join([name, 'AP@5' if soft else 'hits', average, *shown])} |"
    yield "exact coverage in %: of the average, of each scene by itself"
    for scenes in SATURATED:
        exact = [coverage_of_rates(part) for part in (scenes, scenes[:1], scenes[1:])]
        yield f"{scenes!s:38} " + " ".join(f"{100 * share:6.1f}" for share in exact)


def _figures_of_scenes(count: int) -> Iterator[str]:
    yield "where scenes are the units: mean (upper limit not known), difference of equal methods"
    for kind in ("N(5, 1)", "exp N(0, 1)", "beta(5, 2)"):
        for scenes in (5, 6, 8, 11, 16):
            mean, unknown, difference = (
                f"{100 * share:.1f} %" for share in coverage_over_scenes(kind, scenes, count)
            )
            yield f"| {kind} | {scenes} | {mean} | {unknown} | {difference} |"


def _figures_of_medians(count: int, resampling: ResamplingConfig) -> Iterator[str]:
    yield "p <= 0.05: equal medians, shifted medians"
    for name, (errors, shift) in (STATED | WITH_FAILURES | OTHERS).items():
        shares = [findings(errors, count, resampling, by) for by in (0.0, shift)]
        shown = " | ".join(f"{100 * share:.1f} %" for share in shares)
        yield f"| {name} | {shown} | {np.exp(shift):.2f} |"


if __name__ == "__main__":
    for line in chain(
        _figures_of_shares(4_000),
        _figures_of_scenes(4_000),
        _figures_of_medians(2_000, ResamplingConfig(1_000)),
        _figures_of_ranks(400),
    ):
        sys.stdout.write(f"{line}\n")
        sys.stdout.flush()
