"""Predictions matched to a scene: rows find their queries, and what cannot be meant is refused."""

from __future__ import annotations

import json
import re
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from airzoo_bench.benchmark.queries import PRIOR_COLUMNS
from airzoo_bench.core.errors import PredictionError
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.rotations import matrix_to_quaternion, quaternion_to_matrix
from airzoo_bench.matching.conventions import (
    refuse_other_conventions,
    suspect_inverted,
    suspect_turned,
)
from airzoo_bench.matching.notes import plausibility_warnings
from airzoo_bench.matching.reading import read_matching
from airzoo_bench.matching.scene_predictions import ScenePredictions, match_scene
from tests.geometry.support import looking_down
from tests.matching.world import N_MATCHES, N_QUERIES, SIZE, World, make_world
from tests.support import run_main

EVERY = np.arange(N_QUERIES)


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    return make_world(tmp_path_factory.mktemp("world"))


def matched(
    world: World, path: Path, fields: dict[str, Any], rows: np.ndarray[Any, Any] = EVERY
) -> ScenePredictions:
    predictions = read_matching(world.write(path / "preds.npz", fields), 1 << 30)
    return match_scene(predictions, world.truth, rows)


def refused(world: World, path: Path, fields: dict[str, Any]) -> str:
    with pytest.raises(PredictionError) as caught:
        matched(world, path, fields)
    assert "preds.npz, " in str(caught.value)
    return str(caught.value)


def test_rows_find_their_queries(world: World, tmp_path: Path) -> None:
    # The predictions have the queries in this order; query 1 is not among them.
    rows = np.array([3, -1, 0, 2, 1])
    there = [2, 4, 3, 0]
    kept = [world.query_xy[q][: 10 + q] for q in there]
    fields = world.correspondences(kept, map_xy=[world.map_xy[q][: 10 + q] for q in there])
    fields["query_ids"] = np.array([world.ids[q] for q in there])
    predicted = matched(world, tmp_path, fields, rows)
    assert predicted.answered.tolist() == [True, False, True, True, True]
    assert np.diff(predicted.offsets).tolist() == [10, 0, 12, 13, 14]
    for query, part in enumerate(predicted.parts()):
        count = part.stop - part.start
        np.testing.assert_array_equal(predicted.query_xy[part], world.query_xy[query][:count])
        assert predicted.map_xy is not None
        np.testing.assert_array_equal(predicted.map_xy[part], world.map_xy[query][:count])


def test_pixels_of_crops_become_those_of_the_map(world: World, tmp_path: Path) -> None:
    predicted = matched(world, tmp_path, world.in_crops())
    np.testing.assert_allclose(predicted.map_xy, np.concatenate(world.map_xy), rtol=0, atol=1e-10)


def test_poses_of_missing_queries_are_nan(world: World, tmp_path: Path) -> None:
    predicted = matched(world, tmp_path, world.poses(), np.array([4, -1, 2, 3, 0]))
    assert predicted.poses is not None
    assert np.isnan(predicted.poses.centres).all(axis=1).tolist() == [
        False,
        True,
        False,
        False,
        False,
    ]
    np.testing.assert_allclose(predicted.poses.centres[0], world.truth.poses.centres[4], atol=1e-7)


@pytest.mark.parametrize("slack", [0.0, 1.0])
def test_borders_belong_to_the_picture(world: World, tmp_path: Path, slack: float) -> None:
    corner = np.array([[-slack, -slack], np.add(SIZE, slack)])
    sides = world.truth.crops[:, 2:]
    fields = world.correspondences(
        [corner] * N_QUERIES, map_xy=[np.stack([corner[0], side + slack]) for side in sides]
    )
    matched(world, tmp_path, fields | {"map_frame": np.array("crop")})


def test_another_image_size(world: World, tmp_path: Path) -> None:
    size = np.tile(SIZE, (N_QUERIES, 1))
    matched(world, tmp_path, world.matches(image_size=size))
    size[3] = (320, 240)
    message = refused(world, tmp_path, world.matches(image_size=size))
    for part in ("hills/q3", "640x480", "320x240", "1 of 5", "'image_size'", "multiply x and y"):
        assert part in message
    # Width and height the wrong way round are another size too.
    turned = world.matches(image_size=np.tile((480, 640), (N_QUERIES, 1)))
    assert "480x640" in refused(world, tmp_path, turned)


@pytest.mark.parametrize("pixel", [(-1.5, 3.0), (641.5, 3.0), (3.0, -1.5), (3.0, 481.5)])
def test_pixels_outside_the_photo(world: World, tmp_path: Path, pixel: tuple[float, float]) -> None:
    query_xy = [xy.copy() for xy in world.query_xy]
    query_xy[2][7] = pixel
    fields = world.correspondences(query_xy, map_xy=world.map_xy)
    message = refused(world, tmp_path, fields)
    for part in ("1 pixel outside", "hills/q2", f"({pixel[0]}, {pixel[1]})", "640x480", "scale"):
        assert part in message


