from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.optional_imports import load_open3d
from airzoo_bench.datasets.mini.build import build_world, digest
from airzoo_bench.datasets.mini.city import city_plan
from airzoo_bench.datasets.mini.rural import rural_plan
from airzoo_bench.datasets.mini.world import REGIONS, SURVEY_SUN, Material, Mesh, World

PLANNED = pytest.mark.parametrize("region", sorted(REGIONS))
# A region takes some 20 s: these run every night.
BUILT = pytest.mark.parametrize(
    "region", [pytest.param(region, marks=pytest.mark.slow) for region in sorted(REGIONS)]
)
PLANS = {"city": city_plan, "rural": rural_plan}


@cache
def world_of(region: str) -> World:
    return build_world(region, 0)


def part(mesh: Mesh, *materials: Material) -> NDArray[np.float64]:
    """Corners (T, 3, 3) of the triangles of some materials."""
    return mesh.vertices[mesh.triangles[np.isin(mesh.material, materials)]]


def normals(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


@BUILT
def test_every_byte_is_as_recorded(region: str) -> None:
    recorded = json.loads(Path(__file__).with_name("checksums.json").read_text("utf-8"))
    assert digest(world_of(region)) == recorded[region]


@BUILT
def test_dsm_is_the_highest_surface_that_a_vertical_ray_meets(region: str) -> None:
    world = world_of(region)
    rows, columns = np.divmod(np.arange(0, 1200 * 1200, 37), 1200)
    x, y = (columns + 0.5) * 0.5, 600.0 - (rows + 0.5) * 0.5
    first, height = falls_on(world.mesh, x, y)
    for off in (-0.01, 0.01):
        # Where a ray beside it meets quite another height, the pixel is at a vertical edge.
        height_beside = falls_on(world.mesh, x + off, y + off)[1]
        first[np.abs(height_beside - height) > 0.15] = -1
    kept = first >= 0
    assert kept.mean() > 0.97
    assert np.abs(world.dsm[rows, columns][kept] - height[kept]).max() < 1e-4


def falls_on(
    mesh: Mesh, x: NDArray[np.float64], y: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The triangle that Open3D's ray from above meets, and its plane's height in float64."""
    o3d = load_open3d()
    scene = o3d.t.geometry.RaycastingScene(nthreads=2)
    scene.add_triangles(
        o3d.core.Tensor(mesh.vertices.astype(np.float32)),
        o3d.core.Tensor(mesh.triangles.astype(np.uint32)),
    )
    rays = np.zeros((len(x), 6), np.float32)
    rays[:, 0], rays[:, 1], rays[:, 2], rays[:, 5] = x, y, 200.0, -1.0
    hits = scene.cast_rays(o3d.core.Tensor(rays), nthreads=2)
    triangle = hits["primitive_ids"].numpy().astype(np.int64)
    corners = mesh.vertices[mesh.triangles[triangle]]
    normal = normals(corners)
    off_x, off_y = x - corners[:, 0, 0], y - corners[:, 0, 1]
    rise = (normal[:, 0] * off_x + normal[:, 1] * off_y) / normal[:, 2]
    return triangle, corners[:, 0, 2] - rise


@BUILT
def test_walls_are_vertical_and_roofs_face_up(region: str) -> None:
    mesh = world_of(region).mesh
    walls, roofs = normals(part(mesh, Material.WALL)), normals(part(mesh, Material.ROOF))
    length = np.linalg.norm(walls, axis=1)
    assert np.abs(walls[:, 2] / length).max() < 1e-9
    assert (roofs[:, 2] > 0).all()
    land = normals(part(mesh, Material.GROUND, Material.APRON))
    assert (land[:, 2] > 0).all()


@BUILT
def test_apron_meets_the_border_and_reaches_far(region: str) -> None:
    mesh = world_of(region).mesh
    land = part(mesh, Material.GROUND).reshape(-1, 3)
    apron = part(mesh, Material.APRON).reshape(-1, 3)
    assert apron[:, :2].min() == -800.0
    assert apron[:, :2].max() == 1400.0
    for axis in (0, 1):
        for border in (0.0, 600.0):
            inner = {tuple(point) for point in land[land[:, axis] == border].tolist()}
            along = apron[apron[:, axis] == border]
            along = along[(along[:, 1 - axis] >= 0) & (along[:, 1 - axis] <= 600)]
            assert {tuple(point) for point in along.tolist()} == inner


@BUILT
def test_orthophoto_is_albedo_in_light_or_shadow(region: str) -> None:
    world = world_of(region)
    # No channel is brighter than the albedo in the whole sun, none darker than in the sky alone.
    albedo = world.top_albedo.astype(np.float64)
    most = albedo * (np.array(SURVEY_SUN.sky) + np.array(SURVEY_SUN.sun))
    assert (world.dom <= np.minimum(most + 0.51, 255)).all()
    assert (world.dom >= np.floor(np.minimum(albedo * np.array(SURVEY_SUN.sky), 255))).all()
    share = world.dom.astype(np.float64).sum() / albedo.sum()
    assert 0.6 < share < 1.05


@BUILT
def test_mosaic_differs_from_the_survey_and_yet_shows_the_same_place(region: str) -> None:
    world = world_of(region)
    grey = world.dom.mean(axis=2).reshape(200, 12, 200, 12).mean(axis=(1, 3))
    older = world.satellite.mean(axis=2).reshape(200, 10, 200, 10).mean(axis=(1, 3))
    right = np.corrcoef(grey.ravel(), older.ravel())[0, 1]
    wrong = np.corrcoef(np.roll(grey, 30, axis=1).ravel(), older.ravel())[0, 1]
    assert 0.35 < right < 0.95
    assert wrong < 0.3
    warmth = [photo[..., 1].mean() - photo[..., 0].mean() for photo in (world.dom, world.satellite)]
    assert warmth[1] < warmth[0]


@pytest.mark.parametrize(("region", "seed"), [("sea", 0), ("city", -1)])
def test_what_cannot_be_built_is_refused(region: str, seed: int) -> None:
    with pytest.raises(UsageError):
        build_world(region, seed)
