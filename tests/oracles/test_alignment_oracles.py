"""Alignment and pose metrics against evo, SciPy and Open3D."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from airzoo_bench.core.optional_imports import load_open3d
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.reconstruction.alignment import AlignmentError, PosedCameras, Similarity, umeyama
from airzoo_bench.reconstruction.clouds import cloud_of
from airzoo_bench.reconstruction.icp import refine
from airzoo_bench.reconstruction.metrics import (
    auc_of_depth_anything_3,
    centre_errors,
    pair_errors,
    rms_of_placed,
    step_errors,
)
from airzoo_bench.reconstruction.track import pose_scores
from tests.reconstruction.world import protocol

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
