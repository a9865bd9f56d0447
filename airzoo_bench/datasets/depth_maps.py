"""Depth maps in files, and depth maps against each other.

Files are ``.tif``, ``.npy``, ``.npz`` or 16-bit ``.png`` of the size of their photo. Where depths
are zero, negative, NaN, infinite or the file's nodata, there is no depth.

Two maps are compared both ways: a pixel of the source becomes a point by its depth, whose depth in
the target's camera, z_projected, is held against the depth z_depth of the target's surface there:
(z_projected - z_depth) / z_depth.

On a plane 1/z, not z, is affine in pixels of a camera without distortion; so 1/z is interpolated
(bilinear over the four pixel centres around), which is exact on planes at any slant. Where the
second differences of 1/z around exceed `EDGE` of it, nothing is compared. A point *behind* the
target's surface by more than `OCCLUSION` of its depth is hidden from the target, and left out;
nothing can hide one in front.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from airzoo_bench.core.errors import BenchmarkError, UsageError, readable
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.geometry.arrays import Bools, Floats, apply_matrix
from airzoo_bench.geometry.cameras import Cameras, back_project, project
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.rasters import open_raster

_SUFFIXES = (".tif", ".tiff", ".npy", ".npz", ".png")


def find_depths(folder: Path, images: Sequence[str]) -> tuple[Path | None, ...]:
    """Find the depth map of each photo: its name with another ending, in its own subfolder."""
    stems = [folder / Path(name).with_suffix("") for name in images]
    files = [path for path in sorted(folder.rglob("*")) if path.suffix.lower() in _SUFFIXES]
    there = {path.with_suffix(""): path for path in files}
    found = tuple(there.get(stem) for stem in stems)
    if not any(found) or len(there) < len(files):
        what = "photos have no depth map, or more than one"
        expected = f"one such as {stems[0].name}.tif a photo ({', '.join(_SUFFIXES)})"
        raise UsageError(what, where=folder, expected=expected, fix="name its folder with --depth")
    return found


def read_depth(
    path: Path, width: int, height: int, scale_m: float | None = None
) -> NDArray[np.float32]:
    """Read a depth map in metres, NaN where there is none."""
    nodata = None
    with readable(path, "is no depth map", kind=BenchmarkError, expected=", ".join(_SUFFIXES)):
        if path.suffix.lower() in (".npy", ".npz"):
            stored = np.load(path, allow_pickle=False)
            if path.suffix.lower() == ".npz":
                stored = stored["depth" if "depth" in stored else stored.files[0]]
        else:
            with open_raster(path) as dataset:
                stored, nodata = dataset.read(), dataset.nodata
    stored = stored.squeeze()
    unknown_unit = stored.dtype.kind in "iu" and not scale_m
    if stored.shape != (height, width) or stored.dtype.itemsize == 1 or unknown_unit:
        raise BenchmarkError(
            f"holds {stored.dtype} of {' x '.join(map(str, stored.shape[::-1]))}",
            where=path,
            expected=f"{width} x {height} depths: metres as float32, or 16-bit whole numbers with "
            "their unit (--depth-scale, such as 0.001 for millimetres)",
        )
    with np.errstate(over="ignore", invalid="ignore"):
        depth = (stored * (1.0 if scale_m is None else scale_m)).astype(np.float32)
        there = (depth > 0.0) & np.isfinite(depth)
    if nodata is not None:
        there &= stored != nodata
    return np.where(there, depth, np.float32(np.nan))


# --- depth maps against each other ---

EDGE, OCCLUSION = 0.01, 0.01
MEDIAN_BELOW = 0.00066
"""The paper's median for its renders, 0.066 %."""

DepthKind = Literal["z", "ray"]
_AROUND = np.arange(-1, 3)
_PARTNERS = 4
_FAR_ABOVE = 3.0  # times the median of all: a frame that stands out


@dataclass(frozen=True, eq=False)
class Frame:
    """A photo's camera, pose and depth; `points` (S, 3), in its frame, from sampled pixels."""

    camera: Cameras
    rotation: Floats
    centre: Floats
    depth: NDArray[np.float32]
    kind: DepthKind
    points: Floats


def sample_frame(
    camera: Cameras, pose: Poses, depth: NDArray[np.float32], kind: DepthKind, most: int, seed: int
) -> Frame:
    """Sample pixels of a depth map, and back-project them."""
    random = np.random.default_rng((0, seed))
    picked = random.choice(depth.size, min(most, depth.size), replace=False)
    row, column = np.divmod(picked, depth.shape[1])
    rays = back_project(camera, np.stack((column, row), axis=-1)[None] + 0.5)[0]
    if kind == "z":
        rays = rays / rays[:, 2:]
    points: Floats = rays * depth[row, column].astype(np.float64)[:, None]
    points = points[np.isfinite(points).all(axis=1)]
    return Frame(camera, pose.rotation[0], pose.centres[0], depth, kind, points)


