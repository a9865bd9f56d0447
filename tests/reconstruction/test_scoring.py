"""Clouds in memory against a made truth: what cannot be bought, and the same to the last bit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.evaluation.track import Run
from airzoo_bench.protocol.model import load_protocol, shipped_protocols
from airzoo_bench.reconstruction import scoring
from airzoo_bench.reconstruction.alignment import PosedCameras
from airzoo_bench.reconstruction.clouds import cloud_of
from airzoo_bench.reconstruction.preparation import box_of, observed_cells
from airzoo_bench.reconstruction.scoring import (
    Comparison,
    compare,
    pose_scores,
    score_comparison,
)
from airzoo_bench.reconstruction.settings import ReconstructionProtocol
from airzoo_bench.reconstruction.truth import open_true_cloud
from tests.formats.cloud_support import LIMIT, SAMPLING
from tests.reconstruction.cloud_support import in_shards, opened, points_in, surface, write_laz
from tests.reconstruction.world import (
    ORIGIN,
    SIDE,
    Array,
    camera_poses,
    lenses,
    made_truth,
    protocol,
    true_points,
)

TRUTH = made_truth("yard")


def compared(
    points: Any,
    truth: Any,
    used: ReconstructionProtocol,
    *,
    block_points: int = 1 << 20,
    jobs: int = 1,
) -> tuple[dict[str, Any], Comparison]:
    poses = camera_poses("yard")
    cameras = PosedCameras(TRUTH.posed.names, poses.centres, poses.rotation)
    run = Run(memory_bytes=block_points * scoring._BYTES_A_POINT, jobs=jobs)
    sources = [
        cloud_of(cloud) if isinstance(cloud, np.ndarray) else cloud for cloud in (points, truth)
    ]
    found = compare(sources[0], cameras, TRUTH, sources[1], used, run)
    posed = pose_scores(cameras, found.alignment.transform, TRUTH.posed, used.scores)
    scored = score_comparison("yard", found, posed, used.scores)
    record: dict[str, Any] = scored.records.iloc[0].to_dict()
    return record, found


def scored(points: Any, truth: Any, used: ReconstructionProtocol, **run: int) -> dict[str, Any]:
    return compared(points, truth, used, **run)[0]


def bought(points: Array, **sections: Any) -> dict[str, Any]:
    """Return the record of a cloud in the yard by the shipped preparation and scores."""
    chosen = load_protocol(shipped_protocols()["photos-reconstruction"])
    assert isinstance(chosen, ReconstructionProtocol)
    shipped = chosen.model_dump()
    given = {name: shipped[name] for name in ("preparation", "scores")}
    given |= {"alignment": {"method": "none"}}
    for name, changes in sections.items():
        given[name] = given[name] | changes
    return scored(points, true_points("yard"), protocol(**given))


PLAIN = {
    "preparation": {"crop": "none", "region": "all", "voxel_m": "none"},
    "scores": {"max_distance_m": "none"},
}


def sparse() -> Array:
    """Return an honest sparse cloud: every 40th true point, off by 0.2 m."""
    points = true_points("yard")[::40]
    return points + np.random.default_rng(0).normal(0, 0.2, points.shape)


def test_a_flood_with_one_true_point_many_times_over() -> None:
    along = np.arange(0.0, SIDE, 1.1)
    up = np.arange(-5.0, 25.0, 1.1)
    flood = np.stack(np.meshgrid(along, along, up), axis=-1).reshape(-1, 3) + ORIGIN
    cheat = np.concatenate([flood, np.repeat(true_points("yard")[:1], 400_000, axis=0)])
    assert bought(cheat, **PLAIN)["f1_1m"] > 0.9
    record = bought(cheat)
    assert record["f1_1m"] < 0.2
    assert bought(sparse())["f1_1m"] > 0.3


def test_recall_is_over_what_the_photos_saw() -> None:
    points = true_points("yard")
    everywhere = bought(points)
    assert everywhere["f1_1m"] == 1.0
    assert 0 < everywhere["truth_unseen"] < everywhere["truth_points"]
    observed = observed_part(points)
    kept = bought(points[observed])
    # Voxels lie across the borders of cells, so that a few are lost.
    assert kept["recall_1m"] > 0.95
    over_all = bought(points[observed], preparation={"region": "all"})
    assert over_all["recall_1m"] < kept["recall_1m"] - 0.02


def observed_part(points: Array) -> Array:
    poses = camera_poses("yard")
    settings = protocol(preparation={"observed_cell_m": 1.0, "hidden_beyond_m": 5.0}).preparation
    cloud, cameras = cloud_of(points), lenses(len(poses))
    cells = observed_cells(cloud, box_of(cloud), cameras, poses, settings, 1 << 20)
    return cells.holds(points)


VARIANTS: dict[str, dict[str, Any]] = {
    "sim3": {},
    "none": {"alignment": {"method": "none"}},
    "icp": {"alignment": {"method": "sim3+icp", "icp_points": 500_000, "icp_iterations": 5}},
    "box": {"preparation": {"crop": "box", "crop_margin_m": 2.0}},
    "covered": {"preparation": {"crop": "covered", "crop_margin_m": 2.0}},
    "observed": {"preparation": {"region": "observed"}},
    "voxels": {"preparation": {"voxel_m": 0.7}, "scores": {"f1_below_m": (2.0, 10.0)}},
}


def noisy(seed: int = 0) -> Array:
    random = np.random.default_rng(seed)
    points = true_points("yard") + random.normal(0, 0.4, true_points("yard").shape)
    points[:50] += 300.0
    points[50:60] = np.nan
    return points


@pytest.mark.parametrize("variant", list(VARIANTS))
def test_the_same_for_any_block_size_and_number_of_threads(
    variant: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(scoring, "_LEAST_BLOCK", 1)
    used = protocol(**VARIANTS[variant])
    runs = [
        compared(noisy(), true_points("yard"), used, block_points=block, jobs=jobs)
        for block, jobs in ((1 << 20, 1), (3001, 3))
    ]
    (one, curve), (other, again) = runs
    assert str(one) == str(other)
    np.testing.assert_array_equal(curve.curve.f1, again.curve.f1)


@pytest.mark.parametrize("variant", ["sim3", "none", "box", "covered", "observed", "voxels"])
def test_the_same_for_any_order_of_points(variant: str) -> None:
    used, truth, points = protocol(**VARIANTS[variant]), true_points("yard"), noisy()
    random = np.random.default_rng(1)
    one = scored(points, truth, used)
    other = scored(random.permutation(points), random.permutation(truth), used)
    assert str(one) == str(other)


PREPARATIONS: list[dict[str, Any]] = [
    {"crop": "none", "voxel_m": "none"},
    {"crop": "covered", "voxel_m": "none"},
    {"crop": "box", "voxel_m": 0.1},
    {"crop": "box", "voxel_m": "none", "region": "observed", "observed_cell_m": 2.0},
    {"crop": "covered", "voxel_m": 0.1},
]


@pytest.mark.parametrize("steps", PREPARATIONS)
@pytest.mark.parametrize("block", [300, 1 << 20])
def test_shards_score_what_one_cloud_scores(
    steps: dict[str, Any], block: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(scoring, "_LEAST_BLOCK", block)
    first, second = (
        some - 50.0 + ORIGIN for some in (surface(2000, 0, far=0.05), surface(1500, 1))
    )
    first = np.vstack((first, first[::3] + 0.01, first[::7] + 0.003))  # shards share voxels
    used = protocol(alignment={"method": "none", "cameras": "optional"}, preparation=steps)
    shards = in_shards(tmp_path / "shards", first, 6, write_laz, ".laz")
    write_laz(shards / "tile-021.laz", np.zeros((0, 3)))
    truth = in_shards(tmp_path / "truth", second, 4, write_laz, ".laz")
    plain = [points_in(opened(folder)) for folder in (shards, truth)]
    whole, there = compared(*plain, used)
    assert (whole["thinned"] > 500) == (steps["voxel_m"] == 0.1)
    true_cloud = open_true_cloud(truth, LIMIT, SAMPLING)
    record, found = compared(opened(shards), true_cloud, used, block_points=0)
    assert str(record) == str(whole)
    for way in ("to_truth", "to_prediction"):
        expected = getattr(there.distances, way)
        np.testing.assert_array_equal(getattr(found.distances, way), expected)
