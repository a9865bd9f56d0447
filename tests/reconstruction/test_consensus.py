"""Alignment of cameras half of which are bad, and the samples that it draws."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from scipy.spatial.transform import Rotation

from airzoo_bench.reconstruction.alignment import PosedCameras, RansacSettings, sample_blocks
from tests.geometry.support import quick, seeds
from tests.reconstruction.posed_cameras import UTM, cameras, made_by, seen_from, sim3

# Half of the cameras are bad: placed anywhere, turned anyhow.

SHIPPED = RansacSettings(
    min_trials=1000,
    max_trials=100_000,
    confidence=0.9999,
    sample_share=None,
    inlier_limit=5.0,
    inlier_limit_deg=10.0,
    line_ratio=0.1,
    seed=0,
)


def flight(count: int, width: float, rng: np.random.Generator) -> PosedCameras:
    """Cameras along 600 m, as wide as so many metres, 80 m above ground."""
    along = np.linspace(0, 600, count)
    across = rng.uniform(-width / 2, width / 2, count)
    centres = np.stack((along, across, 80 + rng.normal(0, width / 20, count)), axis=1)
    return cameras(centres + UTM, rng)


def half_bad(truth: PosedCameras, share: float, rng: np.random.Generator) -> PosedCameras:
    """Return cameras of which a share is bad; the others are off by 0.3 m and 0.5 degrees."""
    count = len(truth.names)
    bad = rng.permutation(count)[: int(share * count)]
    centres = truth.centres + rng.normal(0, 0.3, (count, 3))
    box = truth.centres.min(axis=0) - 50, truth.centres.max(axis=0) + 50
    centres[bad] = rng.uniform(*box, (len(bad), 3))
    shake = Rotation.from_rotvec(rng.normal(0, 0.5, (count, 3)), degrees=True).as_matrix()
    assert truth.rotation is not None
    rotation = shake @ truth.rotation
    rotation[bad] = Rotation.random(len(bad), random_state=rng).as_matrix()
    return PosedCameras(truth.names, centres, rotation)


def survivals(count: int, width: float, share: float, runs: int) -> int:
    """Count runs in which ground points below the flight are within 3 m of their places."""
    survived = 0
    for seed in range(runs):
        rng = np.random.default_rng((seed, count, int(width)))
        truth, made = flight(count, width, rng), made_by(rng)
        predicted = seen_from(half_bad(truth, share, rng), made)
        found = sim3(predicted, truth, replace(SHIPPED, seed=seed))
        ground = truth.centres * (1, 1, 0)
        away = found.transform.apply(made.inverse().apply(ground)) - ground
        survived += bool(np.sqrt((away * away).sum(axis=1)).max() < 3.0)
    return survived


WIDTHS = (5.0, 40.0, 300.0)  # a line, nearly one, a block of strips


@pytest.mark.parametrize("count", [18, 60, 600])
@pytest.mark.parametrize("width", WIDTHS)
def test_half_of_the_cameras_may_be_bad(count: int, width: float) -> None:
    assert survivals(count, width, 0.5, runs=5) == 5


@pytest.mark.slow
@pytest.mark.parametrize("count", [18, 60, 600])
@pytest.mark.parametrize("width", WIDTHS)
def test_half_of_the_cameras_may_be_bad_in_99_of_100_runs(count: int, width: float) -> None:
    assert survivals(count, width, 0.5, runs=100) >= 99


def test_the_rule_of_depth_anything_3_breaks_where_minimal_samples_do_not() -> None:
    rng = np.random.default_rng(0)
    truth, made = flight(600, 300.0, rng), made_by(rng)
    predicted = seen_from(half_bad(truth, 0.3, rng), made)
    assert sim3(predicted, truth, SHIPPED).inliers >= 420
    theirs = replace(SHIPPED, sample_share=0.5, min_trials=1000, max_trials=1000, confidence=1.0)
    found = sim3(predicted, truth, theirs)
    assert found.inliers < 50 or not found.robust


def test_the_order_of_cameras_does_not_matter() -> None:
    rng = np.random.default_rng(1)
    truth, made = flight(60, 40.0, rng), made_by(rng)
    predicted = seen_from(half_bad(truth, 0.5, rng), made)
    one = sim3(predicted, truth, SHIPPED).transform.matrix
    other = sim3(predicted.take(rng.permutation(60)), truth, SHIPPED).transform.matrix
    assert one.tobytes() == other.tobytes()


@quick
@given(seeds)
def test_samples_are_distinct_and_seeded(seed: int) -> None:
    rng = np.random.default_rng(seed)
    count, size = int(rng.integers(5, 40)), int(rng.integers(2, 5))
    settings = replace(SHIPPED, seed=seed, min_trials=1, max_trials=120)
    blocks = list(sample_blocks(count, size, settings, minimal=True))
    rows = np.concatenate(blocks)
    assert rows.shape == (120, size)
    assert (np.diff(rows, axis=1) > 0).all()
    assert rows.min() >= 0
    assert rows.max() < count
    again = np.concatenate(list(sample_blocks(count, size, settings, minimal=True)))
    np.testing.assert_array_equal(rows, again)


def test_few_samples_are_all_tried_once() -> None:
    rows = np.concatenate(list(sample_blocks(6, 3, SHIPPED, minimal=True)))
    assert len({tuple(row) for row in rows.tolist()}) == len(rows) == 20


def test_each_row_is_drawn_as_often() -> None:
    settings = replace(SHIPPED, max_trials=20_000)
    rows = np.concatenate(list(sample_blocks(30, 3, settings, minimal=True)))
    np.testing.assert_allclose(np.bincount(rows.ravel()) / 2000, 1.0, atol=0.1)
