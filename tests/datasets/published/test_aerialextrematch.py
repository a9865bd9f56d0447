"""`prepare aerialextrematch`, from the files as they are downloaded to scores."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import rasterio

from airzoo_bench.api.benchmark import load_benchmark
from airzoo_bench.api.evaluation import evaluate
from airzoo_bench.api.prediction_writer import PredictionWriter
from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.geometry.crs import to_lonlat
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.matching.truth import read_truth
from tests.datasets.published.aerialextrematch_tree import OFF, SHOTS, make_tree
from tests.datasets.published.changsha import (
    CORNER,
    EPSG,
    heights,
    poses_of_shots,
    write_photo,
)
from tests.support import run_main

FIRST = next(iter(SHOTS))
PREPARE = ("prepare", "aerialextrematch", "--source")


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    return make_tree(tmp_path / "下载 set" / "AerialExtreMatch-Localization")


def scored(
    benchmark: str, poses: Poses, path: Path, protocol: str | None = None
) -> dict[str, float]:
    """Return the overall scores of poses of the queries, in the order of `SHOTS`."""
    opened, name = load_benchmark(benchmark), protocol or f"{benchmark}-matching"
    with PredictionWriter(path, name, opened) as writer:
        for row, shot in enumerate(SHOTS):
            writer.add(
                f"localization/{shot}", rotation=poses.rotation[row], centre=poses.centres[row]
            )
    return dict(evaluate(path).overall)


def test_exact_poses_score_perfect(tree: Path, tmp_path: Path) -> None:
    assert run_main(*PREPARE, tree) == 0
    poses = poses_of_shots(SHOTS)
    exact = scored("aerialextrematch", poses, tmp_path / "exact.npz")
    assert exact["within_5m_1deg"] == 1.0
    assert exact["error_m"] < 1e-3
    moved = Poses(rotation=poses.rotation, centres=poses.centres + np.array((7.0, 0.0, 0.0)))
    off = scored("aerialextrematch", moved, tmp_path / "off.npz")
    assert off["within_5m_1deg"] == 0.0
    assert off["within_10m_1deg"] == 1.0
    assert off["error_m"] == pytest.approx(7.0, abs=1e-3)
    original = "aerialextrematch-matching-original"
    again = scored("aerialextrematch", poses, tmp_path / "original.npz", original)
    assert again["within_5m_1deg"] == 1.0


def test_matches_through_the_references_give_the_pose(tree: Path, tmp_path: Path) -> None:
    """The georeference of .tfw is of pixel centres: half a pixel off would be half a metre."""
    assert run_main(*PREPARE, tree) == 0
    truth = read_truth(Benchmark.open(tmp_path / "data" / "aerialextrematch"), "localization")
    surface = heights(1.0)[0]
    opened = load_benchmark("aerialextrematch")
    rng = np.random.default_rng(0)
    with PredictionWriter(tmp_path / "m.npz", "aerialextrematch-matching", opened) as writer:
        for row, name in enumerate(truth.queries["id"]):
            x, y, width, height = truth.crops[row]
            cells = np.stack(
                (rng.integers(x, x + width, 400), rng.integers(y, y + height, 400)), axis=1
            )
            places = np.array(CORNER) + (cells + 0.5) * (1.0, -1.0)
            points = np.column_stack((places, surface[cells[:, 1], cells[:, 0]]))
            pose = truth.poses.take(row)
            camera = (points - pose.centres[0]) @ pose.rotation[0].T
            pixel = camera[:, :2] / camera[:, 2:] * 40.0 + (20.0, 15.0)
            seen = (camera[:, 2] > 0) & (pixel > 0).all(axis=1) & (pixel < (40, 30)).all(axis=1)
            writer.add(name, query_xy=pixel[seen], map_xy=cells[seen] + 0.5)
    assert dict(evaluate(tmp_path / "m.npz").overall)["error_m"] < 0.05


def test_priors_are_the_photos_own(tree: Path, tmp_path: Path) -> None:
    assert run_main(*PREPARE, tree) == 0
    truth = read_truth(Benchmark.open(tmp_path / "data" / "aerialextrematch"), "localization")
    assert len(truth.queries) == len(SHOTS)
    apart = truth.queries[["prior_x", "prior_y", "prior_z"]].to_numpy() - truth.poses.centres
    expected = (OFF["x"], -OFF["y"], OFF["up"])
    np.testing.assert_allclose(apart, np.tile(expected, (len(SHOTS), 1)), atol=0.02)


def test_lq_and_the_truth_as_prior_are_benchmarks_of_their_own(tree: Path, tmp_path: Path) -> None:
    assert run_main(*PREPARE, tree, "--reference", "lq") == 0
    assert run_main(*PREPARE, tree, "--prior", "truth") == 0
    poses = poses_of_shots(SHOTS)
    for benchmark in ("aerialextrematch-lq", "aerialextrematch-truth-prior"):
        found = scored(benchmark, poses, tmp_path / f"{benchmark}.npz")
        assert found["within_5m_1deg"] == 1.0
    assert not (tmp_path / "data" / "aerialextrematch").exists()


def test_photos_without_metadata_have_no_prior_but_by_a_table(tree: Path, tmp_path: Path) -> None:
    for name in SHOTS:
        write_photo(tree / "rgb" / f"{name}.JPG", None)
    assert run_main(*PREPARE, tree) == 2
    table = tmp_path / "priors.csv"
    lonlat = to_lonlat(EPSG, poses_of_shots(SHOTS).centres[:, :2]) + 1e-4
    rows = [
        f"{name}.JPG,{lon:.9f},{lat:.9f},152,{shot.yaw},{shot.pitch},0"
        for (name, shot), (lon, lat) in zip(SHOTS.items(), lonlat, strict=True)
    ]
    table.write_text("\n".join(["image,lon,lat,altitude_m,yaw_deg,pitch_deg,roll_deg", *rows]))
    assert run_main(*PREPARE, tree, "--priors", table) == 0


def test_the_truth_is_the_same_wherever_the_download_stands(
    tree: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The surface model is a virtual raster here, whose own bytes are the place of a file."""
    found = []
    for place in ("one", "two"):
        shutil.copytree(tree, tmp_path / place / "set")
        monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / place / "data"))
        assert run_main(*PREPARE, tmp_path / place / "set") == 0
        benchmark = Benchmark.open(tmp_path / place / "data" / "aerialextrematch")
        assert (benchmark.scene("localization").dsm or "").endswith(".vrt")
        found.append(read_truth(benchmark, "localization").fingerprint)
    assert found[0] == found[1]
    surface = tmp_path / "two" / "set" / "HQref" / "Production_4_DSM_merge.tif"
    with rasterio.open(surface, "r+") as file:
        file.write(file.read(1) + 1.0, 1)
    with pytest.raises(BenchmarkError, match="not the one"):
        read_truth(benchmark, "localization")


