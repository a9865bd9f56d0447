from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from scipy.spatial.transform import Rotation

from airzoo_bench.reconstruction.alignment.cameras import Alignment, align, partners
from airzoo_bench.reconstruction.alignment.consensus import (
    PosedCameras,
    RansacSettings,
    mean_rotation,
)
from airzoo_bench.reconstruction.alignment.icp import IcpSettings, refine, subsample
from airzoo_bench.reconstruction.alignment.similarity import AlignmentError, Similarity
from tests.geometry.support import looking_down, quick, seeds

UTM = np.array((576663.25, 5188165.5, 197.0))
RANSAC = RansacSettings(iterations=50, sample_share=0.0, inlier_limit=1.0, line_ratio=0.02, seed=3)
ICP = IcpSettings(
    max_points=2000,
    max_distance=2.0,
    max_iterations=60,
    tolerance=1e-6,
    with_scale=True,
    seed=0,
)


def cameras(centres: np.ndarray, rng: np.random.Generator) -> PosedCameras:
    names = tuple(f"{row:03}.jpg" for row in range(len(centres)))
    shake = Rotation.from_euler("xyz", rng.normal(0, 10, (len(centres), 3)), degrees=True)
    return PosedCameras(names, centres, shake.as_matrix() @ looking_down(20.0))


def grid(rng: np.random.Generator) -> PosedCameras:
    x, y = np.meshgrid(np.arange(6.0) * 30, np.arange(4.0) * 40)
    flat = np.stack((x.ravel(), y.ravel(), rng.normal(60, 1, 24)), axis=1)
    return cameras(flat + UTM, rng)


def strip(rng: np.random.Generator, sway: float = 0.05) -> PosedCameras:
    along = np.arange(12.0)[:, None] * (20.0, 11.0, 0.5)
    return cameras(along + rng.normal(0, sway, (12, 3)) + UTM, rng)


def seen_from(truth: PosedCameras, made: Similarity) -> PosedCameras:
    """Return the cameras in the frame that `made` takes into the truth's."""
    assert truth.rotation is not None
    return PosedCameras(
        truth.names, made.inverse().apply(truth.centres), truth.rotation @ made.rotation
    )


def made_by(rng: np.random.Generator) -> Similarity:
    rotation = Rotation.random(random_state=rng).as_matrix()
    return Similarity(25.0, rotation, UTM + rng.normal(0, 50, 3), rng.normal(size=3))


def sim3(predicted: PosedCameras, truth: PosedCameras, ransac: RansacSettings) -> Alignment:
    return align("sim3", predicted, truth, ransac=ransac, icp=None)


def moved(cameras: PosedCameras, rows: list[int], by: np.ndarray | float) -> PosedCameras:
    centres = cameras.centres.copy()
    centres[rows] += by
    return replace(cameras, centres=centres)


def assert_same(found: Similarity, made: Similarity, points: np.ndarray, atol: float) -> None:
    np.testing.assert_allclose(found.apply(points), made.apply(points), rtol=0, atol=atol)


