"""AirZoo-Mini as a benchmark: perfect input scores perfectly, worse input scores worse."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from airzoo_bench.api.benchmark import load_benchmark
from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.files import fingerprint
from airzoo_bench.datasets.dataset import PrepareSettings
from airzoo_bench.datasets.geometry_checks.dataset import PosedScene, scenes_of_benchmark
from airzoo_bench.datasets.geometry_checks.depth_frames import PairRule, Sampling
from airzoo_bench.datasets.geometry_checks.depth_maps import DepthKind
from airzoo_bench.datasets.geometry_checks.depth_report import (
    DepthConsistency,
    check_depth_consistency,
)
from airzoo_bench.datasets.mini.prepare import prepare_airzoo_mini
from airzoo_bench.evaluation.evaluate import evaluate
from airzoo_bench.evaluation.parts import Resources
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.depth import depth_to_points
from airzoo_bench.geometry.heightfield import HeightField
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.rasters import world_to_pixel
from airzoo_bench.leaderboard.board import BOARD_FILE, read_board
from airzoo_bench.leaderboard.checks import check_submission
from airzoo_bench.leaderboard.known import known_submissions
from airzoo_bench.leaderboard.rescoring import rescore
from airzoo_bench.matching.truth import read_truth as read_matching
from airzoo_bench.reconstruction.truth import read_truth as read_reconstruction
from airzoo_bench.results.result import Result
from airzoo_bench.retrieval.truth import read_truth as read_retrieval
from tests.datasets.parts import hold_crops, hold_tiles

SCENES = ("city", "rural")
CHECKOUT = Path(__file__).resolve().parents[3]
OWN = sorted(CHECKOUT.glob("submissions/*/*/*/"))
MEMORY = 1 << 30
PAPER_MEDIAN = 0.00066


@dataclass(frozen=True)
class Prepared:
    """A data root with AirZoo-Mini in it."""

    root: Path
    benchmark: Benchmark

    def depth(self, scene: str, image: str) -> Floats:
        photos = self.benchmark.resolve(self.benchmark.scene(scene).images)
        with Image.open(photos.parent / "depth" / f"{Path(image).stem}.tif") as picture:
            return np.asarray(picture, dtype=np.float64)


@pytest.fixture(scope="module")
def mini(tmp_path_factory: pytest.TempPathFactory) -> Prepared:
    root = tmp_path_factory.mktemp("data")
    folder = root / "airzoo-mini"
    prepare_airzoo_mini(
        0, PrepareSettings(folder, root, tiles_on_disk=True, crops_on_disk=True, jobs=2)
    )
    return Prepared(root, Benchmark.open(root / "airzoo-mini"))


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


def test_a_second_run_keeps_what_is_there_and_mends_what_is_not(mini: Prepared) -> None:
    frames = mini.benchmark.resolve(mini.benchmark.scene("rural").images)
    kept, lost, cut = sorted(frames.glob("*.jpg"))[:3]
    before = {path: path.read_bytes() for path in (kept, lost, cut)}
    stamp = kept.stat().st_mtime_ns
    lost.unlink()
    cut.write_bytes(before[cut][:1000])
    dom = Path(mini.benchmark.scene("rural").dom)
    whole = dom.read_bytes()
    dom.write_bytes(whole[:-5000])
    said: list[str] = []
    folder = mini.root / "again"
    prepare_airzoo_mini(0, PrepareSettings(folder, mini.root, jobs=2, note=said.append))
    assert len(said) == 1
    assert "made again" in said[0]
    assert dom.read_bytes() == whole
    assert {path: path.read_bytes() for path in before} == before
    assert kept.stat().st_mtime_ns == stamp
    assert Benchmark.open(folder).file.checksums == mini.benchmark.file.checksums


# --- retrieval -------------------------------------------------------------------------------


def rank(mini: Prepared, path: Path, right: float) -> Result:
    """Score rankings that begin with a positive tile for a share of the queries."""
    random = np.random.default_rng(0)
    ids, ranked = [], []
    for scene in SCENES:
        truth = read_retrieval(mini.benchmark.scene_folder(scene), scene)
        tiles = truth.tiles["id"].to_numpy(str)
        for row, query in enumerate(truth.queries["id"]):
            positive = truth.positives.of(row)
            others = np.setdiff1d(np.arange(len(tiles)), positive)
            first = positive if random.random() < right else others
            order = np.concatenate([first, np.setdiff1d(np.arange(len(tiles)), first)])
            ids.append(query)
            ranked.append(tiles[order[:10]])
    np.savez(
        path, protocol="airzoo-mini-retrieval", query_ids=np.array(ids), ranked_ids=np.array(ranked)
    )
    return evaluate(path, data=mini.root).result


def test_retrieval_is_perfect_and_falls(mini: Prepared, tmp_path: Path) -> None:
    results = [rank(mini, tmp_path / "p.npz", right) for right in (1.0, 0.7, 0.4, 0.0)]
    recalls = [result.overall["recall@1"] for result in results]
    assert recalls[0] == 1.0
    assert recalls[-1] == 0.0
    assert all(better > worse for better, worse in pairwise(recalls))


# --- matching --------------------------------------------------------------------------------


def match(mini: Prepared, path: Path, noise_px: float, outliers: float) -> Result:
    """Score matches by exact depth, with noise on the map and wrong matches among them."""
    random = np.random.default_rng(1)
    ids: list[str] = []
    photo_xy, map_xy = [], []
    for scene in SCENES:
        truth = read_matching(mini.benchmark, scene)
        surface = HeightField.read(truth.maps[0].dsm)
        for row, (query, image) in enumerate(
            zip(truth.queries["id"], truth.queries["image"], strict=True)
        ):
            depth = mini.depth(scene, image)
            points, pixels = sampled(depth, truth.cameras.take(row), truth.poses.take(row))
            # What lies under a roof's edge or a tree is not what the surface model shows there.
            level = np.abs(surface.sample(points[:, :2]) - points[:, 2]) < 0.05
            there = world_to_pixel(truth.maps[0].dom.transform, points[level, :2])
            there += random.normal(0, noise_px, there.shape) if noise_px else 0.0
            wrong = random.random(len(there)) < outliers
            there[wrong] = random.uniform(0, truth.maps[0].dom.width, (wrong.sum(), 2))
            inside = ((there >= 0) & (there <= truth.maps[0].dom.width)).all(axis=1)
            ids.append(query)
            photo_xy.append(pixels[level][inside])
            map_xy.append(there[inside])
    offsets = np.concatenate([[0], np.cumsum([len(part) for part in photo_xy])])
    np.savez(
        path,
        protocol="airzoo-mini-matching",
        query_ids=np.array(ids),
        offsets=offsets,
        query_xy=np.concatenate(photo_xy),
        map_xy=np.concatenate(map_xy),
    )
    return evaluate(path, data=mini.root, resources=Resources(jobs=2)).result


def sampled(depth: Floats, camera: Cameras, pose: Poses) -> tuple[Floats, Floats]:
    """Return points (n, 3) on a grid of pixels that see something, and these pixels (n, 2)."""
    grid = np.zeros(depth.shape, dtype=bool)
    grid[11::24, 11::24] = True
    grid &= (depth > 0) & (depth < 350)
    rows, columns = np.nonzero(grid)
    pixels = np.stack([columns + 0.5, rows + 0.5], axis=1)
    return depth_to_points(depth, grid, camera, pose), pixels


def test_matching_is_perfect_and_falls(mini: Prepared, tmp_path: Path) -> None:
    ladder = ((0.0, 0.0), (3.0, 0.2), (12.0, 0.5))
    results = [match(mini, tmp_path / "p.npz", noise, wrong) for noise, wrong in ladder]
    perfect = results[0].overall
    assert perfect["within_1m"] == 1.0
    assert perfect["within_1m_1deg"] == 1.0
    assert perfect["error_m"] < 0.05
    medians = [result.overall["error_m"] for result in results]
    assert medians == sorted(medians)
    recalls = [result.overall["within_1m"] for result in results]
    assert recalls[0] > recalls[1] > recalls[2]


# --- reconstruction --------------------------------------------------------------------------

Change = Callable[[Floats, np.random.Generator], Floats]


def reconstruct(mini: Prepared, folder: Path, change: Change, smaller: int = 3) -> Result:
    """Score depth maps: exact ones, so many times smaller, changed."""
    folder.mkdir()
    (folder / "protocol.txt").write_text("airzoo-mini-reconstruction\n")
    for scene in SCENES:
        random = np.random.default_rng(2)
        truth = read_reconstruction(mini.benchmark, scene)
        images = truth.photos["image"]
        cameras, poses = truth.cameras, truth.poses
        # The middle pixel of each three by three is at the centre of the larger one.
        start, wide = smaller // 2, 640 // smaller * smaller
        rows, columns = slice(start, None, smaller), slice(start, wide, smaller)
        depth = np.stack([change(mini.depth(scene, i)[rows, columns], random) for i in images])
        K = np.zeros((len(images), 3, 3))
        K[:, 0, 0], K[:, 1, 1] = cameras.focal.T / smaller
        K[:, 0, 2], K[:, 1, 2] = cameras.principal_point.T / smaller
        K[:, 2, 2] = 1
        np.savez(
            folder / f"{scene}.npz",
            depth=depth.astype(np.float32),
            intrinsics=K,
            extrinsics=np.concatenate([poses.rotation, poses.translation[..., None]], axis=2),
            image_names=images.to_numpy(str),
        )
    return evaluate(folder, data=mini.root, resources=Resources(jobs=2)).result


def noisy(share: float) -> Change:
    return lambda depth, random: depth * (1 + random.normal(0, share, depth.shape))


def scaled(factor: float) -> Change:
    return lambda depth, _: depth * factor


def holed(share: float) -> Change:
    """Lose whole columns from the left: what is seen nowhere else is missing."""
    return lambda depth, _: np.where(np.arange(depth.shape[1]) < share * depth.shape[1], 0.0, depth)


def test_perfect_depth_is_perfect(mini: Prepared, tmp_path: Path) -> None:
    overall = reconstruct(mini, tmp_path / "p", lambda depth, _: depth, smaller=1).overall
    assert overall["f1_10m"] == 1.0
    assert overall["f1_1m"] == 1.0
    assert overall["chamfer_m"] < 1e-3
    assert overall["pose_auc_3deg"] == pytest.approx(1.0, abs=1e-6)
    assert overall["ate_m"] < 1e-6


@pytest.mark.parametrize(
    ("what", "steps"),
    [
        (noisy, (0.0, 0.01, 0.05, 0.2)),
        (scaled, (1.0, 1.02, 1.1, 1.3)),
        (holed, (0.0, 0.4, 0.7, 0.9)),
    ],
    ids=["noise", "scale", "holes"],
)
def test_worse_depth_scores_worse(
    mini: Prepared, tmp_path: Path, what: Callable[[float], Change], steps: tuple[float, ...]
) -> None:
    results = [reconstruct(mini, tmp_path / f"{step}", what(step)).overall for step in steps]
    chamfer = [result["chamfer_m"] for result in results]
    f1 = [result["f1_1m"] for result in results]
    assert all(better < worse for better, worse in pairwise(chamfer))
    assert all(better > worse for better, worse in pairwise(f1))


# --- geometry --------------------------------------------------------------------------------


def geometry(scene: PosedScene, depth: Path) -> DepthConsistency:
    return check_depth_consistency(
        scene,
        depth,
        sampling=Sampling(1024, 0, DepthKind.Z, None),
        rule=PairRule.ALL,
        median_below=PAPER_MEDIAN,
    )


def test_geometry_is_right_and_a_small_fault_is_caught(mini: Prepared, tmp_path: Path) -> None:
    (scene,) = scenes_of_benchmark(mini.benchmark, "city")
    depth = scene.folder.parent / "depth"
    sound = geometry(scene, depth)
    assert sound.median < PAPER_MEDIAN
    assert sound.passes
    # All poses turned by 0.1 degree about their own right-hand axis.
    tilt = np.radians(0.1)
    turn = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    poses = Poses(rotation=turn @ scene.poses.rotation, centres=scene.poses.centres)
    assert not geometry(replace(scene, poses=poses), depth).passes
    # One pose among all.
    one = scene.poses.rotation.copy()
    one[20] = turn @ one[20]
    poses = Poses(rotation=one, centres=scene.poses.centres)
    assert not geometry(replace(scene, poses=poses), depth).passes
    # All depths 0.2 % too large.
    for path in depth.glob("*.tif"):
        with Image.open(path) as picture:
            np.save(tmp_path / f"{path.stem}.npy", np.asarray(picture) * np.float32(1.002))
    assert not geometry(scene, tmp_path).passes


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


def test_its_truth_is_the_same_on_every_machine(mini: Prepared) -> None:
    page = (Path(__file__).parents[3] / "docs" / "airzoo-mini.md").read_text(encoding="utf-8")
    found: dict[str, dict[str, str]] = {}
    for scene in SCENES:
        folder = mini.benchmark.scene_folder(scene)
        found.setdefault("retrieval", {})[scene] = read_retrieval(folder, scene).fingerprint
        for track, read in (("matching", read_matching), ("reconstruction", read_reconstruction)):
            found.setdefault(track, {})[scene] = read(mini.benchmark, scene).fingerprint
    for track, truths in found.items():
        assert f"truth {fingerprint(truths)[:12]}," in page, track


# --- this repository's own submissions -------------------------------------------------------


@pytest.mark.parametrize("folder", OWN, ids=lambda folder: folder.name)
def test_this_repositorys_submissions_score_as_they_claim(mini: Prepared, folder: Path) -> None:
    board = read_board(CHECKOUT / BOARD_FILE)
    known = known_submissions(CHECKOUT)
    checked = check_submission(folder, board, mini.root, known=known)
    assert not checked.errors
    rescored = rescore(checked, data=mini.root, resources=Resources(jobs=2))
    assert rescored.agrees, rescored.lines
    if folder.parent.name == "matching":  # which the rule on the class of a method looks at
        counts = rescored.evaluation.result.counts
        assert {scene: found["near_prior"] for scene, found in counts.items()} == dict.fromkeys(
            SCENES, 0
        )
