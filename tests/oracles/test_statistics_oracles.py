"""Intervals and tests beside SciPy's."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from airzoo_bench.statistics.intervals import sample_intervals
from airzoo_bench.statistics.samples import (
    ResamplingConfig,
    Sample,
    resample_counts,
    sign_flips,
    stream_key,
    weighted_averages,
)
from airzoo_bench.statistics.significance import mcnemar, paired_tests

SIZES = (40, 61, 25)


def drawn(kind: str, size: int, seed: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    if kind == "hits":
        return (random.random(size) < 0.7).astype(float)
    return random.exponential(5.0, size)


def overall(kind: str) -> Any:
    average = np.median if kind == "errors" else np.mean

    def statistic(*groups: np.ndarray, axis: int = -1) -> Any:
        return sum(average(group, axis=axis) for group in groups) / len(groups)

    return statistic


def sample(kind: str, sizes: tuple[int, ...] = SIZES) -> Sample:
    names = tuple(f"s{number}" for number in range(len(sizes)))
    values = tuple(drawn(kind, size, size)[None] for size in sizes)
    return Sample("query", names, values, np.array([kind == "errors"]))


def own_resamples(made: Sample, plan: ResamplingConfig) -> np.ndarray:
    """Return the resamples of the mean over groups, (B,)."""
    parts = []
    for group, values in zip(made.groups, made.values, strict=True):
        key = stream_key(plan.seed, "bootstrap", group)
        counts = resample_counts(values.shape[1], 0, plan.resamples, key)
        parts.append(weighted_averages(values, made.medians, counts)[0])
    return np.mean(parts, axis=0)


@pytest.mark.parametrize("kind", ["hits", "soft", "errors"])
def test_intervals_of_scipy_from_the_same_and_from_its_own_resamples(kind: str) -> None:
    made, plan = sample(kind), ResamplingConfig(resamples=5_000)
    found = sample_intervals(made, plan).overall[0]
    assert found.method == "bca"
    # Of resamples that were made before, z0, acceleration and quantiles are SciPy's own.
    same = SimpleNamespace(bootstrap_distribution=own_resamples(made, plan))
    given: Any = {"n_resamples": 0, "bootstrap_result": same}
    drawn_anew: Any = {"n_resamples": 5_000, "rng": np.random.default_rng(0)}
    values = tuple(values[0] for values in made.values)
    for options, share in ((given, 1e-9), (drawn_anew, 0.06)):
        peer = stats.bootstrap(values, overall(kind), method="BCa", **options).confidence_interval
        width = peer.high - peer.low
        assert (found.low, found.high) == pytest.approx((peer.low, peer.high), abs=share * width)


@pytest.mark.parametrize("kind", ["soft", "errors"])
def test_paired_differences(kind: str) -> None:
    first, second = drawn(kind, 50, 1), drawn(kind, 50, 2)
    made = Sample("query", ("s",), (np.stack([first, second]),), np.full(2, kind == "errors"))
    [found], _ = paired_tests(made, ResamplingConfig(resamples=5_000), [(0, 1)])
    average = np.median if kind == "errors" else np.mean
    peer = stats.bootstrap(
        (first, second),
        lambda x, y, axis: average(x, axis=axis) - average(y, axis=axis),
        paired=True,
        n_resamples=5_000,
        method="percentile",
        rng=np.random.default_rng(0),
    ).confidence_interval
    width = peer.high - peer.low
    assert (found.low, found.high) == pytest.approx((peer.low, peer.high), abs=0.06 * width)


def test_exact_permutation() -> None:
    random = np.random.default_rng(0)
    for shift in (0.0, 0.4, 1.0):
        first, second = random.random(9) + shift, random.random(9)
        made = Sample("query", ("s",), (np.stack([first, second]),), np.zeros(2, bool))
        _, [test] = paired_tests(made, ResamplingConfig(resamples=1_000), [(0, 1)])
        peer = stats.permutation_test(
            (first, second),
            lambda x, y, axis: np.abs(np.mean(x, axis=axis) - np.mean(y, axis=axis)),
            permutation_type="samples",
            alternative="greater",
            n_resamples=np.inf,
        )
        assert test.exact
        assert test.p_value == pytest.approx(peer.pvalue, abs=1e-12)


def test_random_permutation() -> None:
    random = np.random.default_rng(0)
    first, second = random.random(80) + 0.08, random.random(80)
    made = Sample("query", ("s",), (np.stack([first, second]),), np.zeros(2, bool))
    _, [test] = paired_tests(made, ResamplingConfig(), [(0, 1)])
    peer = stats.permutation_test(
        (first, second),
        lambda x, y, axis: np.abs(np.mean(x, axis=axis) - np.mean(y, axis=axis)),
        permutation_type="samples",
        alternative="greater",
        n_resamples=9_999,
        rng=np.random.default_rng(0),
    )
    assert 0.01 < peer.pvalue < 0.5
    assert test.p_value == pytest.approx(peer.pvalue, abs=0.02)


def test_mcnemar() -> None:
    random = np.random.default_rng(0)
    for wins, losses in [*random.integers(0, 60, (50, 2)).tolist(), (0, 1), (1, 0), (4_000, 3_900)]:
        peer = stats.binomtest(wins, wins + losses, 0.5).pvalue if wins + losses else 1.0
        assert float(mcnemar(np.array(wins), np.array(losses))) == pytest.approx(peer, rel=1e-9)


def test_draws_are_uniform() -> None:
    counts = resample_counts(50, 0, 2_000, 9)
    assert stats.chisquare(counts.sum(axis=1)).pvalue > 1e-3
    # One unit's counts are binomial, hardly other than Poisson's with mean 1.
    observed = np.bincount(counts[0], minlength=8)[:5]
    expected = stats.binom.pmf(np.arange(5), 50, 1 / 50) * 2_000
    assert (np.abs(observed - expected) < 4 * np.sqrt(expected)).all()
    coins = sign_flips(50, 0, 2_000, 9).sum(axis=0)
    assert (
        stats.kstest(
            coins + np.linspace(-0.5, 0.5, 2_000), stats.norm(25, np.sqrt(12.5)).cdf
        ).pvalue
        > 1e-3
    )
