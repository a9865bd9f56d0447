from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from shapely import Polygon, STRtree

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.optional_imports import load_open3d
from airzoo_bench.datasets.mini.world.build import build_world, digest
from airzoo_bench.datasets.mini.world.city import city_plan
from airzoo_bench.datasets.mini.world.meshes import building_mesh
from airzoo_bench.datasets.mini.world.model import REGIONS, SURVEY_SUN, Material, Mesh, World
from airzoo_bench.datasets.mini.world.plan import Plan
from airzoo_bench.datasets.mini.world.rural import rural_plan

PLANNED = pytest.mark.parametrize("region", sorted(REGIONS))
# A region takes some 20 s: these run every night.
BUILT = pytest.mark.parametrize(
    "region", [pytest.param(region, marks=pytest.mark.slow) for region in sorted(REGIONS)]
)
PLANS = {"city": city_plan, "rural": rural_plan}


@cache
def world_of(region: str) -> World:
    return build_world(region, 0)


@cache
def plan_of(region: str, seed: int) -> Plan:
    return PLANS[region](seed)


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
def test_arrays_have_the_shapes_of_the_contract(region: str) -> None:
    world = world_of(region)
    found = {
        name: (array.shape, str(array.dtype))
        for name, array in vars(world).items()
        if isinstance(array, np.ndarray) and name != "tree_colours"
    }
    assert found == {
        "ground_albedo": ((2400, 2400, 3), "uint8"),
        "top_albedo": ((2400, 2400, 3), "uint8"),
        "dom": ((2400, 2400, 3), "uint8"),
        "satellite": ((2000, 2000, 3), "uint8"),
        "water": ((2400, 2400), "bool"),
        "dsm": ((1200, 1200), "float32"),
    }
    mesh = world.mesh
    kinds = [str(array.dtype) for array in vars(mesh).values()]
    assert kinds == ["float64", "int32", "uint8", "int32"]
    assert len(mesh.triangles) == len(mesh.material) == len(mesh.owner) < 600_000
    walls, trees = len(world.buildings.style), len(world.tree_colours)
    assert len(np.unique(mesh.owner[mesh.material == Material.WALL])) == walls
    assert len(np.unique(mesh.owner[mesh.material == Material.CANOPY])) == trees
    assert (mesh.owner[np.isin(mesh.material, [Material.GROUND, Material.APRON])] == -1).all()


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


@PLANNED
def test_buildings_are_closed_but_for_the_floor_and_turned_outside(region: str) -> None:
    plan = plan_of(region, 0)
    mesh = building_mesh(plan.buildings)
    ends = np.concatenate([mesh.triangles[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))])
    directed = {tuple(edge) for edge in ends.tolist()}
    assert len(directed) == len(ends)
    low = np.array([b.base_m for b in plan.buildings])
    owner = np.tile(mesh.owner, 3)
    open_edges = np.array([(b, a) not in directed for a, b in ends.tolist()])
    assert open_edges.sum() == 4 * len(plan.buildings)
    assert (mesh.vertices[ends[open_edges], 2] <= low[owner[open_edges]][:, None]).all()
    corners = mesh.vertices[mesh.triangles]
    middle = np.array([(b.rect.frame.x, b.rect.frame.y, b.base_m) for b in plan.buildings])
    out = corners.mean(axis=1) - middle[mesh.owner]
    assert ((out * normals(corners)).sum(axis=1) > 0).all()


@BUILT
def test_canopies_are_closed_irregular_and_turned_outside(region: str) -> None:
    mesh = world_of(region).mesh
    chosen = mesh.material == Material.CANOPY
    corners, owner = mesh.vertices[mesh.triangles[chosen]], mesh.owner[chosen]
    counts = np.bincount(owner)
    assert set(counts.tolist()) <= {32, 80}
    first = np.zeros((len(counts), 3))
    first[owner[::-1]] = corners[::-1, 0]
    around = corners - first[owner][:, None]
    volume = np.bincount(owner, (around[:, 0] * np.cross(around[:, 1], around[:, 2])).sum(1)) / 6
    assert (volume > 0.1).all()
    assert len(np.unique(np.round(volume, 3))) > 0.8 * len(volume)


@BUILT
def test_floors_are_nowhere_above_the_land(region: str) -> None:
    plan, world = plan_of(region, 0), world_of(region)
    mesh = building_mesh(plan.buildings)
    bottom = np.full(len(plan.buildings), np.inf)
    np.minimum.at(bottom, mesh.owner, mesh.vertices[mesh.triangles, 2].min(axis=1))
    land = [
        world.mesh.vertices[: 301 * 301, 2]
        .reshape(301, 301)[int(y // 2) : int(y // 2) + 2, int(x // 2) : int(x // 2) + 2]
        .min()
        for building in plan.buildings
        for x, y in building.rect.corners()
    ]
    lowest = np.array(land).reshape(-1, 4).min(axis=1)
    standing = np.array([building.parent < 0 for building in plan.buildings])
    assert (bottom[standing] <= lowest[standing]).all()


@PLANNED
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_no_building_stands_in_another(region: str, seed: int) -> None:
    buildings = [b for b in plan_of(region, seed).buildings if b.parent < 0]
    shapes = [Polygon(building.rect.corners()) for building in buildings]
    inside = Polygon([(0, 0), (600, 0), (600, 600), (0, 600)])
    assert all(shape.within(inside) for shape in shapes)
    assert len(shapes) > (150 if region == "city" else 15)
    left, right = STRtree(shapes).query(shapes, predicate="intersects")
    for a, b in zip(left.tolist(), right.tolist(), strict=True):
        assert a == b or shapes[a].intersection(shapes[b]).area < 0.01


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


@pytest.mark.slow
def test_water_lies_flat_in_the_city() -> None:
    world = world_of("city")
    assert world.water.mean() > 0.01
    dsm = np.repeat(np.repeat(world.dsm, 2, 0), 2, 1)
    assert np.isclose(dsm[world.water].min(), 35.5)
    assert (np.abs(dsm[world.water] - 35.5) < 0.01).mean() > 0.5


@pytest.mark.slow
def test_country_has_relief_and_woods() -> None:
    world = world_of("rural")
    heights = world.mesh.vertices[: 301 * 301, 2]
    assert 25.0 < np.ptp(heights) < 55.0
    assert len(world.tree_colours) > 2000


@pytest.mark.slow
def test_another_seed_is_another_place() -> None:
    other = digest(build_world("rural", 7))
    same = digest(world_of("rural"))
    shared = {name for name in same if same[name] == other[name]}
    # Buildings may be alike in a column; nothing that is seen may be.
    assert not shared & {"dom", "dsm", "satellite", "mesh.vertices", "ground_albedo", "top_albedo"}


@pytest.mark.parametrize(("region", "seed"), [("sea", 0), ("city", -1)])
def test_what_cannot_be_built_is_refused(region: str, seed: int) -> None:
    with pytest.raises(UsageError):
        build_world(region, seed)
