"""Simulated coverage of intervals and false findings of tests, as docs/statistics.md prints them.

``python -m tests.statistics.simulations`` prints all figures of the page, in some three minutes.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, product
from pathlib import Path

import numpy as np
from scipy.special import ndtri
from scipy.stats import binom

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.statistics.pair_tests import pair_p_values
from airzoo_bench.statistics.rank_ranges import correct_pairs, rank_ranges
from airzoo_bench.statistics.samples import ResamplingConfig, Sample
from airzoo_bench.statistics.share_differences import difference_limits
from airzoo_bench.statistics.shares import average_limits
from airzoo_bench.statistics.significance import PairedTest, paired_permutation, paired_tests

Scenes = Sequence[tuple[int, float]]

SATURATED: tuple[Scenes, ...] = (
    ((10, 0.9), (200, 0.3)),
    ((18, 0.95), (200, 0.3)),
    ((26, 0.04), (400, 0.02)),
)
UAV_VISLOC = (817, 1071, 768, 738, 473, 338, 26, 1033, 444, 144, 590)
UAV_RATES = {
    "0.9": (0.9,) * 11,
    "0.3": (0.3,) * 11,
    "0.02": (0.02,) * 11,
    "0.01 to 0.6": (0.5, 0.3, 0.02, 0.1, 0.6, 0.01, 0.04, 0.4, 0.2, 0.05, 0.3),
}
RANKS = np.array([1, 1, 1, 1 / 2, 1 / 2, 1 / 3, 1 / 4, 1 / 5])
"""Of the one positive, where it is found among five: AP@5 is one of these, or 0."""


def uav_visloc(rates: str) -> Scenes:
    """Return its scenes at one of `UAV_RATES`."""
    return tuple(zip(UAV_VISLOC, UAV_RATES[rates], strict=True))


DESIGNS = {", ".join(f"{q} at {rate}" for q, rate in scenes): scenes for scenes in SATURATED} | {
    f"UAV-VisLoc at {rates}": uav_visloc(rates) for rates in UAV_RATES
}
AGREEMENT = (0.0, 0.5, 0.8)


def documented(*start: str) -> list[float]:
    """Read the shares, in %, of the row of docs/statistics.md that starts with these cells."""
    page = Path(__file__).parents[2] / "docs" / "statistics.md"
    cells = f"| {' | '.join(start)} | "
    lines = page.read_text(encoding="utf-8").splitlines()
    (row,) = [line.removeprefix(cells) for line in lines if line.startswith(cells)]
    return [float(share) / 100 for share in re.findall(r"([\d.]+) %", row)]


def standard_error(share: float, *counts: int) -> float:
    """Return that of the difference of a share in simulations of so many data sets each."""
    return float(np.sqrt(max(share * (1 - share), 1e-3) * sum(1 / count for count in counts)))


@dataclass(frozen=True)
class Coverage:
    """How many intervals hold what is true.

    Attributes
    ----------
    average : float
        Of the first method's average.
    difference : float
        Of the difference of two methods.
    differ : float
        How many queries differ, counted by what they add to the variance of the difference (Kish's
        effective number): few, if most of it comes from the few of a small scene.
    """

    average: float
    difference: float
    differ: float


def coverage_of_rates(scenes: Scenes) -> float:
    """Sum exactly, over all that can happen, how probably the interval of the average holds it."""
    counts = [np.arange(queries + 1) for queries, _ in scenes]
    likely = [
        count[binom.pmf(count, *scene) > 1e-7] for count, scene in zip(counts, scenes, strict=True)
    ]
    cases = np.array(list(product(*likely)))
    chances = np.prod([binom.pmf(cases[:, s], *scene) for s, scene in enumerate(scenes)], axis=0)
    values = [
        (np.arange(queries) < cases[:, [s]]).astype(float) for s, (queries, _) in enumerate(scenes)
    ]
    low, high = average_limits(values, 0.95).T
    true = np.mean([rate for _, rate in scenes])
    return float(chances[(low <= true + 1e-12) & (true - 1e-12 <= high)].sum())


def coverage_of_shares(
    scenes: Scenes,
    count: int,
    agree: float,
    *,
    soft: bool = False,
    gain: float = 0.0,
    seed: int = 0,
) -> Coverage:
    """Draw two methods, and count how many intervals hold what is true.

    Parameters
    ----------
    scenes : sequence of (int, float)
        Queries, and the rate of the first method.
    count : int
        Of data sets.
    agree : float
        On this share of the queries the second method answers as the first does; on the rest, by
        itself.
    soft : bool
        Shares between 0 and 1, as AP@5, instead of hits.
    gain : float
        By so much the rate of the second method's own answers is nearer to 0.5.
    """
    random = np.random.default_rng(seed)
    rates = np.array([rate for _, rate in scenes])
    others = rates + gain * np.sign(0.5 - rates)
    drawn = [
        _two_methods(random, (count, queries), rate, other, agree, soft=soft)
        for (queries, rate), other in zip(scenes, others, strict=True)
    ]
    size = RANKS.mean() if soft else 1.0
    gaps = [one - other for one, other in drawn]
    added = np.concatenate([(gap / gap.shape[1]) ** 2 for gap in gaps], axis=1)
    return Coverage(
        _held(average_limits([one for one, _ in drawn], 0.95), size * rates.mean()),
        _held(difference_limits(gaps, 0.95), (1 - agree) * size * (rates - others).mean()),
        float(added.sum(axis=1).mean() ** 2 / (added**2).sum(axis=1).mean()),
    )


def _two_methods(
    random: np.random.Generator,
    shape: tuple[int, int],
    rate: float,
    other_rate: float,
    agree: float,
    *,
    soft: bool,
) -> tuple[Floats, Floats]:
    one = random.random(shape) < rate
    other = np.where(random.random(shape) < agree, one, random.random(shape) < other_rate)
    if not soft:
        return one.astype(float), other.astype(float)
    return one * random.choice(RANKS, shape), other * random.choice(RANKS, shape)


def _held(limits: Floats, true: float) -> float:
    low, high = limits.T
    return float(((low <= true + 1e-12) & (true - 1e-12 <= high)).mean())


@dataclass(frozen=True)
class Errors:
    """Log-normal errors of two methods with equal medians.

    Attributes
    ----------
    queries : tuple of int
        Of each scene.
    spreads : (float, float)
        Standard deviations of the two methods' logarithms.
    correlation : float
        Of the logarithms.
    failures : (float, float)
        Shares of queries that are infinite; the medians are equal all the same.
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
    "6 queries, alike but for 0.9": (Errors((6,), (1.0, 1.0), 0.9), 0.6),
    "161 queries, alike but for 0.95": (Errors((161,), (1.0, 1.0), 0.95), 0.1),
}


