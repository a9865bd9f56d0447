"""Clouds in memory against a made truth: scores cannot be bought, and are the same to the bit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.evaluation.track import Run
from airzoo_bench.formats.clouds.cloud import CloudSource
from airzoo_bench.protocol.model import load_protocol, shipped_protocols
from airzoo_bench.reconstruction import track
from airzoo_bench.reconstruction.clouds import box_of, cloud_of, observed_cells
from airzoo_bench.reconstruction.settings import ReconstructionProtocol
from airzoo_bench.reconstruction.track import Comparison, compare, pose_scores, score_comparison
from airzoo_bench.reconstruction.truth import open_true_cloud
from tests.formats.cloud_support import LIMIT, SAMPLING
from tests.reconstruction.support import surface, write_laz
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
    points: Any, truth: Any, used: ReconstructionProtocol, *, block: int = 1 << 20, jobs: int = 1
) -> tuple[dict[str, Any], Comparison]:
    run = Run(memory_bytes=block * track._BYTES_A_POINT, jobs=jobs)
    cloud, true = (cloud_of(one) if isinstance(one, np.ndarray) else one for one in (points, truth))
    found = compare(cloud, TRUTH.posed, TRUTH, true, used, run)
    posed = pose_scores(TRUTH.posed, found.alignment.transform, TRUTH.posed, used.scores)
    scored = score_comparison("yard", found, posed, used.scores)
    record: dict[str, Any] = scored.records.iloc[0].to_dict()
    return record, found


def bought(points: Array, **sections: Any) -> dict[str, Any]:
    """Return the record of a cloud in the yard by the shipped preparation and scores."""
    shipped = load_protocol(shipped_protocols()["photos-reconstruction"]).model_dump()
    given = {name: shipped[name] | sections.get(name, {}) for name in ("preparation", "scores")}
    used = protocol(alignment={"method": "none"}, **given)
    return compared(points, true_points("yard"), used)[0]


def test_a_flood_with_one_true_point_many_times_over() -> None:
    along, up = np.arange(0.0, SIDE, 1.1), np.arange(-5.0, 25.0, 1.1)
    flood = np.stack(np.meshgrid(along, along, up), axis=-1).reshape(-1, 3) + ORIGIN
    cheat = np.concatenate([flood, np.repeat(true_points("yard")[:1], 400_000, axis=0)])
    plain = {"crop": "none", "region": "all", "voxel_m": "none"}
    unlimited = {"max_distance_m": "none"}
    assert bought(cheat, preparation=plain, scores=unlimited)["f1_1m"] > 0.9
    assert bought(cheat)["f1_1m"] < 0.2
    # An honest sparse cloud: every 40th true point, off by 0.2 m.
    sparse = true_points("yard")[::40]
    sparse = sparse + np.random.default_rng(0).normal(0, 0.2, sparse.shape)
    assert bought(sparse)["f1_1m"] > 0.3


def test_recall_is_over_the_points_that_the_photos_saw() -> None:
    points, poses = true_points("yard"), camera_poses("yard")
    everywhere = bought(points)
    assert everywhere["f1_1m"] == 1.0
    assert 0 < everywhere["truth_unseen"] < everywhere["truth_points"]
    cloud, settings = cloud_of(points), protocol().preparation
    seen = observed_cells(cloud, box_of(cloud), lenses(len(poses)), poses, settings, 1 << 20)
    observed = points[seen.holds(points)]
    # Voxels lie across the borders of cells, so that a few are lost.
    recall = bought(observed)["recall_1m"]
    assert recall > 0.95
    assert bought(observed, preparation={"region": "all"})["recall_1m"] < recall - 0.02


VARIANTS: dict[str, dict[str, Any]] = {
    "sim3": {},
    "none": {"alignment": {"method": "none"}},
    "icp": {"alignment": {"method": "sim3+icp", "icp_points": 500_000, "icp_iterations": 5}},
    "covered": {"preparation": {"crop": "covered", "crop_margin_m": 2.0}},
    "observed": {"preparation": {"region": "observed"}},
    "voxels": {"preparation": {"voxel_m": 0.7}, "scores": {"f1_below_m": (2.0, 10.0)}},
}


@pytest.mark.parametrize("variant", list(VARIANTS))
def test_the_same_for_any_blocks_threads_and_order(
    variant: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(track, "_LEAST_BLOCK", 1)
    used, random = protocol(**VARIANTS[variant]), np.random.default_rng(0)
    truth = true_points("yard")
    points = truth + random.normal(0, 0.4, truth.shape)
    points[:50] += 300.0
    points[50:60] = np.nan
    one, found = compared(points, truth, used)
    other, again = compared(points, truth, used, block=3001, jobs=3)
    assert str(one) == str(other)
    np.testing.assert_array_equal(found.curve.f1, again.curve.f1)
    if variant != "icp":
        shuffled = random.permutation(points), random.permutation(truth)
        assert str(compared(*shuffled, used)[0]) == str(one)


def in_shards(folder: Path, points: Array, count: int) -> CloudSource:
    folder.mkdir(parents=True)
    for number, part in enumerate(np.array_split(points, count)):
        write_laz(folder / f"tile-{number:02}.laz", part)
    return open_true_cloud(folder, LIMIT, SAMPLING)


@pytest.mark.parametrize(
    "steps",
    [{"region": "observed", "observed_cell_m": 2.0}, {"crop": "covered", "voxel_m": 0.1}],
)
def test_shards_score_as_one_cloud_does(
    steps: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(track, "_LEAST_BLOCK", 300)
    first, second = (one + ORIGIN - 50.0 for one in (surface(2000, 0, far=0.05), surface(1500, 1)))
    first = np.vstack((first, first[::3] + 0.01, first[::7] + 0.003))  # shards share voxels
    used = protocol(alignment={"method": "none", "cameras": "optional"}, preparation=steps)
    both = [in_shards(tmp_path / "one", first, 6), in_shards(tmp_path / "two", second, 4)]
    write_laz(tmp_path / "one" / "tile-021.laz", np.zeros((0, 3)))
    joined = [np.concatenate([piece.points for piece in one.pieces(50)]) for one in both]
    whole, there = compared(*joined, used)
    assert (whole["thinned"] > 500) == ("voxel_m" in steps)
    record, found = compared(*both, used, block=0)
    assert str(record) == str(whole)
    for expected, measured in zip(there.distances, found.distances, strict=True):
        np.testing.assert_array_equal(measured, expected)
