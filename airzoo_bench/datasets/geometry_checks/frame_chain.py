"""The chain pixel -> ray -> ENU -> ECEF -> WGS84 -> CRS of the poses, and all the way back.

It closes to rounding (about 1e-8 m) unless a pixel has no ray (beyond the range of the lens model),
a position is no place of the CRS, or the CRS cannot be inverted to a micrometre.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from airzoo_bench.datasets.angles import grid_to_true_north
from airzoo_bench.geometry.arrays import Floats, apply_matrix
from airzoo_bench.geometry.cameras import Cameras, back_project, project
from airzoo_bench.geometry.crs import (
    ecef_to_geodetic,
    enu_axes,
    from_lonlat,
    geodetic_to_ecef,
    grid_convergence_deg,
    to_lonlat,
)
from airzoo_bench.geometry.poses import Poses, rays_to_world

CLOSES_M = 1e-6
"""The chain closes where no point comes back farther off than this."""
CLOSES_PX = 1e-3
"""Nor any pixel: 1e-6 m at 10 m from a camera of 10,000 px focal length."""
_RANGES_M = np.array((10.0, 100.0, 1000.0))
_SIDE = 5


def check_frame_chain(cameras: Cameras, poses: Poses, crs: Any) -> tuple[Floats, Floats]:
    """Send a grid of 5 x 5 pixels of each photo, borders included, through the chain and back.

    Return how far points (m) and pixels of N photos come back from where they started, at most;
    infinite where a pixel has no ray, or a place is none of the CRS.
    """
    share = np.linspace(0.0, 1.0, _SIDE)
    grid = np.stack(np.meshgrid(share, share), axis=-1).reshape(-1, 2)
    pixels = grid * np.stack((cameras.width, cameras.height), axis=-1)[:, None]
    rays = back_project(cameras, pixels)
    lonlat = to_lonlat(crs, poses.centres[:, :2])
    to_true = grid_to_true_north(grid_convergence_deg(crs, lonlat))
    directions = apply_matrix(to_true[:, None], rays_to_world(poses, rays))
    sent = (_RANGES_M[:, None] * directions[:, :, None]).reshape(len(poses), -1, 3)
    axes = enu_axes(lonlat)
    origin = geodetic_to_ecef(np.concatenate([lonlat, poses.centres[:, 2:]], axis=1))
    geodetic = ecef_to_geodetic(apply_matrix(axes[:, None], sent) + origin[:, None])
    plane = from_lonlat(crs, geodetic[..., :2])
    back = np.concatenate([to_lonlat(crs, plane), geodetic[..., 2:]], axis=-1)
    there = geodetic_to_ecef(back) - origin[:, None]
    returned = apply_matrix(np.swapaxes(axes, -1, -2)[:, None], there)
    on_grid = apply_matrix(np.swapaxes(to_true, -1, -2)[:, None], returned)
    seen = project(cameras, apply_matrix(poses.rotation[:, None], on_grid))
    return _worst(returned - sent), _worst(seen - np.repeat(pixels, len(_RANGES_M), axis=1))


def _worst(differences: Floats) -> Floats:
    """Return the greatest length (N,) of differences (N, M, D); infinite where one is NaN."""
    lengths = np.sqrt((differences * differences).sum(axis=-1))
    worst: Floats = np.where(np.isnan(lengths), np.inf, lengths).max(axis=1)
    return worst
