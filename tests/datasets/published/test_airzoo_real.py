"""`prepare airzoo-real`, from the files as they are downloaded to scores."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from airzoo_bench.api.benchmark import load_benchmark
from airzoo_bench.api.evaluation import evaluate
from airzoo_bench.api.prediction_writer import PredictionWriter
from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.formats.clouds.formats import open_cloud
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.crs import to_lonlat
from airzoo_bench.matching.truth import read_truth as read_matching
from airzoo_bench.reconstruction.truth import read_truth as read_reconstruction
from airzoo_bench.retrieval.truth import read_truth as read_retrieval
from tests.datasets.published.airzoo_real_tree import (
    OFF,
    PHOTO_PX,
    SHOTS,
    SITE_SHOTS,
    WRITTEN_LENS,
    make_region,
    make_tree,
    write_table,
)
from tests.datasets.published.bad_airzoo_real import SCHOOL, SPOILED
from tests.datasets.published.changsha import CORNER, EPSG, heights, poses_of_shots
from tests.support import run_main

PREPARE = ("prepare", "airzoo-real", "--source")
REGIONS = ("--scene", "City", "--scene", "Rural")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_tree(tmp_path_factory.mktemp("airzoo") / "AirZoo-Real")


@pytest.fixture
def tree(tmp_path: Path, made: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(tmp_path / "data"))
    return shutil.copytree(made, tmp_path / "数据 set" / "AirZoo-Real")


def matching_scores(benchmark: str, path: Path, east_m: float = 0.0) -> dict[str, float]:
    """Return the scores of poses so far east of the truth."""
    opened, poses = load_benchmark(benchmark), poses_of_shots(SHOTS)
    with PredictionWriter(path, f"{benchmark}-matching", opened) as writer:
        for scene in ("City", "Rural"):
            for row, name in enumerate(SHOTS):
                centre = poses.centres[row] + np.array((east_m, 0.0, 0.0))
                writer.add(f"{scene}/{name}_V", rotation=poses.rotation[row], centre=centre)
    return dict(evaluate(path).overall)


def test_regions_from_download_to_scores(tree: Path, tmp_path: Path) -> None:
    assert run_main(*PREPARE, tree, *REGIONS) == 0
    exact = matching_scores("airzoo-real", tmp_path / "exact.npz")
    assert exact["within_5m"] == 1.0
    assert exact["error_m"] < 0.02
    assert not any("deg" in name for name in exact)
    assert matching_scores("airzoo-real", tmp_path / "off.npz", 7.0)["within_5m"] == 0.0

    benchmark = Benchmark.open(tmp_path / "data" / "airzoo-real")
    opened = load_benchmark("airzoo-real")
    with PredictionWriter(tmp_path / "r.npz", "airzoo-real-retrieval", opened) as writer:
        for scene in ("City", "Rural"):
            truth = read_retrieval(benchmark.scene_folder(scene), scene)
            assert len(truth.queries) == len(SHOTS)
            for row, query in enumerate(truth.queries["id"]):
                found = set(truth.positives.of(row).tolist())
                rest = [tile for tile in range(len(truth.tiles)) if tile not in found]
                order = [*sorted(found), *rest]
                writer.add(query, ranked_ids=truth.tiles["id"].iloc[order].tolist())
    scores = dict(evaluate(tmp_path / "r.npz").overall)
    assert scores["recall@1"] == 1.0


def test_priors_are_the_photos_own_and_the_truth_the_rtk_table(tree: Path, tmp_path: Path) -> None:
    assert run_main(*PREPARE, tree, *REGIONS) == 0
    benchmark = Benchmark.open(tmp_path / "data" / "airzoo-real")
    truth, poses = read_matching(benchmark, "City"), poses_of_shots(SHOTS)
    np.testing.assert_allclose(truth.poses.centres, poses.centres, atol=2e-3)
    apart = truth.queries[["prior_x", "prior_y", "prior_z"]].to_numpy() - truth.poses.centres
    expected = np.tile((OFF["x"], -OFF["y"], OFF["up"]), (len(SHOTS), 1))
    np.testing.assert_allclose(apart, expected, atol=5e-3)
    entry = benchmark.scene("City")
    assert Path(entry.gallery or "").name == "map_L20.tif"
    assert Path(entry.dom or "").name.startswith("DOM-")


def cloud_points(path: Path) -> Floats:
    source = open_cloud(path, limit_bytes=1 << 28, sampling=None)
    return np.concatenate([piece.points for piece in source.pieces(1 << 20)])


def test_sites_from_download_to_scores(tree: Path, tmp_path: Path) -> None:
    sites = ("--scene", "school-06-08", "--scene", "plaza-18-20", "--truth-reach", 120)
    assert run_main(*PREPARE, tree, *sites) == 0
    name = "airzoo-real-partial"  # two of the fourteen scenes
    benchmark = Benchmark.open(tmp_path / "data" / name)
    truth = read_reconstruction(benchmark, "school-06-08")
    poses = poses_of_shots(SITE_SHOTS)
    np.testing.assert_allclose(truth.poses.centres, poses.centres, atol=1e-3)
    np.testing.assert_allclose(truth.poses.rotation, poses.rotation, atol=1e-8)
    camera = truth.cameras
    np.testing.assert_allclose(camera.focal[0], np.array(WRITTEN_LENS[:2]) / 4.0)
    np.testing.assert_allclose(camera.principal_point[0], np.array(PHOTO_PX) / 2.0)

    points = cloud_points(truth.cloud)
    cells = np.floor((points[:, :2] - np.array(CORNER)) * (2.0, -2.0)).astype(int)
    np.testing.assert_array_equal(points[:, 2], heights(0.5)[0][cells[:, 1], cells[:, 0]])
    centres = np.array(CORNER) + (cells + 0.5) * (0.5, -0.5)
    np.testing.assert_allclose(points[:, :2], centres, atol=1e-6)

    opened = load_benchmark(name)
    for file, moved in (("exact", 0.0), ("off", 40.0)):
        path = tmp_path / file
        with PredictionWriter(path, "airzoo-real-reconstruction-partial", opened) as writer:
            for scene in ("school-06-08", "plaza-18-20"):
                writer.add(scene, points=points + np.array((0.0, 0.0, moved)))
                for row, shot in enumerate(SITE_SHOTS):
                    writer.add(
                        f"{scene}/{shot}_0", rotation=poses.rotation[row], centre=poses.centres[row]
                    )
        scores = dict(evaluate(path).overall)
        assert scores["f1_1m"] == (1.0 if not moved else 0.0)
        assert scores["f1_10m"] == (1.0 if not moved else 0.0)


def test_other_renderings_are_no_photos(tree: Path, tmp_path: Path) -> None:
    assert run_main(*PREPARE, tree, "--scene", "school-06-08") == 0
    folder = tmp_path / "data" / "airzoo-real-partial" / "scenes" / "school-06-08"
    assert sorted(pd.read_csv(folder / "queries.csv")["image"]) == [f"{n}_0.png" for n in range(8)]


def test_poses_of_other_renderings_are_left_aside(tree: Path, tmp_path: Path) -> None:
    path = tree / SCHOOL / "poses/poses/t_pose.txt"
    lines = path.read_text().splitlines()
    others = [line.replace("_0.png", f"_{kind}.png") for line in lines for kind in (1, 2)]
    path.write_text("\n".join([*lines, *others]))
    assert run_main(*PREPARE, tree, "--scene", "school-06-08") == 0
    folder = tmp_path / "data" / "airzoo-real-partial" / "scenes" / "school-06-08"
    assert len(pd.read_csv(folder / "queries.csv")) == 8


def test_metadata_that_are_the_truth_are_no_prior(
    tree: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for scene in ("Scene1", "Scene2"):
        shutil.rmtree(tree / scene)
        make_region(tree / scene, rtk=False)
    assert run_main(*PREPARE, tree, *REGIONS) == 0
    assert "--prior truth crops by the truth" in capsys.readouterr().err
    tracks = Benchmark.open(tmp_path / "data" / "airzoo-real").file.tracks
    assert set(tracks) == {"retrieval"}
    assert run_main(*PREPARE, tree, *REGIONS, "--prior", "truth") == 0
    assert matching_scores("airzoo-real-truth-prior", tmp_path / "m.npz")["within_5m"] == 1.0


def test_positions_and_priors_may_be_given(tree: Path, tmp_path: Path) -> None:
    options: list[object] = []
    for scene, folder in (("City", "Scene1"), ("Rural", "Scene2")):
        shutil.rmtree(tree / folder)
        make_region(tree / folder, {n: s.moved(x=3.0) for n, s in SHOTS.items()}, rtk=False, flag=0)
        table = tmp_path / f"{scene}.csv"
        lonlat = to_lonlat(EPSG, poses_of_shots(SHOTS).centres[:, :2]).tolist()
        rows = [
            f"{name}_V.JPG,{lon:.10f},{lat:.10f},{shot.centre[2]}"
            for (name, shot), (lon, lat) in zip(SHOTS.items(), lonlat, strict=True)
        ]
        table.write_text("\n".join(["image,lon,lat,altitude_m", *rows]) + "\n")
        options += ["--positions", f"{scene}={table}"]
    assert run_main(*PREPARE, tree, *REGIONS, *options) == 0
    assert matching_scores("airzoo-real", tmp_path / "m.npz")["error_m"] < 0.02


def test_without_a_satellite_map_there_is_matching_alone(
    tree: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for scene in ("Scene1", "Scene2"):
        (tree / scene / "map_L20.tif").unlink()
    assert run_main(*PREPARE, tree, *REGIONS) == 0
    assert "no map has 0.3 m a pixel: without --satellite City=FILE" in capsys.readouterr().err
    tracks = Benchmark.open(tmp_path / "data" / "airzoo-real").file.tracks
    assert set(tracks) == {"matching"}


def test_heights_may_be_shifted_and_cameras_given(tree: Path, tmp_path: Path) -> None:
    camera = tmp_path / "camera.json"
    camera.write_text(json.dumps({"fx": 44.0}))
    options = ("--height-offset", "City=-17.5", "--camera", f"City={camera}")
    assert run_main(*PREPARE, tree, *REGIONS, *options) == 0
    truth = read_matching(Benchmark.open(tmp_path / "data" / "airzoo-real"), "City")
    raised = truth.poses.centres - poses_of_shots(SHOTS).centres
    np.testing.assert_allclose(raised[:, 2], -17.5, atol=2e-3)
    above = truth.queries["prior_z"].to_numpy() - truth.poses.centres[:, 2]
    np.testing.assert_allclose(above, OFF["up"], atol=5e-3)
    assert set(truth.queries["fx"]) == {44.0}


def test_a_given_focal_length_is_held_against_exif(
    tree: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    camera = tmp_path / "camera.json"
    camera.write_text(json.dumps({"fx": 4400.0}))
    for path in (tree / "Scene1").glob("*.JPG"):
        with Image.open(path) as photo:
            exif = photo.getexif()
            exif.get_ifd(0x8769)[0xA405] = 35
            photo.save(path, exif=exif, xmp=photo.info["xmp"])
    given = ("--scene", "City", "--camera", f"City={camera}")
    assert run_main(*PREPARE, tree, *given) == 2
    assert "fx is 4400 px, and the focal length of 35 mm film makes" in capsys.readouterr().err


@pytest.mark.parametrize("name", SPOILED)
def test_what_is_wrong_is_one_message(
    name: str, tree: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spoil, scene, said = SPOILED[name]
    spoil(tree)
    assert run_main(*PREPARE, tree, "--scene", scene) == 2
    text = capsys.readouterr().err
    assert "Traceback" not in text
    for part in said:
        assert part in text
    assert not (tmp_path / "data" / "airzoo-real-partial").exists()


def test_an_option_of_no_scene_is_refused(tree: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_main(*PREPARE, tree, "--dom", "Town=x.tif") == 2
    assert "one of City, Rural" in capsys.readouterr().err


def test_a_table_that_lacks_a_photo_is_not_mixed_with_others(
    tree: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    few = dict(list(SHOTS.items())[1:])
    write_table(tree / "Scene1" / "DJI_001_Timestamp.MRK", few)
    assert run_main(*PREPARE, tree, "--scene", "City") == 0
    text = capsys.readouterr().err
    assert "metadata of 5 of 5 photos" in text
    assert "DJI_001_Timestamp.MRK) not used" in text
