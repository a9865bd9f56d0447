from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.retrieval.predictions import check_lists
from airzoo_bench.retrieval.ranking import rank_by_ids
from tests.retrieval.ranking_support import assert_is, naive, positives_of, random_positives


@pytest.mark.parametrize(
    ("ranked", "scores", "positives", "depth", "expected", "tied"),
    [
        # Ties go against the submitter: a non-positive first, then by number.
        ([3, 1, 2, 0], [1, 1, 1, 0.5], [1, 3], 1, [2, 1, 3, 0], True),
        ([3, 1, 2, 0], [-1, -1, -1, -0.5], [1, 3], 1, [2, 1, 3, 0], True),  # distances
        # A tie counts where it begins before the depth.
        ([5, 4, 3, 2, 1, 0], [9, 8, 8, 8, 7, 6], [2], 1, [5, 3, 4, 2, 1, 0], False),
        ([5, 4, 3, 2, 1, 0], [9, 8, 8, 8, 7, 6], [2], 2, [5, 3, 4, 2, 1, 0], True),
        # It takes in what was left out at the end of a list, positives too.
        ([4, 1, 2], [2, 1, 1], [0], 5, [4, 1, 2, 3, 5, -1], True),
        ([4, 1, 2], [2, 1, 1], [1], 5, [4, 0, 2, 3, 5, 1], True),
        ([4, 1, 2], [2, 1, 1], [1], 1, [4, 0, 2, 3, 5, 1], False),
        ([4, 1, 2], [2, 1, 1], [4], 5, [4, 0, 1, 2, 3, 5], False),
        ([4, 1, 2], [2, 1, 1], [0, 1, 2, 3, 5], 5, [4, 1, 2, -1, -1, -1], False),
    ],
)
def test_ties_by_hand(ranked, scores, positives, depth, expected, tied):
    n_tiles = len(expected)
    found = rank_by_ids(
        np.array([ranked]),
        np.array([scores]),
        positives_of(positives),
        n_tiles=n_tiles,
        k=n_tiles,
        tie_ranks=depth,
    )
    assert_is(found, (np.array([expected]), np.array([tied])))


def completed(ranked, scores, positives, n_tiles):
    """What the rule says of lists that end in a tie: the scores of all tiles, those left out too.

    Positives that were left out are as good as not there: worse than everything.
    """
    whole = np.full((len(ranked), n_tiles), -np.inf)
    for query, (tiles, row) in enumerate(zip(ranked, scores, strict=True)):
        if len(tiles) > 1 and row[-1] == row[-2]:
            whole[query] = row[-1]
            whole[query, positives.tiles_of(query)] = -np.inf
        whole[query, tiles] = row
    return whole


# Of three tiles that all answer two are listed, as equals: the third is not given.
@example(seed=1, n_tiles=3, listed=2, k=2, tie_ranks=1, falling=False)
@settings(max_examples=250, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    n_tiles=st.integers(2, 14),
    listed=st.integers(1, 14),
    k=st.integers(1, 14),
    tie_ranks=st.integers(1, 14),
    falling=st.booleans(),
)
def test_lists_agree_with_a_plain_sort_and_a_tie_at_the_end_takes_in_what_was_left_out(
    seed, n_tiles, listed, k, tie_ranks, falling
):
    rng = np.random.default_rng(seed)
    listed = min(listed, n_tiles)
    positives = random_positives(rng, 4, n_tiles)
    ranked = np.stack([rng.permutation(n_tiles)[:listed] for _ in range(4)])
    scores = -np.sort(rng.integers(0, 3, ranked.shape), axis=1).astype(float)
    given_scores = scores if falling else -scores
    found = rank_by_ids(ranked, given_scores, positives, n_tiles=n_tiles, k=k, tie_ranks=tie_ranks)
    whole = completed(ranked, scores, positives, n_tiles)
    if listed == n_tiles:
        assert_is(found, naive(whole, positives, k, tie_ranks))
    for query, row in enumerate(whole):
        positive = np.isin(np.arange(n_tiles), positives.tiles_of(query))
        order = np.lexsort((np.arange(n_tiles), positive, -row))
        order = order[row[order] > -np.inf]
        expected = [*order[:k], *[-1] * k][:k]
        tied_throughout = (scores[query] == scores[query, 0]).all() and listed > 1
        if tied_throughout and not positive.all():
            expected = [-1] * k
        assert found.tiles[query].tolist() == expected


@pytest.mark.parametrize(
    ("ranked", "scores", "field"),
    [
        ([[0, 1, 2], [0, 1, 2]], [[3, 2, 1], [3, 1, 2]], "scores"),
        ([[0, 1, 2], [0, 1, 2]], [[3, 2, 1], [3, np.nan, 2]], "scores"),
        ([[0, 1, 2], [0, -1, 2]], None, "ranked_ids"),
        ([[0, 1, 2], [2, 1, 2]], None, "ranked_ids"),
    ],
)
def test_bad_lists_are_refused_by_name(ranked, scores, field):
    scores = None if scores is None else np.array(scores, float)
    texts = np.where(np.array(ranked) < 0, "", np.array(ranked).astype(str))
    for lists in (np.array(ranked), texts):
        with pytest.raises(PredictionError, match=rf"field '{field}': .*1 of 2 \(b\)"):
            check_lists(lists, scores, ["a", "b"])
    check_lists(texts[:1], None if scores is None else scores[:1], ["a"])
