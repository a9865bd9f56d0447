"""Search values in float32, block by block: what each query must keep as candidates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.retrieval.pairs import offsets_of

__all__ = ["Search", "rounded_down"]


_SPARE = 64  # candidates beyond 2k that a query may keep


@dataclass
class Search:
    """What the search keeps of some queries.

    Parameters
    ----------
    part : slice
        Which n queries.
    k : int
        How many tiles are sought.
    kth : (n,) array
        The k-th best value so far, -inf before there are k.
    crowded : (n,) bool array
        Queries whose candidates are too many to keep; they have none here.
    top : (n,) array
        The best value so far; where searches are merged, that of their crowds.
    query, tile, value : (m,) arrays
        The candidates; queries count from the start of the part.
    """

    part: slice
    k: int
    kth: Floats
    crowded: Bools
    top: Floats
    query: Ints
    tile: Ints
    value: NDArray[np.float32]

    @classmethod
    def of(cls, part: slice, k: int) -> Search:
        """Begin for the queries of a part."""
        n, none = part.stop - part.start, np.zeros(0, np.int64)
        kth, crowded = np.full(n, -np.inf), np.zeros(n, bool)
        return cls(part, k, kth, crowded, kth.copy(), none, none, np.zeros(0, np.float32))

    @staticmethod
    def most(k: int) -> int:
        """How many candidates a query may keep."""
        return 2 * k + _SPARE

    def absorb(self, values: NDArray[np.float32], start: int, bounds: Floats) -> None:
        """Take in the values (B, n) of the tiles from `start` on."""
        row, query = np.nonzero(self._hits(values, bounds))
        found = values[row, query]
        np.maximum.at(self.top, query, found)
        if self.crowded.any():
            best = values[:, self.crowded].max(axis=0)
            self.top[self.crowded] = np.maximum(self.top[self.crowded], best)
        self._take(query, row + start, found, bounds)

    def merge(self, part: Search, bounds: Floats) -> None:
        """Take in what a search of other tiles kept of the same queries; `settle` comes last."""
        self.kth = np.maximum(self.kth, part.kth)
        self.top = np.maximum(self.top, np.where(part.crowded, part.top, -np.inf))
        self._take(part.query, part.tile, part.value, bounds)

    def settle(self, bounds: Floats) -> None:
        """Forget the crowds of parts that cannot be among the first k of all."""
        self.crowded |= (self.top > -np.inf) & (self.top >= self._cut(bounds))
        self.prune(bounds)

    def _take(self, query: Ints, tile: Ints, value: NDArray[np.float32], bounds: Floats) -> None:
        self.query = np.concatenate([self.query, query])
        self.tile = np.concatenate([self.tile, tile])
        self.value = np.concatenate([self.value, value])
        self._raise_kth()
        self.prune(bounds)

    def prune(self, bounds: Floats) -> None:
        """Drop what cannot be among the first k, and queries that keep too much even so."""
        kept = self.value >= self._cut(bounds)[self.query]
        self.crowded |= np.bincount(self.query[kept], minlength=len(self.kth)) > self.most(self.k)
        kept &= ~self.crowded[self.query]
        self.query, self.tile, self.value = self.query[kept], self.tile[kept], self.value[kept]

    def _hits(self, values: NDArray[np.float32], bounds: Floats) -> Bools:
        hits: Bools = values >= self._cut(bounds)
        many = np.flatnonzero(np.count_nonzero(hits, axis=0) > self.most(self.k))
        if len(many):  # they alone are enough to hold a better k-th value
            there = len(values) - self.k
            best = np.partition(values[:, many], there, axis=0)[there]
            self.kth[many] = np.maximum(self.kth[many], best)
            hits[:, many] = values[:, many] >= self._cut(bounds)[many]
            self.crowded[many] |= np.count_nonzero(hits[:, many], axis=0) > self.most(self.k)
            hits[:, self.crowded] = False
        return hits

    def _cut(self, bounds: Floats) -> NDArray[np.float32]:
        """Least value that may still be among the first k."""
        return rounded_down(np.where(self.crowded, np.inf, self.kth - 2 * bounds))

    def _raise_kth(self) -> None:
        counts = np.bincount(self.query, minlength=len(self.kth))
        width = counts.max(initial=0)
        if width < self.k:
            return
        order = np.argsort(self.query, kind="stable")
        self.query, self.tile, self.value = self.query[order], self.tile[order], self.value[order]
        table = np.full((len(self.kth), width), -np.inf, np.float32)
        table[self.query, np.arange(len(order)) - offsets_of(counts)[self.query]] = self.value
        best = np.partition(table, width - self.k, axis=1)[:, width - self.k]
        self.kth = np.maximum(self.kth, best)


def rounded_down(values: Floats) -> NDArray[np.float32]:
    """Round to float32 so that no value grows; at the very least one step down."""
    return np.nextafter(values.astype(np.float32), np.float32(-np.inf))
