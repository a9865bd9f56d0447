"""Retrieval: names of several scenes, galleries beyond memory, VPR's logs, ties of TREC."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from airzoo_bench import evaluate
from airzoo_bench.core.errors import UserError
from airzoo_bench.core.registry import DATASETS
from airzoo_bench.datasets.settings import PrepareSettings, SourceOptions
from airzoo_bench.retrieval.truth import read_truth
from tests.goldens.run import unpack
from tests.readers import method_files as files
from tests.readers.conftest import Worlds
from tests.readers.method_files import Place, made_scenes, perfect, scored, tile_file
from tests.support import MadeScene, run_main

ONE = made_scenes()[:1]
ELSEWHERE = {"database_folder": "/x", "queries_folder": "/y"}
Score = Callable[..., Any]


@pytest.fixture
def crowded(tmp_path: Path) -> Path:
    """Return a benchmark whose west has two photos more than queries, called as east's are."""
    home = Place().prepare(tmp_path / "data")
    left_out = home / "made" / "scenes" / "west" / "retrieval" / "excluded.csv"
    left_out.write_text("id,image,reason\nwest/q00004,q00004.jpg,x\n")
    assert run_main("manifest", home / "made", "--force") == 0
    return home


def described(source: Path, folder: Path, *names: str) -> Path:
    """Write Game4Loc's features of photos, in this order."""
    folder.mkdir(parents=True, exist_ok=True)
    found = dict(np.load(source))
    rows = dict(zip(found["query_names"].tolist(), found["query_features"], strict=True))
    found["query_features"] = np.stack([rows.get(one, rows["east/q00005.jpg"]) for one in names])
    named = np.array([f"/data/{name}" if "/" in name else name for name in names])
    np.savez(folder / "features.npz", **found | {"query_names": named})
    return folder / "features.npz"


def test_scenes_with_photos_of_the_same_names(
    tmp_path: Path, crowded: Path, worlds: Worlds
) -> None:
    """East has the queries q00000 to q00005, west the first four; q00004 and q00005 are none."""
    east, west = ([f"{scene}/q{n:05d}.jpg" for n in range(6)] for scene in ("east", "west"))
    source = worlds.sample("game4loc", tmp_path / "sound")
    result = scored(described(source, tmp_path, *west), crowded)
    answered = result.records.groupby("scene")["recall@1"].mean()
    assert answered.to_dict() == {"east": 0.0, "west": 1.0}
    notes = " | ".join(result.result.notes)
    assert "2 photos described that are no queries, left aside" in notes
    assert "scored at their worst: 6 of 10 (first 3: east/q00000" in notes
    for folder in ("run", "west"):
        path = described(source, tmp_path / folder, *east, *west)
        assert scored(path, crowded).overall["recall@1"] == 1.0
    path = described(source, tmp_path, *east[:4], "q00004.jpg")  # a photo left out has it too
    with pytest.raises(UserError, match=r"'q00004.jpg' could be 2 \(east/q00004, west/q00004"):
        scored(path, crowded)


def test_a_gallery_larger_than_the_memory(tmp_path: Path) -> None:
    data = Place([MadeScene("east", [[0]], 300)]).prepare(tmp_path / "data")
    rows = np.random.default_rng(0).standard_normal((300, 4000), np.float32)
    for kind, count in (("tiles/t", 300), ("photos/q", 1)):
        (tmp_path / "any" / kind).parent.mkdir(parents=True)
        for number in range(count):
            np.save(tmp_path / "any" / f"{kind}{number:05d}.jpg.npy", rows[number : number + 1])
    assert rows.nbytes > 4e6
    spilt = scored(tmp_path / "any", data, max_memory=2_000_000)
    assert spilt.overall["recall@1"] == 1.0
    assert spilt.records.equals(scored(tmp_path / "any", data).records)


def test_precision_of_hloc_is_named_and_ties_of_trec_are_broken_against_the_method(
    tmp_path: Path, worlds: Worlds, retrieved: Score
) -> None:
    path = worlds.sample("hloc-global", tmp_path / "h")
    with h5py.File(path, "a") as file:
        names = [f"{scene}/{kind}" for scene in file for kind in file[scene]]
        for group in (file[name][image] for name in names for image in file[name]):
            rows = group["global_descriptor"][()].astype(np.float16)
            del group["global_descriptor"]
            group["global_descriptor"] = rows
    result = retrieved(path)
    assert result.overall["recall@1"] == 1.0
    assert "float16, as the file has them" in result.result.predictions.reader.conventions[0]
    path = worlds.sample("trec", tmp_path / "t")
    lines = [line.split() for line in path.read_text().splitlines()]
    path.write_text("".join(" ".join([*one[:4], "0.5", "x"]) + "\n" for one in lines))
    assert retrieved(path).overall["recall@1"] == 0.0


@pytest.mark.parametrize("tree", ["university-1652", "denseuav"])
def test_university1652_on_its_benchmarks(tmp_path: Path, tree: str) -> None:
    data, scene = tmp_path / "data", "drone-to-satellite"
    unpack(tree, tmp_path / "source")
    options = SourceOptions(tmp_path / "source" / "in", [scene])
    made = DATASETS.get(tree).prepare(options, PrepareSettings(data / tree, data))
    truth = read_truth(made.folder / "scenes" / scene, scene)
    sets = []
    for home, table in (("query_drone", truth.queries), ("gallery_satellite", truth.tiles)):
        paths = [f"/data/test/{home}/{image}" for image in table["image"]]
        classes = [int(Path(one).parent.name) for one in paths]
        sets.append((np.array([one == np.arange(3000) for one in classes], np.float32), paths))
    path = files.save_mat(tmp_path / "pytorch_result.mat", *sets)
    [protocol] = made.protocols
    assert evaluate(path, protocol=protocol, data=data).overall["recall@1"] == 1.0


