"""Flights, their poses, and whether they stay in the air of their region."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from pyproj import Geod, Transformer

from airzoo_bench.datasets.mini.flights import (
    Trajectory,
    trajectory_poses,
)
from airzoo_bench.datasets.mini.world.model import CRS
from airzoo_bench.geometry.poses import Poses, rotation_angle_deg
from tests.datasets.mini.flights import flights, over_city
from tests.datasets.mini.views import poses_trajectory

TO_GRID = Transformer.from_crs("EPSG:4326", CRS, always_xy=True)


# Poses


@settings(max_examples=60, deadline=None)
@given(flight=flights())
def test_poses_and_back(flight: Trajectory) -> None:
    back = poses_trajectory(trajectory_poses(flight), flight.names, flight.time_s)
    assert np.abs(back.lonlat - flight.lonlat).max() < 1e-10
    assert np.array_equal(back.altitude_m, flight.altitude_m)
    for name in ("roll_deg", "pitch_deg"):
        assert np.abs(getattr(back, name) - getattr(flight, name)).max() < 1e-6
    turn = (back.yaw_deg - flight.yaw_deg + 180.0) % 360.0 - 180.0
    assert np.abs(turn).max() < 1e-6


def test_rotations_go_round_straight_down_too() -> None:
    flight = over_city([100.0], [100.0], [100.0])
    down = Trajectory(*(getattr(flight, n) for n in ("names", "time_s", "lonlat", "altitude_m")),
        np.array((7.0,)), np.array((-90.0,)), np.array((30.0,)))  # fmt: skip
    poses = trajectory_poses(down)
    again = trajectory_poses(poses_trajectory(poses, ("a",), np.zeros(1)))
    assert rotation_angle_deg(poses.rotation, again.rotation).max() < 1e-6


@pytest.mark.parametrize(("yaw", "pitch"), [(0.0, -5.0), (90.0, -30.0), (-135.0, -60.0)])
def test_the_camera_looks_where_the_geodesic_of_its_yaw_goes(yaw: float, pitch: float) -> None:
    """The axis meets the ground where a geodesic of azimuth yaw arrives, as pyproj finds it."""
    flight = over_city([300.0], [300.0], [100.0])
    angle = np.zeros(1)
    flight = Trajectory(
        ("a",), angle, flight.lonlat, flight.altitude_m, angle, angle + pitch, angle + yaw
    )
    poses: Poses = trajectory_poses(flight)
    forward = poses.rotation[0, 2]
    assert np.degrees(np.arcsin(-forward[2])) == pytest.approx(-pitch)
    reach = 100.0 / np.tan(np.radians(-pitch))
    lon, lat, _ = Geod(ellps="WGS84").fwd(*flight.lonlat[0], yaw, reach)
    met = poses.centres[0] + forward * 100.0 / -forward[2]
    # The grid of this CRS scales lengths by a few parts in 10,000 here.
    assert np.hypot(*(met[:2] - TO_GRID.transform(lon, lat))) < 1e-3 * reach
