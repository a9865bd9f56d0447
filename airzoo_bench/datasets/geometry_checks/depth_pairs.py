"""Comparison of ordered pairs of frames, a run of pairs a task."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.geometry_checks.depth_consistency import (
    Comparison,
    compare_depths,
)
from airzoo_bench.datasets.geometry_checks.depth_frames import FrameStore
from airzoo_bench.engines.engine import Engine, split
from airzoo_bench.geometry.arrays import Ints

__all__ = ["ComparedPair", "compared_pairs"]

_PAIRS_A_TASK = 64


class ComparedPair(NamedTuple):
    """Errors of a pair, and counts as in `Comparison`."""

    error: NDArray[np.float32]
    counts: tuple[int, int, int, int]


def compared_pairs(
    store: FrameStore, ordered: Ints, engine: Engine, progress: Progress
) -> Iterator[ComparedPair]:
    """Compare pairs (P, 2) in their order."""
    tasks = split(len(ordered), _PAIRS_A_TASK)
    found = engine.map(
        _compare,
        tasks,
        shared=(store, ordered),
        stage="pairs of frames",
        name=lambda run: f"pairs {run.start + 1:,} to {run.stop:,} of frames",
    )
    for pairs in progress(found, "pairs of frames", len(tasks)):
        yield from pairs


def _compare(shared: tuple[FrameStore, Ints], run: slice) -> list[ComparedPair]:
    store, ordered = shared
    return [_compared(store, source, target) for source, target in ordered[run].tolist()]


def _compared(store: FrameStore, source: int, target: int) -> ComparedPair:
    compared = compare_depths(store.frame(source), store.frame(target))
    return ComparedPair(
        compared.error.astype(np.float32),
        _counts(compared),
    )


def _counts(compared: Comparison) -> tuple[int, int, int, int]:
    return compared.sampled, compared.outside, compared.no_surface, compared.hidden
