"""Depth consistency of a whole scene: all pairs, both ways, and the verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.datasets.geometry_checks.dataset import PosedScene
from airzoo_bench.datasets.geometry_checks.depth_consistency import (
    OCCLUSION,
)
from airzoo_bench.datasets.geometry_checks.depth_frames import (
    FrameStore,
    PairRule,
    Sampling,
    choose_pairs,
)
from airzoo_bench.datasets.geometry_checks.depth_maps import find_depths
from airzoo_bench.datasets.geometry_checks.depth_pairs import compared_pairs
from airzoo_bench.engines.engine import HERE, Engine
from airzoo_bench.geometry.arrays import Floats, Ints

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["FLOATING_BELOW", "MEDIAN_BELOW", "DepthConsistency", "check_depth_consistency"]

MEDIAN_BELOW = 0.00066
"""The paper's median for its renders, 0.066 %."""

FLOATING_BELOW = 0.1
"""The share of points in front of surfaces must be below this: leaves and wires are."""

_POINTS_FOR_OVERLAP = 64
_MOST_SAMPLES = 1 << 23  # of all ordered pairs together
_LEAST_PIXELS = 64
_FAR_ABOVE = 3.0
_FLOATING_OF_A_FRAME = 0.25


@dataclass(frozen=True, eq=False)
class DepthConsistency:
    """Depth errors of a scene.

    Attributes
    ----------
    frames : DataFrame
        A row a frame with depth: id, median (of the error without sign, over all comparisons with
        the frame), ratio (the median by which its depths are longer than its partners' say, as a
        share), floating (share of points that float, see `floating`), compared. NaN where nothing
        was compared.
    pairs : DataFrame
        A row an ordered pair: source, target, counts as in `Comparison`, compared, median, signed
        median. NaN where nothing was compared.
    error : (M,) float32
        All relative errors, with sign.
    without_depth : tuple of str
        Ids of photos that have no depth map.
    median_below : float
        The limit of the verdict.
    """

    frames: pd.DataFrame
    pairs: pd.DataFrame
    error: NDArray[np.float32]
    without_depth: tuple[str, ...]
    median_below: float

    def quantile(self, share: float) -> float:
        """Return a quantile of the relative error without sign; infinite without comparisons."""
        return float(np.quantile(np.abs(self.error), share)) if self.error.size else np.inf

    @property
    def median(self) -> float:
        """The median relative error, without sign."""
        return self.quantile(0.5)

    @property
    def signed_median(self) -> float:
        """The median relative error, with sign; infinite without comparisons."""
        return float(np.median(self.error)) if self.error.size else np.inf

    @property
    def floating(self) -> float:
        """Share of the compared points that float before the surface."""
        return _floating(self.error)

    @property
    def compared(self) -> float:
        """Share of the sampled pixels with depth that were compared."""
        return self.error.size / max(int(self.pairs["sampled"].sum()), 1)

    @property
    def pairs_without_overlap(self) -> int:
        """Unordered pairs of which no pixel could be compared, either way."""
        return int((self.pairs["compared"].to_numpy().reshape(-1, 2).sum(axis=1) == 0).sum())

    @property
    def bad_frames(self) -> pd.DataFrame:
        """Frames that stand out, the worst first."""
        limit = max(self.median_below, _FAR_ABOVE * self.median)
        most = max(_FLOATING_OF_A_FRAME, _FAR_ABOVE * self.floating)
        chosen = (self.frames["median"] >= limit) | (self.frames["floating"] >= most)
        return self.frames[chosen].sort_values("median", ascending=False, kind="stable")

    @property
    def passes(self) -> bool:
        """Whether nothing is wrong with the median, the points that float, or single frames."""
        sound = self.median < self.median_below and self.floating < FLOATING_BELOW
        return sound and self.bad_frames.empty


