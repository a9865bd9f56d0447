"""Alignment by cameras: exact ones, half of them bad, strips, and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from scipy.spatial.transform import Rotation

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.reconstruction.alignment import (
    PosedCameras,
    RansacSettings,
    align,
    partners,
)
from airzoo_bench.reconstruction.similarity import AlignmentError
from tests.geometry.support import quick, seeds
from tests.reconstruction.posed_cameras import (
    RANSAC,
    UTM,
    assert_same,
    cameras,
    grid,
    made_by,
    moved,
    seen_from,
    sim3,
    strip,
)


@quick
@given(seeds)
def test_sim3_is_exact_and_ignores_outliers(seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth, made = grid(rng), made_by(rng)
    predicted = moved(seen_from(truth, made), [3, 11, 17, 20, 22], rng.uniform(2, 9, (5, 3)))
    found = sim3(predicted, truth, RANSAC)
    assert_same(found.transform, made, rng.normal(size=(9, 3)), 1e-7)
    assert (found.cameras, found.inliers, found.cameras_missing) == (24, 19, 0)
    assert found.robust
    assert not found.used_orientations
    assert found.inlier_centres is not None
    assert found.inlier_centres["largest"] < 1e-7
    assert found.centres is not None
    assert found.centres["largest"] > 25.0
    assert found.centres["median"] < 1e-7
    # Only centres were moved.
    assert found.rotations_deg is not None
    assert found.rotations_deg["largest"] < 1e-8


def test_residuals_by_hand() -> None:
    truth = PosedCameras(("a", "b", "c"), np.array(((0, 0, 0), (1, 0, 0), (0, 1, 0.0))))
    predicted = moved(truth, [0, 1], np.array(((3.0, 0, 0), (0, 4.0, 0))))
    found = align("none", predicted, truth, RANSAC)
    assert found.centres is not None
    assert found.centres["rms"] == pytest.approx((25 / 3) ** 0.5)
    assert (found.centres["median"], found.centres["largest"]) == (3.0, 4.0)
    assert found.rotations_deg is None
    assert found.transform.scale == 1.0


def test_rule_for_the_limit() -> None:
    rng = np.random.default_rng(0)
    truth, made = grid(rng), made_by(rng)
    noisy = moved(seen_from(truth, made), list(range(24)), rng.normal(0, 0.01, (24, 3)))
    found = sim3(noisy, truth, replace(RANSAC, inlier_limit=None, sample_share=0.5, max_trials=50))
    # The median distance is near 0.01 * 25 * 1.54, that of a normal vector in space.
    assert found.inlier_limit_m == pytest.approx(0.385, rel=0.4)
    assert 8 <= found.inliers <= 20
    assert_same(found.transform, made, made.inverse().apply(truth.centres), 0.5)
    exact = sim3(seen_from(truth, made), truth, replace(RANSAC, inlier_limit=None))
    assert exact.inliers == 24


@quick
@given(seeds)
def test_a_strip_is_aligned_by_orientations(seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth, made = strip(rng), made_by(rng)
    found = sim3(seen_from(truth, made), truth, RANSAC)
    assert found.used_orientations
    assert found.inliers == 12
    assert_same(found.transform, made, rng.normal(size=(9, 3)), 1e-6)


def test_a_strip_with_outliers() -> None:
    rng = np.random.default_rng(2)
    truth, made = strip(rng), made_by(rng)
    predicted = moved(seen_from(truth, made), [2, 7], 4.0)
    assert predicted.rotation is not None
    # Another camera is turned by a right angle.
    predicted.rotation[5] = (
        predicted.rotation[5] @ Rotation.from_euler("z", 90, degrees=True).as_matrix()
    )
    found = sim3(predicted, truth, RANSAC)
    assert found.used_orientations
    assert found.inliers == 9  # on a line, what is turned is no inlier either
    assert_same(found.transform, made, rng.normal(size=(9, 3)), 1e-6)
    assert found.rotations_deg is not None
    assert found.rotations_deg["largest"] == pytest.approx(90.0)


@pytest.mark.parametrize("whose", ["truth", "prediction"])
def test_a_strip_without_orientations_is_refused(whose: str) -> None:
    rng = np.random.default_rng(4)
    truth = strip(rng)
    predicted = seen_from(truth, made_by(rng))
    bare = {"truth": truth, "prediction": predicted}
    bare[whose] = replace(bare[whose], rotation=None)
    with pytest.raises(AlignmentError, match=f"on a line.*the {whose} has no orientations"):
        sim3(bare["prediction"], bare["truth"], RANSAC)


def test_a_strip_whose_orientations_are_backwards() -> None:
    rng = np.random.default_rng(5)
    truth = strip(rng)
    about = Rotation.from_euler("z", 180, degrees=True).as_matrix()
    assert truth.rotation is not None
    with pytest.raises(PredictionError, match="orientations contradict"):
        sim3(replace(truth, rotation=truth.rotation @ about), truth, RANSAC)


def test_fewer_than_three_cameras_are_refused() -> None:
    truth = grid(np.random.default_rng(8))
    placed = truth.centres.copy()
    placed[2:] = np.nan
    with pytest.raises(AlignmentError, match="needs 3 cameras, and 2 of 24"):
        sim3(replace(truth, centres=placed), truth, RANSAC)


def test_cameras_are_partners_by_name() -> None:
    rng = np.random.default_rng(9)
    truth, made = grid(rng), made_by(rng)
    order = rng.permutation(24)[:20]
    found = sim3(seen_from(truth, made).take(order), truth, RANSAC)
    assert_same(found.transform, made, rng.normal(size=(9, 3)), 1e-7)
    assert (found.cameras, found.cameras_missing) == (20, 4)
    rows, true_rows = partners(truth.take(order), truth)
    np.testing.assert_array_equal(order[rows], true_rows)
    np.testing.assert_array_equal(true_rows, np.sort(order))


SHIPPED = RansacSettings(inlier_limit=5.0)


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


@pytest.mark.parametrize("count", [18, 60])
@pytest.mark.parametrize("width", WIDTHS)
def test_half_of_the_cameras_may_be_bad(count: int, width: float) -> None:
    assert survivals(count, width, 0.5, runs=5) == 5


@pytest.mark.slow
@pytest.mark.parametrize("count", [18, 60, 600])
@pytest.mark.parametrize("width", WIDTHS)
def test_half_of_the_cameras_may_be_bad_in_99_of_100_runs(count: int, width: float) -> None:
    assert survivals(count, width, 0.5, runs=100) >= 99


def test_the_order_of_cameras_does_not_matter() -> None:
    rng = np.random.default_rng(1)
    truth, made = flight(60, 40.0, rng), made_by(rng)
    predicted = seen_from(half_bad(truth, 0.5, rng), made)
    one = sim3(predicted, truth, SHIPPED).transform.matrix
    other = sim3(predicted.take(rng.permutation(60)), truth, SHIPPED).transform.matrix
    assert one.tobytes() == other.tobytes()
