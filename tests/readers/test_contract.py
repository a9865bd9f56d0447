"""What holds for every reader: exact files score so, in any order; faults are refused by name."""

from __future__ import annotations

import shutil
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
import pytest

from airzoo_bench.core.errors import PredictionError, UserError
from airzoo_bench.core.registry import READERS
from airzoo_bench.evaluation.predictions import SURE, find_reader
from tests.hostile.inputs import spoil_bytes
from tests.readers.conftest import LAYOUTS, Worlds
from tests.readers.method_files import Place

SPOILT = 3  # ways a file
ALL = pytest.mark.parametrize("name", LAYOUTS)


def test_every_reader_has_a_layout() -> None:
    assert {name.split()[0] for name in LAYOUTS} == set(READERS.names())


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory, worlds: Worlds) -> dict[str, Path]:
    """Write the files of all layouts once."""
    home = tmp_path_factory.mktemp("written")
    return {name: worlds.sample(name, home / str(n)) for n, name in enumerate(LAYOUTS)}


@ALL
def test_files_are_of_their_reader_alone(name: str, written: dict[str, Path]) -> None:
    path, reader = written[name], name.split()[0]
    assert find_reader(path) == (None if LAYOUTS[name].needs_track else reader)
    assert find_reader(path, LAYOUTS[name].track) == reader
    sure = {one: READERS.get(one).recognise(path) for one in READERS.names()}
    assert {one for one, value in sure.items() if value >= SURE} <= {reader}


def test_own_files_are_of_no_reader(tmp_path: Path) -> None:
    path = Place().canonical(tmp_path / "own.npz")
    assert all(READERS.get(one).recognise(path) < SURE for one in READERS.names())
    assert find_reader(path) is None


@ALL
def test_exact_files_score_as_their_truth(name: str, worlds: Worlds, tmp_path: Path) -> None:
    """They score as files that need no conversion, or perfectly: turned ones too, by names."""
    layout = LAYOUTS[name]
    if layout.is_pickled:
        with pytest.raises(UserError, match="pickle") as caught:
            worlds.score(name)
        assert caught.value.fix
        return
    found = worlds.score(name)
    reader = found.result.predictions.reader
    assert reader is not None
    assert reader.name == name.split()[0]
    assert reader.conventions
    if layout.like is not None:
        expected = worlds.score(layout.like).overall
        assert found.overall == pytest.approx(expected, abs=layout.tolerance)
        assert found.records["answered"].all()
        noisy = expected.get("map", 0.0) < 1.0 and 0.5 < expected.get("error_m", 1.0) < 5.0
        assert noisy
        return
    assert found.overall["f1_0.2m"] == 1.0
    assert found.overall["chamfer_m"] < layout.tolerance
    assert found.overall["ate_m"] < layout.tolerance
    assert found.overall["pose_auc_3deg"] > 0.999
    again = worlds.sample(name, tmp_path / "turned", turned=True)
    names = None if layout.is_named else again.parent / "names.txt"
    turned = worlds.evaluate(layout.track, again, names=names)
    assert turned.overall == pytest.approx(found.overall, abs=5e-5)


@ALL
def test_damage_is_looked_at_without_a_word(
    name: str, written: dict[str, Path], tmp_path: Path
) -> None:
    random, source = np.random.default_rng(len(name)), written[name]
    copy: Callable[..., Any] = shutil.copytree if source.is_dir() else shutil.copyfile
    for number in range(SPOILT):
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


# --- faults by name; goldens hold more of them ---


class Refusal(NamedTuple):
    """Files of a layout, what is done to them, and words of the message."""

    name: str
    spoil: Callable[[Path], object]
    words: str


def fields(file: str, **changes: Any) -> Callable[[Path], object]:
    """Change fields of an npz, or leave them out where None."""

    def spoil(path: Path) -> None:
        with np.load(path / file, allow_pickle=True) as stored:
            found = dict(stored) | changes
        np.savez(path / file, **{name: one for name, one in found.items() if one is not None})

    return spoil


def text(file: str, change: Callable[[str], str]) -> Callable[[Path], object]:
    return lambda path: (path / file).write_text(change((path / file).read_text()))


def content(file: str, change: Callable[[bytes], bytes]) -> Callable[[Path], object]:
    return lambda path: (path / file).write_bytes(change((path / file).read_bytes()))


def gone(file: str) -> Callable[[Path], object]:
    def spoil(path: Path) -> None:
        shutil.rmtree(path / file) if (path / file).is_dir() else (path / file).unlink()

    return spoil


def copied(source: str, target: str) -> Callable[[Path], object]:
    def spoil(path: Path) -> None:
        (path / target).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(path / source, path / target)

    return spoil


def hdf5(file: str, name: str, values: Any) -> Callable[[Path], object]:
    """Replace a dataset, or leave out a group where None."""

    def spoil(path: Path) -> None:
        with h5py.File(path / file, "a") as opened:
            del opened[name]
            if values is not None:
                opened[name] = values

    return spoil


