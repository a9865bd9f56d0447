from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airzoo_bench.datasets.mini.noise import Dice, direction, hash_of, value_noise
from airzoo_bench.datasets.mini.world.build import resampled
from airzoo_bench.datasets.mini.world.model import OLDER_SUN, SURVEY_SUN, Light
from airzoo_bench.datasets.mini.world.shapes import (
    Frame,
    Polygon,
    Raster,
    Rect,
    Stroke,
    line_height,
)
from airzoo_bench.datasets.mini.world.surface import lit, sunlit

NOON_SOUTH = Light((0.0, -0.6, 0.8), (0.5, 0.5, 0.5), (0.25, 0.25, 0.25))


@pytest.mark.parametrize("light", [SURVEY_SUN, OLDER_SUN])
def test_sun_is_a_unit_vector_above_the_horizon(light: Light) -> None:
    assert sum(part * part for part in light.direction) == pytest.approx(1.0, abs=1e-15)
    assert light.direction[2] > 0.3


def test_hash_is_splitmix64() -> None:
    # The first outputs of the published generator started at 0 and at its own increment.
    assert int(hash_of(0, 0)[0]) == 0xE220A8397B1DCDAF
    assert int(hash_of(0x9E3779B97F4A7C15, 0)[0]) == 0x6E789E6AA1B965F4
    both = hash_of(0, np.array([0, 0x1E3779B97F4A7C15]))
    assert both.shape == (2,)
    assert int(both[0]) == 0xE220A8397B1DCDAF


@given(st.integers(0, 1 << 40), st.integers(-50, 50), st.integers(0, 100))
def test_dice_stay_in_their_range(seed: int, low: int, more: int) -> None:
    dice = Dice(seed, 3)
    assert low <= dice.integer(low, low + more) <= low + more
    assert low <= dice.real(low, low + more) <= low + more
    assert Dice(seed, 3).bits() != Dice(seed, 4).bits()


def test_directions_go_round_the_circle_in_nearly_equal_steps() -> None:
    points = np.array([direction(step) for step in range(256)])
    assert np.allclose((points**2).sum(axis=1), 1.0, atol=1e-15)
    angles = np.unwrap(np.arctan2(points[:, 1], points[:, 0]))
    assert np.allclose(np.diff(angles), 2 * np.pi / 256, rtol=0.15)


def test_noise_takes_the_lattice_at_its_points_and_is_smooth() -> None:
    noise = value_noise(5, 1, 97, 8)
    finer = value_noise(5, 1, 50, 8)
    assert np.array_equal(noise[:50, :50], finer)
    assert np.abs(np.diff(noise, axis=1)).max() < 4096 * 1.6 / 8
    assert noise.std() > 600


def test_a_wall_casts_a_shadow_of_the_hand_worked_length() -> None:
    # 8 m high, sun in the south at 4 : 3, so the shadow reaches 6 m = 12 pixels to the north.
    heights = np.zeros((60, 60))
    heights[40, 20:30] = 8.0
    visible = sunlit(heights, NOON_SOUTH, 0.5)
    shadow = visible < 128
    assert not shadow[40:].any()
    assert not shadow[:, :20].any()
    assert not shadow[:, 30:].any()
    # The last pixel is shadowed by 0 m, and some more by less than the penumbra of 0.45 m.
    assert shadow[29:40, 20:30].all()
    assert not shadow[:28].any()


def test_shadows_fall_away_from_the_survey_sun() -> None:
    heights = np.zeros((80, 80))
    heights[40, 40] = 12.0
    rows, columns = np.nonzero(sunlit(heights, SURVEY_SUN, 0.5) < 128)
    assert (rows <= 40).all()
    assert (columns >= 40).all()
    east, north, _ = SURVEY_SUN.direction
    along = (columns - 40) * -east + (40 - rows) * -north
    length = np.hypot(columns - 40, 40 - rows)
    assert np.all(length - along / np.hypot(east, north) < 0.3)


def test_lit_is_the_formula_of_light() -> None:
    albedo = np.full((1, 2, 3), 100, np.uint8)
    visible = np.array([[255, 0]], np.uint8)
    shown = lit(albedo, np.full((1, 2), 0.8, np.float32), visible, NOON_SOUTH)
    assert shown[0, 0].tolist() == [65, 65, 65]
    assert shown[0, 1].tolist() == [25, 25, 25]


def test_the_mosaic_is_shifted_by_its_offset() -> None:
    # A ramp of 2 display values a pixel of 0.25 m: 8 a metre to the east, and to the south.
    side = 120
    ramp = np.arange(side, dtype=np.uint8) * 2
    east = resampled(np.broadcast_to(ramp[None, :, None], (side, side, 3)), 0.25, 100)
    south = resampled(np.broadcast_to(ramp[:, None, None], (side, side, 3)), 0.25, 100)
    centre = (50 + 0.5) * 0.3
    assert abs(int(east[50, 50, 0]) - ((centre + 0.48) * 8 - 1)) <= 1.1
    assert abs(int(south[50, 50, 0]) - ((centre + 0.36) * 8 - 1)) <= 1.1


def test_shapes_cover_the_pixels_within_them() -> None:
    raster = Raster(40, 0.5)
    rect = Rect(Frame(10.0, 10.0), -4.0, 4.0, -2.0, 2.0).patch(raster)
    assert rect.mask.sum() == 16 * 8
    assert rect.u[rect.mask].min() == -3.75
    turned = Rect(Frame(10.0, 10.0, 0.0, 1.0), -4.0, 4.0, -2.0, 2.0).patch(raster)
    assert turned.mask.sum() == 16 * 8
    triangle = Polygon(((0.0, 0.0), (20.0, 0.0), (0.0, 20.0)), Frame(0, 0)).patch(raster)
    assert triangle.mask.sum() == 40 * 39 // 2
    stroke = Stroke(((0.0, 10.0), (20.0, 10.0)), 2.0).patch(raster)
    rows = np.arange(40)[stroke.window[0]]
    assert set(rows[stroke.mask.any(axis=1)]) == {18, 19, 20, 21}


def test_a_line_goes_on_straight_beyond_its_ends() -> None:
    line = ((0.0, 0.0), (2.0, 4.0), (4.0, 4.0))
    x = np.array([-1.0, 1.0, 3.0, 9.0])
    assert line_height(x, line).tolist() == [-2.0, 2.0, 4.0, 4.0]
