"""npz of matchers: exact matches score perfect, and pixels of an unknown size are refused."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.core.registry import READERS
from airzoo_bench.evaluation.reader import Reading, find_reader
from tests.matching.world import World
from tests.readers import matching_files
from tests.support import run_main

Evaluated = Callable[..., Any]
WRITERS: dict[str, Callable[..., Path]] = {
    "loftr": matching_files.write_loftr,
    "superglue": matching_files.write_superglue,
    "roma": matching_files.write_roma,
    "dust3r-matches": matching_files.write_dust3r,
    "mast3r-visloc": matching_files.write_mast3r_visloc,
}


@pytest.fixture(scope="module")
def own(world: World, tmp_path_factory: pytest.TempPathFactory) -> Any:
    import airzoo_bench as ab

    path = world.write(tmp_path_factory.mktemp("own") / "own.npz", world.matches())
    return ab.evaluate(path, data=world.root).overall


def test_whole_pixels_are_what_the_layout_of_dust3r_loses(
    world: World, tmp_path: Path, evaluated: Evaluated
) -> None:
    """DUSt3R's matches are whole pixels of pictures of 512 px; nothing else is lost on the way."""
    home = matching_files.write_dust3r(tmp_path, world)
    for path in home.iterdir():
        fields = dict(np.load(path))
        whole = {key: np.rint(fields[key]) for key in ("matches_im0", "matches_im1")}
        np.savez(path, **fields | whole)
    errors = evaluated(home).records["error_m"]
    assert 0.01 < errors.median() < 2.0


def test_one_file_is_one_query(world: World, tmp_path: Path, evaluated: Evaluated) -> None:
    path = matching_files.write_loftr(tmp_path, world) / "q3.npz"
    assert find_reader(path) == "loftr"
    found = evaluated(path).records.set_index("query")
    assert found.loc["hills/q3", "error_m"] < 1e-6
    assert found["answered"].sum() == 1


@pytest.mark.parametrize(
    "named", ["hills/{0}", "hills/{0}_{0}_dom_matches", "hills/{0}.png/{0}_dom"]
)
def test_folders_name_the_scene_of_their_pairs(named: str, world: World, tmp_path: Path) -> None:
    home = matching_files.write_loftr(tmp_path, world)
    for one in list(home.iterdir()):
        place = home / f"{named.format(one.stem)}.npz"
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(one, place)
        for scene in ("town", "coast"):
            other = home / scene / place.relative_to(home / "hills")
            other.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(one, other)
        one.unlink()
    town = world.truth.queries.assign(id="town/" + world.truth.queries["id"].str[6:])
    asked, left_out = town[:2], town[2:].assign(reason="x")
    crops = world.truth.crops[:2]
    other = replace(world.truth, scene="town", queries=asked, crops=crops, excluded=left_out)
    truths, scenes = [world.truth, other], ("hills", "town", "coast")
    reading = Reading(world.protocol, truths, None, 1 << 26, scenes=scenes)
    read = READERS.get("loftr").read(home, reading)
    assert set(read.predictions.query_ids) == {*world.ids, *asked["id"]}
    assert read.notes == ("8 files of other pictures left out",)


