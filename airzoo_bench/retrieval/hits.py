"""Which ranked tiles are positive: from tile indices to the hit matrix every metric reads."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["hit_matrix"]

# Cells of one block's bitmap: 4 MB stays in the cache, where random reads are cheap.
_CELLS = 1 << 22


def hit_matrix(
    ranked: NDArray[np.int32],
    offsets: NDArray[np.int64],
    tiles: NDArray[np.int32],
    n_tiles: int,
) -> NDArray[np.bool_]:
    """Mark the ranks that hold a positive tile.

    Time grows with Q K + P and memory with the answer; neither depends on how many positives a
    query has. The tiles of one query are taken to be distinct: a tile ranked twice hits twice.

    Parameters
    ----------
    ranked : (Q, K) int32
        Tile indices of each query, best first; -1 where there is no tile, which is never a hit.
    offsets : (Q + 1,) int64
        The positives of query q are ``tiles[offsets[q]:offsets[q + 1]]``.
    tiles : (P,) int32
        Tile indices of the positives.
    n_tiles : int
        Size of the gallery: indices run from 0 to ``n_tiles - 1``.

    Returns
    -------
    (Q, K) bool
        True where the ranked tile is a positive of its query.

    Raises
    ------
    ValueError
        The shapes do not fit together, or an index lies outside the gallery.
    """
    _check(ranked, offsets, tiles, n_tiles)
    n_queries, depth = ranked.shape
    width = n_tiles + 1  # column 0 of the bitmap stands for -1 and stays False
    rows = max(1, _CELLS // max(width, depth))
    bitmap = np.zeros(min(rows, n_queries) * width, dtype=np.bool_)
    hits = np.empty(ranked.shape, dtype=np.bool_)
    for start in range(0, n_queries, rows):
        stop = min(start + rows, n_queries)
        origin = np.arange(stop - start) * width + 1
        bounds = offsets[start : stop + 1]
        positive = np.repeat(origin, np.diff(bounds)) + tiles[bounds[0] : bounds[-1]]
        bitmap[positive] = True
        # "clip" only spares numpy a buffer: every index was checked.
        np.take(bitmap, origin[:, None] + ranked[start:stop], out=hits[start:stop], mode="clip")
        bitmap[positive] = False
    return hits


def _check(
    ranked: NDArray[np.int32], offsets: NDArray[np.int64], tiles: NDArray[np.int32], n_tiles: int
) -> None:
    if ranked.ndim != 2:
        raise ValueError(f"ranked has shape {ranked.shape}, expected (Q, K)")
    if offsets.shape != (len(ranked) + 1,):
        raise ValueError(f"offsets has shape {offsets.shape}, expected ({len(ranked) + 1},)")
    if offsets[0] != 0 or offsets[-1] != len(tiles) or (np.diff(offsets) < 0).any():
        raise ValueError(f"offsets do not run from 0 to {len(tiles)} without falling")
    for name, indices, lowest in (("ranked", ranked, -1), ("tiles", tiles, 0)):
        if indices.size and (indices.min() < lowest or indices.max() >= n_tiles):
            raise ValueError(f"{name} holds an index outside {lowest} to {n_tiles - 1}")
