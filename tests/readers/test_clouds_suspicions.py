"""Suspicions: each says what the cloud looks like, and a good cloud raises none."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airzoo_bench.readers.clouds.suspicions import precision_suspicion, suspicions

TRUTH = np.array([[576_661.0, 5_188_114.0, 156.0], [576_768.0, 5_188_211.0, 169.0]])
LOCAL = TRUTH - TRUTH[0]


@given(st.floats(0.2, 5.0), st.floats(-200, 200))
def test_a_cloud_that_lies_about_right_raises_none(scale: float, shift: float) -> None:
    assert suspicions(TRUTH[0] + LOCAL * scale + shift, TRUTH) == ()


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
    (said,) = suspicions(cloud, truth)
    assert message in said


def test_bounds_that_are_not_finite_tell_nothing() -> None:
    for value in (np.nan, np.inf):
        assert suspicions(np.full((2, 3), value), TRUTH) == ()
        assert precision_suspicion(np.full((2, 3), value), np.dtype("f4")) is None


def test_a_single_point_is_compared_by_its_place() -> None:
    point = np.repeat(TRUTH[:1], 2, axis=0)
    assert suspicions(point, TRUTH) == ()
    assert "away" in suspicions(np.zeros((2, 3)), TRUTH)[0]


def test_coordinates_stored_too_coarsely() -> None:
    said = precision_suspicion(TRUTH, np.dtype("f4"))
    assert said is not None
    assert "0.62" in said
    assert precision_suspicion(TRUTH, np.dtype("f8")) is None
    assert precision_suspicion(TRUTH, np.dtype("i4")) is None
    assert precision_suspicion(LOCAL, np.dtype("f4")) is None
