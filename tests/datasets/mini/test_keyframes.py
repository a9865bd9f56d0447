"""Key frames: footprints against hand-worked ones, and neighbours overlapping as asked."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from airzoo_bench.datasets.mini.flights import (
    Airspace,
    barrel_roll,
    footprints,
    key_frames,
    overlaps,
    survey,
)
from airzoo_bench.datasets.mini.world import REGIONS
from airzoo_bench.geometry.cameras import Cameras, back_project, project
from airzoo_bench.geometry.poses import Poses, angles_to_rotations, rays_to_world, world_to_camera
from airzoo_bench.geometry.rays import intersect_plane

CITY = REGIONS["city"]
AIR = Airspace(CITY, ground_m=50.0, floor_m=130.0, ceiling_m=210.0)
# 90 degrees wide and, in height, three quarters of that.
CAMERA = Cameras.from_matrices(
    np.array([[[320.0, 0.0, 320.0], [0.0, 320.0, 240.0], [0.0, 0.0, 1.0]]]), 640, 480
)
FAR = 400.0


def posed(place: tuple[float, float, float], yaw: float, pitch: float, roll: float = 0.0) -> Poses:
    rotation = angles_to_rotations(yaw, pitch, roll, convergence_deg=0.0)
    return Poses.from_centres(rotation[None], [place])


def footprint(poses: Poses, reach: float = FAR, ground: float = 50.0) -> shapely.Polygon:
    return footprints(CAMERA, poses, ground, reach)[0]


def line_flight(count: int, step_m: float, pitch: float = -90.0) -> Poses:
    """Return a flight to the east at 150 m, 100 m above the ground."""
    x = CITY.west + 100.0 + step_m * np.arange(count)
    centres = np.column_stack((x, np.full(count, CITY.south + 300.0), np.full(count, 150.0)))
    rotation = np.repeat(angles_to_rotations(0.0, pitch, 0.0, convergence_deg=0.0)[None], count, 0)
    return Poses.from_centres(rotation, centres)


def test_straight_down_the_footprint_is_the_image() -> None:
    # 100 m above: 200 m wide, 150 m high.
    box = footprint(posed((10.0, 20.0, 150.0), 0.0, -90.0))
    assert box.bounds == pytest.approx((-100.0, -75.0, 100.0, 75.0))
    assert box.area == pytest.approx(200.0 * 150.0)
    turned = footprint(posed((10.0, 20.0, 150.0), 90.0, -90.0))
    assert turned.bounds == pytest.approx((-75.0, -100.0, 75.0, 100.0))


def test_an_oblique_footprint_by_hand() -> None:
    # To the north at 45 degrees; the axis meets the ground 100 m ahead. The rows at the border are
    # tan = 0.75 off the axis: (1 - 0.75) / (1 + 0.75) and its inverse times 100 m away, and the
    # sides lie depth (100 sqrt(2) / (1 +- 0.75)) to either side.
    trapezium = footprint(posed((0.0, 0.0, 150.0), 0.0, -45.0), reach=1e6)
    near, far = 100 * 0.25 / 1.75, 100 * 1.75 / 0.25
    wide_near, wide_far = 100 * np.sqrt(2) / 1.75, 100 * np.sqrt(2) / 0.25
    expected = shapely.Polygon(
        [(-wide_near, near), (wide_near, near), (wide_far, far), (-wide_far, far)]
    )
    assert shapely.symmetric_difference(trapezium, expected).area < 1e-6 * expected.area


def test_the_range_cuts_by_depth() -> None:
    cut = footprint(posed((0.0, 0.0, 150.0), 0.0, -45.0), reach=200.0)
    # Depth 200 m along the axis: (y + 100) / sqrt(2) = 200.
    assert cut.bounds[3] == pytest.approx(200 * np.sqrt(2) - 100)
    assert cut.bounds[2] == pytest.approx(200.0)
    assert footprint(posed((0.0, 0.0, 150.0), 0.0, 0.0), reach=200.0).bounds == pytest.approx(
        (-200.0, 100 / 0.75, 200.0, 200.0)
    )


@settings(max_examples=60, deadline=None)
@given(
    yaw=st.floats(-180, 180),
    pitch=st.floats(-90, 30),
    roll=st.floats(-60, 60),
    height=st.floats(20, 300),
)
def test_the_footprint_holds_what_pixels_see_and_no_more(
    yaw: float, pitch: float, roll: float, height: float
) -> None:
    poses = posed((0.0, 0.0, 50.0 + height), yaw, pitch, roll)
    grid = np.stack(np.meshgrid(np.linspace(1, 639, 23), np.linspace(1, 479, 17)), -1)
    rays = rays_to_world(poses, back_project(CAMERA, grid.reshape(1, -1, 2)))
    hits = intersect_plane(poses.centres, rays, 50.0, 1e5)
    depth = (hits.points - poses.centres[:, None]) @ poses.rotation[0, 2]
    seen = hits.valid & (depth <= 0.999 * FAR)
    shape = footprint(poses)
    points = shapely.points(hits.points[seen][:, :2])
    assert shapely.covers(shapely.buffer(shape, 1e-6), points).all()
    beyond = shapely.points(hits.points[hits.valid & (depth > 1.001 * FAR)][:, :2])
    assert not shapely.covers(shape, beyond).any()
    if not shape.is_empty:
        # And the other way round: what lies in the footprint is in the image, and in range.
        corners = shapely.get_coordinates(shape)
        inner = corners + 1e-6 * (shapely.get_coordinates(shape.centroid) - corners)
        ground = np.column_stack((inner, np.full(len(inner), 50.0)))
        in_camera = world_to_camera(poses, ground[None])
        pixels = project(CAMERA, in_camera)[0]
        assert (in_camera[..., 2] <= FAR * (1 + 1e-6)).all()
        assert (pixels >= -1e-6).all()
        assert (pixels <= np.add((640.0, 480.0), 1e-6)).all()


def test_overlap_by_hand() -> None:
    box, beside, inside, none = (
        shapely.box(0, 0, 4, 2),
        shapely.box(3, 0, 7, 2),
        shapely.box(1, 1, 2, 2),
        shapely.Polygon(),
    )
    a = np.array([box, beside, box, box, none], dtype=object)
    b = np.array([beside, box, inside, none, none], dtype=object)
    assert overlaps(a, b).tolist() == [0.25, 0.25, 1.0, 0.0, 0.0]


@pytest.mark.parametrize(("overlap", "step"), [(0.75, 50), (0.5, 100), (0.1, 180)])
def test_key_frames_of_a_straight_line_by_hand(overlap: float, step: int) -> None:
    # 200 m wide: 75 % of it is shared after 50 m, with a frame a metre.
    keys = key_frames(line_flight(402, 1.0), CAMERA, 50.0, overlap)
    assert keys.tolist() == list(range(0, 401, step))


FLIGHTS = {
    "barrel": barrel_roll(AIR, 1, rounds=1),
    "survey": survey(AIR, side_m=160.0),
}


@pytest.mark.parametrize("name", FLIGHTS)
@settings(max_examples=4, deadline=None)
@given(overlap=st.floats(0.10, 0.75))
def test_neighbours_overlap_as_asked(name: str, overlap: float) -> None:
    flight = FLIGHTS[name]
    keys = key_frames(flight, CAMERA, AIR.ground_m, overlap)
    assert keys[0] == 0
    assert len(keys) > 5
    assert (np.diff(keys) > 0).all()
    seen = footprints(CAMERA, flight.take(keys), AIR.ground_m, FAR)
    assert np.abs(overlaps(seen[:-1], seen[1:]) - overlap).max() < 0.02
