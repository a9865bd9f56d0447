"""Queries registered in a COLMAP model, and matches and results of AerialExtreMatch."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.core.errors import PredictionError, UserError
from airzoo_bench.evaluation.reader import find_reader
from tests.matching.world import World
from tests.readers.samples import aerialextrematch, colmap

Evaluated = Callable[..., Any]


@pytest.mark.parametrize("text", [False, True])
@pytest.mark.parametrize("below", [".", "sparse/0"])
def test_a_model_is_read(
    text: bool, below: str, world: World, tmp_path: Path, evaluated: Evaluated
) -> None:
    home = tmp_path / "out" / below
    home.parent.mkdir(parents=True, exist_ok=True)
    colmap.write_model(tmp_path, world, text=text).rename(home)
    path = tmp_path / "out"
    assert find_reader(path) is None
    assert find_reader(path, "matching") == "colmap-poses"
    found = evaluated(path)
    assert found.overall["error_m"] < 1e-6
    assert "1 image of the model that are no queries left out" in found.result.notes


def test_another_world_is_named(world: World, tmp_path: Path, evaluated: Evaluated) -> None:
    with pytest.raises(PredictionError, match=r"by \(-299970\.0, -299988\.0\) m"):
        evaluated(colmap.write_model(tmp_path, world, offset=3e5))


@pytest.mark.parametrize("content", ["1 2 3\n", "1 a b c d e f g 1 x.png\n\n", "# nothing\n"])
def test_texts_that_are_no_images(
    content: str, world: World, tmp_path: Path, evaluated: Evaluated
) -> None:
    path = colmap.write_model(tmp_path, world, text=True)
    (path / "images.txt").write_text(content)
    with pytest.raises(PredictionError, match=r"no image|damaged"):
        evaluated(path)


def test_aerialextrematch(world: World, tmp_path: Path, evaluated: Evaluated) -> None:
    path = aerialextrematch.write(tmp_path, world)
    assert find_reader(path) == "aerialextrematch"
    own = evaluated(world.write(tmp_path / "own.npz", world.matches())).overall
    found = evaluated(path)
    assert found.overall == pytest.approx(own, abs=1e-9)
    assert "half a pixel" in found.result.predictions.reader.conventions[0]
    np.save(path / "q0.npy", np.zeros((3, 5)))
    with pytest.raises(PredictionError, match=r"an array of shape \(3, 5\)"):
        evaluated(path, reader="aerialextrematch")


def test_errors_are_no_poses(world: World, tmp_path: Path, evaluated: Evaluated) -> None:
    path = aerialextrematch.write_results(tmp_path, world)
    assert find_reader(path) == "aerialextrematch"
    with pytest.raises(UserError, match="errors in metres and degrees"):
        evaluated(path)
