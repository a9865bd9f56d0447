"""Clouds in memory against a made truth: what cannot be bought, and the same to the last bit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from airzoo_bench.evaluation.track import Run
from airzoo_bench.protocol.lookup import load_protocol, shipped_protocols
from airzoo_bench.reconstruction import scenes
from airzoo_bench.reconstruction.alignment.camera_sets import PosedCameras
from airzoo_bench.reconstruction.cloud_sources import InMemoryCloud
from airzoo_bench.reconstruction.regions import bounding_box
from airzoo_bench.reconstruction.scenes import score_geometry
from airzoo_bench.reconstruction.scoring import ScoredScene
from airzoo_bench.reconstruction.settings import ReconstructionProtocol
from airzoo_bench.reconstruction.visibility import observed_cells
from tests.geometry.support import quick, seeds
from tests.reconstruction.cloud_support import all_pairs
from tests.reconstruction.world import (
    ORIGIN,
    SIDE,
    STEP,
    Array,
    camera_poses,
    ground,
    lenses,
    made_truth,
    protocol,
    true_points,
)

TRUTH = made_truth("yard")


def scored(
    points: Array,
    truth: Array,
    used: ReconstructionProtocol,
    *,
    block_points: int = 1 << 20,
    jobs: int = 1,
) -> ScoredScene:
    poses = camera_poses("yard")
    cameras = PosedCameras(TRUTH.posed.names, poses.centres, poses.rotation)
    predicted, true = (InMemoryCloud(cloud) for cloud in (points, truth))
    resources = Run(memory_bytes=block_points * scenes._BYTES_A_POINT, jobs=jobs)
    return score_geometry(predicted, cameras, TRUTH, true, used, resources)


# What cannot be bought: the shipped preparation against clouds that know nothing of the scene.


def bought(points: Array, **sections: Any) -> dict[str, Any]:
    """Return the record of a cloud in the yard by the shipped preparation and scores."""
    chosen = load_protocol(shipped_protocols()["photos-reconstruction"])
    assert isinstance(chosen, ReconstructionProtocol)
    shipped = chosen.model_dump()
    given = {name: shipped[name] for name in ("preparation", "scores")}
    given |= {"alignment": {"method": "none"}}
    for name, changes in sections.items():
        given[name] = given[name] | changes
    return scored(points, true_points("yard"), protocol(**given)).record


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
    cheat = np.concatenate([flood, np.repeat(true_points("yard")[:1], 800_000, axis=0)])
    assert bought(cheat, **PLAIN)["f1_1m"] > 0.9
    record = bought(cheat)
    assert record["f1_1m"] < 0.2
    assert bought(sparse())["f1_1m"] > 0.3


def test_a_flat_plane_through_the_scene() -> None:
    plane = ground(height=3.0) + ORIGIN
    assert bought(plane, **PLAIN)["f1_10m"] > 0.9
    cheat, honest = bought(plane), bought(sparse())
    assert honest["f1_10m"] >= cheat["f1_10m"]
    for limit in (1, 2):
        assert honest[f"f1_{limit}m"] > cheat[f"f1_{limit}m"] + 0.2
    assert honest["chamfer_m"] < cheat["chamfer_m"]


def test_one_point_at_the_end_of_the_world() -> None:
    far = np.concatenate([true_points("yard"), [[1e9, 1e9, 1e9]]])
    assert bought(far, **PLAIN)["chamfer_m"] > 10_000
    clipped = bought(far, preparation=PLAIN["preparation"])
    assert clipped["chamfer_m"] == pytest.approx(100 / 15_265 / 2, rel=1e-9)
    assert bought(far)["chamfer_m"] == 0.0  # it lies outside of what the truth covers


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
    cloud, cameras = InMemoryCloud(points), lenses(len(poses))
    cells = observed_cells(cloud, bounding_box(points), cameras, poses, settings, 1 << 20)
    return cells.holds(points)


def test_rounded_coordinates_do_not_lie_on_borders_of_voxels() -> None:
    points = np.round(noisy()[60:], 2)
    exact, shaken = bought(points), bought(points + 1e-7)
    assert exact["points"] == shaken["points"]
    assert exact["chamfer_m"] == pytest.approx(shaken["chamfer_m"], abs=1e-6)


def test_voxels_wider_than_half_of_a_threshold_are_refused() -> None:
    with pytest.raises(ValidationError, match="must be at least two voxels"):
        protocol(preparation={"voxel_m": 0.5})


# A naive version of everything.


@quick
@given(seeds, st.sampled_from((1.0, 30.0, 1000.0)))
def test_the_naive_version_finds_the_same(seed: int, spread: float) -> None:
    random = np.random.default_rng(seed)
    counts = random.integers(1, 60, 2)
    points, truth = (random.uniform(0, spread, (count, 3)) + ORIGIN for count in counts)
    record = scored(points, truth, protocol(alignment={"method": "none"})).record
    there, back = all_pairs(points, truth), all_pairs(truth, points)
    assert record["accuracy_m"] == pytest.approx(there.mean(), rel=1e-12)
    assert record["completeness_median_m"] == pytest.approx(np.median(back), rel=1e-12)
    for limit in (0.2, 1.0, 10.0):
        assert record[f"precision_{limit:g}m"] == (there < limit).mean()
        assert record[f"recall_{limit:g}m"] == (back < limit).mean()


# The same to the last bit.

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
    monkeypatch.setattr(scenes, "_LEAST_BLOCK", 1)
    used = protocol(**VARIANTS[variant])
    runs = [
        scored(noisy(), true_points("yard"), used, block_points=block, jobs=jobs)
        for block, jobs in ((1 << 20, 1), (1 << 20, 2), (3000, 1), (3001, 3))
    ]
    pd.testing.assert_frame_equal(  # exact, NaN equal to NaN
        pd.DataFrame([run.record for run in runs[1:]]),
        pd.DataFrame([runs[0].record] * 3),
        check_exact=True,
    )
    for run in runs[1:]:
        assert run.curve is not None
        assert runs[0].curve is not None
        np.testing.assert_array_equal(run.curve.f1, runs[0].curve.f1)
        assert run.counts == runs[0].counts


@pytest.mark.parametrize("variant", ["sim3", "none", "box", "covered", "observed", "voxels"])
def test_the_same_for_any_order_of_points(variant: str) -> None:
    used, truth, points = protocol(**VARIANTS[variant]), true_points("yard"), noisy()
    random = np.random.default_rng(1)
    one = scored(points, truth, used).record
    other = scored(random.permutation(points), random.permutation(truth), used).record
    pd.testing.assert_frame_equal(pd.DataFrame([one]), pd.DataFrame([other]), check_exact=True)


# Errors fall as predictions get better.


def test_scores_fall_with_noise_holes_and_scale() -> None:
    exact = true_points("yard")
    random = np.random.default_rng(2)
    offsets = random.normal(size=exact.shape)
    middle = exact.mean(axis=0)
    series = {
        "noise": [exact + offsets * size for size in (0.0, 0.3, 1.0, 3.0, 10.0)],
        "scale": [middle + (exact - middle) * (1 + s) for s in (0.0, 0.06, 0.15, 0.4)],
        "holes": [exact[exact[:, 0] < ORIGIN[0] + SIDE * s] for s in (1.0, 0.7, 0.4, 0.1)],
    }
    used = protocol(alignment={"method": "none"})
    for name, clouds in series.items():
        records = [scored(points, exact, used).record for points in clouds]
        chamfer = [record["chamfer_m"] for record in records]
        f1 = [record["f1_1m"] for record in records]
        assert chamfer[0] == 0.0
        assert f1[0] == 1.0
        assert (np.diff(chamfer) > 0).all(), name
        assert (np.diff(f1) < 0).all(), name


def test_the_ground_of_the_made_world_is_a_grid() -> None:
    points = ground()
    assert len(points) == (SIDE / STEP) ** 2
    assert (np.unique(np.diff(np.unique(points[:, 0]))) == STEP).all()
