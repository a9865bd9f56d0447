"""AnyLoc, hloc, Game4Loc, University-1652 and TREC: files score as the suite's own."""

from __future__ import annotations

import gc
import tempfile
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.io

from airzoo_bench import evaluate
from airzoo_bench.core.errors import PredictionError, UserError
from airzoo_bench.core.registry import DATASETS
from airzoo_bench.datasets.dataset import PrepareSettings
from airzoo_bench.datasets.native import NativeOptions
from airzoo_bench.formats.budget import Budget
from airzoo_bench.formats.mat5 import MatFile
from airzoo_bench.readers.game4loc import LINES
from airzoo_bench.readers.image_bag import read_bag
from airzoo_bench.readers.names import ImageNames
from airzoo_bench.readers.retrieval import SceneImages
from airzoo_bench.retrieval.truth import read_truth
from tests.datasets.published import image_trees
from tests.readers.retrieval_support import DIMENSIONS, Place, perfect, scored
from tests.readers.samples import anyloc, game4loc, hloc_global, trec, university1652
from tests.support import MadeScene

SAMPLES = (anyloc, game4loc, hloc_global, trec, university1652)
PLENTY = 1 << 30


@pytest.fixture
def home(tmp_path: Path) -> Path:
    return Place().prepare(tmp_path / "data")


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


def test_lengths_that_are_not_1_are_said(tmp_path: Path, home: Path) -> None:
    path = game4loc.write(tmp_path, Place())
    arrays = dict(np.load(path))
    arrays["query_features"] *= 3
    np.savez(path, **arrays)
    notes = scored(path, home).result.notes
    assert any("ranks by inner product, the protocol by L2" in note for note in notes)
    assert any("are 3 to 3 long, not 1" in note for note in notes)


class TestImagesByName:
    """Descriptors of photos and tiles in one folder or file."""

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
        photos, tiles = ImageNames.of("query", [("e/a", "a.jpg")]), [("e/b", "a.png")]
        images = SceneImages((), photos, ImageNames.of("tile", tiles))
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

    def test_numbers_that_are_no_descriptors(self, tmp_path: Path, home: Path) -> None:
        path = hloc_global.write(tmp_path, Place(), np.int32)
        with pytest.raises(UserError, match="of type int32"):
            scored(path, home)

    def test_local_features_are_not_global(self, tmp_path: Path, home: Path) -> None:
        with h5py.File(tmp_path / "f.h5", "w") as file:
            file.create_group("a.jpg").create_dataset("keypoints", data=np.zeros((3, 2)))
        with pytest.raises(UserError, match="holds no global_descriptor"):
            scored(tmp_path / "f.h5", home, reader="hloc-global")


class _Tensor:
    """As much of a tensor as the lines for Game4Loc use."""

    def __init__(self, rows: Any) -> None:
        self.numpy = lambda: rows
        self.cpu = self.float = lambda: self

    @staticmethod
    def cat(parts: list[Any]) -> Any:
        return _Tensor(np.concatenate([part.numpy() for part in parts]))


