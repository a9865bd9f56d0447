"""Mistakes that users make and cannot see: refused or noted, and a good prediction is neither."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.formats.clouds.cloud import ArrayPieces, FileCloud
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.reconstruction.alignment import PosedCameras, Similarity
from airzoo_bench.reconstruction.checks import (
    check_bounds,
    check_datum,
    check_inversion,
    check_mirror,
    check_names,
    check_resolution,
    rounding_error,
)
from tests.reconstruction.support import poses
from tests.reconstruction.world import World, notes_of, save

TRUTH = np.array([[576_661.0, 5_188_114.0, 156.0], [576_768.0, 5_188_211.0, 169.0]])
LOCAL = TRUTH - TRUTH[0]


@given(st.floats(0.2, 5.0), st.floats(-200, 200))
def test_a_cloud_that_lies_about_right_raises_none(scale: float, shift: float) -> None:
    assert check_bounds(TRUTH[0] + LOCAL * scale + (shift, -shift, 0), TRUTH) is None


@pytest.mark.parametrize(
    ("cloud", "truth", "message"),
    [
        (LOCAL * 1000, LOCAL, "millimetres"),
        (LOCAL * 97, LOCAL, "another unit"),
        (LOCAL / 1000, LOCAL, "another unit"),
        (LOCAL, TRUTH, "a local origin"),
        (TRUTH[:, [1, 0, 2]], TRUTH, "x and y exchanged"),
        (TRUTH / 0.3048, TRUTH, "feet"),
        (np.array([[-92.0, 46.7, 150.0], [-91.9985, 46.7012, 166.0]]), TRUTH, "longitude"),
    ],
)
def test_other_coordinates_are_recognised(
    cloud: np.ndarray, truth: np.ndarray, message: str
) -> None:
    assert message in str(check_bounds(cloud, truth))


@pytest.mark.parametrize(
    ("up", "noted"), [(42.0, True), (-31.5, True), (4.0, False), (150.0, False)]
)
def test_heights_of_another_datum(up: float, noted: bool) -> None:
    found = check_datum(TRUTH + np.array((0, 0, up)), TRUTH)
    assert (f"{abs(up):.3g} m {'above' if up > 0 else 'below'}" in str(found)) == noted


SCENE = TRUTH[0] + np.random.default_rng(0).uniform(0, 90, (500, 3))
DIGITS = np.vectorize(lambda x: float(f"{x:.6g}"))


@pytest.mark.parametrize(
    ("points", "lost"),
    [
        *((SCENE.astype("f4"), True), (DIGITS(SCENE), True)),
        *((SCENE, False), (np.round(SCENE, 2), False), (np.zeros((0, 3)), False)),
        *(((SCENE - TRUTH[0]).astype("f4"), False), (DIGITS(SCENE - TRUTH[0]), False)),
    ],
)
def test_digits_that_were_lost(points: np.ndarray, lost: bool) -> None:
    error = rounding_error(FileCloud(Path(), "ply", len(points), ArrayPieces(points), points.dtype))
    assert (error > 0.01) == lost
    if lost:
        rms = np.sqrt(((points - SCENE) ** 2).sum(axis=1).mean())
        assert error == pytest.approx(rms, rel=0.2)


HILLS = np.random.default_rng(1).uniform(0, 100, (2000, 3))
HILLS[:, 2] = 15 * np.sin(HILLS[:, 0] / 12) + HILLS[:, 1] / 5
FLAT = HILLS * (1.0, 0.8, 0.08)  # 3 m high: all of it lies within 10 m, upside down or not
FLAT -= FLAT.mean(axis=0)
TURN = Rotation.from_euler("xyz", (10, 20, 30), degrees=True).as_matrix()


@pytest.mark.parametrize(
    ("scene", "order", "signs", "words"),
    [
        (HILLS, (0, 1, 2), (1, 1, -1), "(+x, +y, -z)"),
        (HILLS, (1, 0, 2), (1, 1, 1), "(+y, +x, +z)"),
        (FLAT, (0, 2, 1), (1, 1, -1), "(+x, -z, +y)"),
    ],
    ids=["z negated", "x and y exchanged", "y up"],
)
def test_a_cloud_that_is_mirrored_in_its_own_frame(
    scene: np.ndarray, order: tuple[int, ...], signs: tuple[int, ...], words: str
) -> None:
    own, limits = Similarity(3.0, TURN, TRUTH[0]), [1.0, 10.0]
    truth, wrong = own.apply(scene / 3), own.apply(scene[:, order] * signs / 3)
    assert words in str(check_mirror(wrong, truth, own, limits))
    # A cloud that fits, or is merely elsewhere, is not mirrored.
    for shift in (0.0, 4.0, 60.0):
        assert check_mirror(truth + np.array((0, 0, shift)), truth, own, limits) is None


@pytest.mark.parametrize(("width", "height"), [(504, 378), (518, 392), (720, 540)])
def test_intrinsics_of_photos_that_are_little_larger_or_smaller(width: int, height: int) -> None:
    """Depth Anything 3 and VGGT make maps of 504 and 518 px of a photo of 640x480."""
    K = np.tile(np.array([[500.0, 0, 320.5], [0, 500, 240.5], [0, 0, 1]]), (3, 1, 1))
    with pytest.raises(PredictionError, match=r"6[34]\d x 4[78]\d"):
        check_resolution(Cameras.from_matrices(K, width, height), None, "it")
    K[:, :2, 2] = np.array([width, height]) / 2 * 1.09
    check_resolution(Cameras.from_matrices(K, width, height), None, "it")


def strip(count: int = 12) -> Poses:
    """Nadir views of one heading on a straight flight: all rotations the same."""
    turn = Rotation.from_euler("zx", [30, 180], degrees=True).as_matrix()
    centres = np.stack([np.arange(count) * 20.0, np.zeros(count), np.full(count, 80.0)], axis=-1)
    return Poses.from_centres(np.tile(turn, (count, 1, 1)), centres)


RANDOM = [poses(np.random.default_rng(seed), count) for seed, count in ((0, 12), (3, 200))]


@pytest.mark.parametrize("truth", [*RANDOM, strip()], ids=["few", "many", "strip"])
def test_camera_to_world_is_refused_and_on_a_strip_noted(truth: Poses) -> None:
    assert check_inversion(truth, truth, "yard.npz") is None
    opengl = Poses.from_centres(np.diag((1.0, -1.0, -1.0)) @ truth.rotation, truth.centres)
    for claimed, fix in ((truth, "R.T and -R.T @ t"), (opengl, "diag(1, -1, -1)")):
        # Their camera-to-world matrices, taken for world-to-camera.
        given = Poses.from_translations(np.swapaxes(claimed.rotation, 1, 2), claimed.centres)
        if len({*truth.centres[:, 1]}) == 1:
            assert "0.0 once inverted" in str(check_inversion(given, truth, "yard.npz"))
            continue
        with pytest.raises(PredictionError) as caught:
            check_inversion(given, truth, "yard.npz")
        assert fix in str(caught.value.fix)


def test_names_one_off_are_refused_where_nothing_else_explains_it() -> None:
    rng, names = np.random.default_rng(0), tuple(f"DJI_{n:04}.JPG" for n in range(16))
    true = PosedCameras(names, poses(rng, 16).centres)
    spacing = float(np.median(np.linalg.norm(np.diff(true.centres, axis=0), axis=1)))
    off = tuple(np.roll(names, -1).tolist())
    for centres in (true.centres, 0.02 * true.centres[:, [1, 0, 2]] * (1, -1, 1)):
        with pytest.raises(PredictionError):
            check_names(PosedCameras(off, centres), true, "yard.npz")
    # Cameras that are poor, or none, are scored without a word.
    rough = true.centres + rng.normal(0, spacing / 6, (16, 3))
    check_names(PosedCameras(off, rough), true, "yard.npz")
    for noise in (0.0, 0.1, 0.5, 2.0):
        centres = true.centres + rng.normal(0, noise * spacing, (16, 3))
        centres[: int(4 * noise)] = np.nan
        check_names(PosedCameras(names, centres), true, "yard.npz")


@pytest.mark.parametrize(("units", "depth", "noted"), [(1e4, 1.0, False), (1.0, 1e3, True)])
def test_far_depths_are_those_after_the_alignment(
    units: float, depth: float, noted: bool, world: World, tmp_path: Path
) -> None:
    fields = world.views("yard")
    fields["extrinsics"] = fields["extrinsics"] * np.array((1.0, 1.0, 1.0, units))
    fields["depth"] = fields["depth"] * units * depth
    path = save(tmp_path / "p" / "yard.npz", fields).parent
    assert any("millimetres" in note for note in notes_of(world, path)) == noted


def test_half_a_pixel_is_asked_for_where_it_matters(world: World, tmp_path: Path) -> None:
    def asked(name: str, **changes: Any) -> list[str]:
        path = save(tmp_path / name / "lot.npz", world.views("lot", **changes)).parent
        return [note for note in notes_of(world, path) if "pixel_centres" in note]

    assert not asked("stated")
    (note,) = asked("silent", pixel_centres=None)
    # Depth 35 m at a focal length of 80 px: half a pixel in x and y is 0.3 m.
    error = float(note.partition("points are ")[2].partition(" m off")[0])
    depth = world.views("lot")["depth"]
    assert error == pytest.approx(np.hypot(0.5, 0.5) / 80 * np.median(depth[depth > 0]), rel=0.05)
