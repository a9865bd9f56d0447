"""What random orders score, against all orders there are, SciPy, and the metrics themselves."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import hypergeom

from airzoo_bench.retrieval.metrics import chance_scores
from airzoo_bench.retrieval.ranking import Ranking
from airzoo_bench.retrieval.settings import TileScores
from tests.retrieval.ranking_support import records_of
from tests.support import MadeScene, made_truth, protocol


def scores(**changes: object) -> TileScores:
    return TileScores.model_validate(protocol().scores.model_dump() | changes)


def over_all_orders(n_tiles: int, n_positives: int, chosen: TileScores) -> dict[str, float]:
    """Score every order with our own metrics; only where the positives stand can matter."""
    places = list(combinations(range(n_tiles), n_positives))
    scene = MadeScene("s", [list(range(n_positives))] * len(places), n_tiles)
    tiles = np.empty((len(places), n_tiles), np.int32)
    for row, place in zip(tiles, places, strict=True):
        row[list(place)] = np.arange(n_positives)
        row[np.setdiff1d(np.arange(n_tiles), place)] = np.arange(n_positives, n_tiles)
    ranking = Ranking(tiles[:, : chosen.ranks_kept], np.zeros(len(tiles), bool))
    records = records_of(made_truth(scene), ranking, chosen)
    return records.select_dtypes("number").mean().to_dict()


@settings(max_examples=25, deadline=None)
@given(st.integers(1, 8), st.data())
def test_the_mean_over_all_orders_is_what_is_given(n_tiles: int, data: st.DataObject) -> None:
    n_positives = data.draw(st.integers(0, n_tiles))
    chosen = scores(ranks_kept=data.draw(st.integers(10, 12)), ap_at=data.draw(st.integers(1, 7)))
    expected = over_all_orders(n_tiles, n_positives, chosen)
    found = chance_scores(np.array([n_positives]), n_tiles, chosen)
    names = {"map", "mrr", *(name for name in expected if name.startswith(("re", "ap@", "nd")))}
    assert set(found) == names
    for name, value in found.items():
        assert value[0] == pytest.approx(expected[name], abs=1e-12), name


def test_recall_is_that_of_scipy_for_each_query() -> None:
    positives = np.array([1, 3, 40, 500, 0, 3, 5000])
    found = chance_scores(positives, 5000, scores())
    for k in (1, 3, 5):
        expected = hypergeom.sf(0, 5000, positives, k)
        np.testing.assert_allclose(found[f"recall@{k}"], expected, rtol=1e-9)


def test_lists_cut_at_the_ranks_kept_agree_with_random_orders() -> None:
    # 400 tiles, 100 kept: the mean over 4,000 random orders, within four standard errors.
    n_tiles, n_positives, n_orders = 400, 9, 4000
    rng = np.random.default_rng(0)
    scene = MadeScene("s", [list(range(n_positives))] * n_orders, n_tiles)
    tiles = rng.permuted(np.tile(np.arange(n_tiles, dtype=np.int32), (n_orders, 1)), axis=1)
    ranking = Ranking(tiles[:, :100], np.zeros(n_orders, bool))
    records = records_of(made_truth(scene), ranking, scores())
    for name, value in chance_scores(np.array([n_positives]), n_tiles, scores()).items():
        column = records[name]
        assert abs(column.mean() - value[0]) < 4 * column.std() / np.sqrt(n_orders), name
