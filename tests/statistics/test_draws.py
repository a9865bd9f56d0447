"""Draws by counting: the same whatever is drawn before or beside them."""

from __future__ import annotations

import numpy as np
import pytest

from airzoo_bench.statistics.samples import resample_counts, sign_flips, stream_key

GOLDEN_COUNTS = [[0, 0, 0, 2, 1, 1], [3, 2, 0, 0, 3, 0], [1, 1, 3, 2, 0, 1], [0, 1, 1, 0, 0, 2]]
GOLDEN_SIGNS = [[1, 0, 1, 1, 0, 0], [1, 0, 1, 0, 0, 0], [1, 1, 1, 0, 1, 0]]
GOLDEN_KEY = 242631316549171704428568933449400340785


@pytest.mark.parametrize("draw", [resample_counts, sign_flips])
@pytest.mark.parametrize("units", [1, 2, 7, 8, 9, 63, 64, 65, 257])
def test_a_resample_does_not_depend_on_its_block(draw, units):
    whole = draw(units, 0, 40, 11)
    parts = [draw(units, 0, 1, 11), draw(units, 1, 25, 11), draw(units, 26, 14, 11)]
    assert np.array_equal(whole, np.concatenate(parts, axis=1))
    assert whole.shape == (units, 40)


def test_every_unit_is_as_likely():
    # 100,000 draws of 10: the chi-square of fair draws is below 27.9 with probability 0.999.
    drawn = resample_counts(10, 0, 10_000, 5).sum(axis=1)
    assert ((drawn - 10_000) ** 2 / 10_000).sum() < 27.9


def test_coins_are_fair_and_independent():
    coins = sign_flips(100, 0, 10_000, 5).astype(np.float64)
    assert set(np.unique(coins)) == {0.0, 1.0}
    assert abs(coins.mean() - 0.5) < 0.002
    correlation = np.corrcoef(coins) - np.eye(100)
    assert np.abs(correlation).max() < 0.05


def test_the_stream_stays_what_it_is():
    # Whoever changes these numbers changes every interval that was ever published.
    assert resample_counts(4, 0, 6, 1).tolist() == GOLDEN_COUNTS
    assert sign_flips(3, 0, 6, 1).tolist() == GOLDEN_SIGNS
    assert stream_key(0, "bootstrap", "east") == GOLDEN_KEY
