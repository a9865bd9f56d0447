"""Retrieval: names of several scenes, galleries beyond memory, VPR's logs, ties of TREC."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any
from unittest import mock

import h5py
import numpy as np
import pytest
import scipy.io

from airzoo_bench import evaluate
from airzoo_bench.core.errors import UserError
from airzoo_bench.core.registry import DATASETS
from airzoo_bench.datasets.settings import PrepareSettings, SourceOptions
from airzoo_bench.retrieval.truth import read_truth
from tests.goldens.recipes import spoil
from tests.goldens.run import unpack
from tests.readers.conftest import Worlds
from tests.support import MadeScene, made_protocol, run_main, write_benchmark

Score = Callable[..., Any]


def recall(result: Any, scene: str = "east") -> float:
    """Return a scene's recall@1, which is 1 for the inputs of the goldens."""
    return float(result.records.groupby("scene")["recall@1"].mean()[scene])


def test_scenes_with_photos_of_the_same_names(tmp_path: Path, worlds: Worlds) -> None:
    """East has the queries q00000 to q00005, west the first four; q00004 and q00005 are none."""
    data = Path(shutil.copytree(worlds.home / "retrieval" / "data", tmp_path / "data"))
    left_out = data / "made" / "scenes" / "west" / "retrieval" / "excluded.csv"
    left_out.write_text("id,image,reason\nwest/q00004,q00004.jpg,x\n")
    assert run_main("manifest", data / "made", "--force") == 0
    found = dict(np.load(worlds.sample("game4loc", tmp_path / "sound")))
    rows = dict(zip(found["query_names"].tolist(), found["query_features"], strict=True))

    def score(folder: Path, *names: str) -> Any:
        """Score features of photos, in this order."""
        folder.mkdir(exist_ok=True)
        described = [rows.get(one, rows["east/q00005.jpg"]) for one in names]
        named = np.array([f"/data/{name}" if "/" in name else name for name in names])
        path = folder / "features.npz"
        np.savez(path, **found | {"query_features": described, "query_names": named})
        return worlds.evaluate("retrieval", path, data=data)

    east, west = ([f"{scene}/q{n:05d}.jpg" for n in range(6)] for scene in ("east", "west"))
    result = score(tmp_path, *west)
    assert (recall(result), recall(result, "west")) == (0.0, 1.0)
    notes = " | ".join(result.result.notes)
    assert "2 photos described that are no queries, left aside" in notes
    assert "scored at their worst: 6 of 10 (first 3: east/q00000" in notes
    for folder in ("run", "west"):
        assert score(tmp_path / folder, *east, *west).overall["recall@1"] == 1.0
    with pytest.raises(UserError, match=r"'q00004.jpg' could be 2 \(east/q00004, west/q00004"):
        score(tmp_path, *east[:4], "q00004.jpg")  # a photo left out has the name too


def test_a_gallery_larger_than_the_memory(tmp_path: Path) -> None:
    scenes = [MadeScene("east", [[0]], 300)]
    write_benchmark(tmp_path / "data" / "made", made_protocol(scenes), scenes)
    rows = np.random.default_rng(0).standard_normal((300, 4000), np.float32)
    for kind, count in (("tiles/t", 300), ("photos/q", 1)):
        (tmp_path / "any" / kind).parent.mkdir(parents=True)
        for number in range(count):
            np.save(tmp_path / "any" / f"{kind}{number:05d}.jpg.npy", rows[number : number + 1])
    assert rows.nbytes > 4e6
    given: dict[str, Any] = {"protocol": "made-retrieval", "data": tmp_path / "data"}
    spilt = evaluate(tmp_path / "any", max_memory=2_000_000, **given)
    assert spilt.overall["recall@1"] == 1.0
    assert spilt.records.equals(evaluate(tmp_path / "any", **given).records)


