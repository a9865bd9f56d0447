"""Ordering points along a Morton curve, so that neighbours in space are neighbours in memory.

The order serves speed alone: no result depends on it.

References
----------
Morton, A computer oriented geodetic data base and a new technique in file sequencing, IBM, 1966.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Floats, Ints

__all__ = ["gather", "morton_order"]

_CHUNK = 1 << 15
_SAMPLE = 1 << 14
_MOST_BITS = 21
_FURTHEST = 1e9
# Each step moves the upper half of every group of bits away, until two zeros follow each bit.
_SPREADING = (
    (32, 0x001F00000000FFFF),
    (16, 0x001F0000FF0000FF),
    (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)


def morton_order(points: Floats) -> Ints:
    """Return the permutation that sorts points along a Morton curve.

    Cell and index of a point share one 64-bit integer, so that sorting is one sort of integers.
    The curve's cells are small where most points are and grow without end away from there: a few
    points however far do not coarsen the order of all others.

    Parameters
    ----------
    points : (N, 3) array
        Finite.

    Returns
    -------
    (N,) int64 array
    """
    index_bits = max(len(points) - 1, 1).bit_length()
    bits = min(_MOST_BITS, (64 - index_bits) // 3)
    middle, spread = _core(points)
    keys = np.empty(len(points), dtype=np.uint64)
    for start in range(0, len(points), _CHUNK):
        part = points[start : start + _CHUNK]
        numbers = np.arange(start, start + len(part), dtype=np.uint64)
        cells = _interleave(_cells(part, middle, spread, bits))
        keys[start : start + len(part)] = cells << np.uint64(index_bits) | numbers
    keys.sort()
    keys &= np.uint64((1 << index_bits) - 1)
    return keys.view(np.int64)


def gather(points: Floats, order: Ints) -> Floats:
    """Return ``points[order]``, contiguous, whatever the layout of `points`."""
    picked = np.empty((len(order), points.shape[1]))
    for start in range(0, len(order), _CHUNK):
        picked[start : start + _CHUNK] = points[order[start : start + _CHUNK]]
    return picked


def _core(points: Floats) -> tuple[Floats, Floats]:
    """Where most points are: their median, and how far it is to most of them, by axis."""
    if len(points) == 0:
        return np.zeros(3), np.ones(3)
    sample = points[:: max(1, len(points) // _SAMPLE)] / 2.0  # halves: differences stay finite
    low, middle, high = np.quantile(sample, (0.1, 0.5, 0.9), axis=0)
    spread = high - low
    return middle, np.where(spread > 0.0, spread, 1.0)


def _cells(points: Floats, middle: Floats, spread: Floats, bits: int) -> NDArray[np.uint64]:
    """Cell (3, N) of each point along each axis, from 0 to 2^bits - 1."""
    with np.errstate(over="ignore"):
        away = (points / 2.0 - middle).T / spread[:, None]
    away = np.clip(away, -_FURTHEST, _FURTHEST)
    share = away / (1.0 + np.abs(away)) * 0.5 + 0.5
    cells: NDArray[np.uint64] = np.minimum(share * 2.0**bits, 2.0**bits - 1.0).astype(np.uint64)
    return cells


def _interleave(cells: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """One integer (N,) of the bits of three: z y x z y x ..."""
    for shift, mask in _SPREADING:
        cells = (cells | cells << np.uint64(shift)) & np.uint64(mask)
    woven: NDArray[np.uint64] = cells[0] | cells[1] << np.uint64(1) | cells[2] << np.uint64(2)
    return woven
