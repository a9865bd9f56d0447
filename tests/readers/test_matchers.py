"""npz of matchers: exact matches score perfect, and pixels of an unknown size are refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.evaluation.reader import find_reader
from tests.matching.world import World
from tests.readers.samples import matchers

Evaluated = Callable[..., Any]
WRITERS = {
    "loftr": matchers.write_loftr,
    "superglue": matchers.write_superglue,
    "roma": matchers.write_roma,
    "dust3r-matches": matchers.write_dust3r,
    "mast3r-visloc": matchers.write_mast3r_visloc,
}


@pytest.fixture(scope="module")
def own(world: World, tmp_path_factory: pytest.TempPathFactory) -> Any:
    import airzoo_bench as ab

    path = world.write(tmp_path_factory.mktemp("own") / "own.npz", world.matches())
    return ab.evaluate(path, data=world.root).overall


@pytest.mark.parametrize("name", WRITERS)
def test_a_folder_scores_as_the_suites_own_file_does(
    name: str, world: World, tmp_path: Path, evaluated: Evaluated, own: Any
) -> None:
    path = WRITERS[name](tmp_path, world)
    assert find_reader(path) == name
    found = evaluated(path)
    assert found.overall == pytest.approx(own, abs=1e-9)
    assert found.result.predictions.reader.name == name
    assert found.records["answered"].all()


def test_whole_pixels_are_what_the_layout_of_dust3r_loses(
    world: World, tmp_path: Path, evaluated: Evaluated
) -> None:
    """DUSt3R's matches are whole pixels of pictures of 512 px; nothing else is lost on the way."""
    home = matchers.write_dust3r(tmp_path, world)
    for path in home.iterdir():
        fields = dict(np.load(path))
        whole = {key: np.rint(fields[key]) for key in ("matches_im0", "matches_im1")}
        np.savez(path, **fields | whole)
    errors = evaluated(home).records["error_m"]
    assert 0.01 < errors.median() < 2.0


def test_one_file_is_one_query(world: World, tmp_path: Path, evaluated: Evaluated) -> None:
    path = matchers.write_loftr(tmp_path, world) / "q3.npz"
    assert find_reader(path) == "loftr"
    found = evaluated(path).records.set_index("query")
    assert found.loc["hills/q3", "error_m"] < 1e-6
    assert found["answered"].sum() == 1


def test_roma_in_pixels(world: World, tmp_path: Path, evaluated: Evaluated, own: Any) -> None:
    found = evaluated(matchers.write_roma(tmp_path, world, pixels=True)).overall
    assert found == pytest.approx(own, abs=1e-9)


def test_height_and_width_as_loftr_has_them(
    world: World, tmp_path: Path, evaluated: Evaluated, own: Any
) -> None:
    turned = matchers.TENSOR[::-1]
    fields = {"image_size0": None, "image_size1": None, "hw0_i": turned, "hw1_i": turned}
    found = evaluated(matchers.write_loftr(tmp_path, world, **fields)).overall
    assert found == pytest.approx(own, abs=1e-6)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"image_size0": None}, "does not say to which size"),
        ({"image_size1": None}, "does not say to which size"),
        ({"image_size0": (160, 112)}, "image_size0 says has 160x112 px"),
        ({"image_size0": (1280, 960)}, "pixels of smaller pictures"),
        ({"image_size0": (0, 3)}, "field 'image_size0' is"),
        ({"image_size0": (3.0, 3.0)}, "field 'image_size0' is"),
    ],
)
def test_sizes_that_do_not_fit(
    fields: dict[str, Any], words: str, world: World, tmp_path: Path, evaluated: Evaluated
) -> None:
    with pytest.raises(PredictionError, match=words):
        evaluated(matchers.write_loftr(tmp_path, world, **fields))


def test_dust3r_needs_its_size(world: World, tmp_path: Path, evaluated: Evaluated) -> None:
    with pytest.raises(PredictionError, match="at which size the pictures were loaded"):
        evaluated(matchers.write_dust3r(tmp_path, world, stated=None))
    with pytest.raises(PredictionError, match=r"load_images makes 384x288 px"):
        evaluated(matchers.write_dust3r(tmp_path, world, stated=384))


@pytest.mark.parametrize(
    ("name", "field", "value", "words"),
    [
        ("loftr", "mkpts0_f", np.zeros((3, 2)), "mkpts0_f has 3 rows"),
        ("loftr", "mkpts0_f", np.zeros(60), "field 'mkpts0_f' is float64"),
        ("loftr", "mkpts0_f", np.full((60, 2), np.nan), "not finite"),
        ("roma", "matches", np.zeros((60, 2)), r"shape \(60, 2\)"),
        ("roma", "matches", np.full((60, 4), 5000.0), "outside it, the first at"),
        ("superglue", "matches", np.full(61, 60), "does not count the keypoints"),
        ("dust3r-matches", "size", np.array([1, 2]), "at which size"),
    ],
)
def test_refusals(
    name: str,
    field: str,
    value: Any,
    words: str,
    world: World,
    tmp_path: Path,
    evaluated: Evaluated,
) -> None:
    path = WRITERS[name](tmp_path, world)
    one = sorted(path.glob("*.npz"))[0]
    with np.load(one) as stored:
        fields = dict(stored)
    np.savez(one, **fields | {field: value})
    with pytest.raises(PredictionError, match=words) as error:
        evaluated(path)
    assert one.name in str(error.value)


def test_names_of_no_query(world: World, tmp_path: Path, evaluated: Evaluated) -> None:
    path = matchers.write_roma(tmp_path, world)
    (path / "q0.npz").rename(path / "other.npz")
    found = evaluated(path)
    assert "1 file of other pictures left out" in found.result.notes
    assert found.records["answered"].sum() == 4
    with pytest.raises(PredictionError, match="pairs no photo with its crop"):
        evaluated(path / "other.npz", reader="roma")


def test_empty_matches_are_an_answer(world: World, tmp_path: Path, evaluated: Evaluated) -> None:
    path = matchers.write_mast3r_visloc(tmp_path, world)
    one = path / "q0.png" / "q0_dom.tif.npz"
    np.savez(one, valid_pts3d=[], matches_im_query=[], matches_im_map=[], matches_conf=[])
    found = evaluated(path)
    assert found.records["answered"].all()
    assert found.records.set_index("query").loc["hills/q0", "error_m"] == float("inf")


def test_the_suites_own_file_is_not_taken(world: World, tmp_path: Path) -> None:
    path = world.write(tmp_path / "q0.npz", world.matches(matches=np.zeros((3, 4))))
    assert find_reader(path, "matching") is None
