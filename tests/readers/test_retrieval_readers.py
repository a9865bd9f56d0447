"""AnyLoc, hloc and TREC: files score as the suite's own, whatever images and scenes are called."""

from __future__ import annotations

import gc
import shutil
import tempfile
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace

import h5py
import numpy as np
import pandas as pd
import pytest
import scipy.io

from airzoo_bench.core.errors import PredictionError, UnreadableError, UserError
from airzoo_bench.core.files import sha256_of
from airzoo_bench.evaluation.reader import find_reader
from airzoo_bench.formats.budget import Budget
from airzoo_bench.readers.image_bag import read_bag
from airzoo_bench.readers.retrieval import SceneImages
from tests.readers.retrieval_support import DIMENSIONS, PLENTY, Place, perfect, scored
from tests.readers.samples import anyloc, game4loc, hloc_global, trec, university1652
from tests.support import MadeScene, made_truth

SAMPLES = (anyloc, game4loc, hloc_global, trec, university1652)


@pytest.mark.parametrize("sample", SAMPLES, ids=lambda one: one.__name__.rsplit(".")[-1])
def test_scores_to_the_last_bit(sample: ModuleType, tmp_path: Path, home: Path) -> None:
    assert perfect(scored(sample.write(tmp_path, Place()), home))
    (tmp_path / "noisy").mkdir()
    place = Place(noise=0.4)
    ours = scored(place.canonical(tmp_path / "own.npz"), home)
    theirs = scored(sample.write(tmp_path / "noisy", place), home)
    assert not perfect(ours)
    assert theirs.overall == ours.overall
    assert theirs.result.predictions.reader.conventions


def test_half_precision_of_hloc(tmp_path: Path, home: Path) -> None:
    result = scored(hloc_global.write(tmp_path, Place(), np.float16), home)
    assert perfect(result)
    assert "float16, as the file has them" in result.result.predictions.reader.conventions[0]
    assert not any("another than the method's own" in note for note in result.result.notes)


@pytest.fixture
def crowded(home: Path) -> Path:
    """Return a benchmark whose west has two photos more than queries, called as east's are."""
    left_out = home / "made" / "scenes" / "west" / "retrieval" / "excluded.csv"
    file, before = home / "made" / "benchmark.toml", sha256_of(left_out)
    place = '"scenes/west/retrieval/excluded.csv" = '
    left_out.write_text("id,image,reason\nwest/q00004,q00004.jpg,x\n")
    text = file.read_text()
    assert f'{place}"{before}"' in text
    file.write_text(text.replace(f'{place}"{before}"', f'{place}"{sha256_of(left_out)}"'))
    return home


