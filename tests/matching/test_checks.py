"""What users do wrong and cannot see is refused, or asked about; poor answers are not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from airzoo_bench.benchmark.queries import PRIOR_COLUMNS
from airzoo_bench.geometry.poses import Poses, matrix_to_quaternion, quaternion_to_matrix
from tests.geometry.support import looking_down
from tests.matching.world import N_QUERIES, World, matched, refused

OPENGL = np.diag((1.0, -1.0, -1.0))
Fields = dict[str, Any]


def notes(world: World, folder: Path, fields: Fields) -> str:
    return " | ".join(matched(world, folder, fields).doubts)


def matrices(rotation: Any, translation: Any) -> Any:
    return np.concatenate([rotation, translation[:, :, None]], axis=2)


def oblique(world: World) -> World:
    """Return the world with priors 55 degrees off nadir."""
    rotation = np.concatenate([looking_down(55, 63 * q) for q in range(N_QUERIES)])
    turned = dict(zip(PRIOR_COLUMNS[:4], matrix_to_quaternion(rotation).T, strict=True))
    truth = replace(world.truth, queries=world.truth.queries.assign(**turned))
    return replace(world, truth=truth)


def points(world: World, change: Callable[[Any], Any]) -> Fields:
    return world.correspondences(world.query_xy, points3d=[change(xyz) for xyz in world.points])


def centred(world: World, rotation: Any = None, centres: Any = None) -> Fields:
    true = world.truth.poses
    rotations = true.rotation if rotation is None else rotation
    return world.named(rotations=rotations, centres=true.centres if centres is None else centres)


def moved(world: World, *by: float) -> Fields:
    return centred(world, centres=world.truth.poses.centres + by)


def feet(xyz: Any) -> Any:
    return xyz / (1.0, 1.0, 0.3048) + 0.123456789


def degrees(xyz: Any) -> Any:
    return xyz / (1e4, 1e6, 1.0)


def back(rotation: Any) -> Any:
    return np.swapaxes(rotation, 1, 2)


def one_outside(world: World) -> Fields:
    query_xy = [xy.copy() for xy in world.query_xy]
    query_xy[2][7] = (641.5, 3.0)
    return world.correspondences(query_xy, map_xy=world.map_xy)


def turned(world: World, change: Callable[[Any], Any]) -> Fields:
    """Return poses whose rotations are the priors' read wrongly."""
    return centred(world, change(world.truth.priors.rotation))


def read_as_wxyz(rotation: Any) -> Any:
    return quaternion_to_matrix(np.roll(matrix_to_quaternion(rotation), -1, axis=1))


