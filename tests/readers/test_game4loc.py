"""Game4Loc: its features score as the suite's own file of the same descriptors."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.core.errors import UserError
from airzoo_bench.readers.game4loc import LINES
from tests.readers.retrieval_support import Place, perfect, scored, tile_file
from tests.readers.samples import game4loc

RECIPE = Path(__file__).parents[2] / "docs" / "recipes" / "game4loc.md"


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
        assert LINES in RECIPE.read_text()

    def test_the_lines_of_eval_custom_write_what_is_read(
        self, tmp_path: Path, home: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        place = Place()
        arrays = np.load(game4loc.write(tmp_path, place))
        (tmp_path / "run").mkdir()
        monkeypatch.chdir(tmp_path / "run")
        known: dict[str, Any] = {"np": np}
        for kind in ("query", "gallery"):
            known[f"img_features_{kind}"] = _Tensor(arrays[f"{kind}_features"])
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
        lines = RECIPE.read_text().split("```python\n")[-1].split("```")[0]
        exec(lines, known)  # noqa: S102 - what users paste
        assert perfect(scored(tmp_path / "run" / "features.npz", home))

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
