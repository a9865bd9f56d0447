"""Intervals of shares: beside SciPy's, by properties, and by how often they hold what is true."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy import stats

from airzoo_bench.results.comparison import score_intervals
from airzoo_bench.statistics.intervals import (
    Rates,
    average_limits,
    difference_limits,
    effective_rates,
    jeffreys_limits,
    sample_intervals,
    wilson_limits,
)
from airzoo_bench.statistics.samples import ResamplingConfig, Sample
from airzoo_bench.statistics.significance import paired_tests
from tests.statistics.simulations import (
    AGREEMENT,
    DESIGNS,
    SATURATED,
    Coverage,
    coverage_of_rates,
    coverage_of_shares,
    documented,
    standard_error,
)
from tests.statistics.support import ERROR, HIT, SOFT, made_method

some = hnp.arrays(np.float64, st.tuples(st.just(2), st.integers(5, 12)), elements=st.floats(0, 1))


def hits(*counts: int, queries: int) -> np.ndarray:
    return np.array([np.arange(queries) < count for count in counts], float)


@pytest.mark.parametrize("queries", [5, 26, 817])
def test_wilson_and_jeffreys_are_scipy_s(queries: int) -> None:
    counts = sorted({0, 1, queries // 3, queries - 1, queries})
    rates = effective_rates(hits(*counts, queries=queries))
    for count, limits in zip(counts, wilson_limits(rates, 0.95), strict=True):
        peer = stats.binomtest(count, queries).proportion_ci(0.95, method="wilson")
        assert limits == pytest.approx([peer.low, peer.high], abs=1e-12)
    for count, limits in zip(counts, jeffreys_limits(rates, 0.9), strict=True):
        low, high = stats.beta.ppf([0.05, 0.95], count + 0.5, queries - count + 0.5)
        low, high = 0.0 if count == 0 else low, 1.0 if count == queries else high
        assert limits == pytest.approx([low, high], abs=1e-9)


def test_limits_of_nothing_and_of_everything_are_exact() -> None:
    for queries in range(1, 300):
        rates = effective_rates(hits(0, queries, queries=queries))
        for limits in (wilson_limits(rates, 0.95), jeffreys_limits(rates, 0.9)):
            assert (limits[0, 0], limits[1, 1]) == (0.0, 1.0)
            assert 0.0 < limits[0, 1] == pytest.approx(1.0 - limits[1, 0])


def test_effective_sizes_by_hand() -> None:
    # Mean 0.3, squares 20 * 0.01, and the prior's 0.5 * (0.09 + 0.49).
    rates = effective_rates(np.array([[0.2, 0.4] * 10, [1.0] * 6 + [0.0] * 14]))
    assert rates.means == pytest.approx([0.3, 0.3])
    assert rates.sizes == pytest.approx([20 * 0.3 * 0.7 * 21 / (0.2 + 0.29), 20])


def test_differences_of_two_scenes_by_hand_and_row_by_row() -> None:
    # Hits, graded shares, and hits in one scene alone: each as if the others were not there.
    random = np.random.default_rng(0)
    one, other = (np.round(random.uniform(-1, 1, (3, size)) * [[1], [4], [1]]) for size in (12, 30))
    one[1] /= 4
    other[1:] /= 5
    together = difference_limits([one, other], 0.9)
    for row in range(3):
        alone = difference_limits([one[row : row + 1], other[row : row + 1]], 0.9)
        assert together[row].tolist() == alone[0].tolist()
    spans = [stats.ttest_1samp(v[1], 0.0).confidence_interval(0.9) for v in (one, other)]
    reach = np.hypot(*((span.high - span.low) / 2 for span in spans)) / 2
    mean = (one[1].mean() + other[1].mean()) / 2
    assert together[1] == pytest.approx([mean - reach, mean + reach])
    # MOVER: of two scenes alike, the reach is that of one over the root of two.
    single, double = difference_limits([one], 0.9), difference_limits([one, one], 0.9)
    middle = one.mean(axis=1, keepdims=True)
    assert (double - middle) * np.sqrt(2) == pytest.approx(single - middle)


def test_mover_by_hand() -> None:
    scenes = [hits(9, queries=10), hits(60, queries=200)]
    one, other = (jeffreys_limits(effective_rates(scene), 0.95)[0] for scene in scenes)
    down = np.hypot(0.9 - one[0], 0.3 - other[0]) / 2
    up = np.hypot(one[1] - 0.9, other[1] - 0.3) / 2
    assert average_limits(scenes, 0.95)[0] == pytest.approx([0.6 - down, 0.6 + up])


def test_a_difference_by_hand() -> None:
    # 6 won, 2 lost, 12 tied.
    gaps = np.array([[1.0] * 6 + [-1.0] * 2 + [0.0] * 12])
    won, lost = jeffreys_limits(Rates(np.array([0.3, 0.1]), np.array([20.0, 20.0])), 0.95)
    correlation = -0.3 * 0.1 / np.sqrt(0.3 * 0.7 * 0.1 * 0.9)
    down, up = (
        np.sqrt(a * a + b * b - 2 * correlation * a * b)
        for a, b in ((0.3 - won[0], lost[1] - 0.1), (won[1] - 0.3, 0.1 - lost[0]))
    )
    assert difference_limits([gaps], 0.95)[0] == pytest.approx([0.2 - down, 0.2 + up])


@given(some, some)
def test_limits_lie_around_the_mean_and_mirror(one, other) -> None:
    for scenes in ([one], [one, other]):
        low, high = average_limits(scenes, 0.95).T
        mean = np.mean([scene.mean(axis=1) for scene in scenes], axis=0)
        assert (low <= mean + 1e-12).all()
        assert (mean <= high + 1e-12).all()
        assert (low >= -1e-12).all()
        assert (high <= 1 + 1e-12).all()
        mirrored = average_limits([1 - scene for scene in scenes], 0.95)
        assert np.stack([1 - high, 1 - low], axis=1) == pytest.approx(mirrored, abs=1e-6)
    low, high = difference_limits([one[:, :5] - other[:, :5]], 0.95).T
    backward = difference_limits([other[:, :5] - one[:, :5]], 0.95)
    assert np.stack([-high, -low], axis=1) == pytest.approx(backward, abs=1e-12)


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_a_scene_that_is_all_alike_keeps_the_uncertainty_of_its_size(value: float) -> None:
    wide, narrow = (
        average_limits([np.full((1, size), value), hits(60, queries=200)], 0.95)[0]
        for size in (10, 1_000)
    )
    assert wide[1] - wide[0] > 1.2 * (narrow[1] - narrow[0])
    method = made_method({"s": {"recall@1": [value] * 10}}, (HIT,))
    (found,) = score_intervals(method, [HIT], ResamplingConfig(100)).overall
    peer = stats.binomtest(int(10 * value), 10).proportion_ci(0.95, method="wilson")
    assert (found.low, found.high) == pytest.approx((peer.low, peer.high))
    assert (found.method, found.reason) == ("wilson", "")


def test_shares_count_as_they_vary_and_never_less_than_hits() -> None:
    scores = np.array(
        [[0.0] * 20, [1.0] * 20, [0.5] * 20, [0.0, 1.0] * 10, [0.4, 0.6] * 10, [1e-3] * 20]
    )
    sizes = effective_rates(scores).sizes
    # Near 0 too: that all reciprocal ranks are a thousandth does not say that no query is a hit.
    assert sizes[[0, 1, 3, 5]].tolist() == [20, 20, 20, 20]
    assert sizes[2] > sizes[4] > 60
    widths = np.diff(average_limits([scores], 0.95))[:, 0]
    assert 0 < widths[2] < widths[4] < widths[3] / 2


def test_shares_take_no_resamples_and_medians_do() -> None:
    random = np.random.default_rng(0)
    scenes = {
        name: {
            "recall@1": (random.random(30) < 0.5).astype(float).tolist(),
            "mrr": random.random(30).tolist(),
            "error_m": random.random(30).tolist(),
        }
        for name in ("east", "west")
    }
    method = made_method(scenes, (HIT, SOFT, ERROR))
    found = score_intervals(method, [HIT, ERROR, SOFT], ResamplingConfig(100))
    assert [i.method for i in found.groups["east"]] == ["wilson", "bca", "wilson"]
    assert [i.method for i in found.overall] == ["mover", "bca", "mover"]
    other = score_intervals(method, [HIT, ERROR, SOFT], ResamplingConfig(100, seed=1))
    same = [one == two for one, two in zip(found.overall, other.overall, strict=True)]
    assert same == [True, False, True]


@pytest.mark.parametrize(("scenes", "alone"), [*zip(SATURATED, (0.930, 0.942, 0.916), strict=True)])
def test_exact_coverage_beside_a_saturated_scene(scenes, alone) -> None:
    assert 0.93 <= coverage_of_rates(scenes) <= 0.97
    assert 0.93 <= coverage_of_rates(scenes[1:]) <= 0.97
    # 26 queries at 0.04: three hits are held or are not, which is 98.1 or 91.6 %, and none between.
    assert coverage_of_rates(scenes[:1]) == pytest.approx(alone, abs=5e-4)


def assert_covered(found: Coverage) -> None:
    """Two standard errors on either side: 95 %, or more where fewer than ten queries differ."""
    error = 2 * standard_error(0.95, 2_000)
    assert 0.93 - error <= found.difference <= (0.975 + error if found.differ >= 10 else 1.0)


@pytest.mark.slow
@pytest.mark.parametrize("agree", AGREEMENT)
@pytest.mark.parametrize("gain", [0.05, 0.1])
@pytest.mark.parametrize("name", DESIGNS)
def test_coverage_of_true_differences(name, gain, agree) -> None:
    assert_covered(coverage_of_shares(DESIGNS[name], 2_000, agree, gain=gain))


@pytest.mark.slow
@pytest.mark.parametrize("soft", [False, True])
@pytest.mark.parametrize("name", DESIGNS)
def test_coverage_is_as_documented(name, soft) -> None:
    found = [coverage_of_shares(DESIGNS[name], 2_000, agree, soft=soft) for agree in AGREEMENT]
    shares = [found[0].average, *(one.difference for one in found)]
    for share, printed in zip(shares, documented(name, "AP@5" if soft else "hits"), strict=True):
        assert share == pytest.approx(printed, abs=3 * standard_error(printed, 2_000, 4_000))
    assert shares[0] >= 0.93 - 2 * standard_error(0.95, 2_000)
    for one in found:
        assert_covered(one)


def test_differences_of_shares_are_of_mover_and_few_queries_have_none() -> None:
    values = np.random.default_rng(0).random((2, 9))
    for units, methods in ((9, ["wilson", "wilson"]), (4, ["", ""])):
        part = (values[:, :units],)
        made = Sample("query", ("a",), part, np.zeros(2, bool), np.ones(2, bool))
        found = sample_intervals(made, ResamplingConfig())
        assert [one.method for one in found.overall] == methods
        assert [one.method for one in found.groups["a"]] == methods
        [interval], _ = paired_tests(made, ResamplingConfig(), [(0, 1)])
        assert interval.method == ("mover" if units > 4 else "")
