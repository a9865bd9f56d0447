"""Lifting beside SciPy's interpolation, poses beside bare calls of pycolmap."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import rasterio
from harness import ROOT, Case, Work, main, no_input, same
from numpy.typing import NDArray
from rasterio import Affine
from rasterio.windows import Window
from scipy.ndimage import map_coordinates

from airzoo_bench.evaluation.track import Run
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.rasters import open_info
from airzoo_bench.matching.solving import lift, solve_queries

sys.path.insert(0, str(ROOT))

from tests.matching.world import PROJECTED, SOLVER, Problem, joined, make_scene

Floats = NDArray[np.float64]


def make_surface(folder: Path, side: int, **_: Any) -> None:
    """Write hills with holes of nodata as a float32 GeoTIFF, a strip of tiles at a time."""
    random = np.random.default_rng(0)
    grid = Affine(0.1, 0.0, 700_000.0, 0.0, -0.1, 3_130_000.0)
    profile: dict[str, Any] = {"driver": "GTiff", "width": side, "height": side, "count": 1}
    profile |= {"dtype": "float32", "crs": "EPSG:32649", "transform": grid, "nodata": -9999.0}
    profile |= {"tiled": True, "blockxsize": 256, "blockysize": 256}
    x = np.arange(side, dtype=np.float32)
    with rasterio.open(folder / "dsm.tif", "w", **profile) as dataset:
        for top in range(0, side, 256):
            y = np.arange(top, min(top + 256, side), dtype=np.float32)[:, None]
            heights = 50 + 20 * np.sin(x / 700) + 15 * np.cos(y / 900)
            heights += random.normal(0, 0.3, heights.shape).astype(np.float32)
            heights[(np.floor(x / 300) + 7 * np.floor(y / 300)) % 20 == 3] = -9999.0
            dataset.write(heights, 1, window=Window(0, top, side, len(y)))


def spread(side: int, matches: int) -> Floats:
    """Return map pixels spread evenly."""
    return np.random.default_rng(1).uniform(0, side, (matches, 2))


def lift_by(folder: Path, jobs: int, side: int, matches: int) -> Work:
    """Lift by this package, which reads the file by windows and gives X, Y and Z."""
    info, xy = open_info(folder / "dsm.tif"), spread(side, matches)

    def work() -> dict[str, Any]:
        points = lift(xy, info, info, jobs=jobs).points
        return {"digest": np.array(hashlib.sha256(points.data).hexdigest())}

    return work


def interpolate(folder: Path, reading: bool, side: int, matches: int) -> Work:
    """Interpolate heights by SciPy, which needs the whole file in memory; holes are heights."""

    def read() -> NDArray[np.float32]:
        with rasterio.Env(GDAL_CACHEMAX=64 << 20), rasterio.open(folder / "dsm.tif") as dataset:
            return dataset.read(1)

    rowcol = np.ascontiguousarray(spread(side, matches).T[::-1]) - 0.5
    kept = None if reading else read()

    def work() -> None:
        heights = read() if kept is None else kept
        map_coordinates(heights, rowcol, np.float64, order=1, mode="nearest")

    return work


MATCHES = 5000
LENS = (-0.28, 0.12, 0.0008, -0.0003, -0.02)


def problems(lens: Sequence[float], queries: int) -> list[Problem]:
    """Return oblique photos with 5,000 matches, half of them outliers, and a pixel of noise."""
    options: dict[str, Any] = {"count": MATCHES, "noise_px": 1.0, "outliers": 0.5}
    options |= {"lens": tuple(lens), "origin": PROJECTED}
    return [make_scene(seed, **options).problem for seed in range(queries)]


def solve(_: Path, lens: Sequence[float], run: Run, queries: int) -> Work:
    """Solve by this package."""
    asked = joined(problems(lens, queries))

    def work() -> dict[str, Any]:
        return {
            "centres": np.array([one.centre for one in solve_queries(*asked, SOLVER, run, "made")])
        }

    return work


def bare_calls(found: Sequence[Problem]) -> Callable[[], None]:
    """Prepare all that pycolmap needs, and return what calls it and drops the answers."""
    names = ("max_error", "min_inlier_ratio", "min_num_trials", "max_num_trials", "confidence")
    keys = ("max_error_px", "min_inlier_ratio", "min_trials", "max_trials", "confidence")
    ransac = {name: getattr(SOLVER, key) for name, key in zip(names, keys, strict=True)}
    options = pycolmap.AbsolutePoseEstimationOptions(ransac=ransac | {"random_seed": SOLVER.seed})
    ready = [
        (xy, points - np.median(points, axis=0), colmap_camera(camera), options)
        for camera, xy, points in found
    ]

    def work() -> None:
        for arguments in ready:
            pycolmap.estimate_absolute_pose(*arguments)

    return work


def colmap_camera(camera: Cameras) -> pycolmap.Camera:
    """Return COLMAP's camera."""
    params, lens = [*camera.focal[0], *camera.principal_point[0]], camera.distortion[0]
    params = [*params, *lens, 0.0, 0.0, 0.0] if lens.any() else params
    model = "FULL_OPENCV" if lens.any() else "PINHOLE"
    size = {"width": int(camera.width[0]), "height": int(camera.height[0])}
    return pycolmap.Camera(model=model, params=params, **size)


def solver_case(name: str, lens: Sequence[float]) -> Case:
    """Return the case of a lens."""
    return Case(
        f"{{queries}} queries of {MATCHES:,} matches, half of them wrong, {name} camera",
        no_input,
        {
            "bare pycolmap": lambda _, queries: bare_calls(problems(lens, queries)),
            "airzoo-bench, one worker": partial(solve, lens=lens, run=Run()),
            "airzoo-bench, two workers": partial(solve, lens=lens, run=Run(jobs=2)),
        },
        {"queries": 40},
        {"queries": 10},
        repeats=3,
    )


CASES = {
    "lifting": Case(
        "{matches:,} matches on a surface model of {side:,} x {side:,} px",
        make_surface,
        {
            "airzoo-bench, two workers": partial(lift_by, jobs=2),
            "airzoo-bench, one worker": partial(lift_by, jobs=1),
            "map_coordinates, array in memory": partial(interpolate, reading=False),
            "map_coordinates, reading included": partial(interpolate, reading=True),
        },
        {"side": 20_000, "matches": 10_000_000},
        {"side": 4_000, "matches": 400_000},
        same,
        repeats=3,
    ),
    "pinhole": solver_case("pinhole", (0.0,) * 5),
    "distorted": solver_case("distorted", LENS),
}

if __name__ == "__main__":
    main(CASES)
