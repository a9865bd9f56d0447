"""Similarities: transforms, fits, and what determines them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from airzoo_bench.reconstruction.alignment import (
    AlignmentError,
    Similarity,
    fit_many,
    umeyama,
)
from tests.geometry.support import quick, seeds

UTM = np.array((576663.330376941, 5188165.013024779, 197.192794194657))


def some(rng: np.random.Generator, scale: float = 1.7) -> Similarity:
    rotation = Rotation.random(random_state=rng).as_matrix()
    return Similarity(scale, rotation, rng.uniform(-9, 9, 3), rng.uniform(-9, 9, 3))


def test_a_quarter_turn_by_hand() -> None:
    quarter = np.array(((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
    transform = Similarity(2.0, quarter, np.array((10.0, 20.0, 30.0)), np.array((1.0, 1.0, 1.0)))
    # (3, 1, 0) is (2, 0, -1) from the origin, turned (0, 2, -1), doubled (0, 4, -2).
    np.testing.assert_array_equal(transform.apply(np.array((3.0, 1.0, 0.0))), (10.0, 24.0, 28.0))


@quick
@given(seeds, st.floats(1e-3, 1e3), st.booleans())
def test_umeyama_finds_the_transform(seed: int, scale: float, with_scale: bool) -> None:
    rng = np.random.default_rng(seed)
    made = some(rng, scale if with_scale else 1.0)
    source = rng.normal(size=(7, 3))
    found = umeyama(source, made.apply(source), with_scale=with_scale)
    assert found.scale == pytest.approx(made.scale, rel=1e-11)
    np.testing.assert_allclose(found.rotation, made.rotation, atol=1e-11)
    np.testing.assert_allclose(found.apply(source), made.apply(source), atol=1e-11 * made.scale)


def test_a_mirror_image_is_turned_not_mirrored() -> None:
    source = np.random.default_rng(3).normal(size=(40, 3)) * (5.0, 3.0, 1.0)
    found = umeyama(source, source * (1.0, 1.0, -1.0), with_scale=True)
    assert np.linalg.det(found.rotation) == pytest.approx(1.0)
    # Least squares: scale (25 + 9 - 1) / 35 of the variances; nearly no rotation.
    values = np.linalg.svd(source - source.mean(axis=0), compute_uv=False) ** 2
    assert found.scale == pytest.approx((values[:2].sum() - values[2]) / values.sum(), rel=0.02)


LINE = np.arange(6.0)[:, None] * (1.0, 2.0, 3.0)
PLANE = np.random.default_rng(5).normal(size=(6, 3))


@pytest.mark.parametrize("far", [0.0, 1.0], ids=["near", "projected"])
@pytest.mark.parametrize(
    ("source", "target", "said"),
    [
        (PLANE[:2], PLANE[:2], "not 2"),
        (LINE, PLANE, "lie on one line"),
        (PLANE, LINE, "lie on one line"),
        (LINE.astype(np.float32) / 7, PLANE, "lie on one line"),
        (PLANE, np.full((6, 3), 0.1), "lie on one line"),
    ],
)
def test_degenerate_points_are_refused(
    source: np.ndarray, target: np.ndarray, said: str, far: float
) -> None:
    source, target = (np.asarray(a, np.float64) + far * UTM for a in (source, target))
    with pytest.raises(AlignmentError, match=said):
        umeyama(source, target, with_scale=True)


@pytest.mark.parametrize(("off_deg", "share"), [(0.0, 1e-10), (5.0, 1e-3)])
def test_centres_of_a_strip_give_its_direction_and_orientations_the_turn_about_it(
    off_deg: float, share: float
) -> None:
    made = some(np.random.default_rng(7), 3.0)
    wrong = Rotation.from_rotvec(np.radians(off_deg) * np.array((0.6, 0.0, 0.8))).as_matrix()
    turns = np.tile(wrong @ made.rotation, (2, len(LINE), 1, 1))
    source, target = np.stack((LINE, LINE)), made.apply(np.stack((LINE, LINE)))
    (fit, again), determined = fit_many(source, target, turns=turns, axis_share=0.02)
    assert determined.all()
    np.testing.assert_array_equal(fit.matrix, again.matrix)
    extent = np.linalg.norm(LINE[-1] - LINE[0]) * 3.0
    away = np.linalg.norm(fit.apply(LINE) - made.apply(LINE), axis=1).max()
    assert away <= share * extent
    if off_deg == 0.0:
        np.testing.assert_allclose(fit.matrix, made.matrix, atol=1e-10)
