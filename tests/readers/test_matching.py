"""Matching: which pictures files mean, what is noted, and what counts as an answer."""

from __future__ import annotations

import shutil
from dataclasses import replace
from importlib.metadata import EntryPoint
from typing import Any

import h5py
import numpy as np
import pycolmap
import pytest

from airzoo_bench.core.errors import PredictionError, UserError
from airzoo_bench.core.files import sha256_of
from airzoo_bench.core.registry import READERS
from airzoo_bench.evaluation.predictions import ReadRequest, find_reader
from tests.matching.world import SIZE


def errors(found: Any) -> Any:
    return found.records.set_index("query")["error_m"]


def test_one_file_is_one_query(worlds, tmp_path, matched) -> None:
    home = worlds.sample("loftr", tmp_path / "f")
    assert find_reader(home / "q3.npz")[0] == "loftr"
    found, every = matched(home / "q3.npz"), matched(home)
    assert errors(found)["hills/q3"] == errors(every)["hills/q3"]
    assert found.records["answered"].sum() == 1


@pytest.mark.parametrize(
    "named", ["hills/{0}", "hills/{0}_{0}_dom_matches", "hills/{0}.png/{0}_dom"]
)
def test_folders_name_the_scene_of_their_pairs(named, worlds, tmp_path) -> None:
    world, home = worlds.hills, worlds.sample("loftr", tmp_path / "f")
    for one in list(home.iterdir()):
        for scene in ("hills", "town", "coast"):
            place = home / named.format(one.stem).replace("hills", scene)
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(one, f"{place}.npz")
        one.unlink()
    town = world.truth.queries.assign(id="town/" + world.truth.queries["id"].str[6:])
    asked, left_out = town[:2], town[2:].assign(reason="x")
    crops = world.truth.crops[:2]
    other = replace(world.truth, scene="town", queries=asked, crops=crops, excluded=left_out)
    truths, scenes = [world.truth, other], ("hills", "town", "coast")
    request = ReadRequest(None, None, None, world.protocol, truths, 1 << 26, scenes=scenes)
    read = READERS.get("loftr").read(home, request)
    assert set(read.predictions.query_ids) == {*world.ids, *asked["id"]}
    assert read.notes == ("8 files of other pictures left out",)


def test_the_crop_of_another_photo_is_noted(worlds, tmp_path, matched) -> None:
    home = worlds.sample("loftr", tmp_path / "f")
    (home / "q0.npz").rename(home / "q0_q1_dom_matches.npz")
    assert any("1 (q0 with q1_dom)" in note for note in matched(home).result.notes)


def test_matches_have_two_columns_and_equal_lengths(worlds, tmp_path, matched, monkeypatch) -> None:
    path = worlds.sample("loftr", tmp_path / "f")
    for given in ((np.ones((4, 2)), np.ones((3, 2))), np.ones((2, 4, 3)), np.ones((2, 4))):
        monkeypatch.setattr(type(READERS.get("loftr")), "matches", lambda *_, given=given: given)
        with pytest.raises(PredictionError, match="reader loftr"):
            matched(path)
    point = EntryPoint("loftr", READERS.places["loftr"], "")
    monkeypatch.setattr(READERS, "_installed", lambda: {"loftr": point})
    monkeypatch.setattr(type(READERS.get("loftr")), "matches", lambda *_: {}["kpts0"])
    monkeypatch.delitem(READERS.places, "loftr")  # as of another package
    with pytest.raises(UserError, match=r"kpts0.*q0\.npz"):
        matched(path)


@pytest.mark.parametrize("shape", [None, (0,), (1, 0), (0, 1)])
def test_empty_matches_are_an_answer(shape, worlds, tmp_path, matched, monkeypatch) -> None:
    path = worlds.sample("mast3r-visloc", tmp_path / "f")
    none = np.zeros(shape or 0)
    np.savez(path / "q0.png" / "q0_dom.tif.npz", matches_im_query=none, matches_im_map=none)
    if shape:  # as a class of another package returns them
        kind = type(READERS.get("mast3r-visloc"))
        monkeypatch.setattr(kind, "matches", lambda *_: (none, none))
    found = matched(path)
    assert found.records["answered"].all()
    assert errors(found)["hills/q0"] == float("inf")