def test_a_size_is_refused_where_it_is_not_used(
    world: World, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    where = ("--protocol", world.protocol.name, "--data", world.root)
    roma = matching_files.write_roma(tmp_path, world)
    plain = world.write(tmp_path / "own.npz", world.matches())
    for path, given in ((roma, "320x224"), (plain, "320x224"), (roma, "7")):
        assert run_main("eval", "matching", path, *where, "--image-size", given) == 2
        assert "--image-size" in capsys.readouterr().err


def test_roma_beyond_its_edges(world: World, tmp_path: Path, evaluated: Evaluated) -> None:
    """A match at 1.003 would have all others of its file taken for pixels of the first pixel."""
    path = matching_files.write_roma(tmp_path, world) / "q3.npz"
    fields = dict(np.load(path))
    fields["matches"][0, 0] = 1.003
    np.savez(path, **fields)
    with pytest.raises(PredictionError, match=r"1 match of 60 beyond"):
        evaluated(path.parent)


@pytest.mark.parametrize("other", ["old/hills/q3", "q3_q3_dom", "q3_dom_q3_matches"])
def test_two_runs_in_one_folder_are_not_pooled(
    other: str, world: World, tmp_path: Path, evaluated: Evaluated
) -> None:
    home = matching_files.write_loftr(tmp_path, world)
    place = home / f"{other}.npz"
    place.parent.mkdir(parents=True, exist_ok=True)
    shutil.copy(home / "q3.npz", place)
    with pytest.raises(PredictionError, match="are both hills/q3 with one part of the map"):
        evaluated(home)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"image_size0": (160, 112)}, "pixels up to"),
        ({"image_size0": (0, 3)}, "field 'image_size0' is"),
        ({"image_size0": (3.0, 3.0)}, "field 'image_size0' is"),
    ],
)
def test_sizes_that_do_not_fit(
    fields: dict[str, Any], words: str, world: World, tmp_path: Path, evaluated: Evaluated
) -> None:
    with pytest.raises(PredictionError, match=words):
        evaluated(matching_files.write_loftr(tmp_path, world, **fields))


@pytest.mark.parametrize(
    ("name", "field", "value", "words"),
    [
        ("loftr", "mkpts0_f", np.zeros(60), "field 'mkpts0_f' is float64"),
        ("roma", "matches", np.zeros((60, 2)), r"shape \(60, 2\)"),
        ("roma", "matches", np.full((60, 4), 5000.0), "outside it, the first at"),
        (
            "roma",
            "matches",
            np.full((60, 4), (9, 9, 5e3, 5e3)),
            "60 pixels of 'q0_dom.tif' outside",
        ),
        ("superglue", "matches", np.full(61, 60), "numbers beyond"),
        ("mast3r-visloc", "matches_im_map", None, "lacks the field 'matches_im_map'"),
        ("dust3r-matches", "size", np.array([1, 2]), "at which size"),
    ],
)
def test_refusals(
    name: str,
    field: str,
    value: Any,
    words: str,
    world: World,
    tmp_path: Path,
    evaluated: Evaluated,
) -> None:
    path = WRITERS[name](tmp_path, world)
    one = sorted(path.rglob("*.npz"))[0]
    with np.load(one) as stored:
        fields = dict(stored) | {field: value}
    np.savez(one, **{key: value for key, value in fields.items() if value is not None})
    with pytest.raises(PredictionError, match=words) as error:
        evaluated(path, reader=name)
    assert one.name in str(error.value)


def test_empty_matches_are_an_answer(world: World, tmp_path: Path, evaluated: Evaluated) -> None:
    path = matching_files.write_mast3r_visloc(tmp_path, world)
    one = path / "q0.png" / "q0_dom.tif.npz"
    np.savez(one, valid_pts3d=[], matches_im_query=[], matches_im_map=[], matches_conf=[])
    found = evaluated(path)
    assert found.records["answered"].all()
    assert found.records.set_index("query").loc["hills/q0", "error_m"] == float("inf")


def test_a_name_that_begins_with_the_crop_exchanges_the_pictures(
    world: World, tmp_path: Path, evaluated: Evaluated, own: Any
) -> None:
    home = matching_files.write_superglue(tmp_path, world)
    for path in list(home.iterdir()):
        fields = dict(np.load(path))
        first, second, found = fields["keypoints0"], fields["keypoints1"], fields["matches"][:-1]
        turned = {"keypoints0": second, "keypoints1": first, "matches": np.argsort(found)}
        stem = path.name.split("_", 1)[0]
        np.savez(home / f"{stem}_dom_{stem}_matches.npz", **fields | turned)
        path.unlink()
    assert evaluated(home).overall == pytest.approx(own, abs=1e-9)
