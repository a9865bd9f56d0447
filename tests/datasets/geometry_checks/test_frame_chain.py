"""The frame chain against places whose answer others know, and against faults."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from airzoo_bench.core.errors import UserError
from airzoo_bench.datasets.geometry_checks import frame_chain
from airzoo_bench.datasets.geometry_checks.frame_chain import CLOSES_M, CLOSES_PX, check_frame_chain
from airzoo_bench.datasets.geometry_checks.scenes import scene_from_poses
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses
from tests.support import BRIGHTON

K = [[1000.0, 0, 640], [0, 1000, 480], [0, 0, 1]]
LENSES = ((0.0,) * 5, (0.0091, 0.0136, -0.00153, 0.00226, 0.0), (-0.28, 0.12, 0.0008, -0.0003, 0.0))


def cameras(count: int, lens: tuple[float, ...] = LENSES[0]) -> Cameras:
    return Cameras.from_matrices([K] * count, 1280, 960, [lens] * count)


def poses(centres: list[tuple[float, float, float]], seed: int = 0) -> Poses:
    rotation = Rotation.random(len(centres), random_state=seed).as_matrix()
    return Poses.from_centres(rotation, centres)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    crs=st.sampled_from(["EPSG:4547", "EPSG:32615", "EPSG:2193", "EPSG:31983"]),
    east=st.floats(-90_000, 90_000),
    north=st.floats(-300_000, 300_000),
    height=st.floats(-100, 3000),
    lens=st.sampled_from(LENSES),
    seed=st.integers(0, 1000),
)
def test_it_closes_wherever_a_crs_is_used(
    crs: str, east: float, north: float, height: float, lens: tuple[float, ...], seed: int
) -> None:
    centre = {
        "EPSG:4547": (500_000, 3_100_000),
        "EPSG:32615": (500_000, 5_100_000),
        "EPSG:2193": (1_600_000, 5_300_000),
        "EPSG:31983": (500_000, 7_500_000),
    }[crs]
    there = (centre[0] + east, centre[1] + north, height)
    found = check_frame_chain(cameras(1, lens), poses([there], seed), crs)
    assert not found.open_photos.any()
    assert found.closure_m[0] < 3e-7
    assert found.closure_px[0] < 1e-4


def test_the_worst_photo_is_named_by_its_fault() -> None:
    centres = [(401_000.0, 3_120_000.0, 100.0)] * 3
    lenses = [LENSES[1], (-0.9, 0.0, 0.0, 0.0, 0.0), LENSES[2]]
    made = Cameras.from_matrices([K] * 3, 1280, 960, lenses)
    found = check_frame_chain(made, poses(centres), "EPSG:4547")
    assert found.open_photos.tolist() == [False, True, False]
    assert found.lens_fails.tolist() == [False, True, False]
    assert found.worst == 1
    assert np.isinf(found.closure_m[1])


def test_a_place_beyond_the_crs_does_not_close() -> None:
    centres = [(401_000.0, 3_120_000.0, 100.0), (4e8, 3e9, 100.0)]
    found = check_frame_chain(cameras(2), poses(centres), "EPSG:4547")
    assert found.off_crs.tolist() == [False, True]
    assert found.open_photos.tolist() == [False, True]


def test_geographic_crs_is_refused() -> None:
    with pytest.raises(UserError, match="grid"):
        check_frame_chain(cameras(1), poses([(113.0, 28.0, 100.0)]), "EPSG:4326")


def test_a_link_that_is_broken_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    back = frame_chain.ecef_to_geodetic
    monkeypatch.setattr(
        frame_chain, "ecef_to_geodetic", lambda p: back(p) + np.array((2e-11, 0, 0))
    )
    found = check_frame_chain(cameras(1), poses([(401_000.0, 3_120_000.0, 50.0)]), "EPSG:4547")
    assert found.closure_m[0] > CLOSES_M
    monkeypatch.setattr(frame_chain, "ecef_to_geodetic", back)
    project = frame_chain.project
    monkeypatch.setattr(frame_chain, "project", lambda c, p: project(c, p) + 0.5)
    found = check_frame_chain(cameras(1), poses([(401_000.0, 3_120_000.0, 50.0)]), "EPSG:4547")
    assert found.closure_px[0] > CLOSES_PX


def test_it_closes_on_the_real_scene() -> None:
    if not BRIGHTON.is_dir():
        pytest.skip(f"no real scene at {BRIGHTON}")
    scene = scene_from_poses(BRIGHTON / "poses.json", BRIGHTON / "images", None)
    assert len(scene.ids) == len(json.loads((BRIGHTON / "poses.json").read_text())["images"])
    assert scene.crs is not None
    found = check_frame_chain(scene.cameras, scene.poses, scene.crs)
    assert not found.open_photos.any()
    assert found.closure_m.max() < 1e-7