class TestScenesWithTheSameNames:
    """East has the queries q00000 to q00005, west the first four; q00004 and q00005 are none."""

    def written(self, folder: Path, photos: list[str]) -> Path:
        path = game4loc.write(folder, Place())
        arrays = dict(np.load(path))
        rows = dict(zip(arrays["query_names"].tolist(), arrays["query_features"], strict=True))
        others = rows["east/q00005.jpg"]
        arrays["query_features"] = np.stack([rows.get(name, others) for name in photos])
        arrays["query_names"] = np.array([f"/data/{name}" for name in photos])
        np.savez(path, **arrays)
        return path

    def photos(self, scene: str) -> list[str]:
        return [f"{scene}/q{number:05d}.jpg" for number in range(6)]

    def test_photos_of_one_are_no_queries_of_the_other(self, tmp_path: Path, crowded: Path) -> None:
        result = scored(self.written(tmp_path, self.photos("west")), crowded)
        answered = result.records.groupby("scene")["recall@1"].mean()
        assert answered.to_dict() == {"east": 0.0, "west": 1.0}
        notes = " | ".join(result.result.notes)
        assert "2 photos described that are no queries, left aside" in notes
        assert "scored at their worst: 6 of 10 (first 3: east/q00000" in notes

    @pytest.mark.parametrize("folder", ["run", "west"])
    def test_all_photos_may_be_described(self, tmp_path: Path, crowded: Path, folder: str) -> None:
        (tmp_path / folder).mkdir()
        photos = [*self.photos("east"), *self.photos("west")]
        result = scored(self.written(tmp_path / folder, photos), crowded)
        assert perfect(result)
        assert any("2 photos described that are no" in note for note in result.result.notes)

    def test_names_without_scene_are_of_that_of_the_file(
        self, tmp_path: Path, crowded: Path
    ) -> None:
        (tmp_path / "east" / "west").mkdir(parents=True)
        path = self.written(tmp_path / "east" / "west", self.photos("west"))
        arrays = dict(np.load(path))
        arrays["query_names"] = np.array([name.rsplit("/")[-1] for name in arrays["query_names"]])
        np.savez(path, **arrays)
        answered = scored(path, crowded).records.groupby("scene")["recall@1"].mean()
        assert answered.to_dict() == {"east": 0.0, "west": 1.0}

    def test_a_name_without_scene_that_a_photo_left_out_has_too(
        self, tmp_path: Path, crowded: Path
    ) -> None:
        path = self.written(tmp_path, self.photos("east"))
        arrays = dict(np.load(path))
        arrays["query_names"][4] = "q00004.jpg"
        np.savez(path, **arrays)
        with pytest.raises(UserError, match=r"'q00004.jpg' could be 2 \(east/q00004, west/q00004"):
            scored(path, crowded)

    @pytest.mark.parametrize("sample", [anyloc, hloc_global], ids=["anyloc", "hloc-global"])
    def test_photos_beside_tiles(self, sample: ModuleType, tmp_path: Path, crowded: Path) -> None:
        path, row = sample.write(tmp_path, Place()), np.ones((1, DIMENSIONS), np.float32)
        for number in (4, 5):
            name = f"west/photos/q{number:05d}"
            if sample is anyloc:
                np.save(path / f"{name}.jpg.npy", row)
                continue
            with h5py.File(path, "a") as file:
                file[f"{name}.png/global_descriptor"] = row[0]
        result = scored(path, crowded)
        assert perfect(result)
        assert any("neither queries nor tiles, left aside: 2" in one for one in result.result.notes)

    def test_trec(self, tmp_path: Path, crowded: Path) -> None:
        path = trec.write(tmp_path, Place())
        text = path.read_text()
        more = [f"west/q0000{n} Q0 west/t00000 1 0.5 mine\n" for n in (4, 5)]
        path.write_text(text + "".join(more))
        assert perfect(scored(path, crowded))
        path.write_text(text.replace("west/t00007", "west/t00009"))
        with pytest.raises(UserError, match=r"ranks what is no tile: 1 \('west/t00009'\)"):
            scored(path, crowded)

    def test_university1652(self, tmp_path: Path, crowded: Path) -> None:
        path = university1652.write(tmp_path, Place())
        found = scipy.io.loadmat(path)
        sets = []
        for kind, more in (("query", "west/0004/q00004.jpeg"), ("gallery", "west/0009/t00009.jpg")):
            rows = np.concatenate([found[f"{kind}_f"], np.full((1, DIMENSIONS), -9, np.float32)])
            paths = [*(one.strip() for one in found[f"{kind}_path"]), f"/data/{more}"]
            sets.append((rows, paths))
        result = scored(university1652.save(path, *sets), crowded)
        assert perfect(result)
        assert any("1 photo described that" in note for note in result.result.notes)


