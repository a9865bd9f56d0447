"""Ties of ranked lists: broken against the submitter, also with the tiles that were left out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Bools, Ints
from airzoo_bench.retrieval.pairs import Positives

__all__ = ["Ranking", "break_ties", "cut_at", "without_constant"]


@dataclass(frozen=True, eq=False)
class Ranking:
    """The gallery of each query, best first.

    Parameters
    ----------
    tiles : (Q, K) int32 array
        Rows of the gallery table; -1 where there are no more.
    tie_dependent : (Q,) bool array
        Whether a run of equal scores that begins before the depth of the scores holds both a
        positive and another tile.
    hit_ranks : (P,) int64 array, optional
        Where scores read whole lists, which are not kept: for each query as many numbers as it
        has positives, the ranks (from 1) that hold one, ascending, and 0 for those not ranked.
    """

    tiles: NDArray[np.int32]
    tie_dependent: Bools
    hit_ranks: Ints | None = None


def break_ties(
    tiles: Ints,
    scores: NDArray[np.floating[Any]],
    positives: Positives,
    n_tiles: int,
    k: int,
    depth: int,
) -> Ranking:
    """Order each run of equal scores non-positive first, then by tile; the last one as a whole."""
    valid = tiles >= 0
    tied = (scores[:, 1:] == scores[:, :-1]) & valid[:, 1:]
    place = np.broadcast_to(np.arange(tiles.shape[1]), tiles.shape)
    opens = np.ones(tiles.shape, bool)
    opens[:, 1:] = ~tied
    begins = np.maximum.accumulate(np.where(opens, place, 0), axis=1)
    query = np.broadcast_to(np.arange(len(tiles))[:, None], tiles.shape)
    positive = valid & positives.holds(query, tiles, n_tiles)
    order = np.lexsort((tiles, positive, begins), axis=1)
    ordered = np.take_along_axis(tiles, order, axis=1)
    positive = np.take_along_axis(positive, order, axis=1)
    mixed = tied & ~positive[:, :-1] & positive[:, 1:] & (begins[:, 1:] < depth)
    ranking = Ranking(cut_at(ordered, k), mixed.any(axis=1))
    length = valid.sum(axis=1)
    last = np.where(length > 0, begins[np.arange(len(tiles)), length - 1], length)
    for row in np.flatnonzero((length - last > 1) & (length < n_tiles)).tolist():
        given = ordered[row, : length[row]]
        ranking.tiles[row, last[row] :] = -1
        _fill_up(ranking, row, given, int(last[row]), positives.of(row), n_tiles, depth)
    flat = (last == 0) & (length > 1)
    return without_constant(ranking, np.flatnonzero(flat), positives, n_tiles)


def _fill_up(
    ranking: Ranking,
    row: int,
    given: Ints,
    start: int,
    positives: NDArray[np.int32],
    n_tiles: int,
    depth: int,
) -> None:
    """Order the run that begins at `start` of a list together with the tiles left out."""
    is_positive, is_free = np.zeros(n_tiles, bool), np.ones(n_tiles, bool)
    is_positive[positives], is_free[given[:start]] = True, False
    others = np.flatnonzero(is_free & ~is_positive)
    found = given[start:][is_positive[given[start:]]]
    room = ranking.tiles[row, start:]
    filled = np.concatenate([others, found])[: len(room)]
    room[: len(filled)] = filled
    mixed = bool(len(others)) and bool((is_free & is_positive).any())
    ranking.tie_dependent[row] |= mixed and start < depth


def cut_at(tiles: Ints, k: int) -> NDArray[np.int32]:
    """Cut ranked tiles to k, or fill them up with -1."""
    cut = np.full((len(tiles), k), -1, np.int32)
    cut[:, : tiles.shape[1]] = tiles[:, :k]
    return cut


def without_constant(
    ranking: Ranking, flat: NDArray[np.integer[Any]], positives: Positives, n_tiles: int
) -> Ranking:
    """Take away the tiles of queries whose whole gallery ties, unless any order is as good."""
    tiles, tied = ranking.tiles.copy(), ranking.tie_dependent.copy()
    right = positives.counts[flat]
    some = flat[right < n_tiles] if n_tiles > 1 else flat[:0]
    tiles[some], tied[some] = -1, positives.counts[some] > 0
    # A list keeps what it gave; descriptors, which were not searched, give the whole gallery.
    every = flat[(right == n_tiles) & (tiles[flat, 0] < 0)]
    depth = min(tiles.shape[1], n_tiles)
    tiles[every, :depth] = np.arange(depth)
    return Ranking(tiles, tied)
