"""AirZoo-Test: frames with depth and poses in ECEF and WGS84, to a true cloud and a score."""

from __future__ import annotations

import csv
import io
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from airzoo_bench.benchmark.folder import find_benchmark
from airzoo_bench.core.errors import UserError
from airzoo_bench.core.progress import silent
from airzoo_bench.datasets.native_scene import NativeScene
from airzoo_bench.datasets.published.airzoo_test import AIRZOO_TEST
from airzoo_bench.datasets.published.airzoo_test_files import find_trajectories
from airzoo_bench.datasets.published.options import AirZooTestOptions
from airzoo_bench.formats.clouds.formats import open_cloud
from airzoo_bench.geometry.crs import ecef_to_geodetic, enu_axes, from_lonlat, geodetic_to_ecef
from tests.datasets.published.airzoo_test_tree import (
    CORNER,
    CRS,
    NAMES,
    depths,
    grid_poses,
    make_trajectory,
)
from tests.datasets.published.reconstruction_world import score
from tests.reconstruction.world import BOX_HIGH, BOX_LOW
from tests.support import run_main


@pytest.fixture
def source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    make_trajectory(tmp_path / "AirZoo 帧" / "Brazil_01_sunny")
    return tmp_path / "AirZoo 帧"


def prepare(source: Path, *options: object) -> int:
    given = ("--name", "mine", "--every", 1)
    return run_main("prepare", "airzoo-test", "--source", source, *given, *options)


def read(source: Path, **changes: object) -> NativeScene:
    given = AirZooTestOptions(source, name="mine", every=1, clouds=source.parent / "clouds")
    chosen = replace(given, **changes)  # type: ignore[arg-type]
    return AIRZOO_TEST.read(chosen, "Brazil_01_sunny", silent)


def points_of(scene: NativeScene) -> np.ndarray:
    assert scene.cloud is not None
    source = open_cloud(scene.cloud, limit_bytes=1 << 20, sampling=None)
    return np.concatenate([piece.points for piece in source.pieces(1 << 16)])


def on_grid(scene: NativeScene, points: np.ndarray) -> np.ndarray:
    """Take points of a scene's frame through the earth back to the made world."""
    place = scene.notes[-1].rpartition("(")[2].rstrip(")").split(",")
    middle = np.array([float(text) for text in place])
    origin = geodetic_to_ecef((*middle, 0.0))
    places = ecef_to_geodetic(points @ enu_axes(middle[None])[0].T + origin)
    return np.column_stack([from_lonlat(CRS, places[:, :2]), places[:, 2]]) - CORNER


def test_exact_predictions_are_perfect(source: Path, tmp_path: Path) -> None:
    assert prepare(source) == 0
    names = [f"{name}.jpg" for name in NAMES]
    # In the projected CRS, whose scale there is not 1: alignment takes that away.
    scene = read(source)
    points = on_grid(scene, points_of(scene)) + CORNER
    data, protocol = tmp_path / "data", "mine-reconstruction"
    exact = score(data, protocol, scene.scene, points, names, grid_poses())
    assert exact["f1_1m"] == exact["f1_10m"] == 1.0
    assert exact["chamfer_m"] < 0.01
    assert exact["pose_auc_3deg"] > 0.99
    shifted = np.add(points, (0.0, 0.0, 12.0))
    off = score(data, protocol, scene.scene, shifted, names, grid_poses())
    assert off["f1_5m"] < 0.3
    entry = find_benchmark("mine", data).scene(scene.scene)
    assert entry.crs == "local"
    queries = pd.read_csv(data / "mine/scenes" / scene.scene / "queries.csv")
    assert queries["weather"].tolist() == ["sunny", "foggy"] * 3


