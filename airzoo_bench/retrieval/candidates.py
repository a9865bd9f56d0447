"""What a search in float32 keeps of each query, block by block of the gallery."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.retrieval.pairs import offsets_of

__all__ = ["Kept", "most_kept", "rounded_down"]

_SPARE = 64  # candidates beyond 2k that a query may keep


class Kept:
    """The candidates of n queries.

    Attributes
    ----------
    k : int
        How many tiles are sought.
    kth : (n,) array
        The k-th best value so far, -inf before there are k.
    crowded : (n,) bool array
        Queries whose candidates are too many to keep; they have none here.
    query, tile, value : (m,) arrays
        The candidates.
    """

    def __init__(self, n: int, k: int) -> None:
        self.k = k
        self.kth: Floats = np.full(n, -np.inf)
        self.crowded: Bools = np.zeros(n, bool)
        self.query: Ints = np.zeros(0, np.int64)
        self.tile: Ints = np.zeros(0, np.int64)
        self.value: NDArray[np.float32] = np.zeros(0, np.float32)

    @classmethod
    def joined(cls, parts: Sequence[Kept], starts: Sequence[int]) -> Kept:
        """Put together what was kept of consecutive queries."""
        whole = cls(0, parts[0].k)
        for name in ("kth", "crowded", "tile", "value"):
            setattr(whole, name, np.concatenate([getattr(part, name) for part in parts]))
        shifted = [part.query + start for part, start in zip(parts, starts, strict=True)]
        whole.query = np.concatenate(shifted)
        return whole

    def absorb(self, values: NDArray[np.float32], start: int, bounds: Floats) -> None:
        """Take in the values (B, n) of the tiles from `start` on."""
        row, query = np.nonzero(self._hits(values, bounds))
        self.query = np.concatenate([self.query, query])
        self.tile = np.concatenate([self.tile, row + start])
        self.value = np.concatenate([self.value, values[row, query]])
        self._raise_kth()
        self.prune(bounds)

    def prune(self, bounds: Floats) -> None:
        """Drop what cannot be among the first k, and queries that keep too much even so."""
        kept = self.value >= self._cut(bounds)[self.query]
        counts = np.bincount(self.query[kept], minlength=len(self.kth))
        self.crowded |= counts > most_kept(self.k)
        kept &= ~self.crowded[self.query]
        self.query, self.tile, self.value = self.query[kept], self.tile[kept], self.value[kept]

    def _hits(self, values: NDArray[np.float32], bounds: Floats) -> Bools:
        most = most_kept(self.k)
        hits: Bools = values >= self._cut(bounds)
        many = np.flatnonzero(np.count_nonzero(hits, axis=0) > most)
        if len(many):  # they alone are enough to hold a better k-th value
            there = len(values) - self.k
            best = np.partition(values[:, many], there, axis=0)[there]
            self.kth[many] = np.maximum(self.kth[many], best)
            hits[:, many] = values[:, many] >= self._cut(bounds)[many]
            self.crowded[many] |= np.count_nonzero(hits[:, many], axis=0) > most
            hits[:, self.crowded] = False
        return hits

    def _cut(self, bounds: Floats) -> NDArray[np.float32]:
        """Return the least value that may still be among the first k."""
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


def most_kept(k: int) -> int:
    """Return how many candidates a query may keep."""
    return 2 * k + _SPARE


def rounded_down(values: Floats) -> NDArray[np.float32]:
    """Round to float32 so that no value grows; at the very least one step down."""
    return np.nextafter(values.astype(np.float32), np.float32(-np.inf))
