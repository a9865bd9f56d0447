"""AirZoo-Mini as a benchmark: what is in it, and what its fingerprints and submissions say."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from airzoo_bench.api.benchmark import load_benchmark
from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.datasets.dataset import PrepareSettings
from airzoo_bench.datasets.geometry_checks.depth import (
    DepthConsistency,
    check_depth_consistency,
    find_depths,
)
from airzoo_bench.datasets.geometry_checks.report import SceneGeometry
from airzoo_bench.datasets.geometry_checks.scenes import PosedScene, scenes_of_benchmark
from airzoo_bench.datasets.mini.dataset import prepare_airzoo_mini
from airzoo_bench.engines.engine import Processes
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.matching.truth import read_truth as read_matching
from airzoo_bench.reconstruction.truth import read_truth as read_reconstruction
from airzoo_bench.retrieval.truth import read_truth as read_retrieval
from tests.datasets.mini.prepared import Prepared
from tests.datasets.parts import hold_crops, hold_tiles
from tests.processor_truths import fingerprints

pytestmark = pytest.mark.slow

SCENES = ("city", "rural")
MEMORY = 1 << 30
PAPER_MEDIAN = 0.00066
WORLDS = "mini-worlds"


# --- the benchmark ---------------------------------------------------------------------------


def test_every_track_has_truth_and_every_condition_is_there(mini: Prepared) -> None:
    for scene in SCENES:
        folder = mini.benchmark.scene_folder(scene)
        photos = pd.read_csv(folder / "queries.csv")
        assert set(photos["sequence"]) == {"survey", "roll"}
        roll = photos[photos["sequence"] == "roll"]
        assert roll.groupby(["weather", "time_of_day"]).size().eq(2).all()
        assert roll.groupby(["weather", "time_of_day"]).ngroups == 15
        assert roll["pitch_deg"].min() < 20
        assert roll["pitch_deg"].max() > 80
        surveyed = photos.loc[photos["sequence"] == "survey", "id"]
        truth = read_reconstruction(mini.benchmark, scene)
        assert truth.photos["id"].tolist() == surveyed.tolist()
        assert len(read_retrieval(folder, scene).queries) >= 50
        assert len(read_matching(mini.benchmark, scene).queries) >= 50


def test_priors_are_noisy_and_tiles_are_those_of_the_older_map(mini: Prepared) -> None:
    truth = read_matching(mini.benchmark, "city")
    away = np.linalg.norm(truth.priors.centres - truth.poses.centres, axis=1)
    assert 2 < np.median(away) < 6
    entry = mini.benchmark.scene("city")
    assert entry.gallery is not None
    assert entry.gallery.endswith("satellite.tif")
    assert entry.dom.endswith("dom.tif")


def test_tiles_and_crops_as_files_are_those_of_the_maps(mini: Prepared) -> None:
    for scene in load_benchmark(mini.root / "airzoo-mini").scenes:
        home = mini.root / "airzoo-mini" / "scenes" / scene.id
        hold_tiles(home, scene)
        hold_crops(home, scene)


def test_a_second_run_keeps_what_is_there_and_mends_what_is_not(
    mini: Prepared, tmp_path: Path
) -> None:
    shutil.copytree(mini.root / WORLDS, tmp_path / WORLDS)
    frames, dom = (
        tmp_path / Path(path).relative_to(mini.root)
        for path in (
            mini.benchmark.resolve(mini.benchmark.scene("rural").images),
            mini.benchmark.scene("rural").dom,
        )
    )
    kept, lost, cut = sorted(frames.glob("*.jpg"))[:3]
    before = {path: path.read_bytes() for path in (kept, lost, cut)}
    stamp = kept.stat().st_mtime_ns
    lost.unlink()
    cut.write_bytes(before[cut][:1000])
    whole = dom.read_bytes()
    dom.write_bytes(whole[:-5000])
    folder = tmp_path / "airzoo-mini"
    prepare_airzoo_mini(0, PrepareSettings(folder, tmp_path, engine=Processes(2)))
    assert dom.read_bytes() == whole
    assert {path: path.read_bytes() for path in before} == before
    assert kept.stat().st_mtime_ns == stamp
    assert Benchmark.open(folder).file.checksums == mini.benchmark.file.checksums


# --- geometry --------------------------------------------------------------------------------


def geometry(scene: PosedScene, depth: Path) -> DepthConsistency:
    found = find_depths(depth, scene.images)
    posed = (scene.ids, scene.cameras, scene.poses)
    return check_depth_consistency(*posed, found, pixels=1024, median_below=PAPER_MEDIAN)


def passes(scene: PosedScene, found: DepthConsistency) -> bool:
    return not SceneGeometry(scene, None, found).failures


def test_geometry_is_right_and_a_small_fault_is_caught(mini: Prepared, tmp_path: Path) -> None:
    (scene,) = scenes_of_benchmark(mini.benchmark, "city")
    depth = scene.folder.parent / "depth"
    sound = geometry(scene, depth)
    assert sound.quantile(0.5) < PAPER_MEDIAN
    assert passes(scene, sound)
    # All poses turned by 0.1 degree about their own right-hand axis.
    tilt = np.radians(0.1)
    turn = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    poses = Poses(rotation=turn @ scene.poses.rotation, centres=scene.poses.centres)
    assert not passes(scene, geometry(replace(scene, poses=poses), depth))
    # One pose among all.
    one = scene.poses.rotation.copy()
    one[20] = turn @ one[20]
    poses = Poses(rotation=one, centres=scene.poses.centres)
    assert not passes(scene, geometry(replace(scene, poses=poses), depth))
    # All depths 0.2 % too large.
    for path in depth.glob("*.tif"):
        with Image.open(path) as picture:
            np.save(tmp_path / f"{path.stem}.npy", np.asarray(picture) * np.float32(1.002))
    assert not passes(scene, geometry(scene, tmp_path))


# --- files -----------------------------------------------------------------------------------


def test_the_frames_say_where_they_were_taken(mini: Prepared) -> None:
    frames = mini.benchmark.resolve(mini.benchmark.scene("city").images).parent
    table = pd.read_csv(frames / "frames.csv")
    photos = pd.read_csv(mini.benchmark.scene_folder("city") / "queries.csv")
    assert set(table["name"] + ".jpg") == set(photos["image"])
    assert table["longitude"].between(112.9, 113.1).all()
    assert table["latitude"].between(28.1, 28.3).all()
    offset = json.loads((frames / "colmap" / "offset.json").read_text())
    assert offset


# --- fingerprints ----------------------------------------------------------------------------


TRUTHS = {
    "city retrieval": "d6985ecbe93e",
    "city matching": "3677725d829e",
    "city reconstruction": "3ad42d0c4a7b",
    "rural retrieval": "20c1a28e1633",
    "rural matching": "be0e74702099",
    "rural reconstruction": "a767fb8de256",
}


def test_its_truth_is_the_same_on_every_machine(mini: Prepared) -> None:
    for name, fingerprint in fingerprints(mini.root / "airzoo-mini").items():
        assert fingerprint.startswith(TRUTHS[name]), name