@pytest.mark.parametrize("kind", ["z", "ray"])
def test_the_true_cloud_is_the_surface_that_depth_shows(source: Path, kind: str) -> None:
    home = source / "Brazil_01_sunny"
    shutil.rmtree(home)
    make_trajectory(home, along_ray=kind == "ray")
    scene = read(source, depth_kind=kind)
    found = on_grid(scene, points_of(scene))
    assert len(found) > 1000
    # Within a voxel of an edge a mean of two surfaces may stand; all others are on the surface.
    level = np.minimum(np.abs(found[:, 2]), np.abs(found[:, 2] - BOX_HIGH[2]))
    sides = np.minimum(np.abs(found - BOX_LOW), np.abs(found - BOX_HIGH))[:, :2].min(axis=1)
    off = np.minimum(level, sides)
    assert np.quantile(off, 0.95) < 0.02
    assert off.max() < 0.5
    wrong = read(source, depth_kind="ray" if kind == "z" else "z")
    assert np.abs(on_grid(wrong, points_of(wrong))[:, 2]).max() > 1.0


def test_poses_by_wgs84_angles_are_those_in_ecef(source: Path) -> None:
    both = read(source)
    table = source / "Brazil_01_sunny" / "frames.csv"
    for kept, dropped in (("ecef", ("longitude", "yaw")), ("longitude", ("ecef_x", "ecef_qw"))):
        columns = pd.read_csv(table).drop(columns=list(dropped))
        copy = source.parent / kept / "Brazil_01_sunny"
        shutil.copytree(table.parent, copy)
        columns.to_csv(copy / "frames.csv", index=False)
        one = read(copy.parent)
        assert one.poses is not None
        assert both.poses is not None
        np.testing.assert_allclose(one.poses.centres, both.poses.centres, atol=1e-4)
        np.testing.assert_allclose(one.poses.rotation, both.poses.rotation, atol=1e-9)


def test_a_cloud_is_made_once(source: Path) -> None:
    first = read(source)
    assert first.cloud is not None
    written = first.cloud.stat().st_mtime_ns
    again = read(source)
    assert (again.cloud, again.cloud and again.cloud.stat().st_mtime_ns) == (first.cloud, written)
    assert read(source, every=2).cloud != first.cloud
    (source / "Brazil_01_sunny/depth/frame_00000.tif").touch()
    assert read(source).cloud != first.cloud


def test_depth_in_whole_numbers_has_a_scale(source: Path) -> None:
    home = source / "Brazil_01_sunny/depth"
    plain = points_of(read(source))
    for name, depth in zip(NAMES, depths(), strict=True):
        (home / f"{name}.tif").unlink()
        whole = np.clip(np.rint(depth * 100.0), 0, 65535).astype(np.uint16)
        Image.fromarray(whole).save(home / f"{name}.png")
    with pytest.raises(UserError, match="depth-scale"):
        read(source)
    scaled = points_of(read(source, depth_scale=0.01))
    assert len(scaled) == pytest.approx(len(plain), rel=0.02)


def test_far_depth_and_sky_are_left_out(source: Path) -> None:
    plain = len(points_of(read(source)))
    path = source / "Brazil_01_sunny/depth/frame_00000.tif"
    depth = np.array(Image.open(path))
    depth[:2], depth[2:4], depth[4:6] = 65504.0, np.inf, 0.0
    Image.fromarray(depth).save(path)
    found = points_of(read(source))
    assert 0 < len(found) < plain
    assert np.abs(found).max() < 500.0


