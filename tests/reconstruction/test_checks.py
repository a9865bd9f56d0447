"""What users do wrong and cannot see: refused or noted, and a good prediction is neither."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.reconstruction.alignment import PosedCameras
from airzoo_bench.reconstruction.checks import (
    Inversion,
    check_bounds,
    check_datum,
    check_digits,
    check_mirror,
    check_resolution,
    refuse_camera_to_world,
    refuse_shifted_names,
)
from airzoo_bench.reconstruction.similarity import Similarity
from tests.formats.cloud_support import refused
from tests.reconstruction.depth_maps import poses
from tests.reconstruction.world import (
    World,
    notes_of,
    predict_clouds,
    save,
    true_points,
)

TRUTH = np.array([[576_661.0, 5_188_114.0, 156.0], [576_768.0, 5_188_211.0, 169.0]])

LOCAL = TRUTH - TRUTH[0]


@given(st.floats(0.2, 5.0), st.floats(-200, 200))
def test_a_cloud_that_lies_about_right_raises_none(scale: float, shift: float) -> None:
    assert check_bounds(TRUTH[0] + LOCAL * scale + (shift, -shift, 0), TRUTH) is None


@pytest.mark.parametrize(
    ("cloud", "truth", "message"),
    [
        (LOCAL * 1000, LOCAL, "millimetres"),
        (LOCAL * 100, LOCAL, "centimetres"),
        (LOCAL * 97, LOCAL, "centimetres"),
        (LOCAL / 1000, LOCAL, "kilometres"),
        (LOCAL * 1e6, LOCAL, "1e+06 times as large"),
        (LOCAL / 1e5, LOCAL, "1e+05 times smaller"),
        (LOCAL, TRUTH, "away from the truth"),
        (TRUTH[:, [1, 0, 2]], TRUTH, "x and y exchanged"),
        (TRUTH / 0.3048, TRUTH, "feet"),
        (np.array([[-92.0, 46.7, 150.0], [-91.9985, 46.7012, 166.0]]), TRUTH, "longitude"),
    ],
)
def test_what_it_looks_like(cloud: np.ndarray, truth: np.ndarray, message: str) -> None:
    assert message in str(check_bounds(cloud, truth))


def test_heights_of_another_datum() -> None:
    assert "lies 42 m above the truth" in str(check_datum(TRUTH + np.array((0, 0, 42.0)), TRUTH))
    assert "another datum" in str(check_datum(TRUTH - np.array((0, 0, 31.5)), TRUTH))
    for heights in (4.0, 150.0):
        assert check_datum(TRUTH + np.array((0, 0, heights)), TRUTH) is None


SCENE = TRUTH[0] + np.random.default_rng(0).uniform(0, 90, (500, 3))


def said(points: np.ndarray, stored: str = "f8", scale: float = 1.0) -> str | None:
    return check_digits(points, np.dtype(stored), scale, 0.01)


def rounded(digits: int) -> np.ndarray:
    return np.array([[float(f"{x:.{digits}g}") for x in row] for row in SCENE])


@pytest.mark.parametrize(
    ("points", "stored", "message"),
    [
        (SCENE.astype("f4"), "f4", "float32 only"),
        (SCENE.astype("f4").astype("f8"), "f8", "float32 only"),  # it went through float32
        (rounded(6), "f8", "6 digits only, steps of 10 m: an error of 2.9 m"),
        (rounded(7), "f8", "7 digits only, steps of 1 m: an error of 0.29 m"),
        (rounded(6).astype("f4"), "f4", "6 digits only"),
    ],
)
def test_digits_that_were_lost(points: np.ndarray, stored: str, message: str) -> None:
    found = said(points.astype("f8"), stored)
    assert found is not None
    assert message in found
    # The error that is told is that of the rounding.
    told = float(found.partition("an error of ")[2].partition(" m ")[0])
    assert told == pytest.approx(np.sqrt(((points - SCENE) ** 2).sum(axis=1).mean()), rel=0.2)


def test_digits_that_suffice() -> None:
    assert said(SCENE) is None
    assert said(SCENE, "i4") is None
    assert said(np.round(SCENE, 2)) is None
    local = SCENE - TRUTH[0]
    assert said(local.astype("f4").astype("f8"), "f4") is None
    assert said(np.array([[float(f"{x:.6g}") for x in row] for row in local])) is None
    # A cloud in a frame of its own: 1e-7 of a unit of 200 m.
    assert said((local / 200).astype("f4").astype("f8"), "f4", scale=200.0) is None
    assert said((local / 200 + 50).astype("f4").astype("f8"), "f4", scale=20_000.0) is not None
    assert said(np.zeros((0, 3))) is None


HILLS = np.random.default_rng(1).uniform(0, 100, (4000, 3))

HILLS[:, 2] = 15 * np.sin(HILLS[:, 0] / 12) + HILLS[:, 1] / 5

OWN = Similarity(3.0, Rotation.from_euler("xyz", (10, 20, 30), degrees=True).as_matrix(), TRUTH[0])


@pytest.mark.parametrize("axes", ["x", "z", "y and z"])
def test_a_cloud_that_is_mirrored_in_its_own_frame(axes: str) -> None:
    signs = [-1.0 if axis in axes else 1.0 for axis in ("x", "y", "z")]
    truth = OWN.apply(HILLS / 3)
    found = check_mirror(OWN.apply(HILLS / 3 * signs), truth, OWN, [2.0])
    assert found is not None
    words = ", ".join("+-"[axis in axes] + axis for axis in "xyz")
    assert f"({words}) for (+x, +y, +z) in its own frame" in found
    # What fits, and what is merely elsewhere, is not mirrored.
    for points in (truth, truth + np.array((60.0, 0, 0))):
        assert check_mirror(points, truth, OWN, [2.0]) is None


@pytest.mark.parametrize(
    ("order", "signs", "words"),
    [
        ((0, 2, 1), (1, 1, -1), "(+x, -z, +y) for (+x, +y, +z)"),
        ((1, 0, 2), (1, 1, 1), "(+y, +x, +z) for (+x, +y, +z)"),
        ((0, 1, 2), (1, 1, -1), "(+x, +y, -z)"),
    ],
    ids=["y up", "x and y exchanged", "z negated"],
)
def test_a_flat_scene_tells_by_the_finer_distances(
    order: tuple[int, ...], signs: tuple[int, ...], words: str
) -> None:
    flat = HILLS * (1.0, 0.8, 0.08)  # 3 m high: all of it lies within 10 m, upside down or not
    flat -= flat.mean(axis=0)
    wrong = flat[:, order] * signs
    own = Similarity(1.0, np.eye(3), TRUTH[0])
    found = check_mirror(own.apply(wrong), own.apply(flat), own, [1.0, 10.0])
    assert found is not None
    assert words in found
    raised = flat + np.array((0.0, 0.0, 4.0))
    assert check_mirror(own.apply(raised), own.apply(flat), own, [1.0, 10.0]) is None


@pytest.mark.parametrize(("width", "height"), [(504, 378), (518, 392), (720, 540)])
def test_intrinsics_of_photos_that_are_little_larger_or_smaller(width: int, height: int) -> None:
    """Depth Anything 3 and VGGT make maps of 504 and 518 px of a photo of 640x480."""
    K = np.tile(np.array([[500.0, 0, 320.5], [0, 500, 240.5], [0, 0, 1]]), (3, 1, 1))
    with refused("6[34][0-9] x 4[78][0-9]"):
        check_resolution(Cameras.from_matrices(K, width, height), None, "it")
    K[1, :2, 2] = width / 2, height / 2
    check_resolution(Cameras.from_matrices(K, width, height), None, "it")
    near = np.array([width, height]) / 2 * 1.09
    K[:, :2, 2] = near
    check_resolution(Cameras.from_matrices(K, width, height), None, "it")


def inverted(given: Poses) -> Poses:
    """Poses whose extrinsics are the camera-to-world matrices of the given ones."""
    return Poses.from_translations(np.swapaxes(given.rotation, 1, 2), given.centres)


def strip(count: int = 12) -> Poses:
    """Nadir views of one heading on a straight flight: all rotations the same."""
    rotation = np.tile(
        Rotation.from_euler("zx", [30, 180], degrees=True).as_matrix(), (count, 1, 1)
    )
    centres = np.stack([np.arange(count) * 20.0, np.zeros(count), np.full(count, 80.0)], axis=-1)
    return Poses.from_centres(rotation, centres)


def said_of(given: Poses, truth: Poses) -> str | None:
    found = Inversion.between(given, truth)
    return str(found) if found is not None and found.is_likely else None


@pytest.mark.parametrize("truth", [poses(12), poses(200, 3), strip()], ids=["few", "many", "strip"])
def test_camera_to_world_is_suspected(truth: Poses) -> None:
    said = said_of(inverted(truth), truth)
    assert said is not None
    assert "0.0 once inverted" in said
    assert said_of(truth, truth) is None


def test_clearly_inverted_cameras_are_refused() -> None:
    truth = poses(12)
    with pytest.raises(PredictionError, match=r"0\.0 once inverted") as caught:
        refuse_camera_to_world(inverted(truth), truth, "yard.npz")
    assert caught.value.fix == "invert them: R.T and -R.T @ t"
    flipped = Poses.from_centres(np.diag((1.0, -1.0, -1.0)) @ truth.rotation, truth.centres)
    with pytest.raises(PredictionError) as caught:
        refuse_camera_to_world(inverted(flipped), truth, "yard.npz")
    assert "diag(1, -1, -1)" in str(caught.value.fix)


@pytest.mark.parametrize("seed", range(20))
def test_names_one_off(seed: int) -> None:
    rng, names = np.random.default_rng(seed), tuple(f"DJI_{n:04}.JPG" for n in range(16))
    true = PosedCameras(names, poses(16, seed=seed).centres)
    spacing = float(np.median(np.linalg.norm(np.diff(true.centres, axis=0), axis=1)))
    for step in (1, -1):
        off = tuple(np.roll(names, step).tolist())
        for centres in (true.centres, 0.02 * true.centres[:, [1, 0, 2]] * (1, -1, 1)):
            with pytest.raises(PredictionError, match="one off"):
                refuse_shifted_names(PosedCameras(off, centres), true, "yard.npz")
        rough = PosedCameras(off, true.centres + rng.normal(0, spacing / 6, (16, 3)))
        refuse_shifted_names(rough, true, "yard.npz")
    # Cameras that are poor, or none, are scored without a word.
    for noise in (0.0, 0.1, 0.5, 2.0):
        shaken = true.centres + rng.normal(0, noise * spacing, (16, 3))
        shaken[: seed % 4] = np.nan
        refuse_shifted_names(PosedCameras(names, shaken), true, "yard.npz")


def test_a_mirrored_cloud_is_named_by_eval_and_check(world: World, tmp_path: Path) -> None:
    points, cameras = true_points("yard"), world.cameras("yard")
    origin = points.mean(axis=0) - np.array((0.0, 0.0, 30.0))
    extrinsics = cameras["extrinsics"].copy()
    extrinsics[..., 3] += (extrinsics[..., :3] @ origin[:, None])[..., 0]
    mirrored = (points - origin) * np.array((1, 1, -1))
    path = predict_clouds(world, tmp_path / "p", {"yard": mirrored})
    save(path / "yard.cameras.npz", cameras | {"extrinsics": extrinsics})
    notes = notes_of(world, path)
    assert any("mirrored or turned over" in note and "(+x, +y, -z)" in note for note in notes)


@pytest.mark.parametrize(("units", "depth", "asked"), [(1e4, 1.0, False), (1.0, 1e3, True)])
def test_far_depths_are_those_after_the_alignment(
    units: float, depth: float, asked: bool, world: World, tmp_path: Path
) -> None:
    fields = world.views("yard")
    fields["extrinsics"] = fields["extrinsics"] * np.array((1.0, 1.0, 1.0, units))
    fields["depth"] = fields["depth"] * units * depth
    path = save(tmp_path / "p" / "yard.npz", fields).parent
    assert any("are they in millimetres?" in note for note in notes_of(world, path)) == asked


def test_half_a_pixel_is_asked_for_where_it_matters(world: World, tmp_path: Path) -> None:
    exact, folder = world.views("lot"), tmp_path / "p"
    unsaid = {name: values for name, values in exact.items() if name != "pixel_centres"}
    # Depth 35 m at a focal length of 80 px: half a pixel in x and y is 0.3 m.
    notes = notes_of(world, save(folder / "lot.npz", unsaid).parent)
    (note,) = [note for note in notes if "does not say where K" in note]
    assert "taken as half" in note
    error = float(note.partition("points are ")[2].partition(" m off")[0])
    median = np.median(unsaid["depth"][unsaid["depth"] > 0])
    assert error == pytest.approx(np.hypot(0.5, 0.5) / 80 * median, rel=0.05)
    assert not any(
        "does not say" in n for n in notes_of(world, save(folder / "lot.npz", exact).parent)
    )
    coarse = world.protocol(
        tmp_path / "c.toml", scores={"f1_below_m": (10.0,), "headline_below_m": 10.0}
    )
    save(folder / "lot.npz", unsaid)
    assert not any("does not say" in note for note in notes_of(world, folder, str(coarse)))
