"""Geometry checks: depth of planes and boxes by a formula, the frame chain, splits of two sets."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import rasterio
import shapely
from PIL import Image
from scipy.spatial.transform import Rotation

from airzoo_bench.benchmark.folder import BenchmarkFile, SceneFile, write_benchmark_file
from airzoo_bench.benchmark.queries import photo_table, write_queries
from airzoo_bench.core.errors import BenchmarkError, UsageError, UserError
from airzoo_bench.datasets.depth_maps import (
    OCCLUSION,
    DepthConsistency,
    Frame,
    check_depth_consistency,
    compare_depths,
    find_depths,
    read_depth,
    sample_frame,
)
from airzoo_bench.datasets.geometry_checks import (
    PosedScene,
    SceneGeometry,
    cast_corners,
    check_frame_chain,
    compare_splits,
    read_footprints,
)
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.crs import from_lonlat
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.retrieval.truth import ANCHOR_COLUMNS
from tests.support import run_main

Box = tuple[Sequence[float], Sequence[float]]

CRS = "EPSG:4547"
ORIGIN = np.array([401_000.0, 3_120_000.0, 0.0])
WIDTH, HEIGHT, FOCAL = 160, 120, 130.0


def looking(azimuth: float, pitch: float) -> np.ndarray:
    """World-to-camera rotation of a camera that looks `pitch` degrees below the horizon."""
    a, p = np.radians([azimuth, pitch])
    forward = np.array([np.sin(a) * np.cos(p), np.cos(a) * np.cos(p), -np.sin(p)])
    right = np.array([np.cos(a), -np.sin(a), 0.0])
    return np.array([right, np.cross(forward, right), forward])


@dataclass(frozen=True)
class Flight:
    """Cameras over boxes on the plane z = 0."""

    rotation: np.ndarray
    centres: np.ndarray
    boxes: Sequence[Box] = ()

    def depths(self, *, along_ray: bool = False) -> np.ndarray:
        """Depth at pixel centres: the nearest of the ground and of the slabs of each box."""
        v, u = np.mgrid[:HEIGHT, :WIDTH] + 0.5
        rays = np.stack([(u - WIDTH / 2) / FOCAL, (v - HEIGHT / 2) / FOCAL, np.ones_like(u)], -1)
        found = []
        for R, C in zip(self.rotation, self.centres, strict=True):
            world = rays @ R
            with np.errstate(divide="ignore", invalid="ignore"):
                z = np.where(world[..., 2] < 0, -C[2] / world[..., 2], np.inf)
                for low, high in self.boxes:
                    near, far = (np.array(low) - C) / world, (np.array(high) - C) / world
                    enter = np.minimum(near, far).max(axis=-1)
                    leave = np.maximum(near, far).min(axis=-1)
                    z = np.where((enter > 0) & (enter <= leave), np.minimum(z, enter), z)
            found.append(np.where(z < 2000.0, z, 0.0))
        lengths = np.linalg.norm(rays, axis=-1) if along_ray else 1.0
        return (np.array(found) * lengths).astype(np.float32)


def orbit(count: int) -> Flight:
    """Go round a block of boxes, up and down, looking obliquely at it."""
    rng = np.random.default_rng(3)
    boxes: list[Box] = []
    for _ in range(14):
        x, y = rng.uniform(-60, 60, 2)
        w, d, h = rng.uniform((4, 4, 4), (14, 14, 25))
        boxes.append(((x - w, y - d, -1.0), (x + w, y + d, h)))
    azimuth = np.arange(count) * 14.0
    pitch = 45.0 + 15.0 * np.sin(np.arange(count) / 2.0)
    a = np.radians(azimuth)
    height = 90.0 + 25.0 * np.sin(np.arange(count) / 3.0)
    centres = np.stack([-95 * np.sin(a), -95 * np.cos(a), height], axis=1)
    rotation = np.array([looking(x, y) for x, y in zip(azimuth, pitch, strict=True)])
    return Flight(rotation, centres, boxes)


def scene(flight: Flight, **changes: float) -> PosedScene:
    """State the poses of a flight, with a camera of perhaps other intrinsics."""
    names = tuple(f"f{number:03d}.png" for number in range(len(flight.centres)))
    f, cx, cy = ({"f": FOCAL, "cx": WIDTH / 2, "cy": HEIGHT / 2} | changes).values()
    matrices = [[[f, 0, cx], [0, f, cy], [0, 0, 1]]] * len(names)
    poses = Poses.from_centres(flight.rotation, flight.centres + ORIGIN)
    cameras = Cameras.from_matrices(matrices, WIDTH, HEIGHT)
    return PosedScene("made", names, names, cameras, poses, CRS, Path(), 0.0)


def write_depths(folder: Path, depths: np.ndarray) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for number, depth in enumerate(depths):
        np.save(folder / f"f{number:03d}.npy", depth)
    return folder


def write_photos(folder: Path, flight: Flight) -> list[object]:
    """Write photos and their pose file, as a person has them; return the command's options."""
    made, images = scene(flight), folder / "images"
    images.mkdir(parents=True)
    for name in made.images:
        Image.new("L", (WIDTH, HEIGHT)).save(images / name)
    posed = zip(made.images, flight.rotation, flight.centres + ORIGIN, strict=True)
    content = {
        "crs": CRS,
        "K": made.cameras.matrices[0].tolist(),
        "images": {n: {"R_w2c": R.tolist(), "center": C.tolist()} for n, R, C in posed},
    }
    (folder / "poses.json").write_text(json.dumps(content))
    return ["--poses", folder / "poses.json", "--images", images]


