"""Clouds, alignment and camera poses against SciPy, Open3D, evo and Depth Anything 3's rule.

==========================================  =================================================
compared with                               tolerance
==========================================  =================================================
SciPy's cKDTree, Open3D's distances         relative 1e-15: the last bit of a sum or a root
Open3D's metrics, from float32 clouds       relative 1e-4; F1 in percent, Chamfer as a sum
Open3D's voxels                             the same number; means to 1e-12 of coordinates
==========================================  =================================================
"""

from __future__ import annotations

from types import ModuleType
from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from airzoo_bench.core.optional_imports import load_open3d
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.reconstruction.alignment import AlignmentError, PosedCameras, Similarity, umeyama
from airzoo_bench.reconstruction.clouds import VoxelGrid, cloud_of
from airzoo_bench.reconstruction.distances import mutual_distances
from airzoo_bench.reconstruction.icp import refine
from airzoo_bench.reconstruction.metrics import (
    auc_of_depth_anything_3,
    centre_errors,
    curve,
    mean_distances,
    pair_errors,
    rms_of_placed,
    step_errors,
)
from airzoo_bench.reconstruction.track import pose_scores
from tests.reconstruction.world import protocol, surface

FAR = np.array((1_000_000.0, 4_000_000.0, 100.0))


@pytest.fixture(scope="module")
def o3d() -> ModuleType:
    return load_open3d()


def legacy(o3d: ModuleType, points: Floats) -> object:
    return o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))


PAIRS = {
    "surfaces": (surface(6000, 0, far=0.05), surface(5000, 1)),
    "far from the origin": (surface(3000, 0) + FAR, surface(3000, 1) + FAR),
    "copies": (np.repeat(surface(300, 0), 10, axis=0), np.repeat(surface(300, 1), 10, axis=0)),
    "identical": (surface(2000, 0), surface(2000, 0)),
    "one point": (surface(2000, 0), surface(1, 1)),
    "all equal": (np.ones((500, 3)), np.zeros((500, 3))),
    "line": (np.linspace(0, 1, 700)[:, None] * FAR, np.linspace(0, 1, 900)[:, None] * FAR),
    "plane": (surface(2000, 0) * (1, 1, 0), surface(2000, 1) * (1, 1, 0)),
    "long and thin": (surface(2000, 0) * (1e4, 1, 1e-4), surface(2000, 1) * (1e4, 1, 1e-4)),
}


@pytest.mark.parametrize("name", PAIRS)
def test_distances_of_scipy(name: str) -> None:
    first, second = PAIRS[name]
    there, back = mutual_distances(first, second, jobs=2)
    np.testing.assert_allclose(there, cKDTree(second).query(first)[0], rtol=1e-15)
    np.testing.assert_allclose(back, cKDTree(first).query(second)[0], rtol=1e-15)


@pytest.mark.parametrize("name", PAIRS)
def test_distances_of_open3d(o3d: ModuleType, name: str) -> None:
    first, second = PAIRS[name]
    there, back = mutual_distances(first, second, jobs=2)
    one, other = legacy(o3d, first), legacy(o3d, second)
    np.testing.assert_allclose(there, one.compute_point_cloud_distance(other), rtol=1e-15)  # type: ignore[attr-defined]
    np.testing.assert_allclose(back, other.compute_point_cloud_distance(one), rtol=1e-15)  # type: ignore[attr-defined]


def open3d_metrics(
    o3d: ModuleType, truth: Floats, prediction: Floats, radii: tuple[float, ...]
) -> list[float]:
    """Chamfer, and F1 at each radius, as Open3D's tensor point clouds compute them."""
    metric = o3d.t.geometry.Metric
    one, other = (
        o3d.t.geometry.PointCloud(o3d.core.Tensor(points.astype(np.float32)))
        for points in (truth, prediction)
    )
    found: list[float] = (
        one.compute_metrics(
            other,
            [metric.ChamferDistance, metric.FScore],
            o3d.t.geometry.MetricParameters(fscore_radius=list(radii)),
        )
        .numpy()
        .tolist()
    )
    return found


