"""Retrieval: names of several scenes, images by name, TREC, Game4Loc's lines, University-1652."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench import evaluate
from airzoo_bench.core.errors import UnreadableError, UserError
from airzoo_bench.core.files import sha256_of
from airzoo_bench.core.registry import DATASETS
from airzoo_bench.datasets.settings import PrepareSettings, SourceOptions
from airzoo_bench.retrieval.truth import read_truth
from tests.goldens.run import unpack
from tests.readers import retrieval_files as files
from tests.readers.retrieval_files import Place, perfect, scored, tile_file
from tests.support import MadeScene

RECIPE = Path(__file__).parents[2] / "docs" / "recipes" / "retrieval.md"


def changed(path: Path, **changes: Any) -> Path:
    arrays = dict(np.load(path)) | changes
    np.savez(path, **{name: value for name, value in arrays.items() if value is not None})
    return path


def test_half_precision_of_hloc(tmp_path: Path, home: Path) -> None:
    result = scored(files.write_hloc_global(tmp_path, Place(), np.float16), home)
    assert perfect(result)
    assert "float16, as the file has them" in result.result.predictions.reader.conventions[0]


@pytest.fixture
def crowded(home: Path) -> Path:
    """Return a benchmark whose west has two photos more than queries, called as east's are."""
    left_out = home / "made" / "scenes" / "west" / "retrieval" / "excluded.csv"
    file, before = home / "made" / "benchmark.toml", sha256_of(left_out)
    left_out.write_text("id,image,reason\nwest/q00004,q00004.jpg,x\n")
    text, line = file.read_text(), '"scenes/west/retrieval/excluded.csv" = "{}"'.format
    assert line(before) in text
    file.write_text(text.replace(line(before), line(sha256_of(left_out))))
    return home


def photos(scene: str) -> list[str]:
    return [f"{scene}/q{number:05d}.jpg" for number in range(6)]


def described(folder: Path, names: list[str]) -> Path:
    """Write Game4Loc's features of photos, in this order."""
    folder.mkdir(parents=True, exist_ok=True)
    path = files.write_game4loc(folder, Place())
    arrays = dict(np.load(path))
    rows = dict(zip(arrays["query_names"].tolist(), arrays["query_features"], strict=True))
    features = np.stack([rows.get(name, rows["east/q00005.jpg"]) for name in names])
    named = np.array([f"/data/{name}" for name in names])
    return changed(path, query_features=features, query_names=named)


class TestScenesWithTheSameNames:
    """East has the queries q00000 to q00005, west the first four; q00004 and q00005 are none."""

    def test_photos_of_one_are_no_queries_of_the_other(self, tmp_path: Path, crowded: Path) -> None:
        result = scored(described(tmp_path, photos("west")), crowded)
        answered = result.records.groupby("scene")["recall@1"].mean()
        assert answered.to_dict() == {"east": 0.0, "west": 1.0}
        notes = " | ".join(result.result.notes)
        assert "2 photos described that are no queries, left aside" in notes
        assert "scored at their worst: 6 of 10 (first 3: east/q00000" in notes

    @pytest.mark.parametrize("folder", ["run", "west"])
    def test_all_photos_may_be_described(self, tmp_path: Path, crowded: Path, folder: str) -> None:
        path = described(tmp_path / folder, photos("east") + photos("west"))
        assert perfect(scored(path, crowded))

    def test_a_name_that_a_photo_left_out_has_too(self, tmp_path: Path, crowded: Path) -> None:
        path = described(tmp_path, photos("east"))
        names = np.load(path)["query_names"]
        names[4] = "q00004.jpg"
        with pytest.raises(UserError, match=r"'q00004.jpg' could be 2 \(east/q00004, west/q00004"):
            scored(changed(path, query_names=names), crowded)


class TestImagesByName:
    """Descriptors of photos and tiles in one folder or file."""

    def test_a_name_of_two_scenes(self, tmp_path: Path, home: Path) -> None:
        path = files.write_anyloc(tmp_path, Place())
        shutil.copytree(path / "east", path, dirs_exist_ok=True)
        shutil.rmtree(path / "east")
        with pytest.raises(UserError, match=r"anyloc: 'photos/q00000.jpg' could be 2 "):
            scored(path, home)

    def test_a_gallery_larger_than_the_memory(self, tmp_path: Path) -> None:
        scene = MadeScene("east", [[0]], 400)
        data = Place([scene]).prepare(tmp_path / "data")
        rows = np.random.default_rng(0).standard_normal((400, 5000), np.float32)
        for kind, count in (("tiles/t", 400), ("photos/q", 1)):
            (tmp_path / "any" / kind).parent.mkdir(parents=True)
            for number in range(count):
                file = tmp_path / "any" / f"{kind}{number:05d}.jpg.npy"
                np.save(file, rows[number : number + 1])
        assert rows.nbytes > 4e6
        spilt = scored(tmp_path / "any", data, max_memory=2_000_000)
        assert spilt.overall["recall@1"] == 1.0
        assert spilt.records.equals(scored(tmp_path / "any", data).records)


