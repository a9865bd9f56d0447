"""AirZoo-Mini: perfect input scores perfectly, worse input scores worse."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.evaluation.evaluate import evaluate
from airzoo_bench.evaluation.track import Run
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.heightfield import HeightField
from airzoo_bench.geometry.poses import Poses, depth_to_points
from airzoo_bench.geometry.rasters import world_to_pixel
from airzoo_bench.matching.truth import read_truth as read_matching
from airzoo_bench.reconstruction.truth import read_truth as read_reconstruction
from airzoo_bench.results.result import Result
from airzoo_bench.retrieval.truth import read_truth as read_retrieval
from tests.datasets.mini.prepared import Prepared

pytestmark = pytest.mark.slow

SCENES = ("city", "rural")
MEMORY = 1 << 30


# --- retrieval -------------------------------------------------------------------------------


def rank(mini: Prepared, path: Path, right: float) -> Result:
    """Score rankings that begin with a positive tile for a share of the queries."""
    random = np.random.default_rng(0)
    ids, ranked = [], []
    for scene in SCENES:
        truth = read_retrieval(mini.benchmark.scene_folder(scene), scene)
        tiles = truth.tiles["id"].to_numpy(str)
        for row, query in enumerate(truth.queries["id"]):
            positive = truth.positives.of_query(row)
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
    return evaluate(path, data=mini.root, run=Run(jobs=2)).result


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
    return evaluate(folder, data=mini.root, run=Run(jobs=2)).result


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