def test_the_published_trajectories_are_sixteen_and_numbered(
    source: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one = source / "Brazil_01_sunny"
    for number in range(1, 15):
        shutil.copytree(one, source / "NewZealand" / f"NZ_{number:02d}")
    options = AirZooTestOptions(source, every=1)
    with pytest.raises(UserError, match="holds 15 trajectories, not 16"):
        AIRZOO_TEST.scenes(options)
    shutil.copytree(one, source / "NewZealand" / "NZ_15")
    assert AIRZOO_TEST.scenes(options) == [f"{number:02d}" for number in range(1, 17)]
    given = ("--source", source, "--every", 1, "--scene", "02")
    assert run_main("prepare", "airzoo-test", *given) == 0
    assert "is the trajectory NZ_01" in "".join(capsys.readouterr())
    assert (tmp_path / "data/airzoo-test-partial/scenes/02").is_dir()


def test_numbers_in_the_names_of_trajectories_count_as_numbers(source: Path) -> None:
    """Letter by letter NZ_10 stands before NZ_2, and so would have its number."""
    one = source / "Brazil_01_sunny"
    for number in range(1, 16):
        shutil.copytree(one, source / f"NZ_{number}")
    found = find_trajectories(source, published=True)
    names = ["Brazil_01_sunny", *(f"NZ_{number}" for number in range(1, 16))]
    assert {scene: folder.name for scene, folder in found.items()} == {
        f"{number:02d}": name for number, name in enumerate(names, 1)
    }


def _table(change: Callable[[list[dict[str, str]]], object]) -> Callable[[Path], object]:
    def spoil(home: Path) -> None:
        path = home / "frames.csv"
        rows = list(csv.DictReader(io.StringIO(path.read_text())))
        change(rows)
        text = io.StringIO()
        writer = csv.DictWriter(text, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
        path.write_text(text.getvalue())

    return spoil


def _each(**values: Callable[[str], str] | str) -> Callable[[Path], object]:
    def change(rows: list[dict[str, str]]) -> None:
        for row in rows:
            for key, value in values.items():
                row[key] = value if isinstance(value, str) else value(row[key])

    return _table(change)


def _swapped(rows: list[dict[str, str]]) -> None:
    for row in rows:
        row["longitude"], row["latitude"] = row["latitude"], row["longitude"]


SPOILED: dict[str, tuple[Callable[[Path], object], str]] = {
    "no table": (lambda h: (h / "frames.csv").unlink(), "holds no trajectory: there are 1 "),
    "no photos": (lambda h: shutil.rmtree(h / "images"), "holds no photo"),
    "a photo missing": (
        lambda h: (h / "images/frame_00003.jpg").unlink(),
        "names photos that are not there: 1 of 6 (frame_00003)",
    ),
    "no depth": (lambda h: shutil.rmtree(h / "depth"), "no such folder of depth maps"),
    "a depth missing": (
        lambda h: (h / "depth/frame_00003.tif").unlink(),
        "photos without a depth map: 1 of 6 (frame_00003.jpg)",
    ),
    "half a depth": (
        lambda h: (h / "depth/frame_00003.tif").write_bytes(b"II*\0"),
        "frame_00003.tif",
    ),
    "no depth in reach": (
        lambda h: [
            Image.fromarray(np.full((36, 48), 5000.0, np.float32)).save(path)
            for path in (h / "depth").iterdir()
        ],
        "no depth below 1000 m in 6 frames",
    ),
    "no poses": (
        lambda h: (h / "frames.csv").write_text(
            "name,width,height,fx,fy,cx,cy\nframe_00000,48,36,80,80,24,18\n"
        ),
        "expected: ecef_x",
    ),
    "a column missing": (_table(lambda rows: [row.pop("fx") for row in rows]), "column fx"),
    "a frame twice": (_each(name="frame_00000"), "several rows have"),
    "longitude and latitude swapped": (_table(_swapped), "column latitude"),
    "poses that contradict": (
        _each(yaw=lambda text: str(float(text) + 90.0)),
        "poses in ECEF and in WGS84 contradict: 6 of 6",
    ),
    "no quaternion": (_each(ecef_qw="5"), "quaternion"),
    "another size": (_each(width="1600"), "photos of another size than stated"),
    "no number": (_each(fx="wide"), "column fx: 'wide'"),
}


@pytest.mark.parametrize("name", SPOILED)
def test_what_is_wrong_has_one_message_and_leaves_nothing(
    source: Path, tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    spoil, said = SPOILED[name]
    spoil(source / "Brazil_01_sunny")
    assert prepare(source) == 2
    assert said in " ".join(capsys.readouterr().err.split())
    assert not list(tmp_path.glob("data/*"))


def test_a_second_run_finds_all_done(source: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert prepare(source) == 0
    capsys.readouterr()
    assert prepare(source) == 0
    assert "nothing" in "".join(capsys.readouterr())
    assert prepare(source, "--depth-kind", "ray", "--force") == 0
