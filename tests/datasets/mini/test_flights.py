"""Flights that are made, smooth and safe; footprints and key frames against hand-worked ones."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from airzoo_bench.datasets.geometry_checks import MOST_DEPTH_M, footprints, key_frames
from airzoo_bench.datasets.mini import flights
from airzoo_bench.datasets.mini.flights import FPS, MARGIN_M
from airzoo_bench.datasets.mini.world import CRS, REGIONS
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras, back_project
from airzoo_bench.geometry.crs import grid_convergence_deg, to_lonlat
from airzoo_bench.geometry.poses import (
    Poses,
    angles_to_rotations,
    rays_to_world,
    rotations_to_angles,
)
from airzoo_bench.geometry.rays import intersect_plane

CITY = REGIONS["city"]
GROUND_M, FLOOR_M = 50.0, 130.0
ROUNDING = 4e-4 * FPS**2  # of second differences at 30 frames a second, by 0.1 mm
SIZES = {"survey": (240.0, 40.0), "five lines": (200.0, 50.0), "three lines": (100.0, 50.0)}
FLIGHTS = {f"barrel {seed}": flights.barrel_roll(CITY, FLOOR_M, seed) for seed in range(5)}
ORIGIN = (CITY.west, CITY.south, 0.0)
FLIGHTS |= {name: flights.survey(CITY, GROUND_M, FLOOR_M, *of) for name, of in SIZES.items()}


def angles(flight: Poses) -> Floats:
    """Return yaw from true north, pitch and roll of the frames, (3, N) degrees."""
    turn = grid_convergence_deg(CRS, to_lonlat(CRS, flight.centres[:, :2]))
    return rotations_to_angles(flight.rotation, convergence_deg=turn).T


@pytest.mark.parametrize("name", FLIGHTS)
def test_a_drone_can_fly_it(name: str) -> None:
    place, (yaw, pitch, roll) = FLIGHTS[name].centres - ORIGIN, angles(FLIGHTS[name])
    assert place[:, :2].min() >= MARGIN_M - 1e-3
    assert place[:, :2].max() <= CITY.side_m - MARGIN_M + 1e-3
    velocity = np.diff(place, axis=0) * FPS
    speed = np.linalg.norm(velocity, axis=1)
    assert 5.0 <= speed.min() <= speed.max() <= 12.0  # metres a second; degrees below
    assert np.linalg.norm(np.diff(velocity, axis=0), axis=1).max() * FPS < 8.0 + ROUNDING
    for angle in (yaw, pitch):
        whole = np.unwrap(angle, period=360.0)
        assert np.abs(np.diff(whole)).max() * FPS <= 30.0
        assert np.abs(np.diff(whole, 2)).max() * FPS**2 <= 10.0 + ROUNDING
    assert np.abs(roll).max() < 1e-6


# Means of the centres and of one row of the rotations: other flights are another world.
KNOWN = {
    "barrel 0": (20906, (301.015594, 301.682116, 169.514241), (-0.025968, -0.009895, -0.566559)),
    "survey": (11403, (301.346441, 298.87634, 130.0), (0.009627, -0.456723, -0.295658)),
}


@pytest.mark.parametrize("name", KNOWN)
def test_flights_stay_what_they_are(name: str) -> None:
    flight, (frames, centre, down) = FLIGHTS[name], KNOWN[name]
    assert len(flight.centres) == frames
    np.testing.assert_allclose((flight.centres - ORIGIN).mean(axis=0), centre, atol=1e-5)
    np.testing.assert_allclose(flight.rotation[:, 1].mean(axis=0), down, atol=1e-5)


# 90 degrees wide and, in height, three quarters of that.
K = np.array([[[320.0, 0.0, 320.0], [0.0, 320.0, 240.0], [0.0, 0.0, 1.0]]])
CAMERA = Cameras.from_matrices(K, 640, 480)


def posed(height: float, yaw: float, pitch: float, roll: float = 0.0) -> Poses:
    rotation = angles_to_rotations(yaw, pitch, roll, convergence_deg=0.0)
    return Poses.from_centres(rotation[None], [(0.0, 0.0, height)])


def test_footprints_by_hand() -> None:
    """Straight down; and to the north at 45 degrees, both from 50 m above the ground.

    There, rows at the border are tan = 0.75 off the axis: (1 - 0.75) / (1 + 0.75) times 50 m and
    its inverse away, at depths of 50 sqrt(2) / (1 +- 0.75).
    """
    near, far = ((50 * np.sqrt(2) / tan, 50 * (2 - tan) / tan) for tan in (1.75, 0.25))
    trapezium = [(-near[0], near[1]), near, far, (-far[0], far[1])]
    for pitch, expected in ((-90.0, shapely.box(-50, -37.5, 50, 37.5)), (-45.0, trapezium)):
        found = footprints(CAMERA, posed(100.0, 0.0, pitch), 50.0)[0]
        assert shapely.symmetric_difference(found, shapely.Polygon(expected)).area < 1e-3


ANGLES = st.tuples(st.floats(-180, 180), st.floats(-90, 30), st.floats(-60, 60))


@given(height=st.floats(20, 300), angles=ANGLES)
def test_the_footprint_holds_what_pixels_see_and_no_more(height, angles) -> None:
    poses = posed(50.0 + height, *angles)
    grid = np.stack(np.meshgrid(np.linspace(1, 639, 23), np.linspace(1, 479, 17)), -1)
    rays = rays_to_world(poses, back_project(CAMERA, grid.reshape(1, -1, 2)))
    hits = intersect_plane(poses.centres, rays, 50.0, 1e5)
    depth = (hits.points - poses.centres[:, None]) @ poses.rotation[0, 2]
    seen = hits.valid & (depth <= 0.999 * MOST_DEPTH_M)
    shape = footprints(CAMERA, poses, 50.0)[0]
    points = shapely.points(hits.points[seen][:, :2])
    assert shapely.covers(shapely.buffer(shape, 1e-6), points).all()
    beyond = shapely.points(hits.points[hits.valid & (depth > 1.001 * MOST_DEPTH_M)][:, :2])
    assert not shapely.covers(shape, beyond).any()


@pytest.mark.parametrize(("overlap", "step"), [(0.75, 50), (0.5, 100), (0.1, 180)])
def test_key_frames_of_a_straight_line_by_hand(overlap: float, step: int) -> None:
    # To the east 100 m above the ground, 200 m wide: 75 % of it is shared after 50 m.
    centres = np.column_stack((np.arange(402.0), np.zeros(402), np.full(402, 150.0)))
    down = angles_to_rotations(0.0, -90.0, 0.0, convergence_deg=0.0)
    flight = Poses.from_centres(np.repeat(down[None], 402, 0), centres)
    assert key_frames(flight, CAMERA, 50.0, overlap).tolist() == list(range(0, 401, step))
    # Straight up: each frame sees all that the one before sees.
    rising = Poses.from_centres(flight.rotation, centres[:, [1, 1, 0]] / 2 + (0.0, 0.0, 60.0))
    assert key_frames(rising, CAMERA, 50.0, overlap).tolist() == [0]
