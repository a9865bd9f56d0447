"""Simulated coverage of intervals."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import binom

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.statistics.intervals import sample_intervals
from airzoo_bench.statistics.samples import ResamplingConfig, Sample
from airzoo_bench.statistics.shares import average_limits, difference_limits
from airzoo_bench.statistics.significance import (
    compare_all,
    correct_pairs,
    paired_tests,
    rank_ranges,
)

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
    """Read the shares, in %, of the row of coverage.md that starts with these cells."""
    page = Path(__file__).with_name("coverage.md")
    cells = f"| {' | '.join(start)} | "
    lines = page.read_text(encoding="utf-8").splitlines()
    (row,) = [line.removeprefix(cells) for line in lines if line.startswith(cells)]
    return [float(share) / 100 for share in re.findall(r"([\d.]+) %", row)]


def standard_error(share: float, *counts: int) -> float:
    """Return that of the difference of a share in simulations of so many data sets each."""
    return float(np.sqrt(max(share * (1 - share), 1e-3) * sum(1 / count for count in counts)))


class Coverage(NamedTuple):
    """How many intervals hold a first method's average, and its difference from a second one.

    `differ` queries differ, counted by what they add to the variance of the difference (Kish's
    effective number): few, if most of it comes from the few of a small scene.
    """

    average: float
    difference: float
    differ: float


def coverage_over_scenes(kind: str, scenes: int, count: int) -> tuple[float, float, float]:
    """Return how often an interval holds the true mean, has no known upper limit, and how often
    that of the difference of two equal methods holds 0.

    Of distances from N(5, 1) and exp N(0, 1), and of shares from beta(5, 2).
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
    found = sample_intervals(sample, plan).overall[:count]
    means, differences = (
        np.array([(one.low, one.high) for one in part])
        for part in (found, paired_tests(sample, plan, pairs)[0])
    )
    unknown = float(np.isinf(means[:, 1]).mean())
    return _held(means, true), unknown, _held(differences, 0.0)


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
    """Draw `count` data sets of two methods on scenes of so many queries at the first one's rates.

    On a share of the queries, `agree`, the second answers as the first does; on the rest by itself,
    at a rate that is nearer to 0.5 by `gain`. If `soft`, shares lie between 0 and 1, as of AP@5.
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
    random: np.random.Generator, shape: Any, rate: float, other: float, agree: float, *, soft: bool
) -> tuple[Floats, Floats]:
    one = random.random(shape) < rate
    two = np.where(random.random(shape) < agree, one, random.random(shape) < other)
    if not soft:
        return one.astype(float), two.astype(float)
    return one * random.choice(RANKS, shape), two * random.choice(RANKS, shape)


def _held(limits: Floats, true: float) -> float:
    low, high = limits.T
    return float(((low <= true + 1e-12) & (true - 1e-12 <= high)).mean())


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
        corrected = correct_pairs(compare_all(sample, ResamplingConfig(2_000))[2])
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
