"""Pixels and poses that follow another convention are refused or asked about."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from airzoo_bench.benchmark.queries import PRIOR_COLUMNS
from airzoo_bench.core.errors import PredictionError
from airzoo_bench.geometry.poses import Poses, matrix_to_quaternion, quaternion_to_matrix
from airzoo_bench.matching.conventions import (
    refuse_other_conventions,
    suspect_inverted,
    suspect_turned,
)
from airzoo_bench.matching.reading import read_matching
from airzoo_bench.matching.scene_predictions import match_scene
from tests.geometry.support import looking_down
from tests.matching.matched import EVERY, matched, refused
from tests.matching.world import N_QUERIES, World
from tests.support import run_main


def test_camera_to_world(world: World, tmp_path: Path) -> None:
    true = world.truth.poses
    inverted = np.swapaxes(true.rotation, 1, 2)
    fields = world.named(poses=np.concatenate([inverted, true.centres[:, :, None]], axis=2))
    message = refused(world, tmp_path, fields)
    for part in ("look camera-to-world", "taken so, cameras lie 5.4 m", "invert", "R.T"):
        assert part in message


def test_only_rotations_camera_to_world(world: World, tmp_path: Path) -> None:
    # Of cameras that look straight down R and its transpose are nearly the same.
    oblique = np.concatenate([looking_down(55, 63 * q) for q in range(N_QUERIES)])
    turned = dict(zip(PRIOR_COLUMNS[:4], matrix_to_quaternion(oblique).T, strict=True))
    truth = replace(world.truth, queries=world.truth.queries.assign(**turned))
    true = Poses(rotation=oblique, centres=world.truth.poses.centres)
    # The centre is right, the rotation is turned about.
    wrong = Poses(rotation=np.swapaxes(true.rotation, 1, 2), centres=true.centres)
    fields = world.named(poses=np.concatenate([wrong.rotation, wrong.translation[..., None]], 2))
    message = refused(replace(world, truth=truth), tmp_path, fields)
    assert "rotations look like camera-to-world" in message


def test_quaternions_x_y_z_w(world: World, tmp_path: Path) -> None:
    true = world.truth.poses
    quaternions = matrix_to_quaternion(true.rotation)
    for order, ok in (([0, 1, 2, 3], True), ([1, 2, 3, 0], False)):
        path = tmp_path / "poses.txt"
        rows = zip(world.ids, np.hstack([quaternions[:, order], true.translation]), strict=True)
        lines = [f"{name} {' '.join(map(repr, values.tolist()))}" for name, values in rows]
        path.write_text("\n".join(lines))
        predictions = read_matching(path, 1 << 30)
        if ok:
            predicted = match_scene(predictions, world.truth, EVERY, world.protocol.scores)
            assert predicted.poses is not None
            np.testing.assert_allclose(predicted.poses.centres, true.centres, rtol=0, atol=1e-6)
            continue
        with pytest.raises(PredictionError, match="quaternions in the order x y z w") as caught:
            match_scene(predictions, world.truth, EVERY, world.protocol.scores)
        assert "w x y z" in str(caught.value)


@pytest.mark.parametrize("quaternions", [False, True])
def test_north_up_tiles_under_a_flight_to_the_south(*, quaternions: bool) -> None:
    # A method that answers with a tile's pose; read as x y z w it would point south.
    rng = np.random.default_rng(0)
    gimbal = np.concatenate(
        [looking_down(rng.normal(0, 2), 180 + yaw) for yaw in range(-20, 20, 4)]
    )
    priors = Poses(rotation=gimbal, centres=np.zeros((10, 3)))
    tiles = replace(priors, rotation=np.tile(np.diag((1.0, -1.0, -1.0)), (10, 1, 1)))
    refuse_other_conventions(tiles, priors, quaternions=quaternions)
    assert suspect_turned(tiles, priors) is None


def test_inverted_rotations_beside_right_centres(world: World, tmp_path: Path) -> None:
    # Cameras that look down: a rotation and its inverse are apart by little more than their tilt.
    true = world.truth.poses
    fields = world.named(rotations=np.swapaxes(true.rotation, 1, 2), centres=true.centres)
    message = refused(world, tmp_path, fields)
    for part in ("look like camera-to-world", "by 35 degrees", "read so by 4"):
        assert part in message
    # Rough rotations that no other reading brings nearer are a method's own.
    for turn in (5.0, 25.0, 90.0, 180.0):
        rough = true.rotation @ Rotation.from_euler("z", turn, degrees=True).as_matrix()
        predicted = matched(world, tmp_path, world.named(rotations=rough, centres=true.centres))
        assert predicted.poses is not None


@pytest.mark.parametrize("tilt", [0.0, 2.0, 5.0, 9.0])
def test_inverted_rotations_of_photos_that_look_down_are_asked_about(tilt: float) -> None:
    asked = 0
    for seed in range(50):
        rng = np.random.default_rng(seed)
        tilts, yaws = rng.normal(0, tilt + 0.01, 20), rng.uniform(0, 360, 20)
        true = np.concatenate([looking_down(*pair) for pair in zip(tilts, yaws, strict=True)])
        # A gimbal off by a degree all the time, by half of one each time, and by five in yaw.
        off = tilts + rng.normal(0, 1) + rng.normal(0, 0.5, 20), yaws + rng.normal(0, 5, 20)
        gimbal = np.concatenate([looking_down(*pair) for pair in zip(*off, strict=True)])
        priors = Poses(rotation=gimbal, centres=np.zeros((20, 3)))
        assert suspect_inverted(replace(priors, rotation=true), priors) is None
        inverted = replace(priors, rotation=np.swapaxes(true, 1, 2))
        refuse_other_conventions(inverted, priors)
        asked += suspect_inverted(inverted, priors) is not None
    assert asked == 0 if tilt == 0 else asked >= (45 if tilt > 4 else 30)


@pytest.mark.parametrize("degrees", [90, 180, -90])
@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_cameras_turned_alike_are_asked_about(axis: str, degrees: int) -> None:
    rng = np.random.default_rng(0)
    gimbal = np.concatenate([looking_down(rng.normal(0, 20), yaw) for yaw in range(0, 360, 18)])
    off = Rotation.from_rotvec(rng.normal(0, np.radians(2), (20, 3))).as_matrix()
    priors = Poses(rotation=gimbal, centres=np.zeros((20, 3)))
    true = Poses(rotation=off @ gimbal, centres=rng.normal(0, 3, (20, 3)))
    turned = Rotation.from_euler(axis, degrees, degrees=True).as_matrix() @ true.rotation
    found = suspect_turned(replace(true, rotation=turned), priors)
    assert found is not None
    assert f"turned by {degrees} degrees about its {axis} axis" in found
    assert suspect_turned(true, priors) is None
    # A gimbal's yaw may be wrong by 180 degrees in some photos.
    flipped = np.where(np.arange(20)[:, None, None] < 6, gimbal @ np.diag((-1, -1, 1)), gimbal)
    assert suspect_turned(replace(true, rotation=turned), replace(priors, rotation=flipped))
    assert suspect_turned(true, replace(priors, rotation=flipped)) is None
    # Not all are turned, or each by another angle, or cameras are elsewhere: no convention.
    some = np.where(np.arange(20)[:, None, None] < 14, turned, true.rotation)
    each = Rotation.random(20, random_state=0).as_matrix() @ true.rotation
    for rotation in (some, each):
        assert suspect_turned(replace(true, rotation=rotation), priors) is None
    far = Poses(rotation=turned, centres=true.centres + 100)
    assert suspect_turned(far, priors) is None
    assert (
        suspect_turned(replace(true, rotation=turned).take(slice(4)), priors.take(slice(4))) is None
    )


def test_a_camera_upside_down_is_asked_about_by_eval_and_check(
    world: World, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    true = world.truth.poses
    upside = np.diag((-1.0, -1.0, 1.0)) @ true.rotation
    path = world.write(tmp_path / "u.npz", world.named(rotations=upside, centres=true.centres))
    for command in (("eval", "matching"), ("check",)):
        assert run_main(*command, path, "--data", world.root) == 0
        said = re.sub(r"\s+", " ", "".join(capsys.readouterr()))
        assert "scene hills: are the rotations those of a camera turned by 180 degrees" in said
        assert "about its z axis? They differ from the gimbal's by 17" in said


@pytest.mark.parametrize("back", [False, True])
def test_opengl_axes(
    world: World, tmp_path: Path, capsys: pytest.CaptureFixture[str], *, back: bool
) -> None:
    oblique = np.concatenate([looking_down(55, 63 * q) for q in range(N_QUERIES)])
    turned = dict(zip(PRIOR_COLUMNS[:4], matrix_to_quaternion(oblique).T, strict=True))
    truth = replace(world.truth, queries=world.truth.queries.assign(**turned))
    opengl = np.diag((1.0, -1.0, -1.0)) @ oblique
    rotations = np.swapaxes(opengl, 1, 2) if back else opengl
    fields = world.named(rotations=rotations, centres=world.truth.poses.centres)
    message = refused(replace(world, truth=truth), tmp_path, fields)
    what = "camera-to-world with OpenGL" if back else "those of OpenGL"
    for part in (what, "z backward", "diag(1, -1, -1) @ R", "by 0"):
        assert part in message
    # As the command finds them, in poses and in check too.
    true = world.truth.poses
    wrong = Poses(rotation=np.diag((1.0, -1.0, -1.0)) @ true.rotation, centres=true.centres)
    fields = world.named(poses=np.concatenate([wrong.rotation, wrong.translation[..., None]], 2))
    path = world.write(tmp_path / "gl.npz", fields)
    for command, code in ((("eval", "matching"), 2), (("check",), 1)):
        assert run_main(*command, path, "--data", world.root) == code
        assert re.search("by 1[78][0-9] degrees", capsys.readouterr().err)


def read_differently(rotation: np.ndarray[Any, Any], *, quaternions: bool = False) -> str:
    """Return what is said of rotations beside IMUs that are one to three degrees off."""
    true = Poses(rotation=rotation, centres=np.zeros((len(rotation), 3)))
    rng = np.random.default_rng(0)
    off = Rotation.from_rotvec(rng.normal(0, 0.02, (len(rotation), 3))).as_matrix()
    opengl = np.diag((1.0, -1.0, -1.0)) @ rotation
    refuse_other_conventions(true, replace(true, rotation=off @ rotation))
    with pytest.raises(PredictionError) as caught:
        refuse_other_conventions(
            replace(true, rotation=opengl),
            replace(true, rotation=off @ rotation),
            quaternions=quaternions,
        )
    return str(caught.value)


@pytest.mark.parametrize("yaw_deg", [0.0, 5.0, 90.0])
@pytest.mark.parametrize("quaternions", [False, True])
def test_opengl_axes_of_photos_that_look_down(yaw_deg: float, *, quaternions: bool) -> None:
    rng = np.random.default_rng(1)
    pairs = zip(rng.normal(0, 1, 20), rng.normal(0, yaw_deg, 20), strict=True)
    message = read_differently(
        np.concatenate([looking_down(*pair) for pair in pairs]), quaternions=quaternions
    )
    if yaw_deg >= 5 or not quaternions:
        assert "OpenGL's camera axes" in message
        assert "quaternions in the order" not in message


def test_opengl_axes_of_real_photos(brighton: Path) -> None:
    images = json.loads((brighton / "poses.json").read_text())["images"].values()
    message = read_differently(np.array([image["R_w2c"] for image in images]))
    assert "those of OpenGL's camera axes" in message


def test_matrices_of_quaternions_in_another_order() -> None:
    true = np.concatenate([looking_down(55, 63 * q) for q in range(N_QUERIES)])
    priors = Poses(rotation=true, centres=np.zeros((N_QUERIES, 3)))
    mistaken = quaternion_to_matrix(np.roll(matrix_to_quaternion(true), -1, axis=1))
    with pytest.raises(PredictionError, match="matrices made of quaternions in the order x y z w"):
        refuse_other_conventions(replace(priors, rotation=mistaken), priors)