def test_rows_before_columns_are_outside_the_photo(world: World, tmp_path: Path) -> None:
    swapped = [xy[:, ::-1] for xy in world.query_xy]
    fields = world.correspondences(swapped, map_xy=world.map_xy)
    assert "outside the photo" in refused(world, tmp_path, fields)


def test_pixels_of_the_map_are_outside_the_crop(world: World, tmp_path: Path) -> None:
    fields = world.matches(map_frame=np.array("crop"))
    message = refused(world, tmp_path, fields)
    for part in ("outside the crop", "hills/q", "'map_xy'", "map_frame='map'"):
        assert part in message


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
            predicted = match_scene(predictions, world.truth, EVERY)
            assert predicted.poses is not None
            np.testing.assert_allclose(predicted.poses.centres, true.centres, rtol=0, atol=1e-6)
            continue
        with pytest.raises(PredictionError, match="quaternions in the order x y z w") as caught:
            match_scene(predictions, world.truth, EVERY)
        assert "w x y z" in str(caught.value)


def test_poor_poses_are_scored_not_refused(world: World, tmp_path: Path) -> None:
    true = world.truth.poses
    away = Poses(rotation=true.rotation[::-1], centres=true.centres + 4000.0)
    fields = world.named(poses=np.concatenate([away.rotation, away.translation[..., None]], 2))
    assert matched(world, tmp_path, fields).poses is not None
    nothing = world.named(poses=np.full((N_QUERIES, 3, 4), np.nan))
    assert matched(world, tmp_path, nothing).answered.all()


def test_the_world_has_matches(world: World) -> None:
    assert [len(xy) for xy in world.query_xy] == [N_MATCHES] * N_QUERIES