@quick
@given(seeds)
def test_sim3_is_exact_and_ignores_outliers(seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth, made = grid(rng), made_by(rng)
    predicted = moved(seen_from(truth, made), [3, 11, 17, 20, 22], rng.uniform(2, 9, (5, 3)))
    found = sim3(predicted, truth, RANSAC)
    assert_same(found.transform, made, rng.normal(size=(9, 3)), 1e-7)
    assert (found.cameras, found.inliers, found.missing) == (24, 19, 0)
    assert found.robust
    assert not found.used_orientations
    assert found.inlier_centres is not None
    assert found.inlier_centres.largest < 1e-7
    assert found.centres is not None
    assert found.centres.largest > 25.0
    assert found.centres.median < 1e-7
    # Only centres were moved.
    assert found.rotations_deg is not None
    assert found.rotations_deg.largest < 1e-8


def test_residuals_by_hand() -> None:
    truth = PosedCameras(("a", "b", "c"), np.array(((0, 0, 0), (1, 0, 0), (0, 1, 0.0))))
    predicted = moved(truth, [0, 1], np.array(((3.0, 0, 0), (0, 4.0, 0))))
    found = align("none", predicted, truth, ransac=None, icp=None)
    assert found.centres is not None
    assert found.centres.rms == pytest.approx((25 / 3) ** 0.5)
    assert (found.centres.median, found.centres.largest) == (3.0, 4.0)
    assert found.rotations_deg is None
    assert found.transform.scale == 1.0


def test_none_needs_no_cameras() -> None:
    found = align("none", None, None, ransac=None, icp=None)
    assert (found.cameras, found.centres) == (0, None)
    np.testing.assert_array_equal(found.transform.matrix, np.eye(4))


def test_rule_for_the_limit() -> None:
    rng = np.random.default_rng(0)
    truth, made = grid(rng), made_by(rng)
    noisy = moved(seen_from(truth, made), list(range(24)), rng.normal(0, 0.01, (24, 3)))
    found = sim3(noisy, truth, replace(RANSAC, inlier_limit=None, sample_share=0.5))
    # The median distance is near 0.01 * 25 * 1.54, that of a normal vector in space.
    assert found.inlier_limit == pytest.approx(0.385, rel=0.4)
    assert 8 <= found.inliers <= 20
    assert_same(found.transform, made, made.inverse().apply(truth.centres), 0.5)
    exact = sim3(seen_from(truth, made), truth, replace(RANSAC, inlier_limit=None))
    assert exact.inliers == 24


def test_the_same_seed_gives_the_same_bytes() -> None:
    rng = np.random.default_rng(1)
    truth, made = grid(rng), made_by(rng)
    predicted = moved(seen_from(truth, made), list(range(24)), rng.normal(0, 0.02, (24, 3)))
    one, two = (sim3(predicted, truth, RANSAC).transform.matrix for _ in range(2))
    assert one.tobytes() == two.tobytes()


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
    assert found.inliers == 10
    assert_same(found.transform, made, rng.normal(size=(9, 3)), 1e-6)
    assert found.rotations_deg is not None
    assert found.rotations_deg.largest == pytest.approx(90.0)


def test_a_plane_that_is_a_strip_with_an_outlier() -> None:
    rng = np.random.default_rng(3)
    path = strip(rng)
    truth, made = moved(path, [4], np.array((0.0, 60.0, 0.0))), made_by(rng)
    predicted = moved(seen_from(truth, made), [4], 5.0)
    found = sim3(predicted, truth, RANSAC)
    assert found.used_orientations
    assert found.inliers == 11
    assert_same(found.transform, made, rng.normal(size=(9, 3)), 1e-6)


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
    with pytest.raises(AlignmentError, match="orientations contradict"):
        sim3(replace(truth, rotation=truth.rotation @ about), truth, RANSAC)


def test_gps_alone_will_do_on_a_grid() -> None:
    rng = np.random.default_rng(6)
    truth, made = grid(rng), made_by(rng)
    found = sim3(seen_from(truth, made), replace(truth, rotation=None), RANSAC)
    assert_same(found.transform, made, rng.normal(size=(9, 3)), 1e-7)
    assert found.rotations_deg is None


@pytest.mark.parametrize("whose", ["true", "predicted"])
def test_centres_at_a_point_are_refused(whose: str) -> None:
    truth = grid(np.random.default_rng(7))
    point = replace(truth, centres=np.tile(UTM / 3, (24, 1)))
    pair = (truth, point) if whose == "true" else (point, truth)
    with pytest.raises(AlignmentError, match=f"the {whose} camera centres all lie at one point"):
        sim3(*pair, RANSAC)


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
    assert (found.cameras, found.missing) == (20, 4)
    rows, true_rows = partners(truth.take(order), truth)
    np.testing.assert_array_equal(order[rows], true_rows)
    np.testing.assert_array_equal(true_rows, np.sort(order))


def test_unknown_and_repeated_names() -> None:
    truth = grid(np.random.default_rng(10))
    strange = replace(truth, names=("x.png", "y.png", *truth.names[2:]))
    with pytest.raises(AlignmentError, match=r"lacks the images 2 of 24 \(x.png, y.png\)"):
        sim3(strange, truth, RANSAC)
    twice = replace(truth, names=(truth.names[1], *truth.names[1:]))
    with pytest.raises(AlignmentError, match=r"twice in the prediction: 1 \(001.jpg\)"):
        sim3(twice, truth, RANSAC)


def test_nobody_agrees() -> None:
    rng = np.random.default_rng(11)
    truth = grid(rng)
    scattered = replace(truth, centres=rng.normal(size=(24, 3)))
    found = sim3(scattered, truth, replace(RANSAC, inlier_limit=1e-3))
    assert not found.robust
    assert found.inliers == 24


def test_mean_rotation() -> None:
    turns = Rotation.from_euler("z", [[10], [20], [30]], degrees=True).as_matrix()
    expected = Rotation.from_euler("z", 20, degrees=True).as_matrix()
    np.testing.assert_allclose(mean_rotation(turns), expected, atol=1e-12)


def terrain(rng: np.random.Generator, count: int) -> np.ndarray:
    x, y = rng.uniform(0, 60, (2, count))
    return np.stack((x, y, 4 * np.sin(x / 6) * np.cos(y / 9)), axis=1)


def test_icp_refines_far_from_the_origin() -> None:
    rng = np.random.default_rng(12)
    cloud, made = terrain(rng, 20000), made_by(rng)
    truth, predicted = cloud + UTM, made.inverse().apply(cloud[:8000] + UTM)
    off = Similarity(
        1.01,
        Rotation.from_euler("xyz", (0.5, -0.4, 0.8), degrees=True).as_matrix(),
        UTM + np.array((0.4, -0.3, 0.5)),
        UTM,
    )
    start = off.after(made)
    found, report = refine(predicted, truth, start, ICP)
    assert_same(found, made, predicted[::50], 1e-3)
    assert report.before.cost > 0.3
    assert report.after.rmse < 1e-3
    assert (report.after.fitness, report.points) == (1.0, 2000)
    again, _ = refine(predicted, truth, start, ICP)
    assert again.matrix.tobytes() == found.matrix.tobytes()


def test_icp_without_scale_keeps_it() -> None:
    rng = np.random.default_rng(13)
    cloud = terrain(rng, 5000)
    start = Similarity(1.02, np.eye(3), np.array((0.1, 0.2, 0.3)))
    found, report = refine(cloud[:3000], cloud, start, replace(ICP, with_scale=False))
    assert found.scale == 1.02
    assert report.after.cost < report.before.cost


def test_icp_leaves_what_it_cannot_mend() -> None:
    cloud = terrain(np.random.default_rng(14), 2000)
    start = Similarity.identity()
    found, report = refine(cloud, cloud, start, ICP)
    assert found is start
    assert report.before == report.after
    assert report.after.cost == 0.0


def test_icp_figures_by_hand() -> None:
    truth = np.array(((0.0, 0, 0), (10, 0, 0), (0, 10, 0), (10, 10, 0)))
    predicted = truth + np.array(((0.0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0, 50)))
    _, report = refine(predicted, truth, Similarity.identity(), replace(ICP, max_iterations=0))
    assert (report.before.fitness, report.before.rmse) == (0.75, 1.0)
    assert report.before.cost == pytest.approx(((3 * 1 + 4) / 4) ** 0.5)


def test_icp_needs_clouds_that_meet() -> None:
    cloud = terrain(np.random.default_rng(15), 100)
    with pytest.raises(AlignmentError, match="0 of 100 predicted points within 2"):
        refine(cloud + 500.0, cloud, Similarity.identity(), ICP)
    with pytest.raises(AlignmentError, match="needs points"):
        refine(cloud[:0], cloud, Similarity.identity(), ICP)


def test_sim3_with_icp_states_both() -> None:
    rng = np.random.default_rng(16)
    truth, made = grid(rng), made_by(rng)
    cloud = terrain(rng, 4000) + UTM
    points = made.inverse().apply(cloud)
    shaken = moved(seen_from(truth, made), list(range(24)), rng.normal(0, 0.01, (24, 3)))
    rough = sim3(shaken, truth, RANSAC)
    fine = align("sim3+icp", shaken, truth, ransac=RANSAC, icp=ICP, clouds=(points, cloud))
    assert fine.icp is not None
    assert fine.icp.after.cost < 0.1 * fine.icp.before.cost
    assert rough.centres is not None
    assert fine.centres is not None
    assert fine.centres != rough.centres
    assert_same(fine.transform, made, points[::100], 0.01)


def test_subsample_is_seeded_and_keeps_the_order() -> None:
    points = np.arange(300.0).reshape(100, 3)
    some = subsample(points, 10, seed=1)
    assert len(some) == 10
    assert (np.diff(some[:, 0]) > 0).all()
    np.testing.assert_array_equal(some, subsample(points, 10, seed=1))
    assert not np.array_equal(some, subsample(points, 10, seed=2))
    assert subsample(points, 100, seed=1) is points
