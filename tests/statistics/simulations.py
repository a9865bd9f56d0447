"""Simulated coverage of intervals and false findings of tests, as coverage.md has them.

``python -m tests.statistics.simulations`` prints all figures of the page, in some three minutes.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Sequence
from itertools import chain, product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.special import ndtri
from scipy.stats import binom

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.statistics.intervals import average_limits, difference_limits, sample_intervals
from airzoo_bench.statistics.samples import ResamplingConfig, Sample
from airzoo_bench.statistics.significance import (
    compare_all,
    correct_pairs,
    paired_tests,
    rank_ranges,
)

Scenes = Sequence[tuple[int, float]]  # of so many queries, and a rate of hits

SATURATED: tuple[Scenes, ...] = (
    ((10, 0.9), (200, 0.3)),
    ((18, 0.95), (200, 0.3)),
    ((26, 0.04), (400, 0.02)),
)
UAV_VISLOC = (817, 1071, 768, 738, 473, 338, 26, 1033, 444, 144, 590)
MIXED = (0.5, 0.3, 0.02, 0.1, 0.6, 0.01, 0.04, 0.4, 0.2, 0.05, 0.3)
UAV_RATES = {"0.9": [0.9] * 11, "0.3": [0.3] * 11, "0.02": [0.02] * 11, "0.01 to 0.6": MIXED}
DESIGNS = {", ".join(f"{q} at {rate}" for q, rate in scenes): scenes for scenes in SATURATED} | {
    f"UAV-VisLoc at {name}": tuple(zip(UAV_VISLOC, rates, strict=True))
    for name, rates in UAV_RATES.items()
}
# Of the one positive, where it is found among five: AP@5 is one of these, or 0.
RANKS = np.array([1, 1, 1, 1 / 2, 1 / 2, 1 / 3, 1 / 4, 1 / 5])
AGREEMENT = (0.0, 0.5, 0.8)
MEANS = ("N(5, 1)", "exp N(0, 1)", "beta(5, 2)")
KINDS = ("hits", "graded", "errors", "medians")


def documented(*start: str) -> list[float]:
    """Read the shares, in %, of the row of coverage.md that starts with these cells."""
    page = Path(__file__).with_name("coverage.md")
    cells = f"| {' | '.join(start)} | "
    lines = page.read_text(encoding="utf-8").splitlines()
    (row,) = [line.removeprefix(cells) for line in lines if line.startswith(cells)]
    return [float(share) / 100 for share in re.findall(r"([\d.]+) %", row)]


def standard_error(share: float, *counts: int) -> float:
    """Return that of the difference of a share in simulations of so many data sets each."""
    return float(np.sqrt(max(share * (1 - share), 1e-3) * sum(1 / count for count in counts)))


def share_held(limits: Floats, true: float) -> float:
    low, high = limits.T
    return float(((low <= true + 1e-12) & (true - 1e-12 <= high)).mean())


# --- means of shares, and where scenes are the units ---


class Coverage(NamedTuple):
    """How many intervals hold a first method's average, and its difference from a second one.

    `differ` queries differ, counted by what they add to the variance of the difference (Kish's
    effective number): few, if most of it comes from the few of a small scene.
    """

    average: float
    difference: float
    differ: float


def coverage_of_rates(scenes: Scenes) -> float:
    """Sum exactly, over all that can happen, how probably the interval of the average holds it."""
    counts = [np.arange(queries + 1) for queries, _ in scenes]
    likely = [n[binom.pmf(n, *scene) > 1e-7] for n, scene in zip(counts, scenes, strict=True)]
    cases = np.array(list(product(*likely)))
    chances = np.prod([binom.pmf(cases[:, s], *scene) for s, scene in enumerate(scenes)], axis=0)
    values = [(np.arange(q) < cases[:, [s]]).astype(float) for s, (q, _) in enumerate(scenes)]
    low, high = average_limits(values, 0.95).T
    true = np.mean([rate for _, rate in scenes])
    return float(chances[(low <= true + 1e-12) & (true - 1e-12 <= high)].sum())


def coverage_of_shares(
    scenes: Scenes, count: int, agree: float, *, soft: bool = False, gain: float = 0.0
) -> Coverage:
    """Draw `count` data sets of two methods on scenes of so many queries at the first one's rates.

    On a share of the queries, `agree`, the second answers as the first does; on the rest by itself,
    at a rate that is nearer to 0.5 by `gain`. If `soft`, shares lie between 0 and 1, as of AP@5.
    """
    random = np.random.default_rng(0)
    rates = np.array([rate for _, rate in scenes])
    others, firsts, gaps = rates + gain * np.sign(0.5 - rates), [], []
    for (queries, rate), other in zip(scenes, others, strict=True):
        shape = (count, queries)
        one = random.random(shape) < rate
        two = np.where(random.random(shape) < agree, one, random.random(shape) < other)
        firsts.append(one * (random.choice(RANKS, shape) if soft else 1.0))
        gaps.append(firsts[-1] - two * (random.choice(RANKS, shape) if soft else 1.0))
    size = RANKS.mean() if soft else 1.0
    added = np.concatenate([(gap / gap.shape[1]) ** 2 for gap in gaps], axis=1)
    return Coverage(
        share_held(average_limits(firsts, 0.95), size * rates.mean()),
        share_held(difference_limits(gaps, 0.95), (1 - agree) * size * (rates - others).mean()),
        float(added.sum(axis=1).mean() ** 2 / (added**2).sum(axis=1).mean()),
    )


def coverage_over_scenes(kind: str, scenes: int, count: int) -> tuple[float, float, float]:
    """Return how often an interval holds the true mean, has no known upper limit, and how often
    that of the difference of two equal methods holds 0.
    """
    random, shape = np.random.default_rng(scenes), (2 * count, scenes)
    if kind == "N(5, 1)":
        true, values = 5.0, np.maximum(random.normal(5, 1, shape), 1e-3)
    elif kind == "exp N(0, 1)":
        true, values = float(np.exp(0.5)), np.exp(random.standard_normal(shape))
    else:
        true, values = 5 / 7, random.beta(5, 2, shape)
    shares = np.full(2 * count, kind == "beta(5, 2)")
    sample = Sample("scene", ("",), (values,), np.zeros(2 * count, bool), shares)
    plan, pairs = ResamplingConfig(), [(row, count + row) for row in range(count)]
    found = (sample_intervals(sample, plan).overall[:count], paired_tests(sample, plan, pairs)[0])
    means, gaps = (np.array([(one.low, one.high) for one in part]) for part in found)
    return share_held(means, true), float(np.isinf(means[:, 1]).mean()), share_held(gaps, 0.0)


# --- ranks ---


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
        parts = []
        for size in (60, 25, 40):
            skilled = random.normal(size=size) + 0.6 * random.normal(size=(12, size))
            skilled += skills[:, None]
            graded = np.clip(np.round(skilled + 2), 0, 5) / 5
            shown = {"hits": (skilled > 0.5).astype(np.float64), "graded": graded}
            parts.append(shown.get(kind, 10 - skilled))
        sample = Sample("query", ("a", "b", "c"), tuple(parts), medians)
        values = np.mean([average(part, axis=1) for part in parts], axis=0)
        corrected = correct_pairs(compare_all(sample, ResamplingConfig(2_000))[2])
        found = rank_ranges(values, corrected, higher_is_better=higher)
        held += bool(((found[:, 0] <= first) & (found[:, 1] >= last)).all())
        width += float((found[:, 1] - found[:, 0]).mean())
    return held / count, width / count


# --- medians ---


class Errors(NamedTuple):
    """Log-normal errors of two methods with equal medians, on scenes of so many queries.

    `spreads` are standard deviations of the methods' logarithms, which correlate; `failures` are
    shares of queries that are infinite: the medians are equal all the same.
    """

    queries: tuple[int, ...]
    spreads: tuple[float, float]
    correlation: float = 0.0
    failures: tuple[float, float] = (0.0, 0.0)

    def scene(self, random: np.random.Generator, count: int, queries: int, shift: float) -> Floats:
        """Draw data sets, the first methods and then the second ones, those shifted."""
        shared, own = random.standard_normal((2, count, queries))
        mixed = self.correlation * shared + np.sqrt(1 - self.correlation**2) * own
        sides = []
        for logs, spread, share in zip((shared, mixed), self.spreads, self.failures, strict=True):
            errors = np.exp(spread * (logs - ndtri(0.5 / (1 - share))))
            sides.append(np.where(random.random(errors.shape) < share, np.inf, errors))
        return np.concatenate([sides[0], sides[1] * np.exp(shift)])


STATED = {  # two are found at 5 %; the others, of few or of like methods, less often
    "161 queries, spreads 0.5 and 1.5": (Errors((161,), (0.5, 1.5)), 0.25),
    "the same, correlated by 0.6": (Errors((161,), (0.5, 1.5), 0.6), 0.25),
    "100 queries, spreads 0.3 and 2": (Errors((100,), (0.3, 2.0)), 0.4),
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


def findings(errors: Errors, count: int, shift: float = 0.0) -> float:
    """Return the share of data sets in which `compare` finds a difference of medians."""
    random, pairs = np.random.default_rng(1), [(row, count + row) for row in range(count)]
    values = [errors.scene(random, count, queries, shift) for queries in errors.queries]
    names = tuple(f"s{number}" for number in range(len(values)))
    sample = Sample("query", names, tuple(values), np.ones(2 * count, bool))
    _, tests = paired_tests(sample, ResamplingConfig(1_000), pairs)
    return float(np.mean([test.p_value <= 0.05 for test in tests]))


# --- the page ---


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


def _other_figures(count: int) -> Iterator[str]:
    yield "where scenes are the units: mean (upper limit not known), difference of equal methods"
    for kind, scenes in product(MEANS, (5, 6, 8, 11, 16)):
        shown = [f"{100 * share:.1f} %" for share in coverage_over_scenes(kind, scenes, count)]
        yield f"| {kind} | {scenes} | {' | '.join(shown)} |"
    yield "p <= 0.05: equal medians, shifted medians"
    for name, (errors, shift) in (STATED | OTHERS).items():
        shown = [f"{100 * findings(errors, count // 2, by):.1f} %" for by in (0.0, shift)]
        yield f"| {name} | {' | '.join(shown)} | {np.exp(shift):.2f} |"
    yield "rank ranges of 12 methods: all true ranks held, and mean width of a range"
    for kind in KINDS:
        held, width = coverage_of_ranks(kind, count // 10)
        yield f"{kind:10} {100 * held:6.1f} %  {width:.1f}"


if __name__ == "__main__":
    for line in chain(_figures_of_shares(4_000), _other_figures(4_000)):
        sys.stdout.write(f"{line}\n")
        sys.stdout.flush()
