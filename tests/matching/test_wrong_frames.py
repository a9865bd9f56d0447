"""The track end to end on pixels and poses of another frame."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.core.errors import PredictionError
from tests.matching.evaluated import evaluated, records
from tests.matching.matched import matched
from tests.matching.world import (
    World,
    made_matching_protocol,
    make_world,
    without,
)
from tests.support import run_main


def test_half_a_pixel_of_the_map_is_seen(world: World, tmp_path: Path) -> None:
    shifted = [xy + 0.5 for xy in world.map_xy]
    rows = records(world, tmp_path, world.correspondences(world.query_xy, map_xy=shifted))
    # A pixel is 2 m: the estimate moves by 1 m to the east and 1 m to the south.
    assert (abs(rows["horizontal_m"] - 2**0.5) < 0.5).all()


def test_half_a_pixel_of_the_query_is_seen(world: World, tmp_path: Path) -> None:
    shifted = [xy + 0.5 for xy in world.query_xy]
    rows = records(world, tmp_path, world.correspondences(shifted, map_xy=world.map_xy))
    # Half a pixel of f = 520 px is 0.055 degrees; 0.078 along the diagonal.
    assert rows["rotation_deg"].between(0.03, 0.15).all()
    assert (rows["error_m"] > 1e-3).all()


def test_rows_before_columns_are_refused(world: World, tmp_path: Path) -> None:
    swapped = [xy[:, ::-1] for xy in world.map_xy]
    fields = world.correspondences(world.query_xy, map_xy=swapped)
    for frame in ({}, {"map_frame": np.array("map")}):
        with pytest.raises(PredictionError, match="rows before columns") as caught:
            records(world, tmp_path, fields | frame)
        assert "x, the column, before y" in str(caught.value)


def test_crop_pixels_taken_for_map_pixels_are_refused(
    world: World, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fields = without(world.in_crops(), "map_frame")
    path = world.write(tmp_path / "m.npz", fields)
    for command, code in ((("eval", "matching"), 2), (("check",), 1)):
        assert run_main(*command, path, "--data", world.root) == code
        message = capsys.readouterr().err
        for part in ("look like pixels of the crop", "100% lie", "26%", "map_frame='crop'"):
            assert part in message
    # Who says that they are the map's is believed, and told.
    stated = evaluated(world, tmp_path, fields | {"map_frame": np.array("map")})
    assert (stated.records["error_m"] > 50).all()
    said = "map pixels lie outside the query's crop"
    assert any(said in note for note in stated.result.notes)
    path = world.write(tmp_path / "m.npz", fields | {"map_frame": np.array("map")})
    assert run_main("check", path, "--data", world.root) == 0
    assert said in capsys.readouterr().err


def test_camera_to_world_is_refused(world: World, tmp_path: Path) -> None:
    true = world.truth.poses
    inverted = np.swapaxes(true.rotation, 1, 2)
    fields = world.named(poses=np.concatenate([inverted, true.centres[..., None]], axis=2))
    with pytest.raises(PredictionError, match="camera-to-world"):
        records(world, tmp_path, fields)
    assert run_main("eval", "matching", tmp_path / "method.npz", "--data", world.root) == 2


def test_pixels_of_a_smaller_photo_are_suspected(world: World, tmp_path: Path) -> None:
    halved = [xy / 2 for xy in world.query_xy]
    run = evaluated(world, tmp_path, world.correspondences(halved, map_xy=world.map_xy))
    assert any("in the size of a smaller image" in note for note in run.result.notes)
    exact = evaluated(world, tmp_path, world.matches())
    assert not any("smaller image" in note for note in exact.result.notes)


def test_integer_centres_shift_the_map_by_half_a_pixel(tmp_path: Path) -> None:
    world = make_world(tmp_path, made_matching_protocol(lift={"map_pixel_centres": "integer"}))
    shifted = [xy - 0.5 for xy in world.map_xy]
    rows = records(world, tmp_path, world.correspondences(world.query_xy, map_xy=shifted))
    assert rows["error_m"].max() < 1e-6


def exchanged_in_crops(world: World) -> dict[str, Any]:
    """Return matches in pixels of the crops, rows before columns, as far as they lie inside."""
    pairs = []
    for xy, seen, crop in zip(world.map_xy, world.query_xy, world.truth.crops, strict=True):
        local = (xy - crop[:2])[:, ::-1]
        inside = (local <= crop[2:]).all(axis=1)
        pairs.append((seen[inside], local[inside]))
    query_xy, map_xy = map(list, zip(*pairs, strict=True))
    return world.correspondences(query_xy, map_xy=map_xy) | {"map_frame": np.array("crop")}


def in_feet(world: World) -> dict[str, Any]:
    true = world.truth.poses
    centres = true.centres / (1.0, 1.0, 0.3048) + 0.123456789
    return world.named(rotations=true.rotation, centres=centres)


def points_in_feet(world: World) -> dict[str, Any]:
    points = [xyz / (1.0, 1.0, 0.3048) for xyz in world.points]
    return world.correspondences(world.query_xy, points3d=points)


MISREAD = {"map_xy": exchanged_in_crops, "poses": in_feet, "points3d": points_in_feet}


@pytest.mark.parametrize("field", MISREAD)
def test_what_another_reading_explains_is_refused(
    world: World, tmp_path: Path, capsys: pytest.CaptureFixture[str], field: str
) -> None:
    path = world.write(tmp_path / "m.npz", MISREAD[field](world))
    for command, code in ((("eval", "matching"), 2), (("check",), 1)):
        assert run_main(*command, path, "--data", world.root) == code
        said = capsys.readouterr().err
        assert field in said
        assert ("feet" if field != "map_xy" else "x and y exchanged") in said


def test_what_another_reading_explains_in_part_is_asked_about(world: World, tmp_path: Path) -> None:
    rough = in_feet(world)
    rough["centres"] += np.random.default_rng(0).normal(0, 80, rough["centres"].shape)
    notes = evaluated(world, tmp_path, rough).result.notes
    assert any("scene hills: heights in feet?" in note for note in notes)


@pytest.mark.parametrize("seed", range(5))
def test_poor_answers_are_scored_without_a_word(world: World, tmp_path: Path, seed: int) -> None:
    rng, true = np.random.default_rng(seed), world.truth.poses
    crops = [crop[:2] + rng.random((60, 2)) * crop[2:] for crop in world.truth.crops]
    noisy = [xyz + rng.normal(0, 40, xyz.shape) for xyz in world.points]
    centres = true.centres + rng.normal(0, 100, true.centres.shape)
    for fields in (
        world.correspondences(world.query_xy, map_xy=crops),
        world.correspondences(world.query_xy, points3d=noisy),
        world.named(rotations=true.rotation, centres=centres),
    ):
        assert matched(world, tmp_path, fields).doubt is None
