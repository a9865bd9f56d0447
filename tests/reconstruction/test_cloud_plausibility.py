"""Suspicions: each says what the cloud looks like, and a good cloud raises none."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from airzoo_bench.reconstruction.checks import check_bounds, check_digits, check_mirror
from airzoo_bench.reconstruction.similarity import Similarity

TRUTH = np.array([[576_661.0, 5_188_114.0, 156.0], [576_768.0, 5_188_211.0, 169.0]])
LOCAL = TRUTH - TRUTH[0]


@given(st.floats(0.2, 5.0), st.floats(-200, 200))
def test_a_cloud_that_lies_about_right_raises_none(scale: float, shift: float) -> None:
    assert check_bounds(TRUTH[0] + LOCAL * scale + shift, TRUTH) == ()


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
        (np.array([[-92.0, 46.7, 150.0], [-91.9985, 46.7012, 166.0]]), TRUTH, "longitude"),
    ],
)
def test_what_it_looks_like(cloud: np.ndarray, truth: np.ndarray, message: str) -> None:
    (said,) = check_bounds(cloud, truth)
    assert message in said


def test_bounds_that_are_not_finite_tell_nothing() -> None:
    for value in (np.nan, np.inf):
        assert check_bounds(np.full((2, 3), value), TRUTH) == ()
        assert check_digits(np.full((2, 3), value), np.dtype("f4"), 1.0, 0.01) is None


def test_a_single_point_is_compared_by_its_place() -> None:
    point = np.repeat(TRUTH[:1], 2, axis=0)
    assert check_bounds(point, TRUTH) == ()
    assert "away" in check_bounds(np.zeros((2, 3)), TRUTH)[0]


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
    assert f"{axes} negated about the origin of its own frame" in found


def test_a_cloud_that_is_mirrored_where_it_lies() -> None:
    truth = HILLS + TRUTH[0]
    middle = np.median(truth, axis=0)
    mirrored = (truth - middle) * (-1, 1, 1) + middle
    found = check_mirror(mirrored, truth, Similarity.identity(), [2.0])
    assert found is not None
    assert "x negated about its middle" in found


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_cloud_that_is_mirrored_about_its_cameras(axis: int) -> None:
    truth = HILLS + TRUTH[0]
    plane = truth[:, axis].mean() + 60.0
    mirrored = truth.copy()
    mirrored[:, axis] = 2 * plane - truth[:, axis]
    found = check_mirror(mirrored, truth, Similarity.identity(), [2.0])
    assert found is not None
    assert f"{'xyz'[axis]} negated about the middle between it and the truth" in found
    # What is merely elsewhere is not mirrored, flat or not.
    away = np.eye(3)[axis] * 60.0
    for height in (1.0, 0.01, 0.0):
        scene = HILLS * (1, 1, height) + TRUTH[0]
        assert check_mirror(scene + away, scene, Similarity.identity(), [1.0, 2.0]) is None


def test_a_cloud_that_fits_or_is_merely_wrong_is_not_mirrored() -> None:
    truth = HILLS + TRUTH[0]
    assert check_mirror(truth, truth, Similarity.identity(), [2.0]) is None
    noise = np.random.default_rng(2).uniform(-300, 300, (4000, 3)) + TRUTH[0]
    assert check_mirror(noise, truth, Similarity.identity(), [2.0]) is None
    assert check_mirror(truth[:0], truth, Similarity.identity(), [2.0]) is None


@pytest.mark.parametrize(
    ("order", "signs", "words"),
    [
        ((0, 2, 1), (1, 1, -1), "(x, -z, y) for (x, y, z)"),
        ((1, 0, 2), (1, 1, 1), "(y, x, z) for (x, y, z)"),
        ((0, 1, 2), (1, 1, -1), "z negated"),
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