def findings(errors: Errors, count: int, resampling: ResamplingConfig, shift: float = 0.0) -> float:
    """Return the share of data sets in which `compare` finds a difference of medians."""
    return _found(paired_tests(errors.drawn(count, shift, 1), resampling, _pairs(count))[1])


def findings_of_permutation(
    errors: Errors, count: int, resampling: ResamplingConfig, shift: float = 0.0
) -> float:
    """Return the same of the permutation of values, which tests more than the medians."""
    return _found(paired_permutation(errors.drawn(count, shift, 1), resampling, _pairs(count)))


def _pairs(count: int) -> list[tuple[int, int]]:
    return [(row, count + row) for row in range(count)]


def _found(tests: Sequence[PairedTest]) -> float:
    return float(np.mean([test.p_value <= 0.05 for test in tests]))


def coverage_of_ranks(kind: str, count: int) -> tuple[float, float]:
    """Return in which share of benchmarks every true rank lies in its range, and their mean width.

    Of 12 methods, of which every two are equally good, on 60, 25 and 40 queries of three scenes.
    """
    random = np.random.default_rng(11)
    skills = np.repeat(np.linspace(0, 1.5, 6), 2)
    first = 1 + (skills > skills[:, None]).sum(axis=1)
    last = (skills >= skills[:, None]).sum(axis=1)
    medians, higher = np.full(12, kind == "medians"), kind in ("hits", "graded")
    average = np.median if kind == "medians" else np.mean
    held, width = 0, 0.0
    for _ in range(count):
        parts = [_skilled(kind, skills, size, random) for size in (60, 25, 40)]
        sample = Sample("query", ("a", "b", "c"), tuple(parts), medians)
        values = np.mean([average(part, axis=1) for part in parts], axis=0)
        corrected = correct_pairs(pair_p_values(sample, ResamplingConfig(2_000)))
        found = rank_ranges(values, corrected, higher_is_better=higher)
        held += bool(((found[:, 0] <= first) & (found[:, 1] >= last)).all())
        width += float((found[:, 1] - found[:, 0]).mean())
    return held / count, width / count


def _skilled(kind: str, skills: Floats, size: int, random: np.random.Generator) -> Floats:
    skilled = random.normal(size=size) + 0.6 * random.normal(size=(12, size)) + skills[:, None]
    if kind == "hits":
        return (skilled > 0.5).astype(np.float64)
    if kind == "graded":
        return np.clip(np.round(skilled + 2), 0, 5) / 5
    return 10 - skilled


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


def _figures_of_medians(count: int, resampling: ResamplingConfig) -> Iterator[str]:
    yield "p <= 0.05 in %: equal medians, permutation and bootstrap; the same of shifted medians"
    for name, (errors, shift) in (STATED | WITH_FAILURES | OTHERS).items():
        shares = [
            tested(errors, count, resampling, by)
            for by in (0.0, shift)
            for tested in (findings_of_permutation, findings)
        ]
        shown = " ".join(f"{100 * share:6.1f}" for share in shares)
        yield f"{name:33} {shown}   shifted by a factor of {np.exp(shift):.2f}"


if __name__ == "__main__":
    for line in chain(
        _figures_of_shares(4_000),
        _figures_of_medians(2_000, ResamplingConfig(1_000)),
        _figures_of_ranks(400),
    ):
        sys.stdout.write(f"{line}\n")
        sys.stdout.flush()