REFUSED: dict[str, tuple[Callable[[World], Fields], list[str]]] = {
    "outside": (one_outside, ["'query_xy'", "hills/q2", "(641.5, 3.0)", "640x480"]),
    "points in feet": (lambda w: points(w, feet), ["'points3d'", "feet"]),
    "points in degrees": (lambda w: points(w, degrees), ["'points3d'", "degrees"]),
    "centres in feet": (lambda w: centred(w, None, feet(w.truth.poses.centres)), ["feet"]),
    "in degrees": (lambda w: centred(w, None, degrees(w.truth.poses.centres)), ["degrees"]),
    "camera-to-world": (
        lambda w: w.named(poses=matrices(back(w.truth.poses.rotation), w.truth.poses.centres)),
        ["camera-to-world", "5.385 m", "R.T and -R.T @ t"],
    ),
    "centres for translations": (
        lambda w: w.named(poses=matrices(w.truth.poses.rotation, w.truth.poses.centres)),
        ["camera-to-world", "t = -R @ centre"],
    ),
    # Cameras that look down: a rotation and its inverse are apart by little more than their tilt.
    "rotations alone": (lambda w: turned(w, back), ["camera-to-world", "degrees"]),
    "OpenGL": (lambda w: turned(oblique(w), lambda R: OPENGL @ R), ["diag(1, -1, -1) @ R"]),
    "OpenGL back": (
        lambda w: turned(oblique(w), lambda R: back(OPENGL @ R)),
        ["camera-to-world rotations", "diag(1, -1, -1) @ R"],
    ),
    "x y z w": (lambda w: turned(oblique(w), read_as_wxyz), ["in the order x y z w"]),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_meant_is_refused(world: World, tmp_path: Path, case: str) -> None:
    make, names = REFUSED[case]
    judged = oblique(world) if case[0] in "Ox" else world
    message = refused(judged, tmp_path, make(world))
    for name in names:
        assert name in message


NOTED: dict[str, tuple[Callable[[World], Fields], str]] = {
    "another datum": (lambda w: moved(w, 0.1, 0.2, 31.0), "vertical datum? They lie +31.0 m"),
    "the priors": (
        lambda w: centred(w, w.truth.priors.rotation, w.truth.priors.centres),
        "5 of 5 answers equal to the prior",
    ),
}


@pytest.mark.parametrize("case", NOTED)
def test_what_may_be_meant_is_noted(world: World, tmp_path: Path, case: str) -> None:
    make, note = NOTED[case]
    assert note in notes(world, tmp_path, make(world))


def test_pixels_of_a_smaller_image_are_suspected(world: World, tmp_path: Path) -> None:
    for factor, repeats, asked in ((1.0, 10, False), (0.8, 10, True), (0.8, 1, False), (0.5, 1, 1)):
        query_xy = [np.tile(xy * factor, (repeats, 1)) for xy in world.query_xy]
        map_xy = [np.tile(xy, (repeats, 1)) for xy in world.map_xy]
        said = notes(world, tmp_path, world.correspondences(query_xy, map_xy=map_xy))
        assert ("scene hills: no match lies beyond" in said) == bool(asked), factor


@pytest.mark.parametrize("seed", range(5))
def test_poor_answers_are_scored_without_a_word(world: World, tmp_path: Path, seed: int) -> None:
    rng, true = np.random.default_rng(seed), world.truth.poses
    crops = [crop[:2] + rng.random((60, 2)) * crop[2:] for crop in world.truth.crops]
    turn = Rotation.from_euler("z", (5.0, 25.0, 90.0, 180.0, 45.0)[seed], degrees=True)
    for fields in (
        world.correspondences(world.query_xy, map_xy=crops),
        points(world, lambda xyz: xyz + rng.normal(0, 40, xyz.shape)),
        centred(world, centres=true.centres + rng.normal(0, 100, true.centres.shape)),
        # Rough rotations that no other reading brings nearer are a method's own.
        centred(world, true.rotation @ turn.as_matrix()),
        world.named(poses=np.full((N_QUERIES, 3, 4), np.nan)),
    ):
        assert not notes(world, tmp_path, fields)


@pytest.mark.parametrize(("decimals", "error"), [(-1, ""), (0, "0.5 m"), (1, "0.05 m"), (2, "")])
def test_centres_on_a_lattice_are_refused_where_it_matters_and_noted_else(
    world: World, tmp_path: Path, decimals: int, error: str
) -> None:
    places = world.truth.poses.centres + np.random.default_rng(0).random((N_QUERIES, 3))
    xyz = dict(zip(("x", "y", "z"), places.T, strict=True))
    real = replace(world, truth=replace(world.truth, queries=world.truth.queries.assign(**xyz)))
    fields = centred(world, centres=np.round(places, decimals))
    if decimals < 0:  # beside 1 m, the finest threshold
        assert "field 'centres': too few digits" in refused(real, tmp_path, fields)
        return
    assert (f"{error} off" in notes(real, tmp_path, fields)) == bool(error)
    # Cameras of a made-up scene may be at whole metres, as they are here.
    assert "lattice" not in notes(world, tmp_path, centred(world))


@pytest.mark.parametrize("form", ["matrices", "quaternions", "normalised again", "exact"])
def test_poses_of_too_few_digits(world: World, tmp_path: Path, form: str) -> None:
    rotation, centres = world.truth.poses.rotation, world.truth.poses.centres + 0.123456789
    quaternions = np.round(matrix_to_quaternion(rotation), 16 if form == "exact" else 6)
    if form == "normalised again":
        quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    rounded = np.round(rotation, 6) if form == "matrices" else quaternion_to_matrix(quaternions)
    translation = Poses(rotation=rotation, centres=centres).translation
    given: Any = world.named(poses=matrices(rounded, translation))
    if form != "matrices":
        given, rows = tmp_path / "poses.txt", np.hstack([quaternions, translation]).tolist()
        named = zip(world.ids, rows, strict=True)
        given.write_text("\n".join(f"{name} {' '.join(map(repr, row))}" for name, row in named))
    if form == "exact":
        assert not matched(world, tmp_path, given).doubts
        return
    said = float(refused(world, tmp_path, given).split("move a camera by ")[1].split(" m")[0])
    off = Poses.from_translations(rounded, translation).centres - centres
    assert said == pytest.approx(np.sqrt((off**2).sum(axis=1).mean()), rel=0.6)
    assert said > 0.3