def compare_depths(source: Frame, target: Frame) -> Floats:
    """Return the signed relative errors of a source's points in a target.

    Points are left out that lie outside the target's image, where it has no depth or an edge, or
    behind its surface.
    """
    turn = target.rotation @ source.rotation.T
    # Centres are subtracted first: they may be millions of metres, their difference is not.
    shift = apply_matrix(target.rotation, source.centre - target.centre)
    projected = apply_matrix(turn, source.points) + shift
    pixels = project(target.camera, projected[None])[0]
    height, width = target.depth.shape
    with np.errstate(invalid="ignore"):
        # A whole block of 4 x 4 pixel centres lies around; NaN has none.
        inside = (pixels >= 1.5).all(axis=1) & (pixels < (width - 1.5, height - 1.5)).all(axis=1)
    inverse, smooth = _inverse_depths(target, pixels[inside])
    error: Floats = inverse[smooth] * projected[inside][smooth, 2] - 1.0
    return error[error <= OCCLUSION]


def _inverse_depths(target: Frame, pixels: Floats) -> tuple[Floats, Bools]:
    """Return 1/z of the target's surface at pixels (M, 2), and where it is smooth (M,)."""
    corner = np.floor(pixels - 0.5).astype(np.int64)
    row = corner[:, 1, None, None] + _AROUND[:, None]
    column = corner[:, 0, None, None] + _AROUND
    depth: Floats = target.depth[row, column].astype(np.float64)
    if target.kind == "ray":
        around = np.stack(np.broadcast_arrays(column, row), axis=-1).reshape(1, -1, 2) + 0.5
        depth *= back_project(target.camera, around)[0, :, 2].reshape(depth.shape)
    inverse = 1.0 / depth
    along_rows = np.abs(np.diff(inverse[:, 1:3], n=2, axis=2)).max(axis=(1, 2))
    along_columns = np.abs(np.diff(inverse[:, :, 1:3], n=2, axis=1)).max(axis=(1, 2))
    level = inverse[:, 1:3, 1:3].mean(axis=(1, 2))
    smooth: Bools = np.maximum(along_rows, along_columns) <= EDGE * level
    a, b, c, d = np.moveaxis(inverse[:, 1:3, 1:3].reshape(-1, 4), 1, 0)
    x, y = (pixels - 0.5 - corner).T
    return (1 - y) * ((1 - x) * a + x * b) + y * ((1 - x) * c + x * d), smooth


@dataclass(frozen=True, eq=False)
class DepthConsistency:
    """All relative errors of a scene, with sign, and medians without sign of frames by id."""

    error: Floats
    medians: pd.Series[float]
    pairs: int
    median_below: float

    def quantile(self, share: float) -> float:
        """Return a quantile of the relative error without sign; infinite without comparisons."""
        return float(np.quantile(np.abs(self.error), share)) if self.error.size else np.inf

    @property
    def bad_frames(self) -> pd.Series[float]:
        """The medians of frames far above the others, the worst first."""
        limit = max(self.median_below, _FAR_ABOVE * self.quantile(0.5))
        return self.medians[self.medians >= limit].sort_values(ascending=False, kind="stable")

    @property
    def failures(self) -> list[str]:
        """Figures beyond their thresholds, a sentence each."""
        found, median = [], self.quantile(0.5)
        if median >= self.median_below:
            found.append(
                f"median depth error {100 * median:.4f} %, not below {100 * self.median_below:g} "
                "%: if it is large, look whether poses are world-to-camera with axes of OpenCV, "
                "and depth along the optical axis (--depth-kind)"
            )
        worst = self.bad_frames.head(3).items()
        return found + [f"{one}: median depth error {100 * value:.4f} %" for one, value in worst]


def check_depth_consistency(
    ids: Sequence[str],
    cameras: Cameras,
    poses: Poses,
    depths: Sequence[Path | None],
    *,
    kind: DepthKind = "z",
    scale_m: float | None = None,
    pixels: int = 4096,
    median_below: float = MEDIAN_BELOW,
    progress: Progress = silent,
) -> DepthConsistency:
    """Compare the depth of each frame of a scene with the next and four that look near."""
    paths = {row: path for row, path in enumerate(depths) if path is not None}
    rows = [*paths]
    if len(rows) < 2:
        raise BenchmarkError("fewer than two photos have a depth map")

    @lru_cache(maxsize=16)
    def frame(number: int) -> Frame:
        row = rows[number]
        camera = cameras.take(row)
        depth = read_depth(paths[row], int(camera.width[0]), int(camera.height[0]), scale_m)
        return sample_frame(camera, poses.take(row), depth, kind, pixels, number)

    middles = np.empty((len(rows), 3))
    for number in progress(range(len(rows)), "depth maps", len(rows)):
        one = frame(number)
        seen = one.points if len(one.points) else np.zeros((1, 3))
        middles[number] = apply_matrix(one.rotation.T, seen.mean(axis=0)) + one.centre
    nearest = cKDTree(middles).query(middles, k=min(_PARTNERS + 1, len(rows)))[1].tolist()
    partners = {(a, b) for a, near in enumerate(nearest) for b in (*near, a + 1) if b < len(rows)}
    pairs = sorted({(min(pair), max(pair)) for pair in partners if len({*pair}) == 2})
    errors: dict[tuple[int, int], Floats] = {}
    for pair in progress(pairs, "pairs of frames", len(pairs)):
        for source, target in (pair, pair[::-1]):
            errors[source, target] = compare_depths(frame(source), frame(target))
    medians = {}
    for number, row in enumerate(rows):
        own = np.concatenate([found for pair, found in errors.items() if number in pair])
        medians[ids[row]] = float(np.median(np.abs(own))) if own.size else np.nan
    every = np.concatenate([*errors.values()])
    return DepthConsistency(every, pd.Series(medians), len(pairs), median_below)
