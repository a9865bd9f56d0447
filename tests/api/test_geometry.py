"""Poses and clouds from Python: the records of the tracks, which oracles hold, and edges."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy.spatial.transform import Rotation

import airzoo_bench as ab
from airzoo_bench.api.arguments import shipped
from airzoo_bench.protocol.model import load_protocol, shipped_protocols
from airzoo_bench.reconstruction.alignment import umeyama
from tests.api.place import made_errors, refused
from tests.matching import world as matching_world
from tests.reconstruction import world as reconstruction_world
from tests.reconstruction.world import camera_poses, predict_clouds, true_points

Array = np.ndarray[Any, Any]


@pytest.fixture(scope="module")
def matching(tmp_path_factory: pytest.TempPathFactory) -> matching_world.World:
    return matching_world.make_world(tmp_path_factory.mktemp("matching"))


@pytest.fixture(scope="module")
def reconstruction(tmp_path_factory: pytest.TempPathFactory) -> reconstruction_world.World:
    return reconstruction_world.make_world(tmp_path_factory.mktemp("reconstruction") / "data")


def as_matrices(rotation: Array, centres: Array) -> Array:
    """Return poses (N, 3, 4) of rotations and centres."""
    moves = -np.einsum("nij,nj->ni", rotation, centres)
    return np.concatenate([rotation, moves[:, :, None]], axis=2)


def records_of(world: matching_world.World, folder: Path, fields: dict[str, Any]) -> ab.Result:
    return ab.evaluate(world.write(folder / "method.npz", fields), data=world.root)


def test_the_settings_are_those_of_all_shipped_protocols() -> None:
    rules: list[Any] = [load_protocol(path) for path in shipped_protocols().values()]
    solvers = [one.solver for one in rules if one.track == "matching"]
    defaults = {"solver": solvers[0].name, **solvers[0].model_dump(), "distortion": None}
    assert ab.solve_pose.__kwdefaults__.items() <= defaults.items()
    used = [solver.model_copy(update={"least_matches": 4}) for solver in solvers]
    assert used == [shipped("matching", "solver")] * 7
    chosen = [one for one in rules if one.track == "reconstruction"]
    assert len(chosen) == 7
    for one in chosen:
        d, settings, alignment = one.scores.headline_below_m, one.preparation, one.alignment
        assert (settings.voxel_m, settings.crop_margin_m) == (d / 20, d)
        assert (settings.crop, settings.crop_cell_m) == ("covered", d / 2)
        assert one.scores.max_distance_m == 10 * d
        expected = {"robust": True, "inlier_m": alignment.inlier_below_m, "seed": alignment.seed}
        assert ab.align_cameras.__kwdefaults__ == expected
        assert alignment == shipped("reconstruction", "alignment", cameras=alignment.cameras)


# --- poses ---


def test_errors_and_scores_are_those_of_the_track(matching, tmp_path) -> None:
    true, random = matching.poses()["poses"], np.random.default_rng(0)
    turn = Rotation.from_rotvec(random.normal(0, 1.0, (len(true), 3)), degrees=True).as_matrix()
    centres = matching.truth.poses.centres + random.normal(0, 6.0, (len(true), 3))
    predicted = as_matrices(turn @ true[:, :, :3], centres)
    predicted[1] = np.nan
    found = records_of(matching, tmp_path, matching.named(poses=predicted))
    limits = matching.protocol.scores.pose_below_m_deg
    scores = ab.pose_scores(ab.pose_errors(predicted, true), limits)
    theirs = found.records[scores.records.columns]
    pd.testing.assert_frame_equal(scores.records, theirs, rtol=1e-9, atol=1e-9)
    # The truth of a folder is rounded to 0.1 mm; of equal errors the scores are equal.
    parts = ("error_m", "horizontal_m", "vertical_m", "rotation_deg")
    again = ab.pose_scores(ab.PoseErrors(*(found.records[x].to_numpy() for x in parts)), limits)
    for one in (again, scores):
        assert (one["queries"], one["failures"]) == (5, 1)
    for name in again.records:
        assert again[name] == found.overall[name], name
    assert 0 < scores["within_10m"] < 1


def test_solve_pose_gives_the_pose_of_the_track_in_any_order(matching, tmp_path) -> None:
    random = np.random.default_rng(1)
    query_xy = [np.clip(xy + random.normal(0, 1, xy.shape), 1, 479) for xy in matching.query_xy]
    fields = matching.correspondences(query_xy, points3d=matching.points)
    rows = records_of(matching, tmp_path, fields).records
    cameras, true = matching.truth.cameras, matching.truth.poses
    for row, (pixels, points) in enumerate(zip(query_xy, matching.points, strict=True)):
        K, lens = cameras.matrices[row], cameras.distortion[row]
        turned = ab.solve_pose(pixels[::-1], points[::-1].tolist(), K, distortion=lens)
        found = ab.solve_pose(pixels, points, K, distortion=lens)
        assert turned.centre.tolist() == found.centre.tolist()
        away = np.hypot(*(found.centre - true.centres[row])[:2])
        assert away == rows["horizontal_m"][row]
        assert found.inliers.sum() == rows["inliers"][row] > 10
        errors = ab.pose_errors(found.matrix[None], matching.poses()["poses"][row][None])
        assert errors.translation_m[0] == pytest.approx(rows["error_m"][row], abs=1e-8)


def test_failures_stay_and_a_truth_without_orientation_has_no_angles() -> None:
    true = np.tile(np.eye(4), (3, 1, 1))
    predicted = true.copy()
    predicted[:2, :3] = np.nan  # the last row may stay
    errors = ab.pose_errors(predicted, true[:, :3])
    assert errors.translation_m.tolist() == [np.inf, np.inf, 0.0]
    scores = ab.pose_scores(errors)
    assert (scores["error_m"], scores["within_5m_1deg"]) == (np.inf, 1 / 3)
    positions = ab.pose_scores(ab.pose_errors(predicted, np.zeros((3, 3))))
    assert positions.scores["within_5m"] == 1 / 3
    assert positions.scores.keys().isdisjoint({"rotation_deg", "within_5m_1deg"})
    one = ab.pose_scores(made_errors([5.0], np.zeros(1)))
    assert (one["within_5m"], one["within_10m"]) == (0.0, 1.0)  # strictly below
    twice = ab.pose_scores(made_errors([1.0], np.ones(1)), [(5, 2), (5, 2)])
    assert twice["within_5m_2deg"] == 1.0
    for values, median in (
        ([5.0, 0, 10, np.inf, 7, np.inf], 8.5),
        ([1.0, 2, np.inf, np.inf], np.inf),  # one of the two middle ones
        ([1.0, 2, np.inf], 2.0),
    ):
        assert ab.pose_scores(ab.PoseErrors(*[np.array(values)] * 3, None))["error_m"] == median


def test_too_few_matches_are_a_result() -> None:
    K = np.diag([500.0, 500.0, 1.0])
    found = ab.solve_pose(np.zeros((3, 2)), np.zeros((3, 3)), K)
    assert found.status == "too few matches"
    assert np.isnan(found.matrix).all()
    assert ab.solve_pose([], [], K).inliers.tolist() == []
    assert np.isinf(ab.pose_errors(found.matrix[None], np.eye(4)[None]).translation_m).all()
    line = np.arange(30.0)[:, None] * (1.0, 0.0, 0.0) + (0, 0, 9)
    assert ab.solve_pose(line[:, :2], line, K).status == "no pose"


# --- clouds ---


@pytest.mark.parametrize(("threshold", "plain"), [(10.0, False), (2.0, False), (2.0, True)])
def test_cloud_scores_are_those_of_the_track(reconstruction, tmp_path, threshold, plain) -> None:
    points, random = true_points("lot"), np.random.default_rng(0)
    kept = points[points[:, 0] < points[:, 0].mean()]
    kept = kept[random.random(len(kept)) < 0.4] + random.normal(0, 1.0, (3,)) + (0, 0, 1.9)
    stray = random.uniform(-60, 120, (300, 3)) + points.mean(axis=0)
    predicted = np.concatenate([kept, stray, [[np.nan] * 3]])
    path = predict_clouds(reconstruction, tmp_path / "p", {"lot": predicted}, cameras=False)
    chosen = reconstruction.protocol(
        tmp_path / "c.toml",
        alignment={"method": "none", "cameras": "optional"},
        preparation={
            "crop": "none" if plain else "covered",
            "crop_margin_m": threshold,
            "crop_cell_m": threshold / 2,
            "region": "all",
            "voxel_m": "none" if plain else threshold / 20,
        },
        scores={
            "f1_below_m": (threshold,),
            "headline_below_m": threshold,
            "max_distance_m": 1e6 if plain else 10 * threshold,
        },
    )
    of_track = reconstruction.score(path, protocol=str(chosen)).scored["lot"]
    record = of_track.records.to_dict("records")[0]
    found = ab.cloud_scores(predicted, points, threshold, plain=plain)
    names = {name: f"{name}_{threshold:g}m" for name in ("f1", "precision", "recall")}
    names |= {name: f"{name}_m" for name in ("chamfer", "accuracy", "completeness")}
    names |= {name: name for name in ("not_finite", "outside", "thinned")}
    assert {name: found[name] for name in names} == {n: record[key] for n, key in names.items()}
    assert len(found.to_truth) == record["points"]
    assert len(found.to_prediction) == record["truth_points"]
    assert 0 < found.f1 < 1
    assert (found.outside > 0) == (not plain)
    assert found.not_finite == 1


def test_edges_of_clouds() -> None:
    true = [[0.0, 0, 0], [1, 0, 0]]
    empty = ab.cloud_scores([], true)
    assert (empty.f1, empty.precision, empty.recall, empty.chamfer) == (0.0, 0.0, 0.0, np.inf)
    same = ab.cloud_scores(true, true, 0.1)
    assert (same.f1, same.chamfer) == (1.0, 0.0)
    at_limit = ab.cloud_scores([[0.0, 0, 2]], [[0.0, 0, 0]], 2.0, plain=True)
    assert (at_limit.f1, at_limit.chamfer) == (0.0, 2.0)  # strictly below
    cloud = np.random.default_rng(0).random((100, 3)) * 20 + (5e5, 5e6, 0)
    assert ab.cloud_scores(cloud.astype(np.float32), cloud, threshold=10.0).f1 == 1.0
    local = (cloud - (5e5, 5e6, 0)).astype(np.float32)
    assert ab.cloud_scores(local, local, threshold=0.2).f1 == 1.0
    away = ab.cloud_scores([[0.0, 0, 0]], [[0.0, 0, 0], [900, 0, 0]], 1.0)
    assert away.completeness == 5.0  # one of two distances, clipped


# --- alignment ---


def test_the_plain_alignment_is_umeyama_s() -> None:  # which is held to evo in tests/oracles
    random = np.random.default_rng(2)
    true = random.normal(0, (60, 40, 8), (12, 3))
    predicted = true @ Rotation.random(random_state=3).as_matrix().T / 7.0
    true += random.normal(0, 3, true.shape)
    found, expected = (
        ab.align_cameras(predicted, true, robust=False),
        umeyama(predicted, true, with_scale=True),
    )
    np.testing.assert_allclose(found.transform.apply(predicted), expected.apply(predicted))
    assert found.inliers.all()
    off = np.linalg.norm(expected.apply(predicted) - true, axis=1)
    np.testing.assert_allclose(found.residuals, off)


def test_the_robust_alignment_is_that_of_the_track(reconstruction, tmp_path) -> None:
    poses = camera_poses("yard")
    turn = Rotation.random(random_state=5).as_matrix()
    centres = (poses.centres - poses.centres[0]) @ turn.T / 4.0
    centres[2] += (9.0, 0, 0)
    extrinsics = as_matrices(poses.rotation @ turn.T, centres)
    points = (true_points("yard") - poses.centres[0]) @ turn.T / 4.0
    path = predict_clouds(reconstruction, tmp_path / "p", {"yard": points}, cameras=False)
    names = np.array(reconstruction.images("yard"))
    np.savez(path / "yard.cameras.npz", image_names=names, extrinsics=extrinsics)
    chosen = reconstruction.protocol(tmp_path / "c.toml", alignment={"method": "sim3"})
    scored = reconstruction.score(path, protocol=str(chosen)).scored["yard"]
    of_track = scored.facts["alignment"]
    true = as_matrices(poses.rotation, poses.centres)
    found = ab.align_cameras(extrinsics, true)
    assert found.inliers.tolist() == [True, True, False, True, True, True]
    assert of_track["inliers"] == 5
    np.testing.assert_allclose(found.matrix, of_track["matrix"], rtol=1e-6)
    assert found.scale == pytest.approx(4.0, rel=1e-6)
    extrinsics[2] = np.nan
    again = ab.align_cameras(extrinsics, true)
    assert again.scale == pytest.approx(found.scale, rel=1e-9)
    plain = ab.align_cameras(extrinsics, true, robust=False)
    assert plain.inliers.tolist() == found.inliers.tolist()
    assert again.residuals[2] == plain.residuals[2] == np.inf


def test_cameras_on_a_line_need_orientations() -> None:
    poses = np.tile(np.eye(4), (5, 1, 1))
    poses[:, 0, 3] = -np.arange(5.0)
    true = poses.copy()
    true[:, 0, 3] *= 10.0
    found = ab.align_cameras(poses, true)
    assert found.used_orientations
    assert found.scale == pytest.approx(10.0)
    refused(ab.align_cameras, -poses[:, :3, 3], -true[:, :3, 3], where="predicted, true")
    refused(ab.align_cameras, poses, true, robust=False, where="predicted, true")
