"""Both worlds, and what chance makes of a seed or a key."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.core.errors import UsageError
from airzoo_bench.datasets.mini.dataset import MiniOptions, mini_photos, mini_protocols
from airzoo_bench.datasets.mini.noise import derived, noisy_priors
from airzoo_bench.datasets.mini.renderer import Raycaster
from airzoo_bench.datasets.mini.world import REGIONS, SURVEY_SUN, Material, Mesh
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.poses import Poses, angles_to_rotations, rotation_angle_deg
from tests.datasets.mini.conftest import Prepared

EACH = pytest.mark.parametrize("region", sorted(REGIONS))
BYTES = {"city": "973ef2cb90fbe227", "rural": "16fdc6a42e2e5260"}


def corners_of(mesh: Mesh, *materials: Material) -> Floats:
    return mesh.vertices[mesh.triangles[np.isin(mesh.material, materials)]]


def normals(corners: Floats) -> Floats:
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


@pytest.mark.slow
@EACH
def test_every_byte_is_as_recorded(mini: Prepared, region: str) -> None:
    found = hashlib.sha256()
    for _, array in sorted(mini.world(region).arrays.items()):
        found.update(np.ascontiguousarray(array).tobytes())
    assert found.hexdigest()[:16] == BYTES[region]


@pytest.mark.slow
@EACH
def test_dsm_is_the_highest_surface_that_a_vertical_ray_meets(mini: Prepared, region: str) -> None:
    world = mini.world(region)
    caster = Raycaster(world.mesh)
    rows, columns = np.divmod(np.arange(0, 1200 * 1200, 37), 1200)
    x, y = (columns + 0.5) * 0.5, 600.0 - (rows + 0.5) * 0.5

    def height(off: float) -> Floats:
        origins = np.stack([x + off, y + off, np.full(len(x), 200.0)])
        return 200.0 - caster.trace(origins, np.array([[0.0], [0.0], [-1.0]]) + 0.0 * origins)[1]

    # Where a ray beside it meets quite another height, the pixel is at a vertical edge.
    met = height(0.0)
    level = (np.abs([height(-0.01) - met, height(0.01) - met]) <= 0.15).all(axis=0)
    assert level.mean() > 0.97
    assert np.abs(world.dsm[rows, columns] - met)[level].max() < 1e-4


@pytest.mark.slow
@EACH
def test_walls_stand_roofs_face_up_and_land_goes_on(mini: Prepared, region: str) -> None:
    mesh = mini.world(region).mesh
    walls = normals(corners_of(mesh, Material.WALL))
    assert np.abs(walls[:, 2] / np.linalg.norm(walls, axis=1)).max() < 1e-9
    upper = corners_of(mesh, Material.ROOF, Material.GROUND, Material.APRON)
    assert (normals(upper)[:, 2] > 0).all()
    land, apron = (corners_of(mesh, kind).reshape(-1, 3) for kind in (0, Material.APRON))
    assert (apron[:, :2].min(), apron[:, :2].max()) == (-800.0, 1400.0)
    for axis, border in ((0, 0.0), (0, 600.0), (1, 0.0), (1, 600.0)):
        along = apron[apron[:, axis] == border]
        along = along[(along[:, 1 - axis] >= 0) & (along[:, 1 - axis] <= 600)]
        inner = land[land[:, axis] == border]
        assert np.array_equal(np.unique(along, axis=0), np.unique(inner, axis=0))


@pytest.mark.slow
@EACH
def test_maps_show_the_same_place_in_their_light(mini: Prepared, region: str) -> None:
    world = mini.world(region)
    # No channel is brighter than the albedo in the whole sun, none darker than in the sky alone.
    albedo, sky = world.top[..., :3].astype(float), np.array(SURVEY_SUN.sky)
    assert (world.dom <= np.minimum(albedo * (sky + SURVEY_SUN.sun) + 0.51, 255)).all()
    assert (world.dom >= np.floor(np.minimum(albedo * sky, 255))).all()
    assert 0.6 < world.dom.sum() / albedo.sum() < 1.05
    grey = world.dom.mean(axis=2).reshape(200, 12, 200, 12).mean(axis=(1, 3))
    older = world.satellite.mean(axis=2).reshape(200, 10, 200, 10).mean(axis=(1, 3))
    assert 0.35 < np.corrcoef(grey.ravel(), older.ravel())[0, 1] < 0.95
    assert np.corrcoef(np.roll(grey, 30, axis=1).ravel(), older.ravel())[0, 1] < 0.3
    warmth = [photo[..., 1].mean() - photo[..., 0].mean() for photo in (world.dom, world.satellite)]
    assert warmth[1] < warmth[0]


def test_priors_are_off_as_a_drones_metadata() -> None:
    spread, names = np.linspace(0, 1, 4000), [f"photo_{row}" for row in range(4000)]
    rotations = angles_to_rotations(360 * spread, -45 - 30 * spread, 0.0, convergence_deg=0.0)
    poses = Poses.from_centres(rotations, np.outer(spread, np.ones(3)))
    noisy = noisy_priors(names, poses, 0)
    offsets = noisy.centres - poses.centres
    np.testing.assert_allclose(offsets.std(axis=0), [2.0, 2.0, 3.0], rtol=0.05)
    np.testing.assert_allclose(offsets.mean(axis=0), 0, atol=0.2)
    # Normal enough: as many beyond one and two deviations as there should be.
    scaled = np.abs(offsets / [2.0, 2.0, 3.0])
    assert (scaled > 1).mean() == pytest.approx(0.317, abs=0.02)
    assert (scaled > 2).mean() == pytest.approx(0.0455, abs=0.01)
    turned = rotation_angle_deg(noisy.rotation, poses.rotation)
    assert 0.5 < np.median(turned) < 3
    assert turned.max() < 15
    # They belong to the name and the seed, and are the same numbers everywhere.
    alone = noisy_priors(names[7:8], poses.take([7]), 0)
    np.testing.assert_array_equal(alone.centres[0], noisy.centres[7])
    assert not np.allclose(noisy_priors(names, poses, 1).centres, noisy.centres)
    one = Poses.from_centres(np.eye(3)[None], np.zeros((1, 3)))
    expected = [1.53424072265625, -0.400146484375, 6.124420166015625]
    assert noisy_priors(["city/0001"], one, 0).centres[0].tolist() == expected


def test_a_sealed_edition_hides_all_that_its_key_does_not_tell(tmp_path: Path) -> None:
    (tmp_path / "mini.key").write_text("9f86d081884c7d659a2feaa0c55ad015\n")
    key = MiniOptions(key_file=tmp_path / "mini.key").source
    assert len({derived(key ^ (1 << bit), "noise") for bit in range(128)}) == 128
    assert len({7, key, *(derived(key, what) for what in ("noise", "world")), derived(7, "a")}) == 4
    dsm = np.full((1200, 1200), 20.0, np.float32)
    public, sealed, other = (mini_photos(REGIONS["city"], dsm, seed) for seed in (0, key, key ^ 1))
    assert set(sealed.names).isdisjoint(other.names)
    assert not any("survey" in name or "roll" in name for name in sealed.names)
    # Nobody flies the survey again: its place and each photo's gusts are hidden.
    for shown in (public, other):
        off = np.linalg.norm(shown.poses.centres[:10] - sealed.poses.centres[:10], axis=1)
        assert off.min() > 1.0
    assert 1.0 < np.std(np.diff(sealed.poses.centres[:20, 2], 2)) / 6**0.5 < 6.0
    given, mixed = (
        sorted(zip(one.weather, one.time_of_day, strict=True)) for one in (public, sealed)
    )
    assert set(given) == set(mixed)
    for protocol in mini_protocols(key).every:
        assert protocol.benchmark == "airzoo-mini-sealed"
        assert f"{key:x}"[1:] not in protocol.model_dump_json()
    for seed, text in ((3, "0" * 32), (0, ""), (0, "0" * 31), (0, "g" * 32), (0, "0" * 64)):
        (tmp_path / "mini.key").write_text(text)
        with pytest.raises(UsageError):
            _ = MiniOptions(seed, tmp_path / "mini.key").source
