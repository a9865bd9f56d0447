"""Footprints of a set of photos, from cameras and poses or from a table.

A footprint is the quadrilateral of ground below the four corners of a photo, on the plane of the
ground.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from airzoo_bench.core.errors import BenchmarkError, first_of
from airzoo_bench.datasets.geometry_checks.dataset import (
    PosedScene,
    open_benchmark,
    scenes_of_benchmark,
)
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.geometry.cameras import Cameras, anchor_pixels, back_project
from airzoo_bench.geometry.crs import to_lonlat
from airzoo_bench.geometry.poses import Poses, rays_to_world
from airzoo_bench.geometry.rays import intersect_plane
from airzoo_bench.retrieval.truth import ANCHOR_COLUMNS

__all__ = ["NamedFootprints", "cast_corners", "read_footprints"]


@dataclass(frozen=True, eq=False)
class NamedFootprints:
    """Footprints of N photos.

    Attributes
    ----------
    source : str
        Where they are from.
    ids : tuple of str
    lonlat : (N, 4, 2) array
        Corners in order, in degrees of WGS84; NaN throughout for a photo that sees no ground.
    unknown : (N,) bool array
        Photos of which it is not known where they look.
    """

    source: str
    ids: tuple[str, ...]
    lonlat: Floats
    unknown: Bools


def read_footprints(place: Path, max_range_m: float) -> NamedFootprints:
    """Read a set of footprints."""
    if place.suffix.lower() == ".csv":
        return _read_csv(place)
    scenes = scenes_of_benchmark(open_benchmark(place))
    parts = [_cast_scene(scene, max_range_m) for scene in scenes]
    return NamedFootprints(
        str(place),
        tuple(name for scene in scenes for name in scene.ids),
        np.concatenate([lonlat for lonlat, _ in parts]),
        np.concatenate([unknown for _, unknown in parts]),
    )


def cast_corners(
    cameras: Cameras, poses: Poses, crs: Any, plane_height_m: float, max_range_m: float
) -> tuple[Floats, Bools]:
    """Cast the corners of N photos onto a plane."""
    rays = rays_to_world(poses, back_project(cameras, anchor_pixels(cameras, 0.0)))
    hits = intersect_plane(poses.centres, rays, plane_height_m, max_range_m)
    ends = poses.centres[:, None] + max_range_m * rays
    lonlat = to_lonlat(crs, np.where(hits.valid[..., None], hits.points, ends)[..., :2])
    unknown = (poses.centres[:, 2] <= plane_height_m) | np.isnan(lonlat).any(axis=(1, 2))
    unknown |= _round_pole(lonlat)
    blind = (rays[..., 2] >= 0.0).all(axis=1)
    lonlat[unknown | blind] = np.nan
    return lonlat, unknown


def _cast_scene(scene: PosedScene, max_range_m: float) -> tuple[Floats, Bools]:
    if scene.plane_height_m is None or scene.crs is None:
        raise BenchmarkError("has no ground plane or no CRS", where=scene.name)
    return cast_corners(scene.cameras, scene.poses, scene.crs, scene.plane_height_m, max_range_m)


def _read_csv(path: Path) -> NamedFootprints:
    import pandas as pd

    from airzoo_bench.benchmark.tables import read_table

    table = read_table(path, ("id", *ANCHOR_COLUMNS))
    columns = [pd.to_numeric(table[name], errors="coerce") for name in ANCHOR_COLUMNS]
    lonlat = np.stack(columns, axis=1).astype(np.float64).reshape(-1, 4, 2)
    ids = tuple(table["id"].astype(str))
    beyond = (np.abs(lonlat) > (360.0, 90.0)).any(axis=(1, 2))
    if beyond.any():
        names = [ids[row] for row in np.flatnonzero(beyond)]
        raise BenchmarkError(
            f"coordinates that are no degrees: {first_of(names, len(ids))}",
            where=path,
            expected="longitude and latitude in WGS84",
        )
    unknown = np.asarray(~np.isfinite(lonlat).all(axis=(1, 2))) | _round_pole(lonlat)
    lonlat[unknown] = np.nan
    return NamedFootprints(str(path), ids, lonlat, unknown)


def _round_pole(lonlat: Floats) -> Bools:
    """Find footprints whose border goes once round the earth."""
    lon = lonlat[..., 0]
    steps = (np.roll(lon, -1, axis=1) - lon + 180.0) % 360.0 - 180.0
    round_it: Bools = np.abs(steps.sum(axis=1)) > 180.0
    return round_it
