"""Depth of rendered frames against geometry that is known otherwise."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from airzoo_bench.datasets.mini.renderer import Frame, Renderer
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras, back_project, project
from airzoo_bench.geometry.poses import Poses, camera_to_world, world_to_camera
from tests.datasets.mini.small_world import (
    APRON_M,
    BLOCK,
    GROUND_M,
    SIDE_M,
    small_mesh,
    small_world,
)
from tests.datasets.mini.views import CORNER, HORIZON, NADIR, OBLIQUE, camera, pose, rays


@pytest.fixture(scope="module")
def renderer() -> Renderer:
    return Renderer(small_world())


def shot(renderer: Renderer, camera: Cameras, pose: Poses) -> Frame:
    return renderer.render(camera, pose, "sunny", "day", 1)


def test_nadir(renderer: Renderer) -> None:
    depth = shot(renderer, camera(), NADIR).depth
    assert depth.shape == (120, 160)
    assert depth.dtype == np.float32
    levels = np.unique(depth.ravel())
    assert {np.float32(100 - GROUND_M), np.float32(100 - BLOCK[4])} <= set(levels.tolist())
    assert depth.max() == np.float32(100 - GROUND_M)


def _block_and_ground(origin: Floats, directions: Floats) -> Floats:
    """Distance to the ground and the block, by slabs; inf elsewhere."""
    low, high = np.array([*BLOCK[:2], GROUND_M]), np.array([*BLOCK[2:4], BLOCK[4]])
    with np.errstate(divide="ignore"):
        to_low, to_high = (low - origin) / directions, (high - origin) / directions
        ground = (GROUND_M - origin[2]) / directions[:, 2]
    enter = np.minimum(to_low, to_high).max(axis=1)
    leave = np.maximum(to_low, to_high).min(axis=1)
    place = origin[:2] + ground[:, None] * directions[:, :2]
    on_land = ((place > -APRON_M) & (place < SIDE_M + APRON_M)).all(axis=1)
    far = np.where((ground > 0) & on_land, ground, np.inf)
    return np.where((enter <= leave) & (enter > 0), enter, far)


@pytest.mark.parametrize("bent", [False, True])
@pytest.mark.parametrize("view", [NADIR, OBLIQUE, HORIZON, pose((5, 20, 26), 60, 0, 8)])
def test_against_slabs(renderer: Renderer, view: Poses, bent: bool) -> None:
    lens = camera(bent=bent)
    directions = rays(lens, view)
    truth = _block_and_ground((view.centres - CORNER)[0], directions)
    depth = shot(renderer, lens, view).depth.ravel()
    # House and trees only come before; rays along a silhouette may fall on either side.
    nearer = (depth > 0) & (depth < truth * (1 - 1e-6) - 1e-4)
    truth = np.where(np.isinf(truth), 0.0, truth)
    same = np.abs(depth - truth) <= 1e-6 * truth
    assert (same | nearer).mean() > 0.999
    assert same.mean() > 0.75


def test_walls_stand_upright(renderer: Renderer) -> None:
    """A camera looking north at the horizon sees the south wall at one depth, top to bottom."""
    depth = shot(renderer, camera(), pose((30, 0, 26), 0, 0)).depth
    focal = camera().focal[0, 0]
    half_width = int(10.0 / 30.0 * focal) - 1
    columns = slice(80 - half_width, 80 + half_width)
    rows = slice(60 - int(6 / 30 * focal) + 1, 60 + int(6 / 30 * focal) - 1)
    wall = depth[rows, columns]
    np.testing.assert_array_equal(wall, np.float32(30.0))
    assert depth[0, 80] == 0.0  # sky above the roof


def test_points_of_the_mesh_project_to_their_depth(renderer: Renderer) -> None:
    """Nothing stands before what the depth says, and most of the mesh seen from above is seen."""
    mesh = small_mesh()
    depth = shot(renderer, camera(320, 240), NADIR).depth
    corners = mesh.vertices[mesh.triangles]
    share = np.random.default_rng(3).dirichlet(np.ones(3), (40, len(corners)))
    points = (share[..., None] * corners).sum(axis=2).reshape(-1, 3) + CORNER
    local = world_to_camera(NADIR, points[None])
    pixel = np.floor(project(camera(320, 240), local)[0]).astype(int)
    inside = ((pixel >= 1) & (pixel < (319, 239))).all(axis=1)
    column, row = pixel[inside].T
    # The nearest depth within the neighbouring pixels lies before every point.
    around = [depth[row + dy, column + dx] for dy in (-1, 0, 1) for dx in (-1, 0, 1)]
    before = np.min(around, axis=0) - local[0, inside, 2]
    assert before.max() < 0.35  # a pixel on the gable's slope
    of_land = np.tile(mesh.owner < 0, 40)[inside]
    on_surface = np.abs(np.min(around, axis=0) - local[0, inside, 2]) < 1e-3
    assert on_surface[of_land].mean() > 0.8  # the rest lies below what stands on it


@pytest.mark.parametrize("bent", [False, True])
def test_two_views_agree(renderer: Renderer, bent: bool) -> None:
    """Back-project one view's depth, project into another, compare: PROTOCOLS' consistency."""
    lens = camera(320, 240, bent=bent)
    other = pose((52, -14, 88), 9, -47)
    first, second = shot(renderer, lens, OBLIQUE).depth, shot(renderer, lens, other).depth
    local = world_to_camera(other, camera_to_world(OBLIQUE, _points(lens, first)))
    pixel = project(lens, local)[0]
    seen, sampled = _bilinear(second, pixel)
    error = np.abs(sampled - local[0, :, 2])[seen] / local[0, seen, 2]
    assert seen.mean() > 0.5
    assert np.median(error) < 1e-5
    assert np.quantile(error, 0.8) < 1e-3


def _points(lens: Cameras, depth: NDArray[np.float32]) -> Floats:
    height, width = depth.shape
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    unit = back_project(lens, np.stack([x.ravel(), y.ravel()], axis=-1)[None])
    points: Floats = unit / unit[..., 2:] * depth.ravel()[:, None].astype(np.float64)
    return points


def _bilinear(image: NDArray[np.float32], pixel: Floats) -> tuple[NDArray[np.bool_], Floats]:
    """Sample inverse depth, which is linear on planes."""
    height, width = image.shape
    x, y = (np.nan_to_num(pixel, nan=-9.0) - 0.5).T
    seen = (x >= 0) & (y >= 0) & (x < width - 1) & (y < height - 1)
    column, row = (np.where(seen, np.floor(v), 0).astype(int) for v in (x, y))
    fx, fy = x - column, y - row
    inverse = 1.0 / np.where(image > 0, image, 1e9).astype(np.float64)
    top = inverse[row, column] * (1 - fx) + inverse[row, column + 1] * fx
    bottom = inverse[row + 1, column] * (1 - fx) + inverse[row + 1, column + 1] * fx
    return seen, 1.0 / np.where(seen, top * (1 - fy) + bottom * fy, 1.0)


def test_sky_and_what_lies_beyond_the_mesh_have_no_depth(renderer: Renderer) -> None:
    depth = shot(renderer, camera(), HORIZON).depth
    directions = rays(camera(), HORIZON).reshape(120, 160, 3)
    assert (depth[directions[..., 2] >= 0] == 0.0).all()
    assert (depth[-20:] > 0.0).all()
    up = shot(renderer, camera(), pose((48, 48, 60), 0, 80))
    assert not up.depth.any()