def test_precision_of_hloc_is_named_and_ties_of_trec_are_broken_against_the_method(
    tmp_path: Path, worlds: Worlds, retrieved: Callable[..., Any]
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


def test_university1652_on_denseuav(tmp_path: Path) -> None:
    data, scene = tmp_path / "data", "drone-to-satellite"
    unpack("denseuav", tmp_path / "source")
    options = SourceOptions(tmp_path / "source" / "in", [scene])
    made = DATASETS.get("denseuav").prepare(options, PrepareSettings(data / "denseuav", data))
    truth = read_truth(made.folder / "scenes" / scene, scene)
    result: dict[str, Any] = {}
    for kind, home, table in (
        ("query", "query_drone", truth.queries),
        ("gallery", "gallery_satellite", truth.tiles),
    ):
        paths = [f"/data/test/{home}/{image}" for image in table["image"]]
        labels = [int(Path(one).parent.name) for one in paths]
        rows = np.array([one == np.arange(3000) for one in labels], np.float32)
        result |= {f"{kind}_f": rows, f"{kind}_label": labels, f"{kind}_path": paths}
    path = tmp_path / "pytorch_result.mat"
    scipy.io.savemat(path, result)
    [protocol] = made.protocols
    assert evaluate(path, protocol=protocol, data=data).overall["recall@1"] == 1.0


class TestVpr:
    """Log folders of VPR-methods-evaluation: where the names of rows come from."""

    IMAGES = ("scenes/east/retrieval/tiles/t{:05d}.png", 12), ("east/photos/q{:05d}.jpg", 6)

    @pytest.fixture
    def of_east(self, tmp_path: Path) -> Score:
        """Return a function that scores a path by a benchmark of one scene."""
        scenes = [MadeScene("east", [[query, query + 1] for query in range(6)], 12)]
        write_benchmark(tmp_path / "data" / "made", made_protocol(scenes), scenes)
        return partial(evaluate, protocol="made-retrieval", data=tmp_path / "data")

    @pytest.fixture
    def log(self, worlds: Worlds, tmp_path: Path) -> Path:
        """Return a log folder of east, whose images are not on this machine."""
        return worlds.sample("vpr", tmp_path / "f") / "east" / "2026-11-22_19-00-00"

    def write_lists(self, log: Path, *, labels: bool = False) -> None:
        """Write preds/NNN.txt as `visualizations.save_file_with_paths` does."""

        def named(name: str) -> str:
            path = Path("/data/made") / name
            east = 600_000 - int(path.stem[1:])  # falling from image to image
            labelled = path.with_name(f"@{east}.00@3100000.00@{path.stem}@{path.suffix}")
            return str(labelled if labels else path)

        (tile, _), (photo, _) = self.IMAGES
        queries, tiles = (np.load(log / f"{x}_descriptors.npy") for x in ("queries", "database"))
        (log / "preds").mkdir()
        for query, order in enumerate(np.argsort(-queries @ tiles.T, axis=1)):
            found = "\n".join(named(tile.format(one)) for one in order[:8])
            said = f"Query path:\n{named(photo.format(query))}\n\nPredictions paths:\n{found}\n\n"
            (log / "preds" / f"{query:03d}.txt").write_text(said)

    def drop_descriptors(self, log: Path) -> None:
        for kind in ("queries", "database"):
            spoil(log, f"{kind}_descriptors.npy: rm")

    def write_images(self, home: Path, log: Path) -> None:
        """Write empty files for images, and their folders into the log."""
        for name, count in self.IMAGES:
            (home / name).parent.mkdir(parents=True)
            for number in range(count):
                (home / name.format(number)).touch()
        spoil(log, f"info.log: sed /data/made => {home}")

    @pytest.mark.parametrize("labels", [False, True])
    def test_lists_of_paths(self, log: Path, of_east: Score, labels: bool) -> None:
        self.write_lists(log, labels=labels)
        self.drop_descriptors(log)
        if labels:
            spoil(log, "info.log: sed use_labels=False => use_labels=True")
        assert recall(of_east(log)) == 1.0

    def test_an_assumed_order_is_held_against_the_lists(self, log: Path, of_east: Score) -> None:
        self.write_lists(log)
        result = of_east(log)
        assert recall(result) == 1.0
        assert not any("names are taken by order" in note for note in result.result.notes)
        for kind in ("queries", "database"):
            file = f"{kind}_descriptors.npy"
            spoil(log, f"{file}: py np.save(path, np.roll(np.load(path), 1, 0))")
            with pytest.raises(UserError, match="preds") as refused:
                of_east(log)
            assert "--names" in str(refused.value)
            spoil(log, f"{file}: py np.save(path, np.roll(np.load(path), -1, 0))")

    def test_names_are_listed_in_the_folders_of_the_log(self, log: Path, of_east: Score) -> None:
        self.write_images(log / "images", log)
        for extra in ("tiles.csv", ".t00000.png", "t00000.tif"):
            (log / "images" / self.IMAGES[0][0]).with_name(extra).touch()
        result = of_east(log)
        assert recall(result) == 1.0
        assert "in the order of their paths" in result.result.predictions.reader.conventions[1]

    @pytest.mark.parametrize("linked", [False, True])
    def test_folders_of_the_machine_are_not_listed(self, linked, tmp_path, log, of_east) -> None:
        """A log of a stranger names a folder of this machine: nothing of it is read or told."""
        private = tmp_path / "private"
        self.write_images(private, log)
        if linked:
            (log / "images").symlink_to(private)
            spoil(log, f"info.log: sed {private} => {log / 'images'}")
        spoil(log, "database_descriptors.npy: py np.save(path, np.eye(11, 24, dtype='f4'))")
        spoil(log, "info.log: sed database: 12 => database: 11")
        seen, walk = list[str](), os.walk

        def watched(top: str) -> Iterator[tuple[str, list[str], list[str]]]:
            seen.append(top)
            return walk(top)

        with mock.patch("os.walk", watched), pytest.raises(UserError, match="without names") as one:
            of_east(log)
        assert "12 images" not in str(one.value)
        assert not any(os.path.realpath(place).startswith(str(private)) for place in seen)

    def test_list_of_the_user(self, tmp_path: Path, log: Path, of_east: Score) -> None:
        order, names = np.random.default_rng(0).permutation(12), tmp_path / "names.txt"
        spoil(log, f"database_descriptors.npy: py np.save(path, np.load(path)[{order.tolist()}])")
        listed = [f"x/east/t{number:05d}.png" for number in order]
        listed += [f"y/east/q{number:05d}.jpg" for number in range(6)]
        names.write_text("\n".join(listed))
        assert recall(of_east(log, names=names)) == 1.0

    def test_one_run_of_all_scenes_below_a_folder_that_is_called_as_one(
        self, tmp_path: Path, log: Path, retrieved: Callable[..., Any]
    ) -> None:
        other, whole = log.parents[1] / "west" / log.name, tmp_path / "east" / "all"
        whole.mkdir(parents=True)
        for kind in ("queries", "database"):
            rows = [np.load(one / f"{kind}_descriptors.npy") for one in (log, other)]
            np.save(whole / f"{kind}_descriptors.npy", np.concatenate(rows))
        said = (log / "info.log").read_text().replace("/data/made", "/x").replace("east", "all")
        (whole / "info.log").write_text(said.replace("queries: 6", "queries: 10"))
        spoil(whole, "info.log: sed database: 12 => database: 20")
        result = retrieved(whole)
        assert result.overall["recall@1"] == 1.0
        conventions = result.result.predictions.reader.conventions
        assert "method salad" in conventions[0]
        assert "names are taken by order" in conventions[1]
        assert conventions[1] in result.result.notes
        assert "compared by l2" in conventions[2]

    def test_lists_of_two_runs_and_lists_that_are_not_whole(self, log, of_east) -> None:
        self.write_lists(log)
        self.drop_descriptors(log)
        shutil.copytree(log, log.parent / "second")
        with pytest.raises(UserError, match="two runs of one query"):
            of_east(log.parent)
        (log / "preds/002.txt").unlink()
        with pytest.raises(UserError, match="lacks the lists of"):
            of_east(log)
