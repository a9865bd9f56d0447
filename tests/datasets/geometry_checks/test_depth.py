"""Exact depth has no error; each fault that must be found is found, and named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import rasterio
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from airzoo_bench.core.errors import BenchmarkError, UsageError
from airzoo_bench.datasets.geometry_checks.depth import (
    OCCLUSION,
    DepthConsistency,
    Frame,
    check_depth_consistency,
    compare_depths,
    find_depths,
    read_depth,
    sampled_frame,
)

from .analytic import Flight, looking, orbit, scene, write_depths

EXACT = 1e-6  # depths are stored as float32
FLIGHT = orbit()
MIDDLE = 8


@pytest.fixture(scope="module")
def depths(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_depths(tmp_path_factory.mktemp("depth"), FLIGHT.depths())


def checked(flight: Flight, folder: Path, kind: str = "z", **changes: float) -> DepthConsistency:
    made = scene(flight, **changes)
    paths = find_depths(folder, made.images)
    posed = (made.ids, made.cameras, made.poses)
    return check_depth_consistency(*posed, paths, kind=kind, pixels=1024)  # type: ignore[arg-type]


def frame(flight: Flight, index: int, depth: np.ndarray, kind: str = "z") -> Frame:
    made = scene(flight)
    camera, pose = made.cameras.take(index), made.poses.take(index)
    return sampled_frame(camera, pose, depth[index], kind, 4096, (0, index))  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", ["z", "ray"])
def test_exact_depth_has_no_error(tmp_path: Path, kind: str) -> None:
    folder = write_depths(tmp_path / "depth", FLIGHT.depths(along_ray=kind == "ray"))
    found = checked(FLIGHT, folder, kind)
    assert found.quantile(0.9) < EXACT
    assert found.error.size > 10_000
    assert found.failures == []
    other = checked(FLIGHT, folder, "ray" if kind == "z" else "z")
    assert other.failures


@settings(max_examples=30, deadline=None, derandomize=True)
@given(
    azimuth=st.floats(0, 360),
    pitch=st.floats(25, 90),
    turn=st.floats(-20, 20),
    step=st.tuples(st.floats(-20, 20), st.floats(-20, 20), st.floats(-15, 15)),
)
def test_a_bare_plane_is_exact_at_any_slant(
    azimuth: float, pitch: float, turn: float, step: tuple[float, float, float]
) -> None:
    rotation = np.array([looking(azimuth, pitch), looking(azimuth + turn, pitch)])
    flight = Flight(rotation, np.array([(0.0, 0.0, 60.0), np.add((0.0, 0.0, 60.0), step)]))
    depth = np.where(flight.depths() > 0, flight.depths(), np.nan)
    error = compare_depths(frame(flight, 0, depth), frame(flight, 1, depth))
    assert np.abs(error).max(initial=0.0) < EXACT


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_one_pose_turned_by_a_fifth_of_a_degree_is_found(depths: Path, axis: int) -> None:
    found = checked(FLIGHT.turned(0.2 * np.eye(3)[axis], MIDDLE), depths)
    assert found.bad_frames.iloc[0]["id"] == "f008.png"
    assert any("f008.png" in fault for fault in found.failures)
    # The frame is one of many, which is why the median of all cannot tell.
    assert found.quantile(0.5) < found.median_below


@pytest.mark.parametrize("factor", [0.998, 1.002])
def test_one_depth_scaled_is_found_and_named(tmp_path: Path, factor: float) -> None:
    depth = FLIGHT.depths()
    depth[MIDDLE] *= np.float32(factor)
    found = checked(FLIGHT, write_depths(tmp_path / "depth", depth))
    worst = found.bad_frames.iloc[0]
    assert worst["id"] == "f008.png"
    assert worst["median"] == pytest.approx(abs(factor - 1), rel=0.1)
    assert len(found.bad_frames) == 1


@pytest.mark.parametrize("changes", [{"f": 131.0}, {"cy": 62.0}])
def test_other_intrinsics_are_found(depths: Path, changes: dict[str, float]) -> None:
    assert checked(FLIGHT, depths, **changes).failures


def test_points_before_a_surface_count_and_those_behind_are_hidden() -> None:
    flight = Flight(np.array([looking(0, 90)] * 2), np.array([(0.0, 0.0, 60.0), (4.0, 0.0, 60.0)]))
    near, far = (np.full((2, 120, 160), depth, np.float32) for depth in (55.0, 60.0))
    error = compare_depths(frame(flight, 0, near), frame(flight, 1, far))
    assert error.size > 1000
    assert (error < -OCCLUSION).all()
    assert compare_depths(frame(flight, 0, far), frame(flight, 1, near)).size == 0


def test_files_of_depth(tmp_path: Path) -> None:
    depth = np.array([[1.5, 0.0, -1.0], [2.5, np.nan, np.inf]], np.float32)
    expected = np.array([[1.5, np.nan, np.nan], [2.5, np.nan, np.nan]], np.float32)
    np.save(tmp_path / "a.npy", depth)
    np.savez(tmp_path / "b.npz", depth=depth[..., None], other=np.ones(3))
    profile = {"driver": "GTiff", "width": 3, "height": 2, "count": 1, "dtype": "float32"}
    profile["transform"] = rasterio.Affine(1, 0, 0, 0, -1, 2)
    with rasterio.open(tmp_path / "c.tif", "w", nodata=2.5, **profile) as raster:
        raster.write(depth, 1)
    Image.fromarray(np.array([[1500, 0, 0], [2500, 0, 0]], np.uint16)).save(tmp_path / "d.png")
    for name in ("a.npy", "b.npz"):
        np.testing.assert_array_equal(read_depth(tmp_path / name, 3, 2), expected)
    np.testing.assert_array_equal(read_depth(tmp_path / "d.png", 3, 2, 0.001), expected)
    assert np.isfinite(read_depth(tmp_path / "c.tif", 3, 2)).sum() == 1
    for name, width in (("d.png", 3), ("a.npy", 2)):
        with pytest.raises(BenchmarkError, match=name):
            read_depth(tmp_path / name, width, 2)
    (tmp_path / "e.npy").write_bytes(b"no array")
    with pytest.raises(BenchmarkError, match=r"e\.npy"):
        read_depth(tmp_path / "e.npy", 3, 2)
    assert find_depths(tmp_path, ["a.jpg", "z.jpg"]) == (tmp_path / "a.npy", None)
    np.save(tmp_path / "b.npy", depth)
    for names in (["b.jpg"], ["z.jpg"]):
        with pytest.raises(UsageError):
            find_depths(tmp_path, names)
