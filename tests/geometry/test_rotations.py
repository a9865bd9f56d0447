from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyproj import Geod, Proj
from scipy.spatial.transform import Rotation

from airzoo_bench.core.errors import CameraError, UserError
from airzoo_bench.geometry.frames import from_lonlat
from airzoo_bench.geometry.rotations import (
    angles_to_rotations,
    rotation_angle_deg,
    rotations_to_angles,
)
from airzoo_bench.geometry.units import grid_convergence_deg

from .support import quick

S = np.sqrt(0.5)

# Where the image's right, its down, and the line of sight point: east, north, up.
BY_HAND = {
    "nadir, north up": ((0, -90, 0), ((1, 0, 0), (0, -1, 0), (0, 0, -1))),
    "nadir, east up": ((90, -90, 0), ((0, -1, 0), (-1, 0, 0), (0, 0, -1))),
    "east at the horizon": ((90, 0, 0), ((0, -1, 0), (0, 0, -1), (1, 0, 0))),
    "south, 45 down": ((180, -45, 0), ((-1, 0, 0), (0, S, -S), (0, -S, -S))),
    "north, rolled clockwise": ((0, 0, 90), ((0, 0, -1), (-1, 0, 0), (0, 1, 0))),
    "north, upside down": ((0, 0, 180), ((-1, 0, 0), (0, 0, 1), (0, 1, 0))),
}

angles = st.floats(-180, 180)


@pytest.mark.parametrize(("gimbal", "rows"), BY_HAND.values(), ids=BY_HAND)
def test_worked_by_hand(gimbal: tuple[float, ...], rows: tuple[tuple[float, ...], ...]) -> None:
    found = angles_to_rotations(*gimbal, convergence_deg=0.0)
    np.testing.assert_allclose(found, rows, rtol=0, atol=1e-15)


def test_convergence_is_taken_from_yaw() -> None:
    # The grid's north lies 3 degrees east of true north, so what is 10 degrees east of true north
    # is 7 degrees east of the grid's.
    found = angles_to_rotations(10.0, 0.0, 0.0, convergence_deg=3.0)
    seven = np.radians(7.0)
    np.testing.assert_allclose(found[2], (np.sin(seven), np.cos(seven), 0.0), atol=1e-15)
    assert rotations_to_angles(found, convergence_deg=3.0)[0] == pytest.approx(10.0)


@quick
@given(angles, st.floats(-90, 90), angles)
def test_against_scipy(yaw: float, pitch: float, roll: float) -> None:
    to_ned = Rotation.from_euler("ZYX", (yaw, pitch, roll), degrees=True).as_matrix()
    from_enu = np.array(((0, 1, 0), (1, 0, 0), (0, 0, -1)))
    to_camera = np.array(((0, 1, 0), (0, 0, 1), (1, 0, 0)))  # forward-right-down, renamed
    expected = to_camera @ to_ned.T @ from_enu
    found = angles_to_rotations(yaw, pitch, roll, convergence_deg=0.0)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-15)


@quick
@given(st.floats(-180, 179.9), st.floats(-89.9, 89.9), st.floats(-179.9, 179.9), angles)
def test_angles_come_back(yaw: float, pitch: float, roll: float, convergence: float) -> None:
    rotation = angles_to_rotations(yaw, pitch, roll, convergence_deg=convergence)
    found = rotations_to_angles(rotation, convergence_deg=convergence)
    found[0] += 360.0 * round((yaw - found[0]) / 360.0)  # -180 and 180 are one
    np.testing.assert_allclose(found, (yaw, pitch, roll), rtol=0, atol=1e-9)


@quick
@given(angles, st.sampled_from((-90.0, 90.0)), st.floats(-1e-5, 1e-5), angles)
def test_straight_down_rotations_come_back(
    yaw: float, pitch: float, off: float, roll: float
) -> None:
    rotation = angles_to_rotations(yaw, pitch + off, roll, convergence_deg=1.0)
    found = rotations_to_angles(rotation, convergence_deg=1.0)
    again = angles_to_rotations(*found, convergence_deg=1.0)
    assert rotation_angle_deg(again, rotation) < 2e-6
    if off == 0.0:
        assert found[2] == 0.0


def test_many_at_once_are_each_alone() -> None:
    gimbal = np.random.default_rng(0).uniform(-90, 90, (2, 5, 3))
    convergence = np.array((0.5, -0.5))[:, None]
    together = angles_to_rotations(*np.moveaxis(gimbal, -1, 0), convergence_deg=convergence)
    assert together.shape == (2, 5, 3, 3)
    alone = angles_to_rotations(*gimbal[1, 3], convergence_deg=-0.5)
    assert np.array_equal(together[1, 3], alone)
    back = rotations_to_angles(together, convergence_deg=convergence)
    np.testing.assert_allclose(back, gimbal, atol=1e-11)


@pytest.mark.parametrize(
    ("crs", "lon", "lat"),
    [
        (4547, 112.3, 28.2),  # west of the central meridian, 114 E
        (4547, 115.2, 28.2),
        (32615, -91.99, 46.84),
        (32756, 151.2, -33.9),
        (2154, 7.2, 43.7),  # conic
        (3031, 60.0, -75.0),  # polar
    ],
)
def test_convergence_against_proj(crs: int, lon: float, lat: float) -> None:
    found = grid_convergence_deg(crs, (lon, lat))
    expected = Proj(crs).get_factors(lon, lat).meridian_convergence
    assert found == pytest.approx(expected, abs=1e-7)


def test_convergence_by_formula() -> None:
    # To first order sin(latitude) times the way from the central meridian: meridians lean towards
    # it on their way north, so east of it true north lies west of the grid's.
    found = grid_convergence_deg(4547, ((113.9, 28.0), (114.0, 28.0), (114.1, 28.0)))
    lean = 0.1 * np.sin(np.radians(28.0))
    np.testing.assert_allclose(found, (-lean, 0.0, lean), rtol=0, atol=1e-6)


@pytest.mark.parametrize(("crs", "lon", "lat"), [(4547, 115.2, 28.2), (32756, 151.2, -33.9)])
@pytest.mark.parametrize("yaw", [0.0, 37.0, -120.0])
def test_the_line_of_sight_follows_the_geodesic(
    crs: int, lon: float, lat: float, yaw: float
) -> None:
    far_lon, far_lat, _ = Geod(ellps="WGS84").fwd(lon, lat, yaw, 10.0)
    step = from_lonlat(crs, (far_lon, far_lat)) - from_lonlat(crs, (lon, lat))
    convergence = grid_convergence_deg(crs, (lon, lat))
    sight = angles_to_rotations(yaw, 0.0, 0.0, convergence_deg=convergence)[2]
    np.testing.assert_allclose(sight[:2], step / np.linalg.norm(step), rtol=0, atol=1e-6)


def test_convergence_where_there_is_none() -> None:
    found = grid_convergence_deg(32615, ((np.nan, 46.0), (-91.99, 46.84), (-93.0, 95.0)))
    assert np.isnan(found).tolist() == [True, False, True]
    assert np.isfinite(grid_convergence_deg(3031, (0.0, -90.0)))
    with pytest.raises(CameraError, match="no grid"):
        grid_convergence_deg(4326, (0.0, 0.0))
    with pytest.raises(UserError, match="unknown CRS"):
        grid_convergence_deg("EPSG:1", (0.0, 0.0))