def test_a_name_that_begins_with_the_crop_exchanges_the_pictures(worlds, tmp_path, matched) -> None:
    home = worlds.sample("superglue", tmp_path / "f")
    expected = matched(home).overall
    for path in list(home.iterdir()):
        found = dict(np.load(path))
        turned = {"keypoints0": found["keypoints1"], "keypoints1": found["keypoints0"]}
        turned["matches"] = np.argsort(found["matches"][:-1])
        stem = path.name.split("_", 1)[0]
        np.savez(home / f"{stem}_dom_{stem}_matches.npz", **found | turned)
        path.unlink()
    assert matched(home).overall == pytest.approx(expected, abs=1e-9)


def test_roma_in_pixels(worlds, tmp_path, matched) -> None:
    home = worlds.sample("roma", tmp_path / "f")
    expected = matched(home, reader="roma").overall
    for path, crop in zip(sorted(home.iterdir()), worlds.hills.truth.crops, strict=True):
        found = dict(np.load(path))
        size = np.array([*SIZE, *crop[2:]])
        np.savez(path, **found | {"matches": (found["matches"] + 1) / 2 * size})
    assert matched(home, reader="roma").overall == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("dtype", [np.float32, np.float16])
def test_precision_and_files_of_hloc_are_named(dtype, worlds, tmp_path, matched) -> None:
    path = worlds.sample("hloc", tmp_path / "f")
    [matches] = path.glob("*_matches.h5")
    [features] = {*path.iterdir()} - {matches}
    with h5py.File(features, "a") as file:
        names: list[str] = []
        file.visit(names.append)
        for name in [one for one in names if one.endswith("/keypoints")]:
            xy = file[name][()].astype(dtype)
            del file[name]
            file[name] = xy
    assert find_reader(matches)[0] == "hloc"
    found = matched(matches)
    said = found.result.predictions.reader.conventions
    assert "0.5 was added" in said[0]
    assert said[-1] == f"read too: {features.name}, SHA-256 {sha256_of(features)}"
    step = "keypoints were rounded to float16, in steps of up to 0.5 px"
    assert any(step in one for one in found.result.notes) == (dtype is np.float16)


def test_the_whole_map_may_be_matched(worlds, tmp_path, matched) -> None:
    world, path = worlds.hills, tmp_path / "m.h5"
    with h5py.File(path, "w") as file:
        rows = zip(world.truth.queries["image"], world.query_xy, world.map_xy, strict=True)
        for name, query_xy, map_xy in rows:
            file[f"dom.tif/{name}/keypoints0"] = map_xy - 0.5
            file[f"dom.tif/{name}/keypoints1"] = query_xy - 0.5
        file["q0.png/q1.png/keypoints0"] = file["q0.png/q1.png/keypoints1"] = np.zeros((3, 2))
    found = matched(path)
    assert found.overall["error_m"] < 1e-6
    assert "1 pair of other pictures left out" in found.result.notes


def test_the_identity_is_no_pose(worlds, tmp_path, matched) -> None:
    path = worlds.sample("hloc-poses", tmp_path / "f")
    lines = [one for one in path.read_text().splitlines() if not one.startswith("q1.png")]
    lines += [f"{name} 1 0 0 0 0 0 0" for name in ("q1.png", "other.png")]
    path.write_text("\n".join(lines))
    found = matched(path)
    assert errors(found)["hills/q1"] == float("inf")
    notes = " | ".join(found.result.notes)
    assert "1 pose of photos that are no queries left out" in notes
    assert "1 photo at the identity or NaN count as not found" in notes


def test_a_colmap_model_below_a_folder(worlds, tmp_path, matched) -> None:
    home = tmp_path / "out" / "sparse/0"
    home.mkdir(parents=True)
    sample = worlds.sample("colmap-poses", tmp_path / "f")
    pycolmap.Reconstruction(str(sample)).write_binary(str(home))
    found, expected = matched(tmp_path / "out"), matched(sample)
    assert found.overall == pytest.approx(expected.overall, abs=1e-9)
    assert "1 pose of photos that are no queries left out" in found.result.notes
