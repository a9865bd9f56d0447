"""Alignment by cameras: fits, exact ones, half of them bad, strips, and refusals; ICP."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from scipy.spatial.transform import Rotation

from airzoo_bench.geometry.poses import Poses
from airzoo_bench.reconstruction.alignment import (
    Alignment,
    AlignmentError,
    PosedCameras,
    Similarity,
    align,
    pair_cameras,
    umeyama,
)
from airzoo_bench.reconstruction.checks import alignment_notes
from airzoo_bench.reconstruction.clouds import cloud_of
from airzoo_bench.reconstruction.icp import refine
from tests.geometry.support import quick, seeds
from tests.reconstruction.world import UTM, cameras, moved, ransac, seen_from, shaken, similarity

LINE = np.arange(6.0)[:, None] * (1.0, 2.0, 3.0)
PLANE = np.random.default_rng(5).normal(size=(6, 3))


def sim3(predicted: PosedCameras, truth: PosedCameras, **changes: Any) -> Alignment:
    return align(predicted, truth, ransac(**changes))


def assert_same(found: Similarity, made: Similarity, points: np.ndarray, atol: float) -> None:
    np.testing.assert_allclose(found.apply(points), made.apply(points), rtol=0, atol=atol)


def grid(rng: np.random.Generator) -> PosedCameras:
    x, y = np.meshgrid(np.arange(6.0) * 30, np.arange(4.0) * 40)
    return cameras(np.stack((x.ravel(), y.ravel(), rng.normal(60, 1, 24)), axis=1), rng)


def strip(rng: np.random.Generator) -> PosedCameras:
    along = np.arange(12.0)[:, None] * (20.0, 11.0, 0.5)
    return cameras(along + rng.normal(0, 0.05, (12, 3)), rng)


# --- least squares ---


def test_a_quarter_turn_by_hand() -> None:
    quarter = np.array(((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
    transform = Similarity(2.0, quarter, np.array((10.0, 20.0, 30.0)), np.array((1.0, 1.0, 1.0)))
    # (3, 1, 0) is (2, 0, -1) from the origin, turned (0, 2, -1), doubled (0, 4, -2).
    np.testing.assert_array_equal(transform.apply(np.array((3.0, 1.0, 0.0))), (10.0, 24.0, 28.0))


@pytest.mark.parametrize(
    ("source", "target"),
    [
        (PLANE[:2], PLANE[:2]),
        (LINE, PLANE),
        (PLANE, LINE),
        (LINE.astype(np.float32) / 7, PLANE),
        (PLANE, np.full((6, 3), 0.1)),
    ],
)
def test_degenerate_points_are_refused(source: np.ndarray, target: np.ndarray) -> None:
    for place in (0.0, UTM):
        with pytest.raises(AlignmentError):
            umeyama(source + place, target + place, with_scale=True)


# --- cameras ---


@quick
@given(seeds)
def test_sim3_is_exact_and_ignores_outliers(seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth, made = grid(rng), similarity(rng)
    predicted = moved(seen_from(truth, made), [3, 11, 17, 20, 22], rng.uniform(2, 9, (5, 3)))
    order = rng.permutation(24)
    found = sim3(predicted.take(order), truth)
    assert_same(found.transform, made, rng.normal(size=(9, 3)), 1e-7)
    assert (found.cameras, found.inliers, found.cameras_missing) == (24, 19, 0)
    assert (found.robust, found.used_orientations) == (True, False)
    assert found.values["inlier_centres"]["largest"] < 1e-7
    assert found.values["centres"]["largest"] > 25.0
    assert found.values["rotations_deg"]["largest"] < 1e-8
    rows, true_rows = pair_cameras(truth.take(order[:20]), truth)
    np.testing.assert_array_equal(order[:20][rows], true_rows)
    np.testing.assert_array_equal(true_rows, np.sort(order[:20]))


def test_residuals_by_hand() -> None:
    truth = PosedCameras(("a", "b", "c"), np.array(((0, 0, 0), (1, 0, 0), (0, 1, 0.0))))
    predicted = moved(truth, [0, 1], np.array(((3.0, 0, 0), (0, 4.0, 0))))
    found = align(predicted, truth, ransac(method="none"))
    assert found.centres == {"rms": pytest.approx((25 / 3) ** 0.5), "median": 3.0, "largest": 4.0}
    assert found.rotations_deg is None
    assert found.transform.scale == 1.0


@quick
@given(seeds)
def test_a_strip_is_aligned_by_orientations(seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth, made = strip(rng), similarity(rng)
    exact = seen_from(truth, made)
    found = sim3(exact, truth)
    assert (found.used_orientations, found.inliers) == (True, 12)
    assert_same(found.transform, made, rng.normal(size=(9, 3)), 1e-6)
    predicted = moved(exact, [2, 7], 4.0)
    assert predicted.rotation is not None
    right_angle = Rotation.from_euler("z", 90, degrees=True).as_matrix()
    predicted.rotation[5] = predicted.rotation[5] @ right_angle
    found = sim3(predicted, truth)
    assert found.inliers == 9  # on a line, a camera that is turned is no inlier either
    assert_same(found.transform, made, rng.normal(size=(9, 3)), 1e-6)


@pytest.mark.parametrize("fault", ["truth", "prediction", "two cameras", "one point"])
def test_cameras_that_determine_nothing_are_refused(fault: str) -> None:
    rng = np.random.default_rng(4)
    truth = grid(rng) if fault == "two cameras" else strip(rng)
    predicted = seen_from(truth, similarity(rng))
    given = {
        "truth": (predicted, replace(truth, rotation=None)),
        "prediction": (replace(predicted, rotation=None), truth),
        "two cameras": (predicted.take(np.arange(2)), truth),
        "one point": (replace(predicted, centres=np.zeros((12, 3))), truth),
    }
    with pytest.raises(AlignmentError):
        sim3(*given[fault])


def test_fewer_than_three_that_agree_are_no_inliers() -> None:
    rng = np.random.default_rng(2)
    truth = cameras(rng.uniform(0, 100, (4, 3)), rng)
    apart = moved(truth, [0, 1, 2, 3], rng.uniform(-90, 90, (4, 3)))
    found = sim3(apart, truth)
    assert (found.robust, found.inliers, len(found.inlier_names)) == (False, 0, 4)


def flight(count: int, width: float, rng: np.random.Generator) -> PosedCameras:
    """Cameras along 600 m, as wide as so many metres, 80 m above ground."""
    across = rng.uniform(-width / 2, width / 2, count)
    high = 80 + rng.normal(0, width / 20, count)
    return cameras(np.stack((np.linspace(0, 600, count), across, high), axis=1), rng)


def test_what_is_unusual_of_an_alignment_is_said() -> None:
    rng = np.random.default_rng(0)
    truth = flight(20, 100.0, rng)
    usual = sim3(seen_from(truth, similarity(rng)), truth)
    assert alignment_notes(usual, "sim3") == []
    cases: list[tuple[str, dict[str, Any]]] = [
        ("9 of 20", {"inlier_names": usual.inlier_names[:9]}),
        ("fewer than 3", {"robust": False}),
        ("on a line", {"used_orientations": True}),
        ("179 degrees", {"rotations_deg": {"median": 179.0}}),
        ("no overlap", {"icp_failure": "no overlap"}),
        ("2 of 22", {"cameras_missing": 2}),
        ("no cameras", {"centres": None}),
    ]
    for said, changes in cases:
        [note] = alignment_notes(replace(usual, **changes), "sim3")
        assert said in note


def half_bad(truth: PosedCameras, rng: np.random.Generator) -> PosedCameras:
    """Return cameras of which half are bad; the others are off by 0.3 m and 0.5 degrees."""
    assert truth.rotation is not None
    good = shaken(Poses(rotation=truth.rotation, centres=truth.centres), rng, 0.5, 0.3)
    bad = rng.permutation(len(good))[: len(good) // 2]
    box = truth.centres.min(axis=0) - 50, truth.centres.max(axis=0) + 50
    good.centres[bad] = rng.uniform(*box, (len(bad), 3))
    good.rotation[bad] = Rotation.random(len(bad), random_state=rng).as_matrix()
    return PosedCameras(truth.names, good.centres, good.rotation)


SHIPPED = {"inlier_below_m": 5.0, "line_ratio": 0.1, "min_trials": 1000, "max_trials": 100_000}
RUNS = [(18, 4, 4), *(pytest.param(n, 100, 99, marks=pytest.mark.slow) for n in (18, 600))]


@pytest.mark.parametrize(("count", "runs", "least"), RUNS)
@pytest.mark.parametrize("width", [5.0, 40.0, 300.0])  # a line, nearly one, a block of strips
def test_half_of_the_cameras_may_be_bad_in_any_order(count, width, runs, least) -> None:
    survived = 0
    for seed in range(runs):
        rng = np.random.default_rng((seed, count, int(width)))
        truth, made = flight(count, width, rng), similarity(rng)
        predicted = seen_from(half_bad(truth, rng), made)
        found = sim3(predicted, truth, **SHIPPED, seed=seed).transform
        flat = truth.centres * (1, 1, 0)
        away = found.apply(made.inverse().apply(flat)) - flat
        survived += bool(np.sqrt((away * away).sum(axis=1)).max() < 3.0)
        if seed == 0:
            other = predicted.take(rng.permutation(count))
            again = sim3(other, truth, **SHIPPED, seed=seed).transform
            assert again.matrix.tobytes() == found.matrix.tobytes()
    assert survived >= least


# --- iterated closest points ---

OFF = Similarity(
    1.01,
    Rotation.from_euler("xyz", (0.5, -0.4, 0.8), degrees=True).as_matrix(),
    UTM + np.array((0.4, -0.3, 0.5)),
    UTM,
)


def terrain() -> np.ndarray:
    x, y = np.random.default_rng(12).uniform(0, 60, (2, 10_000))
    return np.stack((x, y, 4 * np.sin(x / 6) * np.cos(y / 9)), axis=1) + UTM


def icp(predicted: np.ndarray, truth: np.ndarray, **changes: Any) -> Any:
    settings = ransac(icp_points=2000, icp_iterations=60, **changes)
    return refine(cloud_of(predicted), cloud_of(truth), settings, memory_points=1 << 20)


def test_icp_refines_far_from_the_origin() -> None:
    cloud = terrain()
    predicted = OFF.apply(cloud[:4000])
    found, report = icp(predicted, cloud)
    assert_same(found, OFF.inverse(), predicted[::50], 1e-3)
    assert report["before"]["cost"] > 0.3
    assert report["after"]["rmse"] < 1e-3
    assert (report["after"]["fitness"], report["points"]) == (1.0, 2000)
    unscaled, report = icp(predicted, cloud, icp_with_scale=False)
    assert unscaled.scale == 1.0
    assert report["after"]["cost"] < report["before"]["cost"]


def test_icp_figures_by_hand() -> None:
    truth = np.array(((0.0, 0, 0), (10, 0, 0), (0, 10, 0), (10, 10, 0)))
    predicted = truth + np.array(((0.0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0, 50)))
    _, report = icp(predicted, truth)
    assert (report["before"]["fitness"], report["before"]["rmse"]) == (0.75, 1.0)
    assert report["before"]["cost"] == pytest.approx(((3 * 1 + 4) / 4) ** 0.5)
    with pytest.raises(AlignmentError):
        icp(predicted + 100.0, truth)
