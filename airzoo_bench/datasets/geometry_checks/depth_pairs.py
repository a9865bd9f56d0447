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
from airzoo_bench.datasets.geometry_checks.depth_faults import design_rows
from airzoo_bench.datasets.geometry_checks.depth_frames import FrameStore
from airzoo_bench.engines.engine import Engine, runs
from airzoo_bench.geometry.arrays import Floats, Ints

__all__ = ["ComparedPair", "compared_pairs"]

_PAIRS_A_TASK = 64


class ComparedPair(NamedTuple):
    """Errors of a pair, some rows of its regression, counts, and the depth of a point or none."""

    error: NDArray[np.float32]
    design: tuple[Floats, Floats, Floats]
    counts: tuple[int, int, int, int]
    near_m: list[float]


def compared_pairs(
    store: FrameStore, ordered: Ints, rows: int, engine: Engine, progress: Progress
) -> Iterator[ComparedPair]:
    """Compare pairs (P, 2) in their order, with so many rows of a regression each."""
    tasks = runs(len(ordered), _PAIRS_A_TASK)
    found = engine.map(
        _compare,
        tasks,
        shared=(store, ordered, rows),
        stage="pairs of frames",
        name=lambda run: f"pairs {run.start + 1:,} to {run.stop:,} of frames",
    )
    for pairs in progress(found, "pairs of frames", len(tasks)):
        yield from pairs


def _compare(shared: tuple[FrameStore, Ints, int], run: slice) -> list[ComparedPair]:
    store, ordered, rows = shared
    return [_compared(store, source, target, rows) for source, target in ordered[run].tolist()]


def _compared(store: FrameStore, source: int, target: int, rows: int) -> ComparedPair:
    a, b = store.frame(source), store.frame(target)
    compared = compare_depths(a, b)
    return ComparedPair(
        compared.error.astype(np.float32),
        design_rows(compared, b.rotation @ a.rotation.T, rows),
        _counts(compared),
        compared.projected[:1, 2].tolist(),
    )


def _counts(compared: Comparison) -> tuple[int, int, int, int]:
    return compared.sampled, compared.outside, compared.no_surface, compared.hidden