def count(number: int) -> Callable[[bytes], bytes]:
    return lambda found: struct.pack("<Q", number) + found[8:]


FEATURES = "feats-superpoint-n4096-r1024.h5"
MATCHES = "feats-superpoint-n4096-r1024_matches.h5"
PAIR, PHOTO, CROP = "photos-q0.png/matching-crops-q0_dom.tif/matches0", "photos/q0.png", "q0_dom"
DENSE = "photos-q0.png/matching-crops-q0_dom.tif/keypoints0"
VISLOC = "q0.png/q0_dom.tif.npz"
YARD = "yard/predictions.npz"
SPARSE = "yard/sparse"
MASK = np.ones((6, 3, 3), bool)
FLAT = np.tile(np.diag((1.0, 1.0, 0.0, 1.0))[:3], (6, 1, 1)).astype("f4")
LARGE = np.tile(np.array([[800.0, 0, 240], [0, 800, 180], [0, 0, 1]]), (6, 1, 1)).astype("f4")
BEYOND = np.full((60, 4), (0.5, 0.5, 0.5, 1.003))


def inverted(field: str) -> Callable[[Path], object]:
    """Turn world-to-camera into camera-to-world, and the other way round."""

    def spoil(path: Path) -> None:
        with np.load(path / YARD, allow_pickle=True) as stored:
            matrices = np.tile(np.eye(4), (6, 1, 1))
            matrices[:, :3] = stored[field][:, :3]
        fields(YARD, **{field: np.linalg.inv(matrices).astype("f4")})(path)

    return spoil


