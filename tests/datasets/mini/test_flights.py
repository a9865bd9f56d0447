"""Flights that are made: smooth, safe, the same every time."""

from __future__ import annotations

import numpy as np
import pytest
from pyproj import Geod, Transformer

from airzoo_bench.core.errors import UsageError
from airzoo_bench.datasets.mini.flights import (
    FPS,
    MARGIN_M,
    Airspace,
    barrel_roll,
    fly,
    frame_poses,
    survey,
)
from airzoo_bench.datasets.mini.world import CRS, REGIONS
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.crs import grid_convergence_deg, to_lonlat
from airzoo_bench.geometry.poses import Poses, rotations_to_angles

CITY = REGIONS["city"]
AIR = Airspace(CITY, ground_m=50.0, floor_m=130.0, ceiling_m=210.0)
# What rounding to 0.1 mm may do to second differences at 30 frames a second.
ROUNDING = 4e-4 * FPS**2
# What a drone flies: metres a second, degrees a second and a second squared.
SPEEDS, MAX_RATE, MAX_ACCELERATION = (5.0, 12.0), 30.0, 10.0

FLIGHTS = {
    "barrel 0": lambda: barrel_roll(AIR, 0),
    "barrel 1": lambda: barrel_roll(AIR, 1, rounds=1),
    "barrel 2": lambda: barrel_roll(AIR, 2, rounds=3),
    "survey": lambda: survey(AIR),
    "small survey": lambda: survey(AIR, side_m=100.0, spacing_m=50.0),
    "survey of four lines": lambda: survey(AIR, side_m=180.0, spacing_m=60.0),
    "high survey": lambda: survey(Airspace(CITY, 50.0, 330.0, 400.0)),
}


@pytest.fixture(scope="module", params=FLIGHTS)
def flight(request: pytest.FixtureRequest) -> Poses:
    return FLIGHTS[request.param]()


def places(flight: Poses) -> np.ndarray:
    return flight.centres - (CITY.west, CITY.south, 0.0)


def angles(flight: Poses) -> Floats:
    """Return yaw from true north, pitch and roll of the frames, (3, N) degrees."""
    turn = grid_convergence_deg(CRS, to_lonlat(CRS, flight.centres[:, :2]))
    return rotations_to_angles(flight.rotation, convergence_deg=turn).T


def rates(angle_deg: np.ndarray) -> tuple[float, float]:
    """Fastest turn and its fastest change, in degrees a second (squared)."""
    whole = np.unwrap(angle_deg, period=360.0)
    return np.abs(np.diff(whole)).max() * FPS, np.abs(np.diff(whole, 2)).max() * FPS**2


def test_speed_is_a_drones(flight: Poses) -> None:
    speed = np.linalg.norm(np.diff(places(flight), axis=0), axis=1) * FPS
    assert speed.min() >= SPEEDS[0]
    assert speed.max() <= SPEEDS[1]


def test_velocity_has_no_jumps(flight: Poses) -> None:
    acceleration = np.linalg.norm(np.diff(places(flight), 2, axis=0), axis=1) * FPS**2
    assert acceleration.max() < 8.0 + ROUNDING


def test_the_gimbal_turns_smoothly(flight: Poses) -> None:
    yaw, pitch, roll = angles(flight)
    for angle in (yaw, pitch):
        rate, change = rates(angle)
        assert rate <= MAX_RATE
        assert change <= MAX_ACCELERATION + ROUNDING
    assert np.abs(roll).max() < 1e-6


def test_it_stays_in_the_region_less_its_margin(flight: Poses) -> None:
    xy = places(flight)[:, :2]
    assert xy.min() >= MARGIN_M - 1e-3
    assert xy.max() <= CITY.side_m - MARGIN_M + 1e-3


def test_the_same_seed_is_the_same_flight_and_another_is_not() -> None:
    first, again, other = barrel_roll(AIR, 5), barrel_roll(AIR, 5), barrel_roll(AIR, 6)
    assert first.centres.tobytes() == again.centres.tobytes()
    assert first.rotation.tobytes() == again.rotation.tobytes()
    assert len(first) != len(other) or not np.allclose(first.centres, other.centres, atol=1.0)


@pytest.mark.parametrize("seed", range(25))
def test_every_seed_can_be_flown(seed: int) -> None:
    flight = barrel_roll(AIR, seed, rounds=1)
    place = places(flight)
    assert place[:, :2].min() >= MARGIN_M
    assert place[:, :2].max() <= CITY.side_m - MARGIN_M
    velocity = np.diff(place, axis=0) * FPS
    speed = np.linalg.norm(velocity, axis=1)
    assert SPEEDS[0] <= speed.min()
    assert speed.max() <= SPEEDS[1]
    assert np.linalg.norm(np.diff(velocity, axis=0), axis=1).max() * FPS < 8.0 + ROUNDING
    assert max(rates(angle)[0] for angle in angles(flight)[:2]) <= MAX_RATE