def write_benchmark(folder: Path, flight: Flight) -> Path:
    made = scene(flight)
    table = photo_table("park", made.images, made.cameras, made.poses, None, 0.0)
    write_queries(folder / "scenes" / "park", table)
    places = {"images": "data/park/images", "dom": "dom.tif", "crs": CRS, "plane_height_m": 0.0}
    entries = (SceneFile(id="park", title="Park", **places),)
    file = BenchmarkFile(
        schema=1, name="made", version=1, title="m", tracks={}, scenes=entries, checksums={}
    )
    write_benchmark_file(folder, file)
    return folder


# --- depth and the frame chain ---

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
    return sample_frame(camera, pose, depth[index], "z", 4096, index)


class TestDepth:
    @pytest.mark.parametrize("kind", ["z", "ray"])
    def test_exact_depth_has_no_error(self, tmp_path: Path, kind: str) -> None:
        folder = write_depths(tmp_path / "depth", FLIGHT.depths(along_ray=kind == "ray"))
        found = checked(FLIGHT, folder, kind)
        assert found.quantile(0.9) < EXACT
        assert found.error.size > 5000
        assert found.failures == []
        assert checked(FLIGHT, folder, "ray" if kind == "z" else "z").failures

    def test_a_bare_plane_is_exact_at_any_slant(self) -> None:
        low, high = (0, 25, -20, -20, -20, -15), (360, 90, 20, 20, 20, 15)
        cases = np.random.default_rng(0).uniform(low, high, (30, 6))
        for azimuth, pitch, turn, *step in cases:
            rotation = np.array([looking(azimuth, pitch), looking(azimuth + turn, pitch)])
            flight = Flight(rotation, np.array([(0, 0, 60), np.add((0, 0, 60), step)]))
            depth = flight.depths()
            depth[depth <= 0] = np.nan
            error = compare_depths(frame(flight, 0, depth), frame(flight, 1, depth))
            assert np.abs(error).max(initial=0.0) < EXACT

    def test_one_frame_that_is_off_is_named(self, depths: Path, tmp_path: Path) -> None:
        """A pose turned by a fifth of a degree, a depth 0.2 % short; intrinsics fail as a whole."""
        assert checked(FLIGHT, depths, f=131.0).failures
        assert checked(FLIGHT, depths, cy=62.0).failures
        rotation, depth = FLIGHT.rotation.copy(), FLIGHT.depths()
        rotation[MIDDLE] = (
            Rotation.from_euler("y", 0.2, degrees=True).as_matrix() @ rotation[MIDDLE]
        )
        turned = checked(replace(FLIGHT, rotation=rotation), depths)
        depth[MIDDLE] *= np.float32(0.998)
        short = checked(FLIGHT, write_depths(tmp_path / "depth", depth))
        for found in (turned, short):
            assert found.bad_frames.index[0] == "f004.png"
            assert any("f004.png" in said for said in found.failures)
        assert short.bad_frames.iloc[0] == pytest.approx(0.002, rel=0.1)

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