@pytest.mark.parametrize("name", ["surfaces", "copies", "identical", "one point", "plane"])
def test_metrics_of_open3d(o3d: ModuleType, name: str) -> None:
    prediction, truth = PAIRS[name]
    radii = (0.3, 1.0, 10.0)
    both = mutual_distances(prediction, truth, jobs=2)
    means = mean_distances(*both, None)
    total, *shares = open3d_metrics(o3d, truth, prediction, radii)
    assert means["accuracy"] + means["completeness"] == pytest.approx(total, rel=1e-4)
    assert means["chamfer"] == pytest.approx(total / 2, rel=1e-4)
    f1 = curve(*both, np.array(radii)).f1
    assert (100 * f1).tolist() == pytest.approx(shares, rel=1e-3, abs=1e-3)


def test_cube_and_its_larger_copy_as_open3d_has_it(o3d: ModuleType) -> None:
    corners = np.array([(x, y, z) for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)])
    total, *_ = open3d_metrics(o3d, corners, corners * 1.1, (0.1,))
    assert total == pytest.approx(2 * 0.1121837, abs=1e-6)
    there, back = mutual_distances(corners * 1.1, corners, jobs=1)
    assert np.mean(there) + np.mean(back) == pytest.approx(total, abs=1e-6)


@pytest.mark.parametrize(("size", "shift"), [(0.5, 0.0), (3.0, 0.0), (2.0, 1_000_000.0)])
def test_voxels_of_open3d(o3d: ModuleType, size: float, shift: float) -> None:
    points = surface(20_000, 0) + shift
    cloud = legacy(o3d, points)
    theirs = cloud.voxel_down_sample(size)  # type: ignore[attr-defined]
    # Open3D's grid begins half a voxel below the cloud.
    origin = points.min(axis=0) - size / 2.0
    grid = VoxelGrid(size, origin)
    grid.add(points)
    ours = grid.points()
    expected = np.asarray(theirs.points)
    order = np.lexsort(np.floor((expected - origin) / size).T[::-1])
    assert len(ours) == len(expected)
    np.testing.assert_allclose(ours, expected[order], rtol=1e-12, atol=1e-9)


UTM = np.array((576663.25, 5188165.5, 197.0))


def path(poses: Poses) -> Any:
    trajectory = pytest.importorskip("evo.core.trajectory")
    to_world = np.tile(np.eye(4), (len(poses), 1, 1))
    to_world[:, :3, :3] = np.swapaxes(poses.rotation, 1, 2)
    to_world[:, :3, 3] = poses.centres
    return trajectory.PosePath3D(poses_se3=list(to_world))


def shaken(rng: np.random.Generator, count: int) -> tuple[Poses, Poses]:
    rotation = Rotation.random(count, random_state=rng).as_matrix()
    truth = Poses(rotation=rotation, centres=rng.normal(size=(count, 3)) * 40)
    turn = Rotation.from_rotvec(rng.normal(0, 5, (count, 3)), degrees=True).as_matrix()
    centres = truth.centres + rng.normal(size=(count, 3))
    return Poses(rotation=turn @ rotation, centres=centres), truth


@pytest.mark.parametrize("with_scale", [True, False])
@pytest.mark.parametrize("mirrored", [1.0, -1.0])
@pytest.mark.parametrize("seed", range(4))
def test_umeyama_of_evo(seed: int, mirrored: float, with_scale: bool) -> None:
    geometry = pytest.importorskip("evo.core.geometry")
    rng = np.random.default_rng(seed)
    source = rng.normal(size=(9, 3)) * (7, 5, 2)
    turn = Rotation.random(random_state=rng).as_matrix()
    target = 3.0 * (source * (1, 1, mirrored)) @ turn.T + rng.normal(size=(9, 3)) + (5, 6, 7)
    rotation, translation, scale = geometry.umeyama_alignment(source.T, target.T, with_scale)
    found = umeyama(source, target, with_scale=with_scale)
    assert found.scale == pytest.approx(scale, rel=1e-12)
    np.testing.assert_allclose(found.rotation, rotation, atol=1e-12)
    np.testing.assert_allclose(found.matrix[:3, 3], translation, atol=1e-11)


