"""The parts of rendering by themselves: noise, textures, walls, surroundings, contact sheets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from airzoo_bench.datasets.mini.noise import (
    floor_log2,
    gaussians,
    hash64,
    seed_of,
    uniforms,
    volume_noise,
)
from airzoo_bench.datasets.mini.rendering.renderer import Raycaster
from airzoo_bench.datasets.mini.rendering.surfaces import (
    Facades,
    Points,
    Texture,
    Wall,
    surroundings,
)
from tests.datasets.mini.small_world import BLOCK, SIDE_M, small_mesh, small_world

Single = np.float32


def test_the_hash_is_splitmix64() -> None:
    """The first outputs of the published generator with state 0, which adds before it mixes."""
    counters = np.array([1, 2, 3], np.uint64)
    expected = [0xE220A8397B1DCDAF, 0x6E789E6AA1B965F4, 0x06C45D188009454F]
    assert hash64(counters, 0).tolist() == expected
    assert seed_of("a", 1) != seed_of("a1")
    assert seed_of(3, "f001") == seed_of(3, "f001") < 1 << 64


def test_noise_has_the_moments_it_should() -> None:
    hashes = hash64(np.arange(200_000, dtype=np.uint64), 5)
    normal = gaussians(hashes)
    np.testing.assert_allclose(normal.mean(axis=1), 0.0, atol=0.01)
    np.testing.assert_allclose(normal.std(axis=1), 1.0, atol=0.01)
    np.testing.assert_allclose(np.corrcoef(normal), np.eye(4), atol=0.01)
    for lane in range(4):
        part = uniforms(hashes, lane)
        assert 0.0 <= part.min() < part.max() < 1.0
        assert abs(part.mean() - 0.5) < 0.01


def test_exponents() -> None:
    values = np.array([0.25, 0.3, 0.99, 1.0, 1.5, 2.0, 1000.0], Single)
    assert floor_log2(values).tolist() == [-2, -2, -1, 0, 0, 1, 9]


def test_volume_noise_fades_with_the_size_of_the_pixel() -> None:
    places = np.random.default_rng(1).uniform(-40, 40, (3, 20_000)).astype(Single)
    xyz = (places[0], places[1], places[2])

    def spread(footprint: float) -> float:
        size = np.full(20_000, footprint, Single)
        return float(volume_noise(xyz, 0.1, size).std())

    assert spread(0.1) == pytest.approx(1.0, abs=0.05)
    assert spread(0.1) > spread(0.4) > spread(1.6) > spread(100.0)
    assert spread(100.0) < 0.01


def _texture() -> tuple[NDArray[np.uint8], Texture]:
    lanes = np.random.default_rng(2).integers(0, 256, (24, 24, 4), dtype=np.uint8)
    return lanes, Texture.of(lanes, 6.0)


def _sample(texture: Texture, x: float, y: float, footprint: float) -> NDArray[np.float32]:
    one = [np.array([value], Single) for value in (x, y, footprint, 0.0)]
    return texture.sample(*one)[:, 0] * Single(255)


def test_a_texture_at_and_between_the_centres_of_texels() -> None:
    lanes, texture = _texture()
    # Row 3 from the north, column 5, texels of 0.25 m
    x, y = 5.5 * 0.25, 6.0 - 3.5 * 0.25
    np.testing.assert_allclose(_sample(texture, x, y, 0.1), lanes[3, 5], atol=1e-3)
    between = lanes[3, 5] * 0.75 + lanes[3, 6] * 0.25
    np.testing.assert_allclose(_sample(texture, x + 0.0625, y, 0.1), between, atol=1e-3)
    corner = lanes[3:5, 5:7].mean(axis=(0, 1))
    np.testing.assert_allclose(_sample(texture, x + 0.125, y - 0.125, 0.1), corner, atol=1e-3)


def test_a_texture_seen_by_large_pixels_is_averaged() -> None:
    lanes, texture = _texture()
    block = lanes[4:8, 8:12].mean(axis=(0, 1))
    # The middle of that block of four by four
    np.testing.assert_allclose(_sample(texture, 2.5, 4.5, 1.2), block, atol=1.1)


def test_a_texture_is_mirrored_beyond_its_border() -> None:
    _, texture = _texture()
    for x, inside in ((7.0, 5.0), (11.0, 1.0), (13.0, 1.0), (-1.0, 1.0), (-7.0, 5.0)):
        expected = _sample(texture, inside, 6.0 - inside, 0.1)
        beyond = _sample(texture, x, 6.0 - x, 0.1)
        np.testing.assert_allclose(beyond, expected, atol=1e-3)


def _south_wall(u: float, height: float, footprint: float, style: int = 0) -> Wall:
    """Look straight at the block's south wall, `u` m from its west corner."""
    world = small_world()
    caster = Raycaster(small_mesh())
    place = np.array([BLOCK[0] + u, BLOCK[1], 20.0 + height])
    triangle, _ = caster.trace(place - (0, 5, 0), np.array([[0.0], [1.0], [0.0]]))
    points = Points(
        xyz=place[:, None].astype(Single),
        normal=np.array([[0], [-1], [0]], Single),
        view=np.array([[0], [1], [0]], Single),
        distance=np.array([5], Single),
        footprint=np.array([footprint], Single),
        dither=np.zeros(1, Single),
        material=np.array([2], np.uint8),
        owner=np.zeros(1, np.int32),
        triangle=triangle,
    )
    walls = replace(world.buildings, style=np.array([style, 2], np.uint8))
    return Facades(world.mesh, caster.normal, walls).look(points)