def chain(lenses: Sequence[Any], centres: Any, crs: str) -> Any:
    """Check photos with these lenses at these places."""
    rotation = Rotation.random(len(centres), random_state=0).as_matrix()
    cameras = Cameras.from_matrices([K] * len(lenses), 1280, 960, lenses)
    return check_frame_chain(cameras, Poses.from_centres(rotation, centres), crs)


class TestFrameChain:
    @pytest.mark.parametrize("crs", MIDDLES)
    def test_it_closes_wherever_a_crs_is_used(self, crs: str) -> None:
        most = np.array((90_000, 300_000, 1550))
        away = np.random.default_rng(0).uniform(-most, most, (30, 3))
        metres, pixels = chain(LENSES * 10, np.add(away, (*MIDDLES[crs], 1450)), crs)
        assert metres.max() < 3e-7
        assert pixels.max() < 1e-4

    def test_a_lens_that_folds_back_and_a_place_beyond_the_crs_are_named(self) -> None:
        here, nowhere = (401_000.0, 3_120_000.0, 100.0), (4e8, 3e9, 100.0)
        folded = (-0.9, 0.0, 0.0, 0.0, 0.0)
        closure = chain([LENSES[1], folded], [here, here], "EPSG:4547")
        assert np.isfinite(closure[0]).tolist() == [True, False]
        [fault] = SceneGeometry(scene(orbit(2)), closure, None).failures
        assert "1 of 2 photos" in fault
        assert "f001.png" in fault
        metres, _ = chain(LENSES[:2], [here, nowhere], "EPSG:4547")
        assert np.isfinite(metres).tolist() == [True, False]
        with pytest.raises(UserError, match="grid"):
            chain(LENSES[:1], [(113.0, 28.0, 100.0)], "EPSG:4326")


class TestCommand:
    """`check-geometry` as a person calls it: exit codes and names."""

    def test_photos_pass_and_a_scaled_depth_is_named(self, tmp_path, capsys) -> None:
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

    def test_a_benchmark_folder_with_depth_beside_its_photos(self, tmp_path, capsys) -> None:
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


# --- splits ---

SQUARE = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])


def footprints(*corners: tuple[float, float], size: float = 0.001) -> np.ndarray:
    return np.array(corners)[:, None] + size * SQUARE


def named(lonlat: np.ndarray) -> pd.DataFrame:
    ids = [str(number) for number in range(len(lonlat))]
    return pd.DataFrame(lonlat.reshape(-1, 8), ids, list(ANCHOR_COLUMNS))


def pairs(train: np.ndarray, test: np.ndarray) -> list[tuple[int, int]]:
    found = compare_splits(named(train), named(test))
    return [*zip(found["train"].astype(int), found["test"].astype(int), strict=True)]


