"""hloc's features and matches: exact ones score perfect, and what is not meant so is refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.core.files import sha256_of
from airzoo_bench.evaluation.reader import find_reader
from tests.matching.world import World
from tests.readers import matching_files

Evaluated = Callable[..., Any]


def test_sparse_matches(world: World, tmp_path: Path, evaluated: Evaluated) -> None:
    path = matching_files.write_hloc(tmp_path, world)
    assert find_reader(path) == find_reader(path / matching_files.MATCHES) == "hloc"
    for given in (path, path / matching_files.MATCHES):
        found = evaluated(given)
        assert found.overall["error_m"] < 1e-2
        assert len(found.records) == len(world.ids)
    said = found.result.predictions.reader.conventions
    assert "0.5 was added" in said[0]
    assert said[1:] == (
        f"read too: {matching_files.FEATURES}, SHA-256 {sha256_of(path / matching_files.FEATURES)}",
    )
    assert evaluated(path).result.predictions.reader.conventions == said[:1]


def test_half_precision_is_named_with_its_step(
    world: World, tmp_path: Path, evaluated: Evaluated
) -> None:
    found = evaluated(matching_files.write_hloc(tmp_path, world, dtype=np.float16))
    step = "keypoints were rounded to float16, in steps of up to 0.5 px"
    assert any(step in one for one in found.result.predictions.reader.conventions)
    assert any(step in one for one in found.result.notes)
    assert 1e-3 < found.overall["error_m"] < 1


def test_the_whole_map_may_be_matched(world: World, tmp_path: Path, evaluated: Evaluated) -> None:
    path = tmp_path / "m.h5"
    with h5py.File(path, "w") as file:
        rows = zip(world.truth.queries["image"], world.query_xy, world.map_xy, strict=True)
        for name, query_xy, map_xy in rows:
            file[f"dom.tif/{name}/keypoints0"] = map_xy - 0.5
            file[f"dom.tif/{name}/keypoints1"] = query_xy - 0.5
        file["q0.png/q1.png/keypoints0"] = file["q0.png/q1.png/keypoints1"] = np.zeros((3, 2))
    found = evaluated(path)
    assert found.overall["error_m"] < 1e-6
    assert "1 pair of other pictures left out" in found.result.notes


def test_pixels_outside_of_a_picture_are_refused(
    world: World, tmp_path: Path, evaluated: Evaluated
) -> None:
    with pytest.raises(PredictionError, match="outside it, the first at"):
        evaluated(matching_files.write_hloc_dense(tmp_path, world, scale=2.0))


def _change(file: Any, name: str, values: Any) -> None:
    del file[name]
    file[name] = values


PAIR = "photos-q0.png/matching-crops-q0_dom.tif/matches0"


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda f, m: _change(m, PAIR, np.full(61, -2, np.int16)), "numbers beyond"),
        (
            lambda f, m: _change(
                f, "matching/crops/q0_dom.tif/keypoints", np.zeros((40_000, 2), np.float32)
            ),
            "numbers beyond",
        ),
        (lambda f, m: _change(m, PAIR, np.full(61, 61, np.int16)), "numbers beyond"),
        (lambda f, m: _change(m, PAIR, np.zeros(60, np.int16)), "matches0"),
        (lambda f, m: _change(f, "photos/q0.png/image_size", [320, 240]), "image_size is"),
        (lambda f, m: _change(f, "photos/q0.png/keypoints", np.zeros(61)), "of shape"),
        (lambda f, m: f.__delitem__("photos/q0.png"), "no features of 'photos-q0.png'"),
        (
            lambda f, m: _change(
                f, "photos/q0.png/keypoints", np.full((61, 2), np.nan, np.float32)
            ),
            "not finite",
        ),
    ],
)
def test_refusals(
    spoil: Callable[..., None], words: str, world: World, tmp_path: Path, evaluated: Evaluated
) -> None:
    path = matching_files.write_hloc(tmp_path, world)
    with (
        h5py.File(path / matching_files.FEATURES, "a") as f,
        h5py.File(path / matching_files.MATCHES, "a") as m,
    ):
        spoil(f, m)
    with pytest.raises(PredictionError, match=words):
        evaluated(path)
