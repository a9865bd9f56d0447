"""Samples for RANSAC: distinct rows, seeded, or all of them where there are few."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import Protocol

import numpy as np

from airzoo_bench.geometry.arrays import Ints

__all__ = ["sample_blocks"]

# Trials of a block are judged at once, so that how many are made depends on it.
_BLOCK = 50


class _Trials(Protocol):
    @property
    def min_trials(self) -> int: ...
    @property
    def max_trials(self) -> int: ...
    @property
    def seed(self) -> int: ...


def sample_blocks(count: int, size: int, settings: _Trials, *, minimal: bool) -> Iterator[Ints]:
    """Yield samples of `size` of `count` rows, block by block.

    Parameters
    ----------
    count, size : int
    settings : RansacSettings
    minimal : bool
        Where true, and there are at most `min_trials` such samples, all of them are yielded.

    Yields
    ------
    (S, size) int64 array
        Rows in each sample ascending.
    """
    if minimal and math.comb(count, size) <= settings.min_trials:
        yield from _all(count, size)
        return
    random = np.random.default_rng(settings.seed)
    for start in range(0, settings.max_trials, _BLOCK):
        yield _drawn(random, min(_BLOCK, settings.max_trials - start), count, size)


def _all(count: int, size: int) -> Iterator[Ints]:
    every = itertools.combinations(range(count), size)
    while block := list(itertools.islice(every, _BLOCK)):
        yield np.array(block, dtype=np.int64)


def _drawn(random: np.random.Generator, trials: int, count: int, size: int) -> Ints:
    """Draw without replacement: the n-th row is one of those that are left."""
    rows = np.empty((trials, 0), dtype=np.int64)
    for taken in range(size):
        row = random.integers(0, count - taken, trials)
        for column in rows.T:  # ascending
            row += row >= column
        rows = np.sort(np.column_stack((rows, row)), axis=1)
    return rows