def test_squares_worked_by_hand() -> None:
    train = footprints((10.0, 0.0), (11.0, 0.0), (10.0005, 0.0))
    test = footprints((10.0008, 0.0), (12.0, 0.0))
    found = compare_splits(named(train), named(test))
    assert found["train"].tolist() == ["0", "2"]
    assert found["share_of_test"].tolist() == pytest.approx([0.2, 0.7], abs=1e-6)
    assert found["shared_m2"][0] == pytest.approx(0.2 * (0.001 * 111_195) ** 2, rel=1e-4)
    touching = footprints((10.0, 28.0)), footprints((10.001, 28.0), (10.0, 28.001))
    assert pairs(*touching) == []
    assert pairs(touching[0], touching[1] - (1e-8, 1e-8)) == [(0, 0), (0, 1)]
    assert pairs(train, np.full((1, 4, 2), np.nan)) == []


@pytest.mark.parametrize("seed", range(25))
def test_the_same_pairs_as_every_pair_by_shapely(seed: int) -> None:
    rng = np.random.default_rng(seed)
    train, test = (
        rng.uniform(-1, 1, (n, 1, 2)) * 0.01 + rng.uniform(-1, 1, (n, 4, 2)) * 0.002
        for n in (30, 20)
    )
    shapes = [[shapely.Polygon(corners) for corners in some] for some in (train, test)]
    # Those that cross themselves count as their hull.
    shapes = [[s if s.is_valid else s.convex_hull for s in some] for some in shapes]
    expected = {
        (a, b)
        for a, one in enumerate(shapes[0])
        for b, other in enumerate(shapes[1])
        if one.intersection(other).area * 111_195**2 > 2e-4
    }
    assert set(pairs(train, test)) == expected


def test_corners_are_cast_and_cut() -> None:
    rotation = np.array([looking(0, 90), looking(0, 5), looking(0, -60), looking(0, 90)])
    centres = np.array([(0, 0, 100.0), (0, 0, 100), (0, 0, 100), (0, 0, -1)])
    made = scene(Flight(rotation, centres))
    lonlat = cast_corners(made, 500.0)
    assert np.isnan(lonlat).any(axis=(1, 2)).tolist() == [False, False, True, True]
    ground = from_lonlat(CRS, lonlat[:2]) - ORIGIN[:2]
    half = 100 * np.array([80, 60]) / 130
    nadir = half * np.array([(-1, 1), (1, 1), (1, -1), (-1, -1)])
    assert ground[0] == pytest.approx(nadir, abs=1e-3)
    # The upper corners of a level camera look at the sky: cut at 500 m along the ray.
    assert (np.hypot(*ground[1, :2].T) <= 500.0).all()
    assert (np.hypot(*ground[1, :2].T) > 400.0).all()
    with pytest.raises(BenchmarkError, match="no ground plane"):
        cast_corners(replace(made, plane_height_m=None), 500.0)


def test_tables_and_folders(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = named(footprints((10.0, 0.0), (10.0005, 0.0))).assign(id=["007", "b"])
    table.to_csv(tmp_path / "train.csv", index=False)
    train = read_footprints(tmp_path / "train.csv", 100.0)
    assert [*train.index] == ["007", "b"]
    assert len(compare_splits(train, train)) == 4
    table.assign(anchor0_lon=401_000.0).to_csv(tmp_path / "metres.csv", index=False)
    with pytest.raises(BenchmarkError, match="a number, at most 540 in size"):
        read_footprints(tmp_path / "metres.csv", 100.0)
    flight = orbit(4)
    here = write_benchmark(tmp_path / "here", flight)
    away = replace(flight, centres=flight.centres + np.array((50_000, 0, 0)))
    assert run_main("check-split", here, write_benchmark(tmp_path / "there", away)) == 0
    assert run_main("check-split", here, here, "--out", tmp_path / "pairs.csv") == 1
    assert "f000" in capsys.readouterr().out
    found = pd.read_csv(tmp_path / "pairs.csv")
    assert found["test"].nunique() == len(flight.centres)
    assert found["train"][0] == "park/f000"
    table.assign(anchor0_lon="").to_csv(tmp_path / "unknown.csv", index=False)
    assert run_main("check-split", here, tmp_path / "unknown.csv") == 1
    for missing in (tmp_path, tmp_path / "no.csv"):
        assert run_main("check-split", missing, here) == 2
