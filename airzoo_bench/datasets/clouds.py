"""Whether a true cloud lies where the photos are, in the same units and at the same height."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import laspy
import numpy as np

from airzoo_bench.benchmark.folder import needed
from airzoo_bench.benchmark.queries import SceneInputs, cameras_of, poses_of
from airzoo_bench.core.errors import BenchmarkError, UsageError, readable
from airzoo_bench.formats.clouds.formats import open_cloud
from airzoo_bench.formats.clouds.las import open_shards, shards_in
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import project
from airzoo_bench.geometry.crs import LOCAL_CRS, check_same_crs
from airzoo_bench.geometry.heightfield import blocked_heights
from airzoo_bench.geometry.poses import world_to_camera
from airzoo_bench.geometry.vertical import vertical_m

# What the parts of a cloud that cannot be read in pieces may take in memory.
_CLOUD_BYTES = 8 << 30
_PIECE, _SAMPLES = 1 << 20, 1 << 16
# A true cloud is at most so far from the photos, beyond what these span themselves.
_REACH_M = 1000.0
_PHOTOS, _LEAST_LOOKING = 100, 2


def check_cloud(cloud: Path, inputs: SceneInputs) -> float:
    """Read a true cloud completely, and compare its place with cameras and surface model.

    Return the median height of the cloud above the surface model, in metres; NaN where they do not
    meet, or there is no surface model.
    """
    if not cloud.exists():
        raise UsageError("no such cloud", where=cloud)
    crs = needed(inputs.crs, "CRS", inputs.scene)
    paths = shards_in(cloud) if cloud.is_dir() else [cloud]
    for path in paths:
        if path.suffix.lower() in (".las", ".laz"):
            _check_stated_crs(path, crs)
    points = _sampled(cloud, paths)
    low, high = points.min(axis=0), points.max(axis=0)
    centres = inputs.photos[["x", "y"]].to_numpy(np.float64)
    reach = _REACH_M + np.ptp(centres, axis=0)
    beside = (high[:2] < centres.min(axis=0) - reach) | (low[:2] > centres.max(axis=0) + reach)
    if beside.any() or (inputs.dsm is None and not _is_seen(points, inputs)):
        x, y = centres.mean(axis=0)
        what = f"lies about ({low[0]:.0f}, {low[1]:.0f}), the photos are about ({x:.0f}, {y:.0f}) "
        fix = f"transform the cloud to {crs}, or add the offset that it was reduced by"
        raise BenchmarkError(f"{what}and do not look at it", where=cloud, fix=fix)
    if inputs.dsm is None:
        return math.nan
    with blocked_heights(inputs.dsm) as surface:
        above = points[:, 2] - surface.sample(points[:, :2])
    above = above[np.isfinite(above)]
    return float(np.median(above)) if above.size else math.nan


def _sampled(cloud: Path, paths: list[Path]) -> Floats:
    """Read all of a cloud, and return some 65,000 evenly spaced finite points."""
    if cloud.is_dir():
        source: Any = open_shards(cloud, paths)
    else:
        source = open_cloud(cloud, limit_bytes=_CLOUD_BYTES, sampling=None)
    step = max(source.count // _SAMPLES, 1)
    kept = [piece.points[::step].copy() for piece in source.pieces(_PIECE)]
    points: Floats = np.concatenate([*kept, np.empty((0, 3))])
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        raise BenchmarkError("the true cloud holds no finite point", where=cloud)
    return points


def _check_stated_crs(cloud: Path, crs: str) -> None:
    """Refuse a LAS or LAZ cloud of another CRS by its header, or with heights not in metres."""
    with (
        readable(cloud, "its CRS cannot be read", kind=BenchmarkError),
        laspy.open(cloud, read_evlrs=False) as reader,
    ):
        stated = reader.header.parse_crs()
    if stated is None:
        return
    if crs != LOCAL_CRS:
        check_same_crs(crs, stated, f"the poses and the cloud ({cloud})")
    units = {axis.unit_conversion_factor for axis in stated.axis_info}
    if units - {1.0} or vertical_m(stated) not in (None, 1.0):
        what = f"is in {stated.name}, in units of {max(units):.10g} m"
        raise BenchmarkError(
            what, where=cloud, fix="convert it to metres, e.g. with pdal translate"
        )


def _is_seen(points: Floats, inputs: SceneInputs) -> bool:
    """Tell whether photos look at a cloud: all frames of their own lie about zero."""
    rows = np.linspace(0, len(inputs.photos) - 1, min(len(inputs.photos), _PHOTOS)).astype(int)
    photos = inputs.photos.iloc[np.unique(rows)]
    cameras, poses, looking = cameras_of(photos), poses_of(photos), 0
    for row in range(len(photos)):
        camera, local = cameras.take(row), world_to_camera(poses.take(row), points[None])[0]
        pixels = project(camera, local[None, local[:, 2] > 0.0])[0]
        inside = (pixels >= 0.0) & (pixels <= (camera.width[0], camera.height[0]))
        looking += bool(inside.all(axis=1).any())
    return looking >= min(len(photos), _LEAST_LOOKING)
