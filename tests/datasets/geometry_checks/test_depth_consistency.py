"""Exact data have no error; each fault that must be found is found, and named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.datasets.geometry_checks.depth_consistency import OCCLUSION, compare_depths
from airzoo_bench.datasets.geometry_checks.depth_frames import (
    Frame,
    FrameStore,
    PairRule,
    Sampling,
    choose_pairs,
)
from airzoo_bench.datasets.geometry_checks.depth_maps import DepthKind
from airzoo_bench.datasets.geometry_checks.depth_report import (
    DepthConsistency,
    check_depth_consistency,
)

from . import analytic
from .analytic import Flight, looking, orbit, scene, write_depths

EXACT = 1e-6  # depths are stored as float32
FLIGHT = orbit()
MIDDLE = 8


@pytest.fixture(scope="module")
def depths(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_depths(tmp_path_factory.mktemp("depth"), FLIGHT.depths())


def checked(
    flight: Flight, folder: Path, rule: PairRule = PairRule.ALL, **changes: float
) -> DepthConsistency:
    sampling = Sampling(pixels=1024)
    return check_depth_consistency(scene(flight, **changes), folder, sampling=sampling, rule=rule)


def frame(flight: Flight, index: int, folder: Path, kind: DepthKind = DepthKind.Z) -> Frame:
    made = scene(flight)
    paths = sorted(folder.iterdir())
    return FrameStore(made.cameras, made.poses, paths, Sampling(4096, 0, kind)).frame(index)


@pytest.mark.parametrize("rule", PairRule)
def test_exact_scene_has_no_error_and_passes(depths: Path, rule: PairRule) -> None:
    found = checked(FLIGHT, depths, rule)
    assert found.median < EXACT
    assert found.quantile(0.9) < EXACT
    assert found.passes
    assert found.compared > 0.2
    parts = found.pairs[["outside", "no_surface", "hidden", "compared"]].sum(axis=1)
    assert (parts == found.pairs["sampled"]).all()


@settings(max_examples=30, deadline=None, derandomize=True)
@given(
    azimuth=st.floats(0, 360),
    pitch=st.floats(25, 90),
    turn=st.floats(-20, 20),
    step=st.tuples(st.floats(-20, 20), st.floats(-20, 20), st.floats(-15, 15)),
)
def test_a_bare_plane_is_exact_at_any_slant(
    tmp_path_factory: pytest.TempPathFactory,
    azimuth: float,
    pitch: float,
    turn: float,
    step: tuple[float, float, float],
) -> None:
    rotation = np.array([looking(azimuth, pitch), looking(azimuth + turn, pitch)])
    flight = Flight(rotation, np.array([(0.0, 0.0, 60.0), np.add((0.0, 0.0, 60.0), step)]))
    folder = write_depths(tmp_path_factory.mktemp("plane"), flight.depths())
    error = compare_depths(frame(flight, 0, folder), frame(flight, 1, folder)).error
    assert np.abs(error).max(initial=0.0) < EXACT


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_one_pose_turned_by_a_fifth_of_a_degree_is_found(depths: Path, axis: int) -> None:
    turn = 0.2 * np.eye(3)[axis]
    found = checked(FLIGHT.turned(turn, MIDDLE), depths)
    assert not found.passes
    worst = found.bad_frames.iloc[0]
    assert worst["id"] == "f008.png"
    # The frame is one of many, which is why the median of all cannot tell.
    assert found.median < found.median_below < 5 * worst["median"]


def test_poses_turned_at_random_raise_the_median(depths: Path) -> None:
    flight, rng = FLIGHT, np.random.default_rng(0)
    for index in range(len(FLIGHT.centres)):
        way = rng.normal(size=3)
        flight = flight.turned(0.1 * way / np.linalg.norm(way), index)
    found = checked(flight, depths)
    assert found.median > found.median_below
    assert not found.passes


@pytest.mark.parametrize("factor", [0.998, 1.002])
def test_one_depth_scaled_is_found_and_named(tmp_path: Path, factor: float) -> None:
    depths = FLIGHT.depths()
    depths[MIDDLE] *= np.float32(factor)
    found = checked(FLIGHT, write_depths(tmp_path / "depth", depths))
    worst = found.bad_frames.iloc[0]
    assert worst["id"] == "f008.png"
    assert worst["ratio"] == pytest.approx(factor - 1, rel=0.1)
    assert len(found.bad_frames) == 1


def test_one_centre_shifted_is_found(depths: Path) -> None:
    centres = FLIGHT.centres.copy()
    centres[MIDDLE] += 0.3 * FLIGHT.rotation[MIDDLE, 1]
    found = checked(Flight(FLIGHT.rotation, centres), depths)
    assert found.bad_frames.iloc[0]["id"] == "f008.png"


@pytest.mark.parametrize("fault", ["camera to world", "y and z swapped", "north reversed"])
def test_wrong_axes_are_found(depths: Path, fault: str) -> None:
    rotation, centres = FLIGHT.rotation, FLIGHT.centres
    if fault == "camera to world":
        rotation = np.swapaxes(rotation, 1, 2)
    elif fault == "y and z swapped":
        rotation = rotation[:, [0, 2, 1]] * np.array([1, -1, 1])[:, None]
    else:
        centres = centres * (1, -1, 1)
    found = checked(Flight(rotation, centres), depths)
    assert not found.passes
    # Mirrored positions leave the level ground where it is; what stands on it gives them away.
    assert found.floating > 0.1 if fault == "north reversed" else found.median > 0.02


def test_depth_of_another_frame_is_found(tmp_path: Path) -> None:
    depths = FLIGHT.depths()
    depths[[MIDDLE, 2]] = depths[[2, MIDDLE]]
    found = checked(FLIGHT, write_depths(tmp_path / "depth", depths))
    assert {"f002.png", "f008.png"} <= set(found.bad_frames["id"].head(4))


def test_depth_along_rays_is_exact_if_it_is_said(tmp_path: Path) -> None:
    folder = write_depths(tmp_path / "depth", FLIGHT.depths(along_ray=True))
    ray = Sampling(1024, kind=DepthKind.RAY)
    assert check_depth_consistency(scene(FLIGHT), folder, sampling=ray).passes
    assert checked(FLIGHT, folder).median > 0.005


def test_what_a_wall_hides_is_left_out_and_what_stands_before_it_is_not(tmp_path: Path) -> None:
    wall = ((-200.0, 20.0, -1.0), (200.0, 21.0, 12.0))
    flight = Flight(
        np.array([looking(0, 90), looking(0, 40)]),
        np.array([(0.0, 30, 60), (0, -30, 40.0)]),
        [wall],
    )
    folder = write_depths(tmp_path / "depth", flight.depths())
    above, before = frame(flight, 0, folder), frame(flight, 1, folder)
    compared = compare_depths(above, before)
    assert compared.hidden > 100
    assert np.abs(compared.error).max() <= OCCLUSION
    # Without the wall in the other's depth its roof hangs in front of the ground: a fault.
    bare = write_depths(tmp_path / "bare", Flight(flight.rotation, flight.centres).depths())
    error = compare_depths(above, frame(flight, 1, bare)).error
    assert error.min() < -10 * OCCLUSION


def test_no_error_is_too_large_to_be_seen(tmp_path: Path) -> None:
    depths = FLIGHT.depths()
    depths[MIDDLE] *= np.float32(0.9)
    found = checked(FLIGHT, write_depths(tmp_path / "depth", depths))
    assert found.bad_frames.iloc[0]["id"] == "f008.png"
    assert found.bad_frames.iloc[0]["median"] > 0.05


def test_frames_that_share_nothing_are_counted(tmp_path: Path) -> None:
    centres = np.array([(0.0, 0, 60), (10.0, 0, 60), (9000.0, 0, 60)])
    flight = Flight(np.array([looking(0, 90)] * 3), centres)
    found = checked(flight, write_depths(tmp_path / "depth", flight.depths()), PairRule.NEIGHBOURS)
    assert len(found.pairs) == 4
    assert found.pairs_without_overlap == 1
    assert found.passes
    assert np.isnan(found.frames["median"].iloc[2])


def test_nothing_compared_does_not_pass(tmp_path: Path) -> None:
    flight = Flight(np.array([looking(0, 90)] * 2), np.array([(0.0, 0, 60), (9000.0, 0, 60)]))
    for rule in PairRule:
        folder = write_depths(tmp_path / "depth", flight.depths())
        found = checked(flight, folder, rule)
        assert not found.passes
        assert found.median == np.inf


def test_photos_without_depth_are_named_and_one_alone_is_refused(tmp_path: Path) -> None:
    folder = write_depths(tmp_path / "depth", FLIGHT.depths())
    (folder / "f003.npy").unlink()
    assert checked(FLIGHT, folder).without_depth == ("f003.png",)
    for path in sorted(folder.iterdir())[1:]:
        path.unlink()
    with pytest.raises(BenchmarkError, match="only one photo"):
        checked(FLIGHT, folder)


def test_same_bytes_each_time_and_other_pixels_by_another_seed(depths: Path) -> None:
    first, second = (checked(FLIGHT, depths) for _ in range(2))
    assert first.error.tobytes() == second.error.tobytes()
    assert first.frames.equals(second.frames)
    other = check_depth_consistency(scene(FLIGHT), depths, sampling=Sampling(1024, seed=1))
    assert other.error.tobytes() != first.error.tobytes()


def test_pairs_by_overlap_and_width() -> None:
    made = scene(Flight(np.array([looking(0, 90)] * 6), np.zeros((6, 3))))
    centres = np.array([(x, 0.0, 60.0) for x in (0, 5, 20, 45, 300, 305)]) + analytic.ORIGIN
    poses = type(made.poses).from_centres(made.poses.rotation, centres)
    ground = np.array([(x, y, -60.0) for x in np.linspace(-35, 35, 8) for y in (-20, 20)])
    points = centres[:, None] + ground
    for rule in (PairRule.OVERLAP, PairRule.WIDE):
        pairs = {tuple(pair) for pair in choose_pairs(rule, made.cameras, poses, points).tolist()}
        assert (4, 5) in pairs
        assert (0, 1) in pairs
        assert not pairs & {(3, 4), (0, 4), (2, 5)}
    neighbours = choose_pairs(PairRule.NEIGHBOURS, made.cameras, poses, points)
    assert neighbours.tolist() == [[n, n + 1] for n in range(5)]
