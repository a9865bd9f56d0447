"""Scores of camera poses on a made world."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from airzoo_bench.geometry.poses import Poses
from tests.reconstruction.world import (
    Array,
    World,
    camera_poses,
    predict_clouds,
    save,
    true_points,
)

NEAR = 1e-8  # of coordinates of millions of metres, after an alignment


def with_poses(world: World, folder: Path, extrinsics: Array | None) -> dict[str, float]:
    """Return the scores of the yard with other poses, aligned by nothing."""
    path = predict_clouds(world, folder / "p", {s: true_points(s) for s in ("yard", "lot")})
    if extrinsics is None:
        (path / "yard.cameras.npz").unlink()
    else:
        save(path / "yard.cameras.npz", world.cameras("yard", extrinsics=extrinsics))
    as_it_stands = {"trajectory_alignment": "cloud"}
    chosen = world.protocol(folder / "c.toml", alignment={"method": "none"}, scores=as_it_stands)
    return world.score(path, protocol=str(chosen)).result.scenes["yard"]


def test_one_camera_turned_by_ten_degrees(world: World, tmp_path: Path) -> None:
    poses = camera_poses("yard")
    turn = Rotation.from_rotvec(np.radians(10) * np.array([0.6, 0.8, 0.0])).as_matrix()
    rotation = poses.rotation.copy()
    rotation[3] = turn @ rotation[3]
    wrong = Poses(rotation=rotation, centres=poses.centres)
    extrinsics = np.concatenate([rotation, wrong.translation[..., None]], axis=2)
    values = with_poses(world, tmp_path, extrinsics)
    # 10 of the 30 ordered pairs have it, and err by the whole turn.
    assert values["pose_auc_5deg"] == pytest.approx(20 / 30, abs=1e-6)
    assert values["pose_auc_15deg"] == pytest.approx(20 / 30 + 10 / 30 * 5 / 15, abs=1e-6)
    assert values["ate_m"] < NEAR
    assert values["rpe_deg"] == pytest.approx(np.sqrt(2 * 100 / 5), rel=1e-7)


def test_one_camera_moved_by_two_metres(world: World, tmp_path: Path) -> None:
    poses = camera_poses("yard")
    centres = poses.centres.copy()
    centres[0] += (0.0, 0.0, 2.0)
    extrinsics = np.concatenate([poses.rotation, -(poses.rotation @ centres[..., None])], axis=2)
    values = with_poses(world, tmp_path, extrinsics)
    assert values["ate_m"] == pytest.approx(np.sqrt(4 / 6), rel=1e-6)
    # The first camera has one step only.
    assert values["rpe_m"] == pytest.approx(np.sqrt(4 / 5), rel=1e-6)


def test_cameras_that_are_left_out_buy_no_score(world: World, tmp_path: Path) -> None:
    """Three of six cameras fit anything: their share, and the AUC, say so."""
    few = world.cameras("yard")
    few = {name: values[:3] for name, values in few.items()}
    path = predict_clouds(world, tmp_path / "p", {"yard": true_points("yard")})
    save(path / "yard.cameras.npz", few)
    values = world.score(path).result.scenes["yard"]
    assert values["cameras_placed"] == 0.5
    assert values["pose_auc_30deg"] == pytest.approx(6 / 30, abs=1e-6)
    two = {name: values[:2] for name, values in few.items()}
    save(path / "yard.cameras.npz", two)
    chosen = world.protocol(tmp_path / "c.toml", alignment={"method": "none"})
    values = world.score(path, protocol=str(chosen)).result.scenes["yard"]
    assert np.isinf([values["ate_m"], values["rpe_m"], values["rpe_deg"]]).all()


def test_a_scene_without_cameras_where_others_have_them(world: World, tmp_path: Path) -> None:
    values = with_poses(world, tmp_path, None)
    assert values["pose_auc_30deg"] == 0.0
    assert np.isinf([values["ate_m"], values["rpe_m"], values["rpe_deg"]]).all()
    assert values["f1_10m"] == 1.0