REFUSALS = [
    # Pixels, sizes and pairs of matchers.
    Refusal("loftr", fields("q0.npz", image_size0=(160, 112)), "pixels up to"),
    Refusal("loftr", fields("q0.npz", image_size0=(0, 3)), "field 'image_size0' is"),
    Refusal("loftr", fields("q0.npz", image_size0=(3.0, 3.0)), "field 'image_size0' is"),
    Refusal("loftr", fields("q0.npz", mkpts0_f=np.zeros(60)), "field 'mkpts0_f' is float64"),
    *(
        Refusal("loftr", copied("q3.npz", f"{other}.npz"), "are both hills/q3 with one part")
        for other in ("old/hills/q3", "q3_q3_dom", "q3_dom_q3_matches")
    ),
    Refusal("roma", fields("q0.npz", matches=np.zeros((60, 2))), r"shape \(60, 2\)"),
    Refusal("roma", fields("q0.npz", matches=np.full((60, 4), 5e3)), "outside it, the first at"),
    Refusal("roma", fields("q0.npz", matches=np.full((60, 4), (9, 9, 5e3, 5e3))), CROP),
    Refusal("roma", fields("q0.npz", matches=np.vstack([BEYOND[:1], BEYOND[1:] / 2])), "1 match"),
    Refusal("superglue", fields("q0_q0_dom_matches.npz", matches=np.full(61, 60)), "beyond"),
    Refusal("mast3r-visloc", fields(VISLOC, matches_im_map=None), "lacks the field"),
    Refusal("dust3r-matches", fields("q0.npz", size=np.array([1, 2])), "at which size"),
    # hloc
    Refusal("hloc dense", hdf5("", DENSE, np.full((60, 2), 5e3)), "outside it, the first at"),
    Refusal("hloc", hdf5(MATCHES, PAIR, np.full(61, -2, np.int16)), "numbers beyond"),
    Refusal("hloc", hdf5(MATCHES, PAIR, np.full(61, 61, np.int16)), "numbers beyond"),
    Refusal("hloc", hdf5(MATCHES, PAIR, np.zeros(60, np.int16)), "matches0"),
    Refusal(
        "hloc",
        hdf5(FEATURES, "matching/crops/q0_dom.tif/keypoints", np.zeros((40_000, 2), "f4")),
        "numbers beyond",
    ),
    Refusal("hloc", hdf5(FEATURES, f"{PHOTO}/image_size", [320, 240]), "image_size is"),
    Refusal("hloc", hdf5(FEATURES, f"{PHOTO}/keypoints", np.zeros(61)), "of shape"),
    Refusal("hloc", hdf5(FEATURES, PHOTO, None), "no features of 'photos-q0.png'"),
    Refusal(
        "hloc", hdf5(FEATURES, f"{PHOTO}/keypoints", np.full((61, 2), np.nan, "f4")), "not finite"
    ),
    # Poses
    Refusal("tum", lambda path: (path.parent / "names.txt").write_text("q0.png"), "and 1 name"),
    Refusal("kitti", lambda path: (path.parent / "names.txt").write_text("q0.png"), "and 1 name"),
    *(
        Refusal("hloc-poses", text("", lambda said, one=lines: one), words)
        for lines, words in (
            ("q0.png 1 0 0 0 1 2\n", "row 1 has 7 columns"),
            ("q0.png 1 0 0 0 1 2 x\n", "words where numbers should be"),
            ("", "holds no pose"),
            ("zz.png 1 0 0 0 1 2 3\n", "none of its names is that of a query"),
            ("q0.png 1 0 0 0 1 2 3\nx/q0.jpg 1 0 0 0 1 2 3\n", "are both hills/q0"),
            ("q0.png 2 0 0 0 1 2 3\n", "unit"),
        )
    ),
    # Retrieval
    Refusal(
        "trec", text("", lambda t: t.replace("east/t00004", "east/x")), "ranks what is no tile"
    ),
    Refusal("trec", text("", lambda t: t.replace(" mine", "")), "is no line of a run"),
    Refusal("trec", text("", lambda t: t.replace("0.", "nan0.")), "is no line of a run"),
    Refusal("trec", text("", lambda t: t.replace("-", "")), "scores rise with the rank"),
    Refusal("game4loc", fields("", gallery_names=None), "gallery_names"),
    Refusal("game4loc", fields("", query_names=np.array(["a"], object)), "never loaded"),
    Refusal("game4loc", fields("", query_names=np.array(["a"] * 9)), "and there are 9 names"),
    Refusal("anyloc", lambda path: _without_scenes(path), "'photos/q00000.jpg' could be 2 "),
    # Maps and cameras in arrays
    Refusal("vggt", fields(YARD, depth=np.array([{}], dtype=object)), "holds pickled Python"),
    Refusal("vggt", inverted("extrinsic"), "extrinsics look inverted"),
    Refusal("mapanything", inverted("extrinsic"), "extrinsics look inverted"),
    Refusal("vggt", fields(YARD, intrinsic=LARGE), "the intrinsics look of images of about"),
    Refusal("vggt", fields(YARD, extrinsic=FLAT), "rotation"),
    Refusal("vggt", fields(YARD, depth=np.array(1.0)), r"field 'depth' has shape \(\)"),
    Refusal("mapanything", fields(YARD, final_mask=MASK), "'final_mask' is bool"),
    Refusal(
        "vggt",
        lambda path: (path / "yard/images/x.jpg").touch(),
        "there are 7 names, named by the images",
    ),
    # A file a frame
    *(
        Refusal(name, gone(f"yard/{file}"), words)
        for name, file, words in (
            ("cut3r", "depth/000001.npy", "files are missing"),
            ("cut3r", "camera/000001.npz", "files are missing"),
            ("cut3r", "conf/000005.npy", "files are missing"),
            ("depth-anything-3 streaming", "camera_poses.txt", "camera_poses"),
            ("depth-anything-3 streaming", "results_output/frame_2.npz", "files are missing"),
            ("depth-anything-3 streaming", "results_output", "files are missing"),
        )
    ),
    Refusal(
        "cloud-trajectory",
        text("yard/trajectory.txt", lambda said: "\n".join(said.splitlines()[::-1])),
        "do not fit the photos in the order",
    ),
    # COLMAP models
    *(
        Refusal("vggt-colmap", content(f"{SPARSE}/{file}.bin", change), words)
        for file, change, words in (
            ("images", lambda found: found[:-7], "damaged"),
            ("images", lambda found: found + b"\0", "damaged"),
            ("images", count(1 << 60), "memory"),
            ("images", lambda found: found.replace(b"yard_3.jpg", b"yard\x1b[2Jg"), "text"),
            ("images", lambda found: found[:12] + struct.pack("<d", 7) + found[20:], "norm"),
            ("points3D", lambda found: found[:-7], "damaged"),
            ("points3D", count(1 << 60), "damaged"),
        )
    ),
]


def _without_scenes(path: Path) -> None:
    shutil.copytree(path / "east", path, dirs_exist_ok=True)
    shutil.rmtree(path / "east")


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory, worlds: Worlds) -> dict[str, tuple[Path, str]]:
    """Put the files of each layout into a folder once; return it, and the path below it."""
    home, found = tmp_path_factory.mktemp("sound"), {}
    for name in sorted({one.name for one in REFUSALS}):
        path = worlds.sample(name, home / name)
        found[name] = home / name, path.relative_to(home / name).as_posix()
    return found


@pytest.mark.parametrize("one", REFUSALS, ids=lambda one: f"{one.name}: {one.words}")
def test_refusals(
    one: Refusal, sound: dict[str, tuple[Path, str]], worlds: Worlds, tmp_path: Path
) -> None:
    whole, below = sound[one.name]
    path = Path(shutil.copytree(whole, tmp_path / "f")) / below
    one.spoil(path)
    names = path.parent / "names.txt" if LAYOUTS[one.name].is_listed else None
    reader, track = one.name.split()[0], LAYOUTS[one.name].track
    with pytest.raises(PredictionError, match=one.words) as refused:
        worlds.evaluate(track, path, names=names, reader=reader)
    assert str(tmp_path) in str(refused.value)
    if track == "reconstruction" and "pickled" not in one.words:
        assert find_reader(path) == reader  # or people would not know what it lacks
