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

Fields = dict[str, Any]


def oblique(world: World) -> World:
    """Return the world with priors 55 degrees off nadir."""
    rotation = np.concatenate([looking_down(55, 63 * q) for q in range(N_QUERIES)])
    turned = dict(zip(PRIOR_COLUMNS[:4], matrix_to_quaternion(rotation).T, strict=True))
    truth = replace(world.truth, queries=world.truth.queries.assign(**turned))
    return replace(world, truth=truth)


def points(world: World, change: Callable[[Any], Any]) -> Fields:
    return world.correspondences(world.query_xy, points3d=[change(xyz) for xyz in world.points])


def centred(world: World, change: Callable[[Any], Any] = np.array, rotation: Any = None) -> Fields:
    true = world.truth.poses
    rotations = true.rotation if rotation is None else rotation
    return world.named(rotations=rotations, centres=change(true.centres))


def turned(world: World, change: Callable[[Any], Any]) -> Fields:
    """Return poses whose rotations are those of oblique priors read wrongly."""
    return centred(world, rotation=change(oblique(world).truth.priors.rotation))


def inverted(world: World) -> Fields:
    true = world.truth.poses
    rotation = np.swapaxes(true.rotation, 1, 2)
    return world.named(poses=np.concatenate([rotation, true.centres[:, :, None]], axis=2))


def degrees(xyz: Any) -> Any:
    return xyz / (1e4, 1e6, 1.0)


def one_outside(world: World) -> Fields:
    query_xy = [xy.copy() for xy in world.query_xy]
    query_xy[2][7] = (641.5, 3.0)
    return world.correspondences(query_xy, map_xy=world.map_xy)


# Faults beyond those of tests/goldens/refusals.txt.
REFUSED: dict[str, tuple[Callable[[World], Fields], list[str]]] = {
    "outside": (one_outside, ["'query_xy'", "hills/q2", "(641.5, 3.0)", "640x480"]),
    "points in degrees": (lambda w: points(w, degrees), ["'points3d'", "degrees"]),
    "feet": (lambda w: centred(w, lambda xyz: xyz / (1.0, 1.0, 0.3048) + 0.1234567), ["feet"]),
    "in degrees": (lambda w: centred(w, degrees), ["degrees"]),
    "camera-to-world": (inverted, ["camera-to-world", "5.385 m", "R.T and -R.T @ t"]),
    "OpenGL back": (
        lambda w: turned(w, lambda R: np.swapaxes(np.diag((1.0, -1.0, -1.0)) @ R, 1, 2)),
        ["camera-to-world rotations", "diag(1, -1, -1) @ R"],
    ),
    "x y z w": (
        lambda w: turned(
            w, lambda R: quaternion_to_matrix(np.roll(matrix_to_quaternion(R), -1, axis=1))
        ),
        ["in the order x y z w"],
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_meant_is_refused(world: World, tmp_path: Path, case: str) -> None:
    make, names = REFUSED[case]
    judged = oblique(world) if case[0] in "Ox" else world
    message = refused(judged, tmp_path, make(world))
    for name in names:
        assert name in message


def smaller(world: World, factor: float, repeats: int = 10) -> Fields:
    """Return matches of images that are smaller by a factor, each match more than once."""
    query_xy = [np.tile(xy * factor, (repeats, 1)) for xy in world.query_xy]
    return world.correspondences(
        query_xy, map_xy=[np.tile(xy, (repeats, 1)) for xy in world.map_xy]
    )


def poor(world: World, seed: int) -> list[Fields]:
    rng, true = np.random.default_rng(seed), world.truth.poses
    crops = [crop[:2] + rng.random((60, 2)) * crop[2:] for crop in world.truth.crops]
    turn = Rotation.from_euler("z", (5.0, 90.0, 180.0)[seed], degrees=True).as_matrix()
    return [
        world.correspondences(world.query_xy, map_xy=crops),
        points(world, lambda xyz: xyz + rng.normal(0, 40, xyz.shape)),
        centred(world, lambda xyz: xyz + rng.normal(0, 100, xyz.shape)),
        # Rough rotations that no other reading brings nearer are a method's own.
        centred(world, rotation=true.rotation @ turn),
        world.named(poses=np.full((N_QUERIES, 3, 4), np.nan)),
    ]


# By case: predictions, and what their note says, if they get one.
NOTED: dict[str, tuple[Callable[[World], list[Fields]], str]] = {
    "another datum": (
        lambda w: [centred(w, lambda xyz: xyz + np.array((0.1, 0.2, 31.0)))],
        "vertical datum? They lie +31.0 m",
    ),
    "the priors": (
        lambda w: [w.named(rotations=w.truth.priors.rotation, centres=w.truth.priors.centres)],
        "5 of 5 answers equal to the prior",
    ),
    "smaller photos": (
        lambda w: [smaller(w, 0.8), smaller(w, 0.5, 1)],
        "scene hills: no match lies beyond",
    ),
    "few matches or whole photos": (lambda w: [smaller(w, 0.8, 1), smaller(w, 1.0)], ""),
    **{f"poor {seed}": (lambda w, seed=seed: poor(w, seed), "") for seed in range(3)},
}


@pytest.mark.parametrize("case", NOTED)
def test_what_may_be_meant_is_noted_and_poor_answers_are_not(
    world: World, tmp_path: Path, case: str
) -> None:
    make, note = NOTED[case]
    for fields in make(world):
        said = " | ".join(matched(world, tmp_path, fields).doubts)
        assert note in said
        assert bool(said) == bool(note)


@pytest.mark.parametrize(("decimals", "error"), [(-1, ""), (0, "0.5 m"), (1, "0.05 m"), (2, "")])
def test_centres_on_a_lattice_are_refused_where_it_matters_and_noted_else(
    world: World, tmp_path: Path, decimals: int, error: str
) -> None:
    places = world.truth.poses.centres + np.random.default_rng(0).random((N_QUERIES, 3))
    xyz = dict(zip(("x", "y", "z"), places.T, strict=True))
    real = replace(world, truth=replace(world.truth, queries=world.truth.queries.assign(**xyz)))
    fields = centred(world, lambda _: np.round(places, decimals))
    if decimals < 0:  # beside 1 m, the finest threshold
        assert "field 'centres': too few digits" in refused(real, tmp_path, fields)
        return
    said = matched(real, tmp_path, fields).doubts
    assert any(f"{error} off" in note for note in said) == bool(error)
    # Cameras of a made-up scene may be at whole metres, as they are here.
    assert not any("lattice" in note for note in matched(world, tmp_path, centred(world)).doubts)


def test_rotations_of_too_few_digits_are_refused_with_the_figure(
    world: World, tmp_path: Path
) -> None:
    rotation, centres = world.truth.poses.rotation, world.truth.poses.centres + 0.123456789
    translation, rounded = Poses(rotation=rotation, centres=centres).translation, rotation.round(6)
    fields = world.named(poses=np.concatenate([rounded, translation[:, :, None]], axis=2))
    said = float(refused(world, tmp_path, fields).split("move a camera by ")[1].split(" m")[0])
    off = Poses.from_translations(rounded, translation).centres - centres
    assert said == pytest.approx(np.sqrt((off**2).sum(axis=1).mean()), rel=0.6)
    assert said > 0.3
