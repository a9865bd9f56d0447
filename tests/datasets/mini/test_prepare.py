"""AirZoo-Mini as a benchmark: perfect input scores perfectly, worse input scores worse."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.api.benchmark import load_benchmark
from airzoo_bench.evaluation.evaluate import evaluate
from airzoo_bench.evaluation.track import Run
from airzoo_bench.geometry.heightfield import HeightField
from airzoo_bench.geometry.poses import depth_to_points
from airzoo_bench.geometry.rasters import world_to_pixel
from airzoo_bench.matching.truth import read_truth as read_matching
from airzoo_bench.reconstruction.truth import read_truth as read_reconstruction
from airzoo_bench.retrieval.truth import read_truth as read_retrieval
from tests.datasets.mini.conftest import Prepared
from tests.datasets.support import hold_crops, hold_tiles
from tests.processor_truths import fingerprints
from tests.support import run_main

pytestmark = pytest.mark.slow

HOME = Path(__file__).parents[3]
SCENES = ("city", "rural")
TRUTHS = {
    "city retrieval": "41580b87fce5",
    "city matching": "22bd551d6457",
    "city reconstruction": "dc6f7d5c2bb7",
    "rural retrieval": "02346c8a0363",
    "rural matching": "54776295dbf3",
    "rural reconstruction": "88b277010868",
}
Scores = dict[str, float]


def test_its_truth_is_the_same_on_every_machine(mini: Prepared) -> None:
    for name, fingerprint in fingerprints(mini.root / "airzoo-mini").items():
        assert fingerprint.startswith(TRUTHS[name]), name


def test_every_track_has_truth_and_every_condition_is_there(mini: Prepared) -> None:
    for scene in load_benchmark(mini.root / "airzoo-mini").scenes:
        home = mini.root / "airzoo-mini" / "scenes" / scene.id
        hold_tiles(home, scene)
        hold_crops(home, scene)
        entry = mini.benchmark.scene(scene.id)
        assert entry.dom.endswith("dom.tif")
        assert str(entry.gallery).endswith("satellite.tif")
        photos = pd.read_csv(home / "queries.csv")
        frames = pd.read_csv(mini.frames(scene.id) / "frames.csv")
        assert set(frames["name"] + ".jpg") == set(photos["image"])
        roll = photos[photos["sequence"] == "roll"]
        assert roll.groupby(["weather", "time_of_day"]).size().tolist() == [2] * 15
        assert roll["pitch_deg"].min() < 20
        assert roll["pitch_deg"].max() > 80
        surveyed = photos.loc[photos["sequence"] == "survey", "id"].tolist()
        assert read_reconstruction(mini.benchmark, scene.id).photos["id"].tolist() == surveyed
        assert len(read_retrieval(home, scene.id).queries) >= 50
        truth = read_matching(mini.benchmark, scene.id)
        assert len(truth.queries) >= 50
        away = np.linalg.norm(truth.priors.centres - truth.poses.centres, axis=1)
        assert 2 < np.median(away) < 6


def test_the_submissions_of_this_repository(
    mini: Prepared, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("AIRZOO_BENCH_DATA", str(mini.root))
    monkeypatch.chdir(HOME)
    assert run_main("submission", "check", "submissions/airzoo-mini/matching/sift") == 0
    assert "scored" in capsys.readouterr().out


def result_of(mini: Prepared, path: Path) -> Scores:
    return dict(evaluate(path, data=mini.root, run=Run(jobs=2)).result.overall)


def match(mini: Prepared, path: Path, noise_px: float, outliers: float) -> Scores:
    """Score matches by exact depth, with noise on the map and wrong matches among them."""
    random, ids, photo_xy, map_xy = np.random.default_rng(1), [], [], []
    for scene in SCENES:
        truth = read_matching(mini.benchmark, scene)
        surface, dom = HeightField.read(truth.maps[0].dsm), truth.maps[0].dom
        for row, query in truth.queries.iterrows():
            depth = mini.depth(scene, query["image"])
            grid = np.zeros(depth.shape, dtype=bool)
            grid[11::24, 11::24] = True
            grid &= (depth > 0) & (depth < 350)
            points = depth_to_points(depth, grid, truth.cameras.take(row), truth.poses.take(row))
            # What lies under a roof's edge or a tree is not what the surface model shows there.
            level = np.abs(surface.sample(points[:, :2]) - points[:, 2]) < 0.05
            there = world_to_pixel(dom.transform, points[level, :2])
            there += random.normal(0, noise_px, there.shape) if noise_px else 0.0
            wrong = random.random(len(there)) < outliers
            there[wrong] = random.uniform(0, dom.width, (wrong.sum(), 2))
            inside = ((there >= 0) & (there <= dom.width)).all(axis=1)
            ids.append(query["id"])
            photo_xy.append((np.argwhere(grid)[:, ::-1] + 0.5)[level][inside])
            map_xy.append(there[inside])
    offsets = np.cumsum([0, *(len(part) for part in photo_xy)])
    pairs = {"query_xy": np.concatenate(photo_xy), "map_xy": np.concatenate(map_xy)}
    np.savez(path, protocol="airzoo-mini-matching", query_ids=ids, offsets=offsets, **pairs)
    return result_of(mini, path)


def test_matching_is_perfect_and_falls(mini: Prepared, tmp_path: Path) -> None:
    ladder = ((0.0, 0.0), (3.0, 0.2), (12.0, 0.5))
    results = [match(mini, tmp_path / "p.npz", noise, wrong) for noise, wrong in ladder]
    assert results[0]["within_1m"] == results[0]["within_1m_1deg"] == 1.0
    assert results[0]["error_m"] < 0.05
    for better, worse in pairwise(results):
        assert better["error_m"] < worse["error_m"]
        assert better["within_1m"] > worse["within_1m"]


def reconstruct(mini: Prepared, folder: Path, noise: float, smaller: int = 3) -> Scores:
    """Score depth maps: exact ones, so many times smaller, with a share of noise."""
    folder.mkdir()
    (folder / "protocol.txt").write_text("airzoo-mini-reconstruction\n")
    for scene in SCENES:
        random, truth = np.random.default_rng(2), read_reconstruction(mini.benchmark, scene)
        images, poses = truth.photos["image"], truth.poses
        # The middle pixel of each three by three is at the centre of the larger one.
        rows = slice(smaller // 2, None, smaller)
        columns = slice(smaller // 2, 640 // smaller * smaller, smaller)
        depth = np.stack([mini.depth(scene, image)[rows, columns] for image in images])
        depth *= 1 + random.normal(0, noise, depth.shape)
        K = truth.cameras.matrices / [[smaller], [smaller], [1.0]]
        np.savez(
            folder / f"{scene}.npz",
            depth=depth.astype(np.float32),
            intrinsics=K,
            extrinsics=np.concatenate([poses.rotation, poses.translation[..., None]], axis=2),
            image_names=images.to_numpy(str),
        )
    return result_of(mini, folder)


def test_reconstruction_is_perfect_and_falls(mini: Prepared, tmp_path: Path) -> None:
    overall = reconstruct(mini, tmp_path / "p", 0.0, smaller=1)
    assert overall["f1_10m"] == overall["f1_1m"] == 1.0
    assert overall["pose_auc_3deg"] == pytest.approx(1.0, abs=1e-6)
    assert max(overall["chamfer_m"], overall["ate_m"]) < 1e-3
    found = [reconstruct(mini, tmp_path / f"{by}", by) for by in (0.0, 0.01, 0.2)]
    for better, worse in pairwise(found):
        assert better["chamfer_m"] < worse["chamfer_m"]
        assert better["f1_1m"] > worse["f1_1m"]
