"""What holds for every reader: exact files score so, in any order; faults are refused by name."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.core.errors import PredictionError, UserError
from airzoo_bench.core.registry import READERS
from airzoo_bench.evaluation.predictions import SURE, find_reader
from tests.goldens.recipes import spoil
from tests.hostile.inputs import spoil_bytes
from tests.readers.conftest import LAYOUTS, Worlds

ALL = pytest.mark.parametrize("name", LAYOUTS)
UNNAMED = [
    name for name, one in LAYOUTS.items() if one.track == "reconstruction" and not one.is_named
]


def test_every_reader_has_a_layout() -> None:
    assert {name.split()[0] for name in LAYOUTS} == set(READERS.names())


@ALL
def test_files_are_of_their_reader_alone(name: str, worlds: Worlds, tmp_path: Path) -> None:
    path, reader = worlds.sample(name, tmp_path / "f"), name.split()[0]
    assert find_reader(path) == (None if LAYOUTS[name].needs_track else reader)
    assert find_reader(path, LAYOUTS[name].track) == reader
    sure = {one: READERS.get(one).recognise(path) for one in READERS.names()}
    assert {one for one, value in sure.items() if value >= SURE} <= {reader}


def test_own_files_are_of_no_reader(tmp_path: Path) -> None:
    path = tmp_path / "own.npz"
    np.savez(path, query_ids=["east/q00000"], ranked_ids=[["east/t00000"]], protocol="made")
    assert all(READERS.get(one).recognise(path) < SURE for one in READERS.names())
    assert find_reader(path) is None


@ALL
def test_exact_files_score_as_their_truth(name: str, worlds: Worlds) -> None:
    """Layouts of one noisy truth score the same, one that needs no conversion among them."""
    layout = LAYOUTS[name]
    if layout.is_pickled:
        with pytest.raises(UserError, match="pickle") as caught:
            worlds.score(name)
        assert caught.value.fix
        return
    found, expected = worlds.score(name), worlds.score(layout.like).overall
    reader = found.result.predictions.reader
    assert reader is not None
    assert reader.name == name.split()[0]
    assert reader.conventions
    assert found.overall == pytest.approx(expected, abs=layout.tolerance)
    if layout.track == "reconstruction":
        noisy = 0.1 < expected["ate_m"] < 0.3 and 0.1 < expected["f1_0.2m"] < 0.2
    else:
        assert found.records["answered"].all()
        noisy = expected.get("map", 0.0) < 1.0 and 0.5 < expected.get("error_m", 1.0) < 5.0
    assert noisy


@pytest.mark.parametrize("name", UNNAMED)
def test_a_list_of_names_decides_which_view_is_which(
    name: str, worlds: Worlds, tmp_path: Path
) -> None:
    path, names = worlds.sample(name, tmp_path), tmp_path / "names.txt"
    names.write_text("\n".join(names.read_text().splitlines()[::-1]))
    turned = worlds.evaluate("reconstruction", path, names=names)
    assert turned.overall["ate_m"] > 10 * worlds.score(name).overall["ate_m"]


@ALL
def test_damage_is_looked_at_without_a_word(name: str, worlds: Worlds, tmp_path: Path) -> None:
    random, source = np.random.default_rng(len(name)), worlds.sample(name, tmp_path / "f")
    copy: Callable[..., Any] = shutil.copytree if source.is_dir() else shutil.copyfile
    for number in range(3):
        place = tmp_path / str(number) / source.name
        place.parent.mkdir()
        copy(source, place)
        files = sorted(one for one in (place, *place.rglob("*")) if one.is_file())
        file = files[int(random.integers(len(files)))]
        content = file.read_bytes()
        cut = content[: int(random.integers(len(content) + 1))]
        file.write_bytes(cut if number % 2 else spoil_bytes(random, content))
        for reader in READERS.names():
            assert 0.0 <= READERS.get(reader).recognise(place) <= 1.0


# --- faults by name, as recipes of the goldens, which hold more of them ---

PAIR = "photos-q0.png/matching-crops-q0_dom.tif"
FEATURES = "feats-superpoint-n4096-r1024"
YARD = "yard/predictions.npz: do"
LINES = "hloc_results.txt: text"
W2C = "_r = extrinsic[:, :, :3].transpose(0, 2, 1); extrinsic[:, :, 3:] = -_r @ extrinsic[:, :, 3:]"
LARGE = "[[800, 0, 240], [0, 800, 180], [0, 0, 1]]"


def hdf5(file: str, name: str, values: str) -> str:
    """Return a recipe that replaces a dataset, or leaves out a group for no values."""
    replaced = f"; f[{name!r}] = {values}" if values else ""
    return f"{file}: py import h5py; f = h5py.File(path, 'a'); del f[{name!r}]{replaced}; f.close()"


def model(file: str, content: str) -> str:
    """Return a recipe that makes other bytes of a file's."""
    return f"yard/sparse/{file}.bin: py b = path.read_bytes(); path.write_bytes({content})"