def test_the_barrel_roll_sweeps_all_that_it_says() -> None:
    flight = barrel_roll(AIR, 0)
    (yaw, pitch, _), altitude = angles(flight), flight.centres[:, 2]
    assert pitch.min() == pytest.approx(-90.0, abs=0.01)
    assert pitch.max() == pytest.approx(-10.0, abs=0.01)
    assert altitude.min() == pytest.approx(130.0, abs=0.01)
    assert altitude.max() == pytest.approx(210.0, abs=0.01)
    # Up and down several times, and round in both senses.
    turns = np.diff(np.sign(np.diff(altitude[::30])))
    assert np.count_nonzero(turns) >= 8
    assert np.ptp(np.unwrap(yaw, period=360.0)) > 360.0
    # It crosses the scene and goes round it.
    place = places(flight)[:, :2] - CITY.side_m / 2
    away = np.linalg.norm(place, axis=1)
    assert away.min() < 40.0
    assert away.max() > 160.0


def test_the_survey_has_its_lines_and_its_orbit() -> None:
    flight = survey(AIR, side_m=200.0, spacing_m=50.0)
    assert set(np.unique(flight.centres[:, 2])) == {130.0}
    yaw, pitch, _ = angles(flight)
    place = places(flight)[:, :2] - CITY.side_m / 2
    north = pitch < -84.9
    # Five lines at -100, -50, 0, 50, 100 m are crossed where they pass the middle.
    middle = north[1:] & (np.diff(np.sign(place[:, 1])) != 0)
    assert np.round(place[1:][middle, 0], -1).tolist() == [-100.0, -50.0, 0.0, 50.0, 100.0]
    orbit = pitch > -45.05
    away = np.linalg.norm(place[orbit][5 * FPS :], axis=1)
    # At 45 degrees the centre of the scene is seen from as far away as high: 130 - 50 m.
    assert np.abs(away - 80.0).max() < 4.0
    assert np.ptp(np.unwrap(yaw[orbit], period=360.0)) > 300.0


@pytest.mark.parametrize(
    "made",
    [
        lambda: survey(AIR, side_m=521.0),
        lambda: survey(AIR, spacing_m=0.0),
        lambda: survey(AIR, spacing_m=250.0),
    ],
)
def test_what_cannot_be_flown_is_refused(made: object) -> None:
    with pytest.raises(UsageError):
        made()  # type: ignore[operator]


def test_a_straight_leg_is_flown_straight() -> None:
    line = np.column_stack((np.full(161, 5.0), np.arange(161.0), np.full(161, 90.0)))
    level = np.zeros(161)
    flight = fly(CITY, line, level, level - 30.0)
    place = places(flight)
    assert np.abs(place[:, (0, 2)] - (5.0, 90.0)).max() < 1e-3
    assert np.abs(place[(0, -1), 1] - (0.0, 160.0)).max() < 0.5
    # North of the grid is not true north: the camera follows the grid.
    assert np.abs(flight.rotation[:, 2] - (0.0, np.cos(np.pi / 6), -0.5)).max() < 1e-5
    assert np.abs(angles(flight)[0]).min() > 0.1


@pytest.mark.parametrize(("yaw", "pitch"), [(0.0, -5.0), (90.0, -30.0), (-135.0, -60.0)])
def test_the_camera_looks_where_the_geodesic_of_its_yaw_goes(yaw: float, pitch: float) -> None:
    """The axis meets the ground where a geodesic of azimuth yaw arrives, as pyproj finds it."""
    lonlat = to_lonlat(CRS, np.array([[CITY.west + 300.0, CITY.south + 300.0]]))
    poses = frame_poses(lonlat, *np.array([[100.0], [pitch], [yaw]]))
    forward = poses.rotation[0, 2]
    assert np.degrees(np.arcsin(-forward[2])) == pytest.approx(-pitch)
    reach = 100.0 / np.tan(np.radians(-pitch))
    lon, lat, _ = Geod(ellps="WGS84").fwd(*lonlat[0], yaw, reach)
    met = poses.centres[0] + forward * 100.0 / -forward[2]
    # The grid of this CRS scales lengths by a few parts in 10,000 here.
    to_grid = Transformer.from_crs("EPSG:4326", CRS, always_xy=True)
    assert np.hypot(*(met[:2] - to_grid.transform(lon, lat))) < 1e-3 * reach
