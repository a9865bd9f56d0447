"""UrbanScene3D: poses of Mega-NeRF and COLMAP, taken to the frame of a scan, to a score."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import laspy
import numpy as np
import pandas as pd
import pytest

from airzoo_bench.benchmark.images import photo_size
from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.core.progress import silent
from airzoo_bench.datasets.poses import read_poses
from airzoo_bench.datasets.published.options import UrbanScene3DOptions
from airzoo_bench.datasets.published.urbanscene3d import URBANSCENE3D
from airzoo_bench.geometry.poses import Poses, rotation_angle_deg
from tests.datasets.published.reconstruction_world import (
    local_points,
    local_poses,
    score,
    write_cloud,
    write_photo,
)
from tests.datasets.published.urbanscene3d_tree import (
    SCALE,
    SHIFT,
    TURN,
    make_colmap,
    make_mega_nerf,
    model_poses,
    photo,
    write_transform,
)
from tests.formats.torch_support import Tensor, save
from tests.support import run_main

PROTOCOL = "urbanscene3d-reconstruction-partial"


@pytest.fixture
def source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    root = tmp_path / "城市 3D"
    make_mega_nerf(root / "residence-pixsfm", model_poses())
    write_cloud(root / "scan.ply", local_points())
    write_transform(root / "matrix.txt")
    return root


def options(source: Path, **changes: object) -> UrbanScene3DOptions:
    given: dict[str, object] = {
        "scan": [str(source / "scan.ply")],
        "transform": [str(source / "matrix.txt")],
    }
    return UrbanScene3DOptions(source, **(given | changes))  # type: ignore[arg-type]


def prepare(source: Path, *more: object) -> int:
    given = ("--scan", source / "scan.ply", "--transform", source / "matrix.txt")
    return run_main("prepare", "urbanscene3d", "--source", source, *given, *more)


@pytest.mark.parametrize("kind", ["mega-nerf", "colmap"])
def test_exact_predictions_are_perfect_in_the_frame_of_the_scan(
    source: Path, tmp_path: Path, kind: str
) -> None:
    names = [photo(number) for number in range(6)]
    scene = "residence"
    if kind == "colmap":
        shutil.rmtree(source / "residence-pixsfm")
        make_colmap(source / "Campus", model_poses())
        names, scene = [f"a/DJI_{number:04d}.JPG" for number in range(6)], "campus"
    assert prepare(source) == 0
    # Predictions stand in another frame again: that of the model.
    points, poses = local_points(), model_poses()
    moved = (points - SHIFT) @ TURN / SCALE
    record = score(tmp_path / "data", PROTOCOL, scene, moved, names, poses)
    assert record["f1_1m"] == record["f1_10m"] == 1.0
    assert record["chamfer_m"] < 0.01
    assert record["pose_auc_3deg"] > 0.999
    assert record["scale"] == pytest.approx(SCALE, rel=1e-4)
    off = np.add(points, (0.0, 0.0, 12.0))
    record = score(tmp_path / "data", PROTOCOL, scene, off, names, local_poses())
    assert record["f1_5m"] < 0.2


@pytest.mark.parametrize("double", [False, True])
def test_mega_nerf_poses_are_those_of_the_model(tmp_path: Path, double: bool) -> None:
    poses = local_poses()
    make_mega_nerf(tmp_path / "sci-art-pixsfm", poses, double=double)
    scan = write_cloud(tmp_path / "scan.ply", local_points())
    given = UrbanScene3DOptions(tmp_path, scan=[str(scan)], same_frame=True)
    read = URBANSCENE3D.read(given, "artsci", silent)
    assert read.names == tuple(photo(number) for number in range(6))
    assert read.poses is not None
    assert read.cameras is not None
    np.testing.assert_allclose(read.poses.centres, poses.centres, atol=1e-9 if double else 1e-4)
    assert rotation_angle_deg(read.poses.rotation, poses.rotation).max() < 1e-4
    assert not read.cameras.distortion.any()
    every = URBANSCENE3D.read(options_of(given, every=4), "artsci", silent)
    assert every.names == (photo(0), photo(4))


def options_of(given: UrbanScene3DOptions, every: int) -> UrbanScene3DOptions:
    return UrbanScene3DOptions(given.source, scan=given.scan, same_frame=True, every=every)


def test_scenes_go_by_the_names_of_folders(tmp_path: Path) -> None:
    for name in ("Sci-Art-pixsfm", "PolyTech", "campus-pixsfm", "other"):
        make_mega_nerf(tmp_path / name, model_poses())
    assert URBANSCENE3D.scenes(UrbanScene3DOptions(tmp_path)) == ["polytech", "artsci", "campus"]
    one = UrbanScene3DOptions(tmp_path / "Sci-Art-pixsfm")
    assert URBANSCENE3D.scenes(one) == ["artsci"]


def test_a_scan_may_be_las(source: Path) -> None:
    header = laspy.LasHeader(point_format=3, version="1.2")
    header.scales, points = np.full(3, 1e-3), local_points()
    made = laspy.LasData(header)
    made.x, made.y, made.z = points.T
    made.write(source / "scan.las")
    assert prepare(source, "--scan", f"residence={source / 'scan.las'}", "--force") == 2
    scan = ("--scan", f"residence={source / 'scan.las'}")
    matrix = ("--transform", source / "matrix.txt")
    assert run_main("prepare", "urbanscene3d", "--source", source, *scan, *matrix) == 0


def test_a_transform_may_be_written_with_commas_and_remarks(
    source: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = source / "matrix.txt"
    path.write_text("# from CloudCompare\n" + path.read_text().replace(" ", ", "))
    assert prepare(source) == 0


MATRICES = {
    "1 0 0 0\n0 1 0 0\n0 0 1 0\n": "holds no 4 x 4 numbers",
    "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 x\n": "holds no 4 x 4 numbers",
    "1 0 0 nan\n0 1 0 0\n0 0 1 0\n0 0 0 1\n": "holds no 4 x 4 numbers",
    "1 0 0 0\n0 1 0 0\n0 0 1 0\n5 6 7 1\n": "the last is 0 0 0 1",
    "1 0 0 0\n0 1.1 0 0\n0 0 1 0\n0 0 0 1\n": "shears",
    "1 0 0 0\n0 -1 0 0\n0 0 1 0\n0 0 0 1\n": "mirrors",
    "0 0 0 0\n0 0 0 0\n0 0 0 0\n0 0 0 1\n": "mirrors or flattens",
}


@pytest.mark.parametrize("text", MATRICES)
def test_other_matrices_are_refused(
    source: Path, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (source / "matrix.txt").write_text(text)
    assert prepare(source) == 2
    assert MATRICES[text] in capsys.readouterr().err


def _metadata(source: Path, number: int = 0) -> Path:
    part = photo(number).split("/")[0]
    return source / "residence-pixsfm" / part / "metadata" / f"{number:06d}.pt"


def _stated(source: Path, **values: object) -> None:
    content = {"H": 36, "W": 48, "c2w": Tensor(np.eye(4)[:3]), "intrinsics": Tensor([80] * 4)}
    save(_metadata(source), {k: v for k, v in (content | values).items() if v is not None})


SPOILED: dict[str, tuple[Callable[[Path], object], str]] = {
    "no scene": (
        lambda s: (s / "residence-pixsfm").rename(s / "elsewhere"),
        "holds no scene: there are",
    ),
    "a scene twice": (
        lambda s: shutil.copytree(s / "residence-pixsfm", s / "Residence"),
        "several folders claim to be one scene",
    ),
    "poses of two kinds": (
        lambda s: make_colmap(s / "residence-pixsfm", model_poses()),
        "poses of Mega-NeRF and of COLMAP",
    ),
    "no photos yet": (
        lambda s: shutil.rmtree(s / "residence-pixsfm/train/rgbs"),
        "copy_images.py makes them",
    ),
    "a photo missing": (
        lambda s: (s / "residence-pixsfm" / photo(1)).unlink(),
        "poses without a photo: 1 of 4 (000001.pt)",
    ),
    "no metadata": (
        lambda s: shutil.rmtree(s / "residence-pixsfm/val/metadata"),
        "holds no .pt file: there is no such folder",
    ),
    "half a file": (
        lambda s: _metadata(s).write_bytes(_metadata(s).read_bytes()[:300]),
        "cannot be read as tensors",
    ),
    "a missing key": (lambda s: _stated(s, c2w=None), "lacks 'c2w'"),
    "another shape": (
        lambda s: _stated(s, c2w=Tensor(np.eye(4))),
        "'c2w' is float32 of shape (4, 4)",
    ),
    "NaN": (lambda s: _stated(s, intrinsics=Tensor([np.nan] * 4)), "expected: finite numbers"),
    "text for a number": (lambda s: _stated(s, W="wide"), "'W' is"),
    "another size": (lambda s: _stated(s, W=4096), "its photo is 48x36 px, not 4096x36"),
    "no rotation": (lambda s: _stated(s, c2w=Tensor(np.ones((3, 4)))), "rotation"),
    "no scale": (
        lambda s: save(
            s / "residence-pixsfm/coordinates.pt",
            {"origin_drb": Tensor([0, 0, 0]), "pose_scale_factor": 0.0},
        ),
        "pose_scale_factor is 0",
    ),
    "a mesh for a scan": (
        lambda s: (s / "scan.ply").write_text(
            "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
            "property float z\nelement face 1\nproperty list uchar int vertex_indices\n"
            "end_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
        ),
        "is a mesh",
    ),
    "a scan elsewhere": (
        lambda s: write_cloud(s / "scan.ply", np.add(local_points(), (9e5, 0.0, 0.0))),
        "lies about",
    ),
}


@pytest.mark.parametrize("name", SPOILED)
def test_what_is_wrong_has_one_message_and_leaves_nothing(
    source: Path, tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    spoil, said = SPOILED[name]
    spoil(source)
    assert prepare(source) == 2
    assert said in " ".join(capsys.readouterr().err.split())
    assert not list(tmp_path.glob("data/*"))


def test_scan_and_frame_must_be_named(source: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scan, matrix = ("--scan", source / "scan.ply"), ("--transform", source / "matrix.txt")
    for given, said in (
        (matrix, "the scan of residence is not named"),
        (scan, "it is not known how the poses of residence lie to its scan"),
        ((*scan, "--transform", "campus=x"), "names no scene that is there"),
        ((*scan, *matrix, *matrix), "names 'residence' twice"),
    ):
        assert run_main("prepare", "urbanscene3d", "--source", source, *given) == 2
        assert said in " ".join(capsys.readouterr().err.split())


def test_a_colmap_model_needs_its_photos(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    make_colmap(tmp_path / "campus", model_poses())
    write_photo(tmp_path / "campus/images/a/extra.jpg")
    scan = write_cloud(tmp_path / "scan.ply", local_points())
    given = UrbanScene3DOptions(tmp_path, scan=[str(scan)], same_frame=True)
    assert URBANSCENE3D.read(given, "campus", silent).unposed == ("a/extra.jpg",)
    (tmp_path / "campus/images").rename(tmp_path / "campus/Image")
    with pytest.raises(BenchmarkError, match="has no folder images: there are 2 "):
        URBANSCENE3D.read(given, "campus", silent)


def test_a_real_scene_has_the_truth_that_own_photos_have(
    brighton: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = sorted(path.name for path in (brighton / "images").iterdir())[:6]
    sizes = {name: photo_size(brighton / "images" / name) for name in names}
    own = read_poses(brighton / "poses.json", sizes)
    corner = np.floor(own.poses.centres.mean(axis=0))
    local = Poses(rotation=own.poses.rotation, centres=own.poses.centres - corner)
    home = tmp_path / "source" / "hospital"
    make_mega_nerf(home, local, cameras=own.cameras, double=True)
    for number, name in enumerate(own.names):
        (home / photo(number)).unlink()
        (home / photo(number)).symlink_to(brighton / "images" / name)
    shift = np.eye(4)
    shift[:3, 3] = corner
    np.savetxt(tmp_path / "matrix.txt", shift, fmt="%.3f")
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    scan = ("--scan", brighton / "model.laz", "--transform", tmp_path / "matrix.txt")
    assert run_main("prepare", "urbanscene3d", "--source", tmp_path / "source", *scan) == 0
    table = pd.read_csv(tmp_path / "data/urbanscene3d-partial/scenes/hospital/queries.csv")
    found = table.sort_values("image", key=lambda images: images.str[-10:])
    centres = found[["x", "y", "z"]].to_numpy()
    np.testing.assert_allclose(centres, own.poses.centres, atol=2e-4)
    np.testing.assert_allclose(found[["fx", "fy"]], own.cameras.focal, rtol=1e-9)