def test_check_refuses_what_eval_refuses(
    world: World, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fields = world.matches()
    fields["query_ids"] = np.array([f"hills/nobody{n}" for n in range(len(fields["query_ids"]))])
    path = world.write(tmp_path / "m.npz", fields)
    for command, code in ((("eval", "matching"), 2), (("check",), 1)):
        assert run_main(*command, path, "--data", world.root) == code
        assert "none of its query ids belongs to" in capsys.readouterr().err


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


def test_many_pixels_of_a_little_smaller_image_are_suspected(world: World, tmp_path: Path) -> None:
    for factor, repeats, asked in ((1.0, 10, False), (0.8, 10, True), (0.8, 1, False)):
        query_xy = [np.tile(xy * factor, (repeats, 1)) for xy in world.query_xy]
        map_xy = [np.tile(xy, (repeats, 1)) for xy in world.map_xy]
        predicted = matched(world, tmp_path, world.correspondences(query_xy, map_xy=map_xy))
        said = " | ".join(plausibility_warnings([world.truth], [predicted]))
        assert ("scene hills: no match lies beyond" in said) == asked, factor


def test_a_centre_beyond_measure_is_told_in_words_only(
    world: World, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    true = world.truth.poses
    centres = np.where(np.arange(N_QUERIES)[:, None] == 0, 1e300, true.centres)
    path = world.write(tmp_path / "far.npz", world.named(rotations=true.rotation, centres=centres))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for command in (("eval", "matching"), ("check",)):
            assert run_main(*command, path, "--data", world.root) == 0
            assert "1 of 5 poses lies more than 1,000 m from the photo's GPS" in re.sub(
                r"\s+", " ", "".join(capsys.readouterr())
            )


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


def test_centres_lose_nothing(world: World, tmp_path: Path) -> None:
    true = world.truth.poses
    fields = world.named(rotations=true.rotation.astype(np.float32), centres=true.centres)
    predicted = matched(world, tmp_path, fields)
    assert predicted.poses is not None
    np.testing.assert_array_equal(predicted.poses.centres, true.centres)
    np.testing.assert_allclose(predicted.poses.rotation, true.rotation, rtol=0, atol=1e-6)


@pytest.mark.parametrize(("decimals", "error"), [(0, "0.5 m"), (1, "0.05 m"), (2, None)])
def test_centres_of_few_decimals_are_judged_as_translations_are(
    world: World, tmp_path: Path, decimals: int, error: str | None
) -> None:
    true = world.truth.poses
    centres = true.centres + np.random.default_rng(0).random((N_QUERIES, 3))
    moved = dict(zip(("x", "y", "z"), centres.T, strict=True))
    real = replace(world, truth=replace(world.truth, queries=world.truth.queries.assign(**moved)))
    rounded = np.round(centres, decimals)
    fields = world.named(rotations=true.rotation, centres=rounded)
    if error is None:
        assert matched(real, tmp_path, fields).poses is not None
        return
    message = refused(real, tmp_path, fields)
    for part in ("field 'centres'", "too few digits in the centres of 5 of 5", error, "0.01 m"):
        assert part in message
    # Fewer than three centres may have few decimals; so may places of a grid at one height, one
    # place for all, and the cameras of a made-up scene, which are at whole metres here.
    one = np.where(np.arange(N_QUERIES)[:, None] == 2, rounded, np.nan)
    turned = np.where(np.isfinite(one)[:, :, None], true.rotation, np.nan)
    assert matched(real, tmp_path, world.named(rotations=turned, centres=one)).poses is not None
    level = np.where([False, False, True], rounded[0], rounded)
    for there in (level, np.tile(rounded[0], (N_QUERIES, 1))):
        fields = world.named(rotations=true.rotation, centres=there)
        assert matched(real, tmp_path, fields).poses is not None
    fields = world.named(rotations=true.rotation, centres=true.centres)
    assert matched(world, tmp_path, fields).poses is not None


def test_poses_of_too_few_digits(
    world: World, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    true = world.truth.poses
    offset = np.array((0.123456789, 0.987654321, 0.5555555))
    true = Poses(rotation=true.rotation, centres=true.centres + offset)
    rounded = np.concatenate([np.round(true.rotation, 6), true.translation[..., None]], 2)
    moved = Poses.from_translations(rounded[..., :3], rounded[..., 3]).centres - true.centres
    error = np.sqrt((moved**2).sum(axis=1).mean())
    message = refused(world, tmp_path, world.named(poses=rounded))
    said = float(message.split("moves a camera by ")[1].split(" m")[0])
    assert said == pytest.approx(error, rel=0.5)
    assert error > 0.3
    assert "rotations and centres" in message
    for data, code in ((world.root, 1), (tmp_path, 1)):  # without the benchmark too
        path = world.write(tmp_path / "p.npz", world.named(poses=rounded))
        named = ("--protocol", world.folder / "protocols" / "hills-matching.toml")
        assert run_main("check", path, "--data", data, *named) == code
        assert "too few digits" in capsys.readouterr().err


@pytest.mark.parametrize("digits", [4, 6])
def test_pose_lists_of_too_few_digits(world: World, tmp_path: Path, digits: int) -> None:
    true = world.truth.poses
    centres = true.centres + 0.123456789
    exact = Poses(rotation=true.rotation, centres=centres)
    quaternions = np.round(matrix_to_quaternion(true.rotation), digits)
    rows = zip(world.ids, quaternions, exact.translation, strict=True)
    lines = [f"{name} {' '.join(f'{v:.12f}' for v in (*q, *t))}" for name, q, t in rows]
    path = tmp_path / "poses.txt"
    path.write_text("\n".join(lines))
    moved = Poses.from_quaternions(quaternions, exact.translation).centres - centres
    error = np.sqrt((moved**2).sum(axis=1).mean())
    with pytest.raises(PredictionError, match="too few digits") as caught:
        match_scene(read_matching(path, 1 << 30), world.truth, EVERY)
    said = float(str(caught.value).split("moves a camera by ")[1].split(" m")[0])
    assert said == pytest.approx(error, rel=0.6)
    assert error > (100 if digits == 4 else 1)


@pytest.mark.parametrize("field", ["query_xy", "map_xy"])
@pytest.mark.parametrize("kind", ["f2", "f8"])
def test_pixels_that_went_through_float16(
    world: World, tmp_path: Path, field: str, kind: str
) -> None:
    lost = [xy.astype(np.float16).astype(kind) for xy in getattr(world, field)]
    fields = world.correspondences(world.query_xy, map_xy=world.map_xy)
    fields[field] = np.concatenate(lost)
    message = refused(world, tmp_path, fields)
    for part in ("went through float16", f"'{field}'", "m of ground", "float32"):
        assert part in message
    # Whole pixels fit float16 too, and have lost nothing.
    fields[field] = np.round(np.concatenate(getattr(world, field))).astype(kind)
    matched(world, tmp_path, fields)


def test_the_fix_for_of_swapped_sides(world: World, tmp_path: Path) -> None:
    swapped = [xy[:, ::-1] for xy in world.query_xy]
    message = refused(world, tmp_path, world.correspondences(swapped, map_xy=world.map_xy))
    assert "x, the column, before y" in message
    assert "scale" not in message
    turned = world.matches(image_size=np.tile((480, 640), (N_QUERIES, 1)))
    assert "width before height" in refused(world, tmp_path, turned)


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
