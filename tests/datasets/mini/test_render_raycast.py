"""Rays against the mesh: exact distances, shadows worked by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from airzoo_bench.datasets.mini.renderer import Raycaster
from airzoo_bench.datasets.mini.world import SURVEY_SUN, Material, Mesh
from tests.datasets.mini.small_world import BLOCK, GROUND_M, RIDGE_M, small_mesh

UP = np.array([[0.0], [0.0], [1.0]])


@pytest.fixture(scope="module")
def caster() -> Raycaster:
    return Raycaster(small_mesh())


def test_straight_down_onto_ground_roof_and_ridge(caster: Raycaster) -> None:
    origins = np.array([[5.0, 5.0, 100.0], [30.0, 40.0, 100.0], [66.0, 60.0, 100.0]]).T
    down = np.array([[0.0, 0.0, -2.0]] * 3).T
    triangle, distance = caster.trace(origins, down)
    # in lengths of the direction, which is 2 m
    np.testing.assert_allclose(distance, [40.0, 34.0, (100 - RIDGE_M) / 2], atol=1e-12)
    material = small_mesh().material[triangle]
    assert material.tolist() == [Material.GROUND, Material.ROOF, Material.ROOF]


def test_sideways_onto_a_wall(caster: Raycaster) -> None:
    triangle, distance = caster.trace(np.array([30.0, 3.25, 25.0]), np.array([[0.0], [1.0], [0.0]]))
    np.testing.assert_allclose(distance, BLOCK[1] - 3.25, atol=1e-12)
    assert small_mesh().material[triangle[0]] == Material.WALL
    # counter-clockwise from outside: the south wall looks south
    np.testing.assert_allclose(caster.normal[:, triangle[0]], [0.0, -1.0, 0.0], atol=1e-15)


def test_a_mesh_far_from_the_origin_of_its_ray_is_met_to_the_last_digits() -> None:
    """A slope seen over a kilometre: single precision alone would be 0.1 mm off."""
    vertices = np.array([[900.0, -50.0, -30.0], [1000.0, -50.0, 70.0], [950.0, 90.0, 20.0]])
    mesh = Mesh(
        vertices, np.array([[0, 1, 2]], np.int32), np.zeros(1, np.uint8), np.zeros(1, np.int32)
    )
    origin = np.array([0.1, 0.2, 0.3])
    target = np.array([0.3, 0.3, 0.4]) @ vertices
    _, distance = Raycaster(mesh).trace(origin, (target - origin)[:, None])
    np.testing.assert_allclose(distance, 1.0, atol=1e-14)


@settings(max_examples=40, deadline=None)
@given(north=st.floats(0.3, 11.0), east=st.floats(26.0, 38.0))
def test_the_shadow_of_the_block(north: float, east: float) -> None:
    """The block stands 12 m high and the sun, in (-6, -10, 15), rises 1.5 m a metre of northing.

    North of the wall its shadow so reaches 8 m; x moves by 4.8 m at most and stays in the block.
    """
    mesh = small_mesh()
    point = np.array([[east], [BLOCK[3] + north], [GROUND_M]])
    blocked = Raycaster(mesh).occluded(point, UP, np.array(SURVEY_SUN.direction))
    if abs(north - 8.0) > 0.05:
        assert bool(blocked[0]) == (north < 8.0)
