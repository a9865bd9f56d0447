"""Poses and pixels that have lost digits on their way into a file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.geometry.poses import Poses, matrix_to_quaternion
from airzoo_bench.matching.notes import plausibility_warnings
from airzoo_bench.matching.reading import read_matching
from airzoo_bench.matching.scene_predictions import match_scene
from tests.matching.matched import EVERY, matched, refused
from tests.matching.world import N_QUERIES, World
from tests.support import run_main


def test_centres_lose_nothing(world: World, tmp_path: Path) -> None:
    true = world.truth.poses
    fields = world.named(rotations=true.rotation.astype(np.float32), centres=true.centres)
    predicted = matched(world, tmp_path, fields)
    assert predicted.poses is not None
    np.testing.assert_array_equal(predicted.poses.centres, true.centres)
    np.testing.assert_allclose(predicted.poses.rotation, true.rotation, rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("decimals", "error"), [(-1, "m on average"), (0, "0.5 m"), (1, "0.05 m"), (2, "")]
)
def test_centres_on_a_lattice_are_refused_where_it_matters_and_noted_else(
    world: World, tmp_path: Path, decimals: int, error: str
) -> None:
    true = world.truth.poses
    centres = true.centres + np.random.default_rng(0).random((N_QUERIES, 3))
    moved = dict(zip(("x", "y", "z"), centres.T, strict=True))
    real = replace(world, truth=replace(world.truth, queries=world.truth.queries.assign(**moved)))
    rounded = np.round(centres, decimals)
    fields = world.named(rotations=true.rotation, centres=rounded)
    if decimals < 0:  # beside 1 m, the finest threshold
        message = refused(real, tmp_path, fields)
        for part in ("field 'centres'", "too few digits in the centres of 5 of 5", error):
            assert part in message
        return

    def notes(world: World, fields: dict[str, Any]) -> str:
        predicted, read = matched(world, tmp_path, fields), tmp_path / "preds.npz"
        return " ".join(
            plausibility_warnings(read_matching(read, 1 << 30), [world.truth], [predicted])
        )

    assert (f"{error} off on average" in notes(real, fields)) == bool(error)
    # Fewer than three centres may have few decimals; so may places of a grid at one height, one
    # place for all, and the cameras of a made-up scene, which are at whole metres here.
    one = np.where(np.arange(N_QUERIES)[:, None] == 2, rounded, np.nan)
    turned = np.where(np.isfinite(one)[:, :, None], true.rotation, np.nan)
    assert "lattice" not in notes(real, world.named(rotations=turned, centres=one))
    level = np.where([False, False, True], rounded[0], rounded)
    for there in (level, np.tile(rounded[0], (N_QUERIES, 1))):
        assert "lattice" not in notes(real, world.named(rotations=true.rotation, centres=there))
    assert "lattice" not in notes(world, world.named(rotations=true.rotation, centres=true.centres))


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


@pytest.mark.parametrize("normalised_again", [False, True])
@pytest.mark.parametrize("digits", [4, 6])
def test_pose_lists_of_too_few_digits(
    world: World, tmp_path: Path, digits: int, *, normalised_again: bool
) -> None:
    true = world.truth.poses
    centres = true.centres + 0.123456789
    exact = Poses(rotation=true.rotation, centres=centres)
    quaternions = np.round(matrix_to_quaternion(true.rotation), digits)
    if normalised_again:
        quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    rows = zip(world.ids, quaternions, exact.translation, strict=True)
    lines = [f"{name} {' '.join(f'{v:.17f}' for v in (*q, *t))}" for name, q, t in rows]
    path = tmp_path / "poses.txt"
    path.write_text("\n".join(lines))
    moved = Poses.from_quaternions(quaternions, exact.translation).centres - centres
    error = np.sqrt((moved**2).sum(axis=1).mean())
    with pytest.raises(PredictionError, match="too few digits") as caught:
        match_scene(read_matching(path, 1 << 30), world.truth, EVERY, world.protocol.scores)
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