def check_depth_consistency(
    scene: PosedScene,
    folder: Path,
    *,
    sampling: Sampling,
    rule: PairRule = PairRule.ALL,
    median_below: float = MEDIAN_BELOW,
    engine: Engine = HERE,
    progress: Progress = silent,
) -> DepthConsistency:
    """Compare the depth maps of a scene with each other."""
    paths = find_depths(folder, scene.images)
    rows = np.array([row for row, path in enumerate(paths) if path is not None])
    if len(rows) < 2:
        raise BenchmarkError("only one photo has a depth map", where=folder, expected="two or more")
    cameras, poses = scene.cameras.take(rows), scene.poses.take(rows)
    store = FrameStore(cameras, poses, [p for p in paths if p is not None], sampling)
    chosen = choose_pairs(rule, cameras, poses, _seen_points(store, rule, progress))
    bounded = max(_LEAST_PIXELS, min(sampling.pixels, _MOST_SAMPLES // max(2 * len(chosen), 1)))
    if bounded < sampling.pixels:
        store = FrameStore(cameras, poses, store.depths, replace(sampling, pixels=bounded))
    ids = [scene.ids[row] for row in rows]
    without = tuple(name for name, path in zip(scene.ids, paths, strict=True) if path is None)
    return _Collected.of(store, chosen, engine, progress).report(ids, without, median_below)


def _seen_points(store: FrameStore, rule: PairRule, progress: Progress) -> Floats:
    """Take some points (N, 64, 3) that each frame sees; NaN where it has fewer."""
    points = np.full((len(store), _POINTS_FOR_OVERLAP, 3), np.nan)
    if rule is PairRule.NEIGHBOURS:
        return points
    for index in progress(range(len(store)), "depth maps", len(store)):
        seen = store.frame(index).world_points[:_POINTS_FOR_OVERLAP]
        points[index, : len(seen)] = seen
    return points


@dataclass(frozen=True, eq=False)
class _Collected:
    """Errors and counts from the comparisons of all ordered pairs."""

    pairs: Ints
    errors: list[NDArray[np.float32]]
    counts: list[tuple[int, int, int, int]]

    @classmethod
    def of(cls, store: FrameStore, chosen: Ints, engine: Engine, progress: Progress) -> _Collected:
        ordered = np.stack((chosen, chosen[:, ::-1]), axis=1).reshape(-1, 2)
        found = list(compared_pairs(store, ordered, engine, progress))
        return cls(ordered, [pair.error for pair in found], [pair.counts for pair in found])

    def report(
        self, ids: Sequence[str], without: tuple[str, ...], median_below: float
    ) -> DepthConsistency:
        return DepthConsistency(
            frames=self._frame_table(ids),
            pairs=self._pair_table(ids),
            error=np.concatenate([np.empty(0, np.float32), *self.errors]),
            without_depth=without,
            median_below=median_below,
        )

    def _pair_table(self, ids: Sequence[str]) -> pd.DataFrame:
        import pandas as pd

        table = pd.DataFrame(
            self.counts, columns=["sampled", "outside", "no_surface", "hidden"], dtype=np.int64
        )
        names = np.array(ids, dtype=object)[self.pairs]
        table.insert(0, "source", names[:, 0])
        table.insert(1, "target", names[:, 1])
        return table.assign(
            compared=[len(error) for error in self.errors],
            median=[_median(np.abs(error)) for error in self.errors],
            signed_median=[_median(error) for error in self.errors],
        )

    def _frame_table(self, ids: Sequence[str]) -> pd.DataFrame:
        import pandas as pd

        of_frame: list[list[int]] = [[] for _ in ids]
        for number, pair in enumerate(self.pairs.tolist()):
            for frame in pair:
                of_frame[frame].append(number)
        rows = [self._frame_row(frame, of_frame[frame]) for frame in range(len(ids))]
        table = pd.DataFrame(rows, columns=["median", "ratio", "floating", "compared"])
        table.insert(0, "id", list(ids))
        return table

    def _frame_row(self, frame: int, numbers: list[int]) -> tuple[float, float, float, int]:
        # Depths of the frame too long: its points lie behind, those of others in front.
        signed = [
            self.errors[number] if self.pairs[number, 0] == frame else -self.errors[number]
            for number in numbers
        ]
        error = np.concatenate([np.empty(0), *signed])
        floats = _floating(np.concatenate([np.empty(0), *(self.errors[n] for n in numbers)]))
        return _median(np.abs(error)), _median(error), floats, len(error)


def _median(values: NDArray[Any]) -> float:
    return float(np.median(values)) if values.size else np.nan


def _floating(error: NDArray[Any]) -> float:
    return float((error < -OCCLUSION).mean()) if error.size else 0.0