def test_evo_refuses_a_line_too() -> None:
    geometry = pytest.importorskip("evo.core.geometry")
    line = np.arange(5.0)[:, None] * (1, 0, 0)
    with pytest.raises(geometry.GeometryException):
        geometry.umeyama_alignment(line.T, line.T, True)
    with pytest.raises(AlignmentError):
        umeyama(line, line, with_scale=True)


@pytest.mark.parametrize("seed", range(4))
def test_rotation_of_scipy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    source = rng.normal(size=(8, 3))
    target = source @ Rotation.random(random_state=rng).as_matrix().T + rng.normal(size=(8, 3))
    centred = (source - source.mean(axis=0), target - target.mean(axis=0))
    expected, _ = Rotation.align_vectors(centred[1], centred[0])
    found = umeyama(source, target, with_scale=False)
    np.testing.assert_allclose(found.rotation, expected.as_matrix(), atol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_ate_and_rpe_of_evo(seed: int) -> None:
    metrics = pytest.importorskip("evo.core.metrics")
    predicted, truth = shaken(np.random.default_rng(seed), 12)
    pair = (path(truth), path(predicted))

    def rmse(metric: Any) -> float:
        metric.process_data(pair)
        return float(metric.get_statistic(metrics.StatisticsType.rmse))

    relation = metrics.PoseRelation
    ate = rmse(metrics.APE(relation.translation_part))
    assert rms_of_placed(centre_errors(predicted, truth)) == pytest.approx(ate, rel=1e-12)
    translation, rotation_deg = step_errors(predicted, truth)
    one = {"delta": 1, "delta_unit": metrics.Unit.frames, "all_pairs": False}
    moved = rmse(metrics.RPE(relation.translation_part, **one))
    assert rms_of_placed(translation) == pytest.approx(moved, rel=1e-12)
    turned = rmse(metrics.RPE(relation.rotation_angle_deg, **one))
    assert rms_of_placed(rotation_deg) == pytest.approx(turned, rel=1e-9)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("width", [40.0, 1e-9])  # on a line, the turn about it changes no error
def test_trajectories_are_aligned_as_evo_aligns_them(seed: int, width: float) -> None:
    metrics = pytest.importorskip("evo.core.metrics")
    rng = np.random.default_rng(seed)
    predicted, truth = shaken(rng, 12)
    line = truth.centres * (1.0, width / 40.0, width / 40.0)
    truth = Poses(rotation=truth.rotation, centres=line)
    made = Similarity(0.3, Rotation.random(random_state=rng).as_matrix(), UTM)
    moved = made.apply_poses(predicted)
    names = tuple("abcdefghijkl")
    settings = protocol(alignment={"method": "none"}).scores
    scores = pose_scores(
        PosedCameras(names, moved.centres, moved.rotation),
        Similarity.identity(),
        PosedCameras(names, truth.centres, truth.rotation),
        settings,
    )
    theirs, true = path(predicted), path(truth)
    theirs.align(true, correct_scale=True)
    ate = metrics.APE(metrics.PoseRelation.translation_part)
    ate.process_data((true, theirs))
    expected = float(ate.get_statistic(metrics.StatisticsType.rmse))
    assert scores["ate_m"] == pytest.approx(expected, rel=1e-7)
    rpe = metrics.RPE(metrics.PoseRelation.translation_part, delta=1, all_pairs=False)
    rpe.process_data((true, theirs))
    expected = float(rpe.get_statistic(metrics.StatisticsType.rmse))
    assert scores["rpe_m"] == pytest.approx(expected, rel=1e-7)
    assert scores["cameras_placed"] == 1.0


# What `compute_pose` of Depth Anything 3's bench/utils.py, commit 2c21ea8, gives for `shaken`
# poses of 15 cameras: AUC at 3, 5, 15 and 30 degrees.
DEPTH_ANYTHING_3 = (
    (0.0, 0.013333333333333332, 0.2628571428571428, 0.5958730158730159),
    (0.0, 0.00380952380952381, 0.1638095238095238, 0.5168253968253967),
    (0.0, 0.00380952380952381, 0.07365079365079366, 0.3603174603174603),
    (0.003174603174603175, 0.01142857142857143, 0.22539682539682543, 0.5622222222222224),
    (0.003174603174603175, 0.020952380952380955, 0.32317460317460317, 0.6447619047619048),
    (0.0, 0.0, 0.07809523809523808, 0.380952380952381),
)


@pytest.mark.parametrize("seed", range(6))
def test_auc_of_depth_anything_3(seed: int) -> None:
    found = auc_of_depth_anything_3(*shaken(np.random.default_rng(seed), 15), [3, 5, 15, 30])
    assert found == pytest.approx(DEPTH_ANYTHING_3[seed], rel=1e-12, abs=1e-15)


def test_relative_poses_of_evo() -> None:
    lie = pytest.importorskip("evo.core.lie_algebra")
    predicted, truth = shaken(np.random.default_rng(5), 6)
    rotation_deg, direction_deg = pair_errors(predicted, truth, least_baseline=1e-3)
    claimed, true = path(predicted).poses_se3, path(truth).poses_se3
    pairs = [(i, j) for i in range(6) for j in range(6) if i != j]
    for row, (i, j) in enumerate(pairs):
        a, b = lie.relative_se3(claimed[i], claimed[j]), lie.relative_se3(true[i], true[j])
        angle = np.degrees(lie.so3_log_angle(a[:3, :3].T @ b[:3, :3]))
        assert rotation_deg[row] == pytest.approx(angle, abs=1e-9)
        cosine = a[:3, 3] @ b[:3, 3] / np.linalg.norm(a[:3, 3]) / np.linalg.norm(b[:3, 3])
        assert direction_deg[row] == pytest.approx(np.degrees(np.arccos(cosine)), abs=1e-6)


@pytest.mark.parametrize("with_scale", [True, False])
def test_icp_of_open3d(with_scale: bool) -> None:
    o3d = load_open3d()
    rng = np.random.default_rng(6)
    x, y = rng.uniform(0, 50, (2, 6000))
    truth = np.stack((x, y, 4 * np.sin(x / 5) * np.cos(y / 8)), axis=1)
    turn = Rotation.from_euler("xyz", (0.6, -0.5, 1.0), degrees=True).as_matrix()
    source = truth[:2500] @ turn.T + rng.normal(0, 0.05, (2500, 3)) + 0.2

    def cloud(points: np.ndarray) -> Any:
        return o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))

    registration = o3d.pipelines.registration
    theirs = registration.registration_icp(
        cloud(source),
        cloud(truth),
        1.5,
        np.eye(4),
        registration.TransformationEstimationPointToPoint(with_scale),
        registration.ICPConvergenceCriteria(0.0, 0.0, 80),
    )
    stated = {
        "icp_points": 10**6,
        "icp_below_m": 1.5,
        "icp_iterations": 80,
        "icp_tolerance": 0.0,
        "icp_with_scale": with_scale,
    }
    settings = protocol().alignment.model_copy(update=stated)
    found, report = refine(cloud_of(source), cloud_of(truth), settings, memory_points=10**6)
    moved = source @ theirs.transformation[:3, :3].T + theirs.transformation[:3, 3]
    np.testing.assert_allclose(found.apply(source), moved, atol=1e-6)
    assert report["after"]["fitness"] == pytest.approx(theirs.fitness)
    assert report["after"]["rmse"] == pytest.approx(theirs.inlier_rmse, rel=1e-6)
    # Far from the origin it is the same, shifted.
    there, _ = refine(cloud_of(source + UTM), cloud_of(truth + UTM), settings, memory_points=10**6)
    np.testing.assert_allclose(there.apply(source + UTM) - UTM, found.apply(source), atol=1e-6)
