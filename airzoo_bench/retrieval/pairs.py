"""The positive tiles of every query, as sparse pairs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import BenchmarkError

__all__ = ["Positives", "offsets_of"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


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
        """Make positives of arrays read from a file.

        Raises
        ------
        BenchmarkError
            Where offsets do not rise from 0 to the number of tiles, a tile is not in the
            gallery, tiles do not ascend within a query, or an overlap is not in [0, 1].
        """
        fault = _fault(offsets, tiles, overlap, n_queries, n_tiles)
        if fault is not None:
            raise BenchmarkError(
                f"the positives are damaged: {fault[0]}",
                where=where,
                expected=fault[1],
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

    def holds(
        self, queries: Ints, tiles: NDArray[np.integer[Any]], n_tiles: int
    ) -> NDArray[np.bool_]:
        """Tell which pairs of query and tile are positive, `n_tiles` tiles in the gallery."""
        keys = self.queries * n_tiles + self.tiles
        asked = queries * n_tiles + tiles
        place = np.minimum(np.searchsorted(keys, asked), len(keys) - 1)
        held: NDArray[np.bool_] = keys[place] == asked if len(keys) else np.zeros(asked.shape, bool)
        return held

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


def offsets_of(counts: Ints) -> Ints:
    """Offsets (Q + 1,) of groups of the given sizes (Q,)."""
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


def _fault(
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
