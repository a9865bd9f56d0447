"""University-1652's result files: scores as of the suite's own, and what is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.io

from airzoo_bench import evaluate
from airzoo_bench.core.errors import PredictionError, UserError
from airzoo_bench.core.files import sha256_of
from airzoo_bench.core.registry import DATASETS
from airzoo_bench.datasets.settings import PrepareSettings, SourceOptions
from airzoo_bench.formats.mat5 import MatFile
from airzoo_bench.retrieval.truth import read_truth
from tests.datasets.published import image_trees
from tests.readers.retrieval_support import PLENTY, Place, perfect, scored
from tests.readers.samples import university1652


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
        options = SourceOptions(write[tree](tmp_path / "source"), None, False)
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
        result = scored(path, home)
        assert perfect(result)
        lists = [tmp_path / f"{kind}_name.txt" for kind in ("query", "gallery")]
        said = [f"read too: {one.name}, SHA-256 {sha256_of(one)}" for one in lists]
        assert list(result.result.predictions.reader.conventions[-2:]) == said

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
        assert file.names() == set(arrays)
        for name in ("small", "f8", "cube", "u1", "none"):
            assert np.array_equal(file.numbers(name), oracle[name])
            assert file.numbers(name).dtype == oracle[name].dtype
        assert file.texts("text") == [one.rstrip() for one in oracle["text"]]
        for name in ("text", "f8", "cell", "complex"):
            wrong = file.texts if name == "f8" else file.numbers
            with pytest.raises(PredictionError, match="holds no"):
                wrong(name)
        with pytest.raises(PredictionError, match="more than the limit"):
            MatFile(tmp_path / "a.mat", 100).numbers("f8")

    def test_compressed_variables_are_read(self, tmp_path: Path) -> None:
        values = np.arange(81.0).reshape(9, 9)
        scipy.io.savemat(tmp_path / "a.mat", {"a": values}, do_compression=True)
        assert np.array_equal(MatFile(tmp_path / "a.mat", PLENTY).numbers("a"), values)

    @pytest.mark.parametrize("place", [160, 164, 180])
    @pytest.mark.parametrize("value", [0, 1, 1 << 20, 0x7FFFFFFF])
    def test_counts_that_lie(self, place: int, value: int, tmp_path: Path) -> None:
        path = tmp_path / "a.mat"
        scipy.io.savemat(path, {"a": np.ones((3, 5))})
        raw = bytearray(path.read_bytes())
        raw[place : place + 4] = value.to_bytes(4, "little")
        path.write_bytes(raw)
        with pytest.raises(PredictionError):
            MatFile(path, PLENTY).numbers("a")

    def test_a_file_that_is_cut_off(self, tmp_path: Path) -> None:
        scipy.io.savemat(tmp_path / "a.mat", {"a": np.ones((3, 5))})
        whole = (tmp_path / "a.mat").read_bytes()
        for length in (100, 140, len(whole) // 2, len(whole) - 8):
            (tmp_path / "a.mat").write_bytes(whole[:length])
            with pytest.raises(PredictionError):
                MatFile(tmp_path / "a.mat", PLENTY).numbers("a")
