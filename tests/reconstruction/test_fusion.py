"""Depth maps and point maps as clouds, pixel by pixel and fused."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.reconstruction import fusion
from airzoo_bench.reconstruction.alignment import Similarity
from airzoo_bench.reconstruction.clouds import PieceCloud
from airzoo_bench.reconstruction.fusion import DepthMaps, PointMaps, depth_cloud, fuse
from airzoo_bench.reconstruction.settings import Fusion
from tests.geometry.support import looking_down
from tests.reconstruction.support import UTM, similarity

STILL = Similarity.identity()
SLOPE = np.array((0.1, -0.05, 1.0))
ABOVE = 30.0
TSDF = Fusion(
    method="tsdf",
    confidence_above="none",
    max_depth_m=100.0,
    tsdf_voxel_m=0.5,
    tsdf_truncation_m=2.0,
    tsdf_max_voxels=10**7,
)


def joined(source: PieceCloud, points: int = 1 << 20) -> Floats:
    parts = [piece.points for piece in source.pieces(points)]
    assert all(0 < len(part) <= points for part in parts)
    return np.concatenate(parts)


def fused(maps: DepthMaps, **changes: Any) -> Floats:
    return joined(fuse(maps, STILL, TSDF.model_copy(update=changes)))


def one_view(depth: Any, focal: float = 2.0, above: float = 0.0) -> DepthMaps:
    """Return a view with the principal point (1, 1), or of a camera that looks down from above."""
    grid = np.array(depth, np.float64)[None]
    height, width = grid.shape[1:]
    x, y = (width / 2 + 1, height / 2 - 1.5) if above else (1.0, 1.0)
    cameras = Cameras.from_matrices([[[focal, 0, x], [0, focal, y], [0, 0, 1]]], width, height)
    turn = looking_down(0.0) if above else np.eye(3)[None]
    centres = UTM[None] + np.array((0.0, 0.0, above))
    return DepthMaps(grid, cameras, Poses(rotation=turn, centres=centres))


def slope_maps(views: int = 6, width: int = 64, height: int = 48) -> DepthMaps:
    """Views of the plane SLOPE . (X - UTM) = 0, from some 30 m above."""
    K = np.tile([[60.0, 0, 33.0], [0, 60.0, 22.5], [0, 0, 1]], (views, 1, 1))
    turns = np.concatenate([looking_down(5.0 * row, 40.0 * row) for row in range(views)])
    centres = UTM + np.stack([(3.0 * row, 2.0 * (row % 3), ABOVE) for row in range(views)])
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    rays = np.stack(((x - 33.0) / 60, (y - 22.5) / 60, np.ones_like(x)), axis=-1)
    down = (centres - UTM) @ SLOPE
    depth = -down[:, None, None] / np.einsum("hwi,ni->nhw", rays, turns @ SLOPE)
    cameras = Cameras.from_matrices(K, width, height)
    return DepthMaps(depth, cameras, Poses(rotation=turns, centres=centres))


def off_plane(points: Floats) -> Floats:
    return np.asarray((points - UTM) @ SLOPE / np.linalg.norm(SLOPE))


def test_pixels_by_hand() -> None:
    found = joined(depth_cloud(one_view([[4, 8], [0, 2]]), STILL, TSDF))
    # Through (0.5, 0.5), (1.5, 0.5) and (1.5, 1.5) of a camera with f = 2 and c = (1, 1).
    expected = UTM + np.array(((-1, -1, 4.0), (2, -2, 8), (0.5, 0.5, 2)))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)
    cloud = depth_cloud(one_view([[np.nan, np.inf, -1.0], [0.0, 101.0, 7.0]]), STILL, TSDF)
    assert cloud.count == 1
    assert joined(cloud)[0, 2] == UTM[2] + 7.0


def test_the_plane_comes_back_in_another_frame_and_in_any_pieces() -> None:
    maps = slope_maps(2)
    whole = joined(depth_cloud(maps, STILL, TSDF))
    made = similarity(np.random.default_rng(1), 0.01)
    there = replace(maps, values=maps.values * 0.01, poses=made.apply_poses(maps.poses))
    found = joined(depth_cloud(there, made.inverse(), TSDF))
    assert len(found) == maps.values.size
    assert np.abs(off_plane(found)).max() < 1e-5
    np.testing.assert_allclose(found, whole, atol=1e-5)
    assert joined(depth_cloud(maps, STILL, TSDF), 7).tobytes() == whole.tobytes()


def test_point_maps() -> None:
    points = np.arange(24.0).reshape(2, 2, 2, 3)
    points[0, 0, 1, 2], points[1, 1, 1, 0] = np.nan, np.inf
    confidence = np.full((2, 2, 2), 2.0)
    confidence[1, 0, 0] = 1.0
    maps = PointMaps(points.astype(np.float32), confidence)
    used = TSDF.model_copy(update={"confidence_above": 1.0})
    cloud = fusion.point_map_cloud(maps, Similarity(2.0, np.eye(3), UTM), used)
    assert cloud.count == 6  # one of too little confidence
    expected = 2 * points.reshape(-1, 3)[[0, 2, 3, 5, 6]] + UTM
    np.testing.assert_array_equal(joined(cloud, 2), expected)


def test_tsdf_gives_the_plane_back() -> None:
    maps = slope_maps()
    found = fused(maps)
    assert len(found) > 1000
    # A voxel takes the depth of the pixel that it falls on: the slant over half a pixel, of some
    # 0.5 m, is its error, either way.
    away = off_plane(found)
    assert abs(away.mean()) < 0.01
    assert np.median(np.abs(away)) < 0.05
    assert np.abs(away).max() < 0.5
    # Half a pixel off would be 0.25 m at 30 m, seen by the border of the surface.
    seen, reach = joined(depth_cloud(maps, STILL, TSDF)), TSDF.tsdf_truncation_m
    assert ((found > seen.min(axis=0) - reach) & (found < seen.max(axis=0) + reach)).all()


def test_tsdf_pixel_centres_and_a_ground_at_a_round_height() -> None:
    # A step in depth, between columns 31 and 32, seen from straight above: it lies at u = 32.
    depth = np.full((48, 64), 30.0)
    depth[:, 32:] = 33.0
    found = fused(one_view(depth, 60.0, ABOVE), tsdf_voxel_m=0.1, tsdf_truncation_m=0.4) - UTM
    high, low = found[found[:, 2] > -0.2], found[found[:, 2] < -2.8]
    # The pixel right of the step ends at (31.5 + 0.5 - 33) / 60 * 30 = -0.5 m.
    assert high[:, 0].max() == pytest.approx(-0.5, abs=0.11)
    assert low[:, 0].min() == pytest.approx(-0.55, abs=0.11)
    # Rows 0 to 48 lie from 22.5 / 60 * 30 = 11.25 m north to 12.75 m south.
    assert high[:, 1].max() == pytest.approx(11.25, abs=0.15)
    assert high[:, 1].min() == pytest.approx(-12.75, abs=0.15)
    # Pixels of 0.5 m, five times the voxels, leave no holes.
    np.testing.assert_allclose(high[high[:, 0] < -0.6, 2], 0.0, atol=1e-4)
    assert len(np.unique(np.floor(high[:, :2] / 0.5).astype(int), axis=0)) >= 30 * 44


def test_tsdf_outliers_do_not_allocate_the_world() -> None:
    maps = slope_maps(2)
    maps.values[:, ::7, ::7] = 1e9
    maps.values[:, 1::7, ::7] = 99.0
    assert len(fused(maps)) > 1000
    with pytest.raises(PredictionError):
        fused(maps, tsdf_max_voxels=50_000)
