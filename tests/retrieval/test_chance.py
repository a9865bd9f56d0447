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


def score_orders(tiles: np.ndarray, n_positives: int, chosen: TileScores) -> dict[str, np.ndarray]:
    """Score orders (n, tiles) of a gallery whose first tiles are positive by our own metrics."""
    scene = MadeScene("s", [list(range(n_positives))] * len(tiles), tiles.shape[1])
    ranking = Ranking(tiles[:, : chosen.ranks_kept], np.zeros(len(tiles), bool))
    return dict(records_of(made_truth(scene), ranking, chosen).select_dtypes("number"))


@settings(max_examples=25, deadline=None)
@given(st.integers(1, 8), st.data())
def test_the_mean_over_all_orders_is_what_is_given(n_tiles: int, data: st.DataObject) -> None:
    n_positives = data.draw(st.integers(0, n_tiles))
    chosen = scores(ranks_kept=data.draw(st.integers(10, 12)), ap_at=data.draw(st.integers(1, 7)))
    places = list(combinations(range(n_tiles), n_positives))  # only these can matter
    tiles = np.empty((len(places), n_tiles), np.int32)
    for row, place in zip(tiles, places, strict=True):
        row[list(place)] = np.arange(n_positives)
        row[np.setdiff1d(np.arange(n_tiles), place)] = np.arange(n_positives, n_tiles)
    expected = score_orders(tiles, n_positives, chosen)
    found = chance_scores(np.array([n_positives]), n_tiles, chosen)
    names = {"map", "mrr", *(name for name in expected if name.startswith(("re", "ap@", "nd")))}
    assert set(found) == names
    for name, value in found.items():
        assert value[0] == pytest.approx(expected[name].mean(), abs=1e-12), name


def test_recall_is_that_of_scipy_for_each_query() -> None:
    positives = np.array([1, 3, 40, 500, 0, 3, 5000])
    found = chance_scores(positives, 5000, scores())
    for k in (1, 3, 5):
        expected = hypergeom.sf(0, 5000, positives, k)
        np.testing.assert_allclose(found[f"recall@{k}"], expected, rtol=1e-9)


def test_lists_cut_at_the_ranks_kept_agree_with_random_orders() -> None:
    # 400 tiles, 100 kept: the mean over 4,000 random orders, within four standard errors.
    rng = np.random.default_rng(0)
    tiles = rng.permuted(np.tile(np.arange(400, dtype=np.int32), (4000, 1)), axis=1)
    expected = score_orders(tiles, 9, scores())
    for name, value in chance_scores(np.array([9]), 400, scores()).items():
        column = expected[name]
        assert abs(column.mean() - value[0]) < 4 * column.std() / np.sqrt(4000), name
