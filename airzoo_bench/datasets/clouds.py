"""Whether a true cloud lies where the photos are, in the same units and at the same height."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import laspy
import numpy as np
from laspy.errors import LaspyException
from pyproj.exceptions import CRSError

from airzoo_bench.benchmark.folder import needed
from airzoo_bench.benchmark.queries import SceneInputs, cameras_of, poses_of
from airzoo_bench.core.errors import BenchmarkError, UsageError
from airzoo_bench.formats.clouds.cloud import Cloud, CloudSource
from airzoo_bench.formats.clouds.formats import open_cloud
from airzoo_bench.formats.clouds.shards import open_shards, shards_in
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import project
from airzoo_bench.geometry.crs import LOCAL_CRS, check_same_crs
from airzoo_bench.geometry.heightfield import blocked_heights
from airzoo_bench.geometry.poses import world_to_camera
from airzoo_bench.geometry.vertical import vertical_m
from airzoo_bench.reconstruction.preparation import box_of

__all__ = ["check_cloud"]

# What the parts of a cloud that cannot be read in pieces may take in memory.
_CLOUD_BYTES = 8 << 30
# A true cloud is at most so far from the photos, beyond what these span themselves.
_REACH_M = 1000.0
_SAMPLES = 1 << 16
_PHOTOS, _LEAST_LOOKING = 100, 2


def check_cloud(cloud: Path, inputs: SceneInputs) -> float:
    """Read a true cloud completely, and compare its place with cameras and surface model.

    Return the median height of the cloud above the surface model, in metres; NaN where they do not
    meet, or there is no surface model.
    """
    if not cloud.exists():
        raise UsageError("no such cloud", where=cloud)
    paths = shards_in(cloud) if cloud.is_dir() else [cloud]
    watched = _Watched(
        open_shards(cloud, paths)
        if cloud.is_dir()
        else open_cloud(cloud, limit_bytes=_CLOUD_BYTES, sampling=None)
    )
    crs = needed(inputs.crs, "CRS", inputs.scene)
    for path in paths:
        if path.suffix.lower() in (".las", ".laz"):
            _check_stated_crs(path, crs)
    box, centres = box_of(watched), inputs.photos[["x", "y"]].to_numpy(np.float64)
    points = np.concatenate(watched.kept)
    reach = _REACH_M + np.ptp(centres, axis=0)
    low, high = centres.min(axis=0) - reach, centres.max(axis=0) + reach
    beside = bool((box.high[:2] < low).any() or (box.low[:2] > high).any())
    if beside or (inputs.dsm is None and not _is_seen(points, inputs)):
        x, y = centres.mean(axis=0)
        raise BenchmarkError(
            f"lies about ({box.low[0]:.0f}, {box.low[1]:.0f}), the photos about ({x:.0f}, {y:.0f})"
            + (" do not look at it" if not beside else ""),
            where=cloud,
            expected=f"a cloud of what the photos show, in the frame of the poses, {crs}",
            fix="transform the cloud, or add the offset that it was reduced by; look whether it is "
            "that of this scene",
        )
    if inputs.dsm is None:
        return math.nan
    with blocked_heights(inputs.dsm) as surface:
        above = points[:, 2] - surface.sample(points[:, :2])
    above = above[np.isfinite(above)]
    return float(np.median(above)) if above.size else math.nan


def _check_stated_crs(cloud: Path, crs: str) -> None:
    """Refuse a LAS or LAZ cloud whose header states another CRS, or heights not in metres."""
    try:
        with laspy.open(cloud, read_evlrs=False) as reader:
            stated = reader.header.parse_crs()
    except (LaspyException, CRSError, ValueError, struct.error) as error:
        raise BenchmarkError(
            f"its CRS cannot be read: {(str(error) or type(error).__name__).splitlines()[0]}",
            where=cloud,
            fix="write its CRS again, e.g. with pdal translate",
        ) from error
    if stated is None:
        return
    if crs != LOCAL_CRS:
        check_same_crs(crs, stated, f"the poses and the cloud ({cloud})")
    units = {axis.unit_conversion_factor for axis in stated.axis_info}
    if units - {1.0} or vertical_m(stated) not in (None, 1.0):
        raise BenchmarkError(
            f"is in {stated.name}, in units of {max(units):.10g} m",
            where=cloud,
            expected="a cloud in metres",
            fix="convert it, e.g. with pdal translate or las2las",
        )


def _is_seen(points: Floats, inputs: SceneInputs) -> bool:
    """Tell whether photos look at a cloud: all frames of their own lie about zero."""
    rows = np.linspace(0, len(inputs.photos) - 1, min(len(inputs.photos), _PHOTOS)).astype(int)
    photos = inputs.photos.iloc[np.unique(rows)]
    cameras, poses = cameras_of(photos), poses_of(photos)
    finite, looking = points[np.isfinite(points).all(axis=1)], 0
    for row in range(len(photos)):
        camera, local = cameras.take(row), world_to_camera(poses.take(row), finite[None])[0]
        pixels = project(camera, local[None, local[:, 2] > 0.0])[0]
        inside = (pixels >= 0.0) & (pixels <= (camera.width[0], camera.height[0]))
        looking += bool(inside.all(axis=1).any())
    return looking >= min(len(photos), _LEAST_LOOKING)


@dataclass(frozen=True, eq=False)
class _Watched:
    """A cloud that keeps some 65,000 evenly spaced points while it is read."""

    source: CloudSource
    kept: list[Floats] = field(default_factory=list)

    @property
    def count(self) -> int:
        return self.source.count

    def pieces(self, points: int) -> Iterator[Cloud]:
        step = max(self.count // _SAMPLES, 1)
        for piece in self.source.pieces(points):
            self.kept.append(piece.points[::step].copy())  # a view would hold all of it
            yield piece