class TestGame4Loc:
    def test_the_lines_write_what_is_read(
        self, tmp_path: Path, home: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        arrays = np.load(game4loc.write(tmp_path, Place()))
        (tmp_path / "run").mkdir()
        monkeypatch.chdir(tmp_path / "run")
        batch = _Tensor(arrays["gallery_features"])
        known = {"np": np, "torch": _Tensor, "gallery_features_batch": batch}
        known["img_features_query"] = _Tensor(arrays["query_features"])
        known["query_list"] = arrays["query_names"].tolist()
        known["gallery_list"] = arrays["gallery_names"].tolist()
        exec(LINES, known)  # noqa: S102 - what users paste
        assert perfect(scored(tmp_path / "run" / "features.npz", home))

    def test_the_recipe_has_the_lines(self) -> None:
        recipe = Path(__file__).parents[2] / "docs" / "recipes" / "game4loc.md"
        assert LINES in recipe.read_text()

    def test_the_lines_are_shown_where_a_field_is_lacking(self, tmp_path: Path, home: Path) -> None:
        path = game4loc.write(tmp_path, Place())
        arrays = dict(np.load(path))
        del arrays["gallery_names"]
        np.savez(path, **arrays)
        with pytest.raises(UserError, match=r"gallery_features\.append"):
            scored(path, home)

    def test_names_as_objects_are_refused(self, tmp_path: Path, home: Path) -> None:
        path = game4loc.write(tmp_path, Place())
        arrays = dict(np.load(path))
        arrays["query_names"] = arrays["query_names"].astype(object)
        np.savez(path, **arrays)
        with pytest.raises(UserError, match="never loaded"):
            scored(path, home, reader="game4loc")

    def test_another_number_of_names(self, tmp_path: Path, home: Path) -> None:
        path = game4loc.write(tmp_path, Place())
        arrays = dict(np.load(path))
        arrays["query_names"] = arrays["query_names"][1:]
        np.savez(path, **arrays)
        with pytest.raises(UserError, match="has 10 rows, and there are 9 names"):
            scored(path, home)


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

    def test_order_of_lines_is_nothing(self, tmp_path: Path, home: Path) -> None:
        path = trec.write(tmp_path, Place())
        lines = path.read_text().splitlines(keepends=True)
        order = np.random.default_rng(0).permutation(len(lines))
        path.write_text("".join(lines[number] for number in order))
        assert perfect(scored(path, home))


class TestUniversity1652:
    """MATLAB files, held against scipy, which wrote them."""

    @pytest.mark.parametrize(
        ("tree", "protocol", "ending"),
        [
            ("university-1652", "university-1652-drone-to-satellite", ".jpg"),
            ("university-1652", "university-1652-satellite-to-drone", ".jpeg"),
            ("denseuav", "denseuav-drone-to-satellite", ".tif"),
        ],
    )
    def test_its_benchmarks(self, tmp_path: Path, tree: str, protocol: str, ending: str) -> None:
        write = {"university-1652": image_trees.university_1652, "denseuav": image_trees.denseuav}
        data = tmp_path / "data"
        options = NativeOptions(write[tree](tmp_path / "source"), None, False)
        made = DATASETS.get(tree).prepare(options, PrepareSettings(data / tree, data))
        scene = protocol.removeprefix(f"{tree}-")
        truth = read_truth(made.folder / "scenes" / scene, scene)
        path = self.of_truth(tmp_path / "pytorch_result.mat", truth, scene)
        assert evaluate(path, protocol=protocol, data=data).overall["recall@1"] == 1.0
        assert ending in "".join(truth.tiles["image"])

    def of_truth(self, path: Path, truth: Any, scene: str) -> Path:
        """Write features that point from each image to its class."""
        asked, _, given = scene.split("-")
        sets = []
        for home, table in ((f"query_{asked}", truth.queries), (f"gallery_{given}", truth.tiles)):
            paths = [f"/data/test/{home}/{image}" for image in table["image"]]
            classes = [int(Path(one).parent.name) for one in paths]
            order = sorted({*classes, *range(2255, 2260), *range(701, 713)})
            rows = np.eye(len(order), dtype=np.float32)[[order.index(one) for one in classes]]
            sets.append((rows, paths))
        return university1652.save(path, *sets)

    def test_names_from_the_lists_beside(self, tmp_path: Path, home: Path) -> None:
        path = university1652.write(tmp_path, Place())
        found = scipy.io.loadmat(path)
        kept = {key: value for key, value in found.items() if "path" not in key and key[0] != "_"}
        scipy.io.savemat(path, kept)
        with pytest.raises(UserError, match=r"has no query_path, and query_name.txt is not"):
            scored(path, home)
        for kind in ("query", "gallery"):
            names = "\n".join(found[f"{kind}_path"])
            (tmp_path / f"{kind}_name.txt").write_text(names)
        assert perfect(scored(path, home))

    def test_classes_of_other_images(self, tmp_path: Path, home: Path) -> None:
        path = university1652.write(tmp_path, Place())
        found = {key: value for key, value in scipy.io.loadmat(path).items() if key[0] != "_"}
        found["gallery_label"] = found["gallery_label"][:, ::-1]
        scipy.io.savemat(path, found)
        with pytest.raises(UserError, match="classes that are not those of the folders"):
            scored(path, home)

    def test_arrays_are_those_of_scipy(self, tmp_path: Path) -> None:
        random = np.random.default_rng(0)
        arrays = {
            "small": np.array([[7]], np.int16),
            "f8": random.standard_normal((3, 5)),
            "cube": random.standard_normal((2, 3, 4)).astype(np.float32),
            "u1": random.integers(0, 255, (4, 3), np.uint8),
            "text": np.array(["a", "bcd", "ef"]),
            "cell": np.array([{"a": 1}, "x"], dtype=object),
            "complex": np.array([[1j]]),
            "none": np.zeros((0, 0)),
        }
        scipy.io.savemat(tmp_path / "a.mat", arrays)
        file, oracle = MatFile(tmp_path / "a.mat", PLENTY), scipy.io.loadmat(tmp_path / "a.mat")
        assert file.names() == {"small", "f8", "cube", "u1", "text", "none"}
        for name in file.names() - {"text"}:
            assert np.array_equal(file.numbers(name), oracle[name])
            assert file.numbers(name).dtype == oracle[name].dtype
        assert file.texts("text") == [one.rstrip() for one in oracle["text"]]
        for name in ("text", "f8"):
            wrong = file.numbers if name == "text" else file.texts
            with pytest.raises(PredictionError, match="holds no"):
                wrong(name)
        with pytest.raises(PredictionError, match="more than the limit"):
            MatFile(tmp_path / "a.mat", 100).numbers("f8")

    def test_compressed_variables_are_refused(self, tmp_path: Path) -> None:
        scipy.io.savemat(tmp_path / "a.mat", {"a": np.zeros((9, 9))}, do_compression=True)
        with pytest.raises(PredictionError, match="do_compression=False"):
            MatFile(tmp_path / "a.mat", PLENTY)