class TestTrec:
    def test_ties_are_broken_against_the_method(self, tmp_path: Path, home: Path) -> None:
        path = files.write_trec(tmp_path, Place())
        lines = [line.split() for line in path.read_text().splitlines()]
        path.write_text("".join(" ".join([*one[:4], "0.5", "x"]) + "\n" for one in lines))
        assert scored(path, home).overall["recall@1"] == 0.0

    @pytest.mark.parametrize(
        ("old", "new", "words"),
        [
            ("east/t00004", "east/elsewhere", "ranks what is no tile"),
            (" mine", "", "is no line of a run"),
            ("0.", "nan0.", "is no line of a run"),
            ("-", "", "scores rise with the rank"),
        ],
    )
    def test_refusals(self, tmp_path: Path, home: Path, old: str, new: str, words: str) -> None:
        path = files.write_trec(tmp_path, Place())
        path.write_text(path.read_text().replace(old, new))
        with pytest.raises(UserError, match=words):
            scored(path, home, reader="trec")
        with pytest.raises(UnreadableError, match="a folder, and so not"):
            scored(tmp_path, home, reader="trec")


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
        place = Place()
        arrays = np.load(files.write_game4loc(tmp_path, place))
        recipe = RECIPE.read_text()
        queries, gallery = (_Tensor(arrays[f"{kind}_features"]) for kind in ("query", "gallery"))
        known = {"np": np, "torch": _Tensor, "gallery_features_batch": gallery}
        known |= {"img_features_query": queries, "img_features_gallery": gallery}
        known["query_list"] = arrays["query_names"].tolist()
        known["gallery_list"] = arrays["gallery_names"].tolist()
        known["query_path_list"] = [
            f"/bench/data/{scene.id}/images/{one.split('/')[1]}.jpg"
            for scene in place.scenes
            for one in scene.query_ids
        ]
        known["gallery_path_list"] = [
            tile_file("/bench", scene, number)
            for scene in place.scenes
            for number in range(scene.n_tiles)
        ]
        blocks = [one.split("```")[0] for one in recipe.split("```python\n")]
        for number, lines in enumerate(one for one in blocks if "query_features=" in one):
            name = str(number)
            (tmp_path / name).mkdir()
            monkeypatch.chdir(tmp_path / name)
            exec(lines, dict(known))  # noqa: S102 - what users paste
            assert perfect(scored(tmp_path / name / "features.npz", home))

    @pytest.mark.parametrize(
        ("changes", "words"),
        [
            ({"gallery_names": None}, "gallery_names"),
            ({"query_names": np.array(["a"], object)}, "never loaded"),
            ({"query_names": np.array(["a"] * 9)}, "has 10 rows, and there are 9 names"),
        ],
    )
    def test_refusals(
        self, changes: dict[str, Any], words: str, tmp_path: Path, home: Path
    ) -> None:
        path = changed(files.write_game4loc(tmp_path, Place()), **changes)
        with pytest.raises(UserError, match=words):
            scored(path, home, reader="game4loc")


class TestUniversity1652:
    @pytest.mark.parametrize(
        ("tree", "protocol"),
        [
            ("university-1652", "university-1652-drone-to-satellite"),
            ("denseuav", "denseuav-drone-to-satellite"),
        ],
    )
    def test_its_benchmarks(self, tmp_path: Path, tree: str, protocol: str) -> None:
        data = tmp_path / "data"
        unpack(tree, tmp_path / "source")
        options = SourceOptions(tmp_path / "source" / "in", None, False)
        made = DATASETS.get(tree).prepare(options, PrepareSettings(data / tree, data))
        scene = protocol.removeprefix(f"{tree}-")
        truth = read_truth(made.folder / "scenes" / scene, scene)
        asked, _, given = scene.split("-")
        sets = []
        for home, table in ((f"query_{asked}", truth.queries), (f"gallery_{given}", truth.tiles)):
            paths = [f"/data/test/{home}/{image}" for image in table["image"]]
            classes = [int(Path(one).parent.name) for one in paths]
            order = sorted({*classes, *range(2255, 2260), *range(701, 713)})
            rows = np.eye(len(order), dtype=np.float32)[[order.index(one) for one in classes]]
            sets.append((rows, paths))
        path = files.save_mat(tmp_path / "pytorch_result.mat", *sets)
        assert evaluate(path, protocol=protocol, data=data).overall["recall@1"] == 1.0