def test_windows_of_a_wall() -> None:
    """20 m in bays of about 3.2 m are six of 3.333 m; storeys are 3 m."""
    bay = 20 / 6
    # The middles of all windows of the second storey, and the pillars between them
    for column in range(6):
        assert _south_wall((column + 0.5) * bay, 4.7, 0.02).glass[0] == pytest.approx(1.0, abs=1e-5)
        assert _south_wall(column * bay + 0.1, 4.7, 0.02).glass[0] == 0.0
    assert _south_wall(0.5 * bay, 3.2, 0.02).glass[0] == 0.0  # below the sill
    # The edge of a window, at 0.24 of the bay, is half seen
    assert _south_wall(2.24 * bay, 4.7, 0.5).glass[0] == pytest.approx(0.5, abs=0.02)
    # Pixels larger than bays see the mean: 0.52 of the width, 0.52 of the height
    assert _south_wall(7.0, 7.7, 9.0).glass[0] == pytest.approx(0.52 * 0.52, abs=0.02)
    np.testing.assert_allclose(_south_wall(3.0, 4.5, 0.02).height, 4.5, atol=1e-5)


def test_styles_of_walls() -> None:
    pillar = 2 * 20 / 6 + 0.3
    assert _south_wall(pillar, 4.7, 0.02, style=0).glass[0] == 0.0
    assert _south_wall(pillar, 4.7, 0.02, style=1).glass[0] > 0.999  # a band
    barn = [_south_wall(x, 1.5, 0.02, style=3) for x in (10.0, 4.0)]
    assert [wall.glass[0] for wall in barn] == [0.0, 0.0]
    assert barn[0].albedo.mean() < 0.5 * barn[1].albedo.mean()  # the door, in the middle


def test_narrow_places_see_less_of_the_sky() -> None:
    around = surroundings(small_world())
    spots = {"open": (48.0, 5.0), "wall": (30.0, 29.0), "roof": (30.0, 40.0)}
    seen = {
        name: around.sample(*(np.array([v], Single) for v in (*spot, 0.1, 0.0)))[0, 0]
        for name, spot in spots.items()
    }
    assert seen["open"] == pytest.approx(1.0, abs=0.01)
    assert seen["roof"] == pytest.approx(1.0, abs=0.01)
    assert 0.5 < seen["wall"] < 0.8


def test_lamps_stand_along_roads() -> None:
    around = surroundings(small_world())
    x = np.arange(0.5, SIDE_M, 1.0, dtype=Single)
    fine, still = np.full(len(x), 0.5, Single), np.zeros(len(x), Single)
    road = around.sample(np.full(len(x), 48, Single), x, fine, still)[1].mean()
    field = around.sample(np.full(len(x), 4, Single), x, fine, still)[1].mean()
    assert road > 2 * field
