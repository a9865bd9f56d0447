"""Predictions matched to a scene: rows find their queries, and what cannot be meant is refused."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.geometry.poses import Poses
from airzoo_bench.matching.notes import plausibility_warnings
from airzoo_bench.matching.reading import read_matching
from tests.matching.matched import matched, refused
from tests.matching.world import N_MATCHES, N_QUERIES, SIZE, World
from tests.support import run_main


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


def test_many_pixels_of_a_little_smaller_image_are_suspected(world: World, tmp_path: Path) -> None:
    for factor, repeats, asked in ((1.0, 10, False), (0.8, 10, True), (0.8, 1, False)):
        query_xy = [np.tile(xy * factor, (repeats, 1)) for xy in world.query_xy]
        map_xy = [np.tile(xy, (repeats, 1)) for xy in world.map_xy]
        predicted = matched(world, tmp_path, world.correspondences(query_xy, map_xy=map_xy))
        read = read_matching(tmp_path / "preds.npz", 1 << 30)
        said = " | ".join(plausibility_warnings(read, [world.truth], [predicted]))
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


def test_the_fix_for_of_swapped_sides(world: World, tmp_path: Path) -> None:
    swapped = [xy[:, ::-1] for xy in world.query_xy]
    message = refused(world, tmp_path, world.correspondences(swapped, map_xy=world.map_xy))
    assert "x, the column, before y" in message
    assert "scale" not in message
    turned = world.matches(image_size=np.tile((480, 640), (N_QUERIES, 1)))
    assert "width before height" in refused(world, tmp_path, turned)