# A layout, what is done to its files, and words of the message.
REFUSALS = [
    # Pixels, sizes and pairs of matchers.
    ("loftr", "q0.npz: do image_size0 = (160, 112)", "pixels up to"),
    ("loftr", "q0.npz: do image_size0 = (0, 3)", "field 'image_size0' is"),
    ("loftr", "q0.npz: do image_size0 = (3.0, 3.0)", "field 'image_size0' is"),
    ("loftr", "q0.npz: do mkpts0_f = np.zeros(60)", "field 'mkpts0_f' is float64"),
    ("loftr", "old/hills/q3.npz: from q3.npz", "are both hills/q3 with one part"),
    ("loftr", "q3_q3_dom.npz: from q3.npz", "are both hills/q3 with one part"),
    ("roma", "q0.npz: do matches = np.zeros((60, 2))", r"shape \(60, 2\)"),
    ("roma", "q0.npz: do matches = np.full((60, 4), 5e3)", "outside it, the first at"),
    ("roma", "q0.npz: do matches = np.full((60, 4), (9, 9, 5e3, 5e3))", "q0_dom"),
    ("roma", "q0.npz: do matches = np.full((60, 4), 0.2); matches[0] = 1.003", "1 match"),
    ("superglue", "q0_q0_dom_matches.npz: do matches = np.full(61, 60)", "beyond"),
    ("mast3r-visloc", "q0.png/q0_dom.tif.npz: do del matches_im_map", "lacks the field"),
    ("dust3r-matches", "q0.npz: do size = np.array([1, 2])", "at which size"),
    # hloc
    (
        "hloc dense",
        hdf5("matches-loftr.h5", f"{PAIR}/keypoints0", "np.full((60, 2), 5e3)"),
        "outside it, the first at",
    ),
    *(
        ("hloc", hdf5(f"{FEATURES}{end}.h5", name, values), words)
        for end, name, values, words in (
            ("_matches", f"{PAIR}/matches0", "np.full(61, -2, np.int16)", "numbers beyond"),
            ("_matches", f"{PAIR}/matches0", "np.full(61, 61, np.int16)", "numbers beyond"),
            ("_matches", f"{PAIR}/matches0", "np.zeros(60, np.int16)", "numbers beyond"),
            ("", "photos/q0.png/image_size", "[320, 240]", "image_size is"),
            ("", "photos/q0.png/keypoints", "np.zeros(61)", "of shape"),
            ("", "photos/q0.png/keypoints", "np.full((61, 2), np.nan)", "not finite"),
            ("", "photos/q0.png", "", "no features of 'photos-q0.png'"),
        )
    ),
    # Poses
    ("tum", "names.txt: text q0.png", "and 1 name"),
    ("hloc-poses", f"{LINES} q0.png 1 0 0 0 1 2", "row 1 has 7 columns"),
    ("hloc-poses", f"{LINES} q0.png 1 0 0 0 1 2 x", "words where numbers should be"),
    ("hloc-poses", LINES, "holds no pose"),
    ("hloc-poses", f"{LINES} zz.png 1 0 0 0 1 2 3", "none of its names is that of a query"),
    ("hloc-poses", f"{LINES} q0.png 1 0 0 0 1 2 3\\nx/q0.jpg 1 0 0 0 1 2 3", "are both hills/q0"),
    ("hloc-poses", f"{LINES} q0.png 2 0 0 0 1 2 3", "unit"),
    # Retrieval
    ("trec", "mine.run: sed east/t00004 => east/x", "ranks what is no tile"),
    ("trec", "mine.run: sed  mine => ", "is no line of a run"),
    ("trec", "mine.run: sed 0. => nan0.", "is no line of a run"),
    ("trec", "mine.run: sed - => ", "scores rise with the rank"),
    ("game4loc", "features.npz: do del gallery_names", "gallery_names"),
    ("game4loc", "features.npz: do query_names = np.array(['a'], object)", "never loaded"),
    ("game4loc", "features.npz: do query_names = np.array(['a'] * 9)", "and there are 9 names"),
    ("anyloc", "east: py path.rename(path.parents[1] / 'anyloc' / 'x')", "could be 2 "),
    # Maps and cameras in arrays
    ("vggt", f"{YARD} depth = np.array([{{}}], object)", "holds pickled Python"),
    ("vggt", f"{YARD} {W2C}; extrinsic[:, :, :3] = _r.copy()", "extrinsics look inverted"),
    ("mapanything", f"{YARD} extrinsic = np.linalg.inv(extrinsic)", "extrinsics look inverted"),
    ("vggt", f"{YARD} intrinsic[:] = {LARGE}", "the intrinsics look of images of about"),
    ("vggt", f"{YARD} extrinsic[:, :, 2] = 0", "rotation"),
    ("vggt", f"{YARD} depth = 1.0", r"field 'depth' has shape \(\)"),
    ("mapanything", f"{YARD} final_mask = np.ones((6, 3, 3), bool)", "'final_mask' is bool"),
    ("vggt", "yard/images/x.jpg: text x", "there are 7 names, named by the images"),
    # A file a frame
    ("cut3r", "yard/depth/000001.npy: rm", "files are missing"),
    ("cut3r", "yard/camera/000001.npz: rm", "files are missing"),
    ("cut3r", "yard/conf/000005.npy: rm", "files are missing"),
    ("depth-anything-3 streaming", "yard/camera_poses.txt: rm", "camera_poses"),
    ("depth-anything-3 streaming", "yard/results_output/frame_2.npz: rm", "files are missing"),
    ("depth-anything-3 streaming", "yard/results_output: rm", "files are missing"),
    ("vggt-slam", "names.txt: text 0 yard/yard_0.jpg\\n0 yard/yard_1.jpg", "or of several"),
    ("vggt-slam", "yard/poses.txt: sed 1.00000000 0.1 => 9.00000000 0.1", "of no photo"),
    # COLMAP models
    ("vggt-colmap", model("images", "b[:-7]"), "damaged"),
    ("vggt-colmap", model("images", "b + bytes(1)"), "damaged"),
    ("vggt-colmap", model("images", "(1 << 60).to_bytes(8, 'little') + b[8:]"), "memory"),
    ("vggt-colmap", model("images", r"b.replace(b'yard_3.jpg', b'yard\x1b[2Jg')"), "text"),
    ("vggt-colmap", model("images", "b[:12] + np.float64(7).tobytes() + b[20:]"), "norm"),
    ("vggt-colmap", model("points3D", "b[:-7]"), "damaged"),
    ("vggt-colmap", model("points3D", "(1 << 60).to_bytes(8, 'little') + b[8:]"), "damaged"),
]


@pytest.mark.parametrize(("name", "recipe", "words"), REFUSALS)
def test_refusals(name: str, recipe: str, words: str, worlds: Worlds, tmp_path: Path) -> None:
    path, layout = worlds.sample(name, tmp_path / "f"), LAYOUTS[name]
    home = path.parent if path.is_file() or recipe.startswith("names.txt") else path
    spoil(home, recipe)
    names, reader = path.parent / "names.txt" if layout.is_listed else None, name.split()[0]
    with pytest.raises(PredictionError, match=words) as refused:
        worlds.evaluate(layout.track, path, names=names, reader=reader)
    assert str(tmp_path) in str(refused.value)
    if layout.track == "reconstruction" and "pickled" not in words:
        assert find_reader(path) == reader  # or people would not know what it lacks
