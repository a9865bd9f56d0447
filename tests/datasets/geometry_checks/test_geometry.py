"""Depth and frame chain: exact ones pass, and each fault that must be found is found, and named."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import rasterio
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image
from scipy.spatial.transform import Rotation

from airzoo_bench.core.errors import BenchmarkError, UsageError, UserError
from airzoo_bench.datasets import geometry_checks
from airzoo_bench.datasets.depth_maps import (
    OCCLUSION,
    DepthConsistency,
    Frame,
    check_depth_consistency,
    compare_depths,
    find_depths,
    read_depth,
    sampled_frame,
)
from airzoo_bench.datasets.geometry_checks import (
    CLOSES_M,
    CLOSES_PX,
    SceneGeometry,
    check_frame_chain,
)
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses
from tests.support import run_main

from .analytic import Flight, looking, orbit, scene, write_benchmark, write_depths, write_photos

EXACT = 1e-6  # depths are stored as float32
FLIGHT = orbit(8)
MIDDLE = 4


@pytest.fixture(scope="module")
def depths(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_depths(tmp_path_factory.mktemp("depth"), FLIGHT.depths())


def checked(flight: Flight, folder: Path, kind: str = "z", **changes: float) -> DepthConsistency:
    made = scene(flight, **changes)
    posed = (made.ids, made.cameras, made.poses, find_depths(folder, made.images))
    return check_depth_consistency(*posed, kind=kind, pixels=1024)  # type: ignore[arg-type]


def frame(flight: Flight, index: int, depth: np.ndarray) -> Frame:
    made = scene(flight)
    camera, pose = made.cameras.take(index), made.poses.take(index)
    return sampled_frame(camera, pose, depth[index], "z", 4096, index)


class TestDepth:
    @pytest.mark.parametrize("kind", ["z", "ray"])
    def test_exact_depth_has_no_error(self, tmp_path: Path, kind: str) -> None:
        folder = write_depths(tmp_path / "depth", FLIGHT.depths(along_ray=kind == "ray"))
        found = checked(FLIGHT, folder, kind)
        assert found.quantile(0.9) < EXACT
        assert found.error.size > 5000
        assert found.failures == []
        assert checked(FLIGHT, folder, "ray" if kind == "z" else "z").failures

    @settings(max_examples=30, deadline=None, derandomize=True)
    @given(
        azimuth=st.floats(0, 360),
        pitch=st.floats(25, 90),
        turn=st.floats(-20, 20),
        step=st.tuples(st.floats(-20, 20), st.floats(-20, 20), st.floats(-15, 15)),
    )
    def test_a_bare_plane_is_exact_at_any_slant(
        self, azimuth: float, pitch: float, turn: float, step: tuple[float, float, float]
    ) -> None:
        rotation = np.array([looking(azimuth, pitch), looking(azimuth + turn, pitch)])
        flight = Flight(rotation, np.array([(0.0, 0.0, 60.0), np.add((0.0, 0.0, 60.0), step)]))
        depth = np.where(flight.depths() > 0, flight.depths(), np.nan)
        error = compare_depths(frame(flight, 0, depth), frame(flight, 1, depth))
        assert np.abs(error).max(initial=0.0) < EXACT

    @pytest.mark.parametrize("axis", [0, 1, 2])
    def test_one_pose_turned_by_a_fifth_of_a_degree_is_named(self, depths: Path, axis: int) -> None:
        found = checked(FLIGHT.turned(0.2 * np.eye(3)[axis], MIDDLE), depths)
        assert found.bad_frames.index[0] == "f004.png"
        assert any("f004.png" in fault for fault in found.failures)

    @pytest.mark.parametrize("factor", [0.998, 1.002])
    def test_one_depth_scaled_is_named(self, tmp_path: Path, factor: float) -> None:
        depth = FLIGHT.depths()
        depth[MIDDLE] *= np.float32(factor)
        found = checked(FLIGHT, write_depths(tmp_path / "depth", depth)).bad_frames
        assert found.index[0] == "f004.png"
        assert found.iloc[0] == pytest.approx(abs(factor - 1), rel=0.1)

    @pytest.mark.parametrize("changes", [{"f": 131.0}, {"cy": 62.0}])
    def test_other_intrinsics_are_found(self, depths: Path, changes: dict[str, float]) -> None:
        assert checked(FLIGHT, depths, **changes).failures

    def test_points_before_a_surface_count_and_those_behind_are_hidden(self) -> None:
        centres = np.array([(0.0, 0.0, 60.0), (4.0, 0.0, 60.0)])
        flight = Flight(np.array([looking(0, 90)] * 2), centres)
        near, far = (np.full((2, 120, 160), depth, np.float32) for depth in (55.0, 60.0))
        error = compare_depths(frame(flight, 0, near), frame(flight, 1, far))
        assert error.size > 1000
        assert (error < -OCCLUSION).all()
        assert compare_depths(frame(flight, 0, far), frame(flight, 1, near)).size == 0

    def test_files_of_depth(self, tmp_path: Path) -> None:
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
        (tmp_path / "e.npy").write_bytes(b"no array")
        for name, width in (("d.png", 3), ("a.npy", 2), ("e.npy", 3)):
            with pytest.raises(BenchmarkError, match=name):
                read_depth(tmp_path / name, width, 2)
        assert find_depths(tmp_path, ["a.jpg", "z.jpg"]) == (tmp_path / "a.npy", None)
        np.save(tmp_path / "b.npy", depth)
        for names in (["b.jpg"], ["z.jpg"]):
            with pytest.raises(UsageError):
                find_depths(tmp_path, names)


K = [[1000.0, 0, 640], [0, 1000, 480], [0, 0, 1]]
LENSES = ((0.0,) * 5, (0.0091, 0.0136, -0.00153, 0.00226, 0.0), (-0.28, 0.12, 0.0008, -0.0003, 0.0))
MIDDLES = {
    "EPSG:4547": (500_000, 3_100_000),
    "EPSG:32615": (500_000, 5_100_000),
    "EPSG:2193": (1_600_000, 5_300_000),
    "EPSG:31983": (500_000, 7_500_000),
}


def cameras(*lenses: tuple[float, ...]) -> Cameras:
    return Cameras.from_matrices([K] * len(lenses), 1280, 960, lenses)


def poses(*centres: tuple[float, float, float], seed: int = 0) -> Poses:
    rotation = Rotation.random(len(centres), random_state=seed).as_matrix()
    return Poses.from_centres(rotation, centres)


class TestFrameChain:
    @settings(max_examples=40, deadline=None, derandomize=True)
    @given(
        crs=st.sampled_from([*MIDDLES]),
        east=st.floats(-90_000, 90_000),
        north=st.floats(-300_000, 300_000),
        height=st.floats(-100, 3000),
        lens=st.sampled_from(LENSES),
        seed=st.integers(0, 1000),
    )
    def test_it_closes_wherever_a_crs_is_used(
        self, crs: str, east: float, north: float, height: float, lens: tuple[float], seed: int
    ) -> None:
        there = (MIDDLES[crs][0] + east, MIDDLES[crs][1] + north, height)
        metres, pixels = check_frame_chain(cameras(lens), poses(there, seed=seed), crs)
        assert metres[0] < 3e-7
        assert pixels[0] < 1e-4

    def test_a_lens_that_folds_back_and_a_place_beyond_the_crs_are_named(self) -> None:
        here, nowhere = (401_000.0, 3_120_000.0, 100.0), (4e8, 3e9, 100.0)
        lenses, centres = (LENSES[1], (-0.9, 0.0, 0.0, 0.0, 0.0)), poses(here, here)
        closure = check_frame_chain(cameras(*lenses), centres, "EPSG:4547")
        assert np.isfinite(closure[0]).tolist() == [True, False]
        [fault] = SceneGeometry(scene(orbit(2)), closure, None).failures
        assert "1 of 2 photos" in fault
        assert "f001.png" in fault
        metres, _ = check_frame_chain(cameras(*LENSES[:2]), poses(here, nowhere), "EPSG:4547")
        assert np.isfinite(metres).tolist() == [True, False]
        with pytest.raises(UserError, match="grid"):
            check_frame_chain(cameras(LENSES[0]), poses((113.0, 28.0, 100.0)), "EPSG:4326")

    def test_a_link_that_is_broken_shows(self, monkeypatch: pytest.MonkeyPatch) -> None:
        one = (cameras(LENSES[0]), poses((401_000.0, 3_120_000.0, 50.0)), "EPSG:4547")
        back, project = geometry_checks.ecef_to_geodetic, geometry_checks.project
        with monkeypatch.context() as patch:
            patch.setattr(
                geometry_checks, "ecef_to_geodetic", lambda p: back(p) + np.array((2e-11, 0, 0))
            )
            assert check_frame_chain(*one)[0][0] > CLOSES_M
        monkeypatch.setattr(geometry_checks, "project", lambda c, p: project(c, p) + 0.5)
        assert check_frame_chain(*one)[1][0] > CLOSES_PX


class TestCommand:
    """`check-geometry` as a person calls it: exit codes and names."""

    def test_photos_pass_and_a_scaled_depth_is_named(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        write_depths(tmp_path / "depth", FLIGHT.depths())
        given = ["check-geometry", *write_photos(tmp_path, FLIGHT)]
        assert run_main(*given, "--format", "json") == 0
        (made,) = json.loads(capsys.readouterr().out)["rows"]
        assert "passes" in str(made)
        path = tmp_path / "depth" / "f004.npy"
        np.save(path, np.load(path) * np.float32(0.998))
        assert run_main(*given) == 1
        assert "f004.png" in capsys.readouterr().out
        np.save(path, np.ones((7, 9), np.float32))
        for more, message in (
            ((), "f004.npy"),
            (("--depth", tmp_path / "none"), "none"),
            (("--depth-scale", 0), "--depth-scale"),
            (("--crs", "EPSG:4326"), "grid"),
        ):
            assert run_main(*given, *more) == 2
            assert message in capsys.readouterr().err

    def test_a_benchmark_folder_with_depth_beside_its_photos(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        flight = orbit(4)
        folder = write_benchmark(tmp_path / "made", flight)
        write_depths(folder / "data" / "park" / "depth", flight.depths())
        assert run_main("check-geometry", folder, "--scene", "park", "--format", "csv") == 0
        assert "passes" in capsys.readouterr().out
        write_depths(folder / "data" / "park" / "depth", flight.depths()[::-1])
        assert run_main("check-geometry", folder) == 1
        for words in ((), (folder, "--poses", folder)):
            assert run_main("check-geometry", *words) == 2
            assert "what is to be checked" in capsys.readouterr().err