class TestVpr:
    """Log folders of VPR-methods-evaluation: where the names of rows come from."""

    @pytest.mark.parametrize("labels", [False, True])
    def test_lists_of_paths(self, tmp_path: Path, retrieved: Score, labels: bool) -> None:
        for scene in Place().scenes:
            files.write_log(tmp_path / "logs" / scene.id, scene)
            files.write_lists(tmp_path / "logs" / scene.id, Place(), scene, labels=labels)
        assert perfect(retrieved(tmp_path / "logs"))

    @pytest.mark.parametrize("spoilt", ["none", "queries", "database", "both"])
    def test_an_assumed_order_is_held_against_the_lists(
        self, one: Path, log: Path, spoilt: str
    ) -> None:
        files.write_lists(log, Place(ONE), ONE[0])
        if spoilt == "none":
            result = scored(log, one)
            assert perfect(result)
            assert not any("names are taken by order" in note for note in result.result.notes)
            return
        for kind in ("queries", "database") if spoilt == "both" else (spoilt,):
            file = log / f"{kind}_descriptors.npy"
            np.save(file, np.roll(np.load(file), 1, axis=0))
        with pytest.raises(UserError, match="preds") as refused:
            scored(log, one)
        assert "--names" in str(refused.value)

    def test_listing(self, one: Path, log: Path) -> None:
        images = str(log / "images")
        files.write_images(images, ONE[0])
        for extra in ("tiles.csv", ".t00000.png", "t00000.tif"):
            (Path(tile_file(images, ONE[0], 0)).parent / extra).touch()
        files.write_log(log, ONE[0], images)
        result = scored(log, one)
        assert perfect(result)
        assert "in the order of their paths" in result.result.predictions.reader.conventions[1]

    def test_folders_of_the_machine_are_not_listed(
        self, tmp_path: Path, one: Path, log: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        """A log of a stranger names a folder of this machine: nothing of it is read or told."""
        images = str(tmp_path / "private")
        files.write_images(images, ONE[0])
        (log / "images").symlink_to(images)
        np.save(log / "database_descriptors.npy", np.eye(11, 24, dtype=np.float32))
        seen, walk = list[str](), os.walk

        def watched(top: str) -> Iterator[tuple[str, list[str], list[str]]]:
            seen.append(top)
            return walk(top)

        for home in (images, str(log / "images")):
            files.write_log(log, ONE[0], home, counts=(6, 11))
            with monkeypatch.context() as patch:
                patch.setattr(os, "walk", watched)
                with pytest.raises(UserError, match="without names") as refused:
                    scored(log, one)
            assert "12 images" not in str(refused.value)
        assert not any(os.path.realpath(place).startswith(images) for place in seen)

    def test_list_of_the_user(self, tmp_path: Path, one: Path, log: Path) -> None:
        order, names = np.random.default_rng(0).permutation(12), tmp_path / "names.txt"
        np.save(log / "database_descriptors.npy", Place(ONE).descriptors(ONE[0])[1][order])
        listed = [f"x/t{number:05d}.png" for number in order]
        listed += [f"y/q{number:05d}.jpg" for number in range(6)]
        names.write_text("\n".join(listed))
        assert perfect(scored(log, one, names=names))
        for wrong, words in ((listed[1:], "17 names for 12"), ([*listed, "z"], "1 name more")):
            names.write_text("\n".join(wrong))
            with pytest.raises(UserError, match=words):
                scored(log, one, names=names)

    def test_the_innermost_scene_of_a_path_counts(self, tmp_path: Path, retrieved: Score) -> None:
        """A run of all scenes below a folder that is called as one of them, and one of west."""
        whole, place = tmp_path / "east" / "all", Place()
        whole.mkdir(parents=True)
        for name, rows in zip(("queries", "database"), place.every_descriptor(), strict=True):
            np.save(whole / f"{name}_descriptors.npy", rows)
        files.write_log(whole, place.scenes[0], counts=(10, 20), **ELSEWHERE)
        result = retrieved(whole)
        assert perfect(result)
        said = result.result.predictions.reader.conventions
        assert "method salad" in said[0]
        assert "names are taken by order" in said[1]
        assert said[1] in result.result.notes
        assert "compared by l2" in said[2]
        assert perfect(retrieved(files.write_vpr(tmp_path / "east", place)))

    @pytest.mark.parametrize("lists", [False, True])
    def test_two_runs_of_one_scene_and_runs_that_are_not_whole(
        self, tmp_path: Path, one: Path, lists: bool
    ) -> None:
        logs, lacking = tmp_path / "logs", "preds/002.txt" if lists else "database_descriptors.npy"
        for name in ("first", "second"):
            files.write_log(logs / name, ONE[0])
            write = files.write_lists if lists else files.write_descriptors
            write(logs / name, Place(ONE), ONE[0])
        with pytest.raises(UserError, match=r"more than once|two runs of one query"):
            scored(logs, one)
        if not lists:
            np.save(logs / "first" / lacking, np.array([{}], dtype=object))
            with pytest.raises(UserError, match="pickled Python objects, never loaded"):
                scored(logs / "first", one)
        (logs / "first" / lacking).unlink()
        with pytest.raises(UserError, match=f"lacks {'the lists of' if lists else lacking}"):
            scored(logs / "first", one)