def test_few_digits_of_the_truth_are_said(tree: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = [line.split() for line in (tree / "gt_pose.txt").read_text().splitlines()]
    lines = [" ".join((row[0], *(f"{float(value):.8f}" for value in row[1:]))) for row in rows]
    (tree / "gt_pose.txt").write_text("\n".join(lines))
    assert run_main(*PREPARE, tree) == 0
    assert "gt_pose.txt: its digits fix camera centres to about 0.0" in capsys.readouterr().err


def test_a_second_run_finds_all_done(tree: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_main(*PREPARE, tree) == 0
    capsys.readouterr()
    assert run_main(*PREPARE, tree) == 0
    assert "its CRS is that of the .prj" not in capsys.readouterr().err


def test_the_folder_above_is_taken_too(tree: Path, tmp_path: Path) -> None:
    assert run_main(*PREPARE, tree.parent) == 0
    assert (tmp_path / "data" / "aerialextrematch" / "benchmark.toml").is_file()


def test_photos_without_a_pose_and_poses_without_a_photo_are_named(
    tree: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    photo = (tree / "rgb" / f"{FIRST}.JPG").read_bytes()
    (tree / "rgb" / "DJI_other.jpg").write_bytes(photo)
    assert run_main(*PREPARE, tree) == 0
    assert "DJI_other.jpg" in capsys.readouterr().err


def _edit(name: str, old: str, new: str) -> Callable[[Path], object]:
    def edit(tree: Path) -> None:
        text = (tree / name).read_text()
        assert old in text
        (tree / name).write_text(text.replace(old, new))

    return edit


def _no_reference(tree: Path) -> None:
    for path in (tree / "HQref").iterdir():
        path.unlink()
    (tree / "HQref" / "HQref.zip.part").write_bytes(b"PK")


def _pairs(tree: Path) -> None:
    shutil.rmtree(tree)
    (tree / "class_0").mkdir(parents=True)


def _archive(tree: Path) -> None:
    shutil.rmtree(tree / "rgb")
    (tree / "rgb.zip").write_bytes(b"PK")


SPOILED: dict[str, tuple[Callable[[Path], object], list[str]]] = {
    "no poses": (lambda t: (t / "gt_pose.txt").unlink(), ["lacks gt_pose.txt"]),
    "an archive": (
        _archive,
        ["lacks rgb", "an archive, rgb.zip: unpack it"],
    ),
    "half a download": (_no_reference, ["orthophoto is not clear", "HQref.zip.part"]),
    "no photo": (
        lambda t: (t / "rgb" / f"{FIRST}.JPG").unlink(),
        ["photos of its poses are missing", FIRST],
    ),
    "two of one name": (
        lambda t: (t / "rgb" / f"{FIRST}.png").write_bytes(b""),
        ["two files each for", FIRST],
    ),
    "decimal commas": (_edit("gt_pose.txt", ".", ","), ["gt_pose.txt", "column q"]),
    "a value less": (_edit("gt_pose.txt", f"{FIRST}.JPG ", ""), ["has 7 values"]),
    "two lines": (
        _edit("gt_pose.txt", [*SHOTS][1], FIRST),
        ["images with two lines", FIRST],
    ),
    "no unit quaternion": (_edit("gt_pose.txt", ".JPG 0", ".JPG 1"), ["not of unit norm", FIRST]),
    "a lens": (_edit("intrinsic.txt", "PINHOLE", "OPENCV"), ["camera models", "OPENCV"]),
    "another size": (_edit("intrinsic.txt", "40 30", "80 60"), ["another size than their cameras"]),
    "another shape": (_edit("intrinsic.txt", "40 30", "40 40"), ["cameras of another shape"]),
    "no prj": (
        lambda t: (t / "HQref" / "Production_4_DSM_merge.prj").unlink(),
        ["no CRS, and no .prj next to it", "Production_4_DSM_merge.tif"],
    ),
    "no tfw": (
        lambda t: (t / "HQref" / "Production_4_ortho_merge.tfw").unlink(),
        ["no geotransform", "ortho_merge"],
    ),
    "the pairs": (
        _pairs,
        ["evaluation pairs", "pickles", "airzoo_bench.pose_errors"],
    ),
    "no folder": (lambda t: t.rename(t.parent.parent / "x"), ["holds none of gt_pose.txt, rgb"]),
}


@pytest.mark.parametrize("name", SPOILED)
def test_what_is_wrong_is_one_message(
    name: str, tree: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spoil, said = SPOILED[name]
    spoil(tree)
    assert run_main(*PREPARE, tree) == 2
    text = capsys.readouterr().err
    assert "Traceback" not in text
    for part in said:
        assert part in text
    assert not (tmp_path / "data" / "aerialextrematch").exists()