class TestImagesByName:
    """Descriptors of photos and tiles in one folder or file."""

    def test_a_run_that_broke_off_at_its_first_file(self, tmp_path: Path, home: Path) -> None:
        path = anyloc.write(tmp_path, Place())
        (path / "east" / "photos" / "q00000.jpg.npy").write_bytes(b"")
        assert find_reader(path) == "anyloc"
        with pytest.raises(UserError, match=r"q00000\.jpg\.npy: no array"):
            scored(path, home)

    def test_a_name_of_two_scenes(self, tmp_path: Path, home: Path) -> None:
        path = anyloc.write(tmp_path, Place())
        shutil.copytree(path / "east", path, dirs_exist_ok=True)
        shutil.rmtree(path / "east")
        with pytest.raises(UserError, match=r"anyloc: 'photos/q00000.jpg' could be 2 "):
            scored(path, home)

    def test_what_is_neither_is_left_aside(self, tmp_path: Path, home: Path) -> None:
        path = anyloc.write(tmp_path, Place())
        np.save(path / "east" / "photos" / "x.jpg.npy", np.ones((1, DIMENSIONS), np.float32))
        result = scored(path, home)
        assert perfect(result)
        assert any("left aside: 1 (east/photos/x.jpg)" in note for note in result.result.notes)

    def test_photos_alone(self, tmp_path: Path, home: Path) -> None:
        path = anyloc.write(tmp_path, Place())
        for tile in path.rglob("t*.npy"):
            tile.unlink()
        with pytest.raises(UserError, match="describes no tile of the protocol"):
            scored(path, home)

    def test_names_of_both(self, tmp_path: Path) -> None:
        photos, tiles = (
            pd.DataFrame({"id": [one], "image": [image]})
            for one, image in (("e/a", "a.jpg"), ("e/b", "a.png"))
        )
        truth = replace(made_truth(MadeScene("e", [[0]], 1)), queries=photos, tiles=tiles)
        images = SceneImages((truth,))
        with pytest.raises(PredictionError, match=r"could be a query or a tile: 1 \('x/a.jpg'\)"):
            read_bag(tmp_path, ["x/a.jpg"], lambda _: np.ones(3), images, Budget(PLENTY))

    def test_another_length(self, tmp_path: Path, home: Path) -> None:
        path = anyloc.write(tmp_path, Place())
        np.save(path / "west" / "tiles" / "t00003.jpg.npy", np.ones((1, 40), np.float32))
        with pytest.raises(UserError, match="has 40 numbers of type float32"):
            scored(path, home)

    def test_more_than_the_memory(self, tmp_path: Path, home: Path) -> None:
        path = anyloc.write(tmp_path, Place())
        with pytest.raises(UserError, match="more than the limit"):
            scored(path, home, max_memory=10_000)

    def test_a_gallery_larger_than_the_memory(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        scene = MadeScene("east", [[0]], 400)
        data = Place([scene]).prepare(tmp_path / "data")
        rows = np.random.default_rng(0).standard_normal((400, 5000), np.float32)
        (tmp_path / "room").mkdir()
        monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "room"))
        for kind, count in (("tiles/t", 400), ("photos/q", 1)):
            (tmp_path / "any" / kind).parent.mkdir(parents=True)
            for number in range(count):
                file = tmp_path / "any" / f"{kind}{number:05d}.jpg.npy"
                np.save(file, rows[number : number + 1])
        assert rows.nbytes > 4e6
        spilt = scored(tmp_path / "any", data, max_memory=2_000_000)
        assert spilt.overall["recall@1"] == 1.0
        assert spilt.records.equals(scored(tmp_path / "any", data).records)
        gc.collect()
        assert not list(Path(tempfile.gettempdir()).glob(".descriptors*"))
        full = SimpleNamespace(free=4_000_000)
        monkeypatch.setattr("shutil.disk_usage", lambda _: full)
        with pytest.raises(UserError, match="more than the limit"):
            scored(tmp_path / "any", data, max_memory=2_000_000)

    def test_local_features_are_not_global(self, tmp_path: Path, home: Path) -> None:
        with h5py.File(tmp_path / "f.h5", "w") as file:
            file.create_group("a.jpg").create_dataset("keypoints", data=np.zeros((3, 2)))
        with pytest.raises(UserError, match="holds no global_descriptor"):
            scored(tmp_path / "f.h5", home, reader="hloc-global")


class TestTrec:
    def test_ties_are_broken_against_the_method(self, tmp_path: Path, home: Path) -> None:
        path = trec.write(tmp_path, Place())
        lines = [line.split() for line in path.read_text().splitlines()]
        path.write_text("".join(" ".join([*one[:4], "0.5", "x"]) + "\n" for one in lines))
        result = scored(path, home)
        assert result.overall["recall@1"] == 0.0

    @pytest.mark.parametrize(
        ("old", "new", "words"),
        [
            ("east/t00004", "east/elsewhere", "ranks what is no tile"),
            (" mine", "", "is no line of a run"),
            (" Q0 ", " Q0 x ", "is no line of a run"),
            ("0.", "nan0.", "is no line of a run"),
            ("-", "", "scores rise with the rank"),
        ],
    )
    def test_refusals(self, tmp_path: Path, home: Path, old: str, new: str, words: str) -> None:
        path = trec.write(tmp_path, Place())
        path.write_text(path.read_text().replace(old, new))
        with pytest.raises(UserError, match=words):
            scored(path, home, reader="trec")

    def test_a_folder_is_none(self, home: Path, tmp_path: Path) -> None:
        trec.write(tmp_path, Place())
        with pytest.raises(UnreadableError, match="a folder, and so not"):
            scored(tmp_path, home, reader="trec")

    def test_order_of_lines_is_nothing(self, tmp_path: Path, home: Path) -> None:
        path = trec.write(tmp_path, Place())
        lines = path.read_text().splitlines(keepends=True)
        order = np.random.default_rng(0).permutation(len(lines))
        path.write_text("".join(lines[number] for number in order))
        assert perfect(scored(path, home))
