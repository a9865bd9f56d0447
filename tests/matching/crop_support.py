"""Crops of a made map, cut for cameras above it."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from pyproj import CRS
from rasterio import Affine

from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.heightfield import HeightField
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.rasters import RasterInfo
from airzoo_bench.matching.crops import (
    CropWindows,
    crop_windows,
)
from airzoo_bench.matching.settings import Crop
from tests.geometry.support import looking_down

NAN = np.nan
X, Y = 576000.0, 5188000.0
# 2 m pixels; the map's corner lies 500 m west and 1000 m north of (X, Y).
GRID = Affine(2.0, 0.0, X - 500, 0.0, -2.0, Y + 1000)


def map_of(width: int, height: int, grid: Affine = GRID, crs: object = 32615) -> RasterInfo:
    known = CRS.from_user_input(crs)
    return RasterInfo(Path("dom.tif"), width, height, grid, known, None, 3, "uint8")


def level(height: float = 0.0) -> HeightField:
    """Ground of 4 km by 4 km about (X, Y)."""
    grid = Affine(20.0, 0.0, X - 2000, 0.0, -20.0, Y + 2000)
    return HeightField(np.full((200, 200), height), grid, "EPSG:32615")


def crop_rule(margin: float, max_range_m: float, missing: str = "nearest") -> Crop:
    return Crop.model_validate(
        {
            "margin": margin,
            "max_range_m": max_range_m,
            "missing_heights": missing,
            "nearest_of_px": 10_000,
        }
    )


grown_crop = partial(crop_rule, 0.1)
plain_crop = partial(crop_rule, 0.0)


def camera(fx: float, fy: float, distortion: Any = None) -> Cameras:
    """A camera of 600 x 400 pixels."""
    K = [[[fx, 0, 300], [0, fy, 200], [0, 0, 1]]]
    return Cameras.from_matrices(K, 600, 400, distortion)


def box(windows: CropWindows) -> list[tuple[int, int, int, int]]:
    return [tuple(window) for window in windows.windows.tolist()]


def cut(
    field: HeightField, rule: Crop, at: Any = (X, Y, 100.0), tilt: float = 0.0, f: float = 600.0
) -> CropWindows:
    """The crop of one photo on a map of 1000 m by 2000 m; rays are along (+-3, +-2, -6) / 7."""
    pose = Poses.from_centres(looking_down(tilt), [at])
    return crop_windows(
        camera(f, f), pose, map_of(500, 1000), field, crop=rule, plane_height_m=-20.0
    )
