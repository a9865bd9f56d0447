"""The positive tiles of every query, as sparse pairs, and which ranked tiles are among them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import BenchmarkError, PredictionError
from airzoo_bench.core.files import write_npz
from airzoo_bench.formats.npz import NpzFile
from airzoo_bench.geometry.arrays import Bools, Floats, Ints

__all__ = ["Positives", "hit_matrix", "offsets_of", "read_pairs", "write_pairs"]

_BYTES_OF_A_NUMBER = 8
_ARRAYS = {"offsets", "tiles", "overlap"}

# Cells of one block's bitmap: 4 MB stays in the cache, where random reads are cheap.
_CELLS = 1 << 22


@dataclass(frozen=True, eq=False)
class Positives:
    """The positive tiles of every query, sparse.

    Parameters
    ----------
    offsets : (Q + 1,) int64 array
        Query q has the tiles `tiles[offsets[q]:offsets[q + 1]]`.
    tiles : (P,) int32 array
        Rows of the gallery table, ascending within each query.
    overlap : (P,) float64 array or None
        Overlap ratio of footprint and tile, where it was computed.
    """

    offsets: Ints
    tiles: NDArray[np.int32]
    overlap: Floats | None = None

    @classmethod
    def checked(
        cls,
        offsets: NDArray[Any],
        tiles: NDArray[Any],
        overlap: NDArray[Any] | None = None,
        *,
        n_queries: int,
        n_tiles: int,
        where: object = None,
    ) -> Positives:
        """Make positives of arrays read from a file."""
        damage = _damage(offsets, tiles, overlap, n_queries, n_tiles)
        if damage is not None:
            raise BenchmarkError(
                f"the positives are damaged: {damage[0]}",
                where=where,
                expected=damage[1],
                fix="run `airzoo-bench prepare` again",
            )
        ratio = None if overlap is None else overlap.astype(np.float64)
        return cls(offsets.astype(np.int64), tiles.astype(np.int32), ratio)

    @property
    def n_queries(self) -> int:
        """Number of queries."""
        return len(self.offsets) - 1

    @property
    def counts(self) -> Ints:
        """Number of positives of each query, (Q,)."""
        return np.diff(self.offsets)

    @property
    def queries(self) -> Ints:
        """Query of each pair, (P,)."""
        return np.repeat(np.arange(self.n_queries), self.counts)

    def holds(self, queries: Ints, tiles: NDArray[np.integer[Any]], n_tiles: int) -> Bools:
        """Tell which pairs of query and tile are positive, `n_tiles` tiles in the gallery."""
        keys = self.queries * n_tiles + self.tiles
        asked = queries * n_tiles + tiles
        place = np.minimum(np.searchsorted(keys, asked), len(keys) - 1)
        found: Bools = keys[place] == asked if len(keys) else np.zeros(asked.shape, bool)
        return found

    def of(self, query: int) -> NDArray[np.int32]:
        """Give the positive tiles of one query."""
        return self.tiles[self.offsets[query] : self.offsets[query + 1]]

    def take(self, queries: Ints) -> Positives:
        """Return the positives of some queries, in the order asked for."""
        counts = self.counts[queries]
        offsets = offsets_of(counts)
        within = np.arange(offsets[-1]) - np.repeat(offsets[:-1], counts)
        pairs = np.repeat(self.offsets[queries], counts) + within
        overlap = None if self.overlap is None else self.overlap[pairs]
        return Positives(offsets, self.tiles[pairs], overlap)


def write_pairs(path: Path, pairs: Positives) -> None:
    """Write pairs as .npz: offsets, tiles and, where there is one, overlap."""
    arrays: dict[str, NDArray[Any]] = {"offsets": pairs.offsets, "tiles": pairs.tiles}
    if pairs.overlap is not None:
        arrays["overlap"] = pairs.overlap
    write_npz(path, arrays, compress=True)


def read_pairs(path: Path, n_queries: int, n_tiles: int) -> Positives:
    """Read what `write_pairs` wrote."""
    if not path.is_file():
        raise BenchmarkError(
            "the benchmark folder has no truth here",
            where=path,
            fix="prepare the benchmark again; `check` needs no truth, `eval` does",
        )
    pairs = n_queries * n_tiles
    try:
        # No more than each query's offset, and the tile and overlap of every pair there can be.
        file = NpzFile(path, _BYTES_OF_A_NUMBER * (n_queries + 1 + 2 * pairs))
        arrays = {name: file.read(name) for name in _ARRAYS & set(file.entries)}
    except PredictionError as error:
        raise _damaged(path, error.what) from error
    if not {"offsets", "tiles"} <= set(arrays):
        raise _damaged(path, f"has the arrays {', '.join(sorted(file.entries)) or 'none'}")
    return Positives.checked(
        arrays["offsets"],
        arrays["tiles"],
        arrays.get("overlap"),
        n_queries=n_queries,
        n_tiles=n_tiles,
        where=path,
    )


def _damaged(path: Path, what: str) -> BenchmarkError:
    return BenchmarkError(
        f"the positives are damaged: {what}",
        where=path,
        expected="offsets and tiles, as `airzoo-bench prepare` wrote them",
        fix="prepare the benchmark again",
    )


def offsets_of(counts: Ints) -> Ints:
    """Offsets (Q + 1,) of groups of the given sizes (Q,)."""
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


def hit_matrix(
    ranked: NDArray[np.int32],
    offsets: Ints,
    tiles: NDArray[np.int32],
    n_tiles: int,
) -> Bools:
    """Mark the ranks that hold a positive tile."""
    _check_hits(ranked, offsets, tiles, n_tiles)
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


def _check_hits(
    ranked: NDArray[np.int32], offsets: Ints, tiles: NDArray[np.int32], n_tiles: int
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


def _damage(
    offsets: NDArray[Any],
    tiles: NDArray[Any],
    overlap: NDArray[Any] | None,
    n_queries: int,
    n_tiles: int,
) -> tuple[str, str] | None:
    """Say what is wrong with stored positives and what was expected."""
    if offsets.dtype.kind not in "iu" or tiles.dtype.kind not in "iu":
        return "offsets or tiles are not integers", "integer arrays"
    if offsets.shape != (n_queries + 1,) or tiles.ndim != 1:
        return f"offsets have shape {offsets.shape}", f"({n_queries + 1},), one query more"
    if offsets[0] != 0 or offsets[-1] != len(tiles) or (offsets[1:] < offsets[:-1]).any():
        return "offsets do not rise from 0", f"ascending offsets from 0 to {len(tiles)}"
    if len(tiles) and not (tiles.min() >= 0 and tiles.max() < n_tiles):
        return "a tile is not in the gallery", f"tiles from 0 to {n_tiles - 1}"
    begins = np.zeros(len(tiles) + 1, dtype=bool)
    begins[offsets] = True
    if not (begins[1:-1] | (tiles[1:] > tiles[:-1])).all():
        return "tiles do not ascend within each query", "ascending tiles without repeats"
    if overlap is None:
        return None
    is_number = overlap.dtype.kind in "fiu"
    if overlap.shape != tiles.shape or not (is_number and ((overlap >= 0) & (overlap <= 1)).all()):
        return "overlaps do not fit", "an overlap in [0, 1] for each tile"
    return None
