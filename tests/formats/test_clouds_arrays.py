"""Clouds in npz and npy files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.core.errors import PredictionError
from tests.formats.cloud_support import colours_of, made, opened, points_of, read, refused

POINTS = points_of(made())


@pytest.mark.parametrize("dtype", ["<f8", "<f4", ">f8", "<i4", "<f2"])
@pytest.mark.parametrize("compress", [False, True])
def test_npz_of_any_numbers(dtype: str, compress: bool, tmp_path: Path) -> None:
    points = (POINTS - POINTS.mean(axis=0)).astype(dtype)
    colours, confidence = colours_of(made()), made()["confidence"]
    save = np.savez_compressed if compress else np.savez
    save(tmp_path / "a.npz", points=points, colors=colours, conf=confidence)
    cloud = read(tmp_path / "a.npz")
    np.testing.assert_array_equal(cloud.points, points.astype(np.float64))
    np.testing.assert_array_equal(cloud.confidence, confidence)
    for order in (points, np.asfortranarray(points)):
        np.save(tmp_path / "a.npy", order)
        np.testing.assert_array_equal(read(tmp_path / "a.npy").points, points.astype(np.float64))


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"points": POINTS.T}, "shape"),
        ({"points": POINTS[:, 0]}, "shape"),
        ({"points": POINTS.astype(str)}, "field 'points' is <U"),
        ({"points": POINTS.astype(complex)}, "complex"),
        ({"points": POINTS.astype(object)}, "pickle"),
        ({"xyz": POINTS}, "lacks the field"),
        ({"points": POINTS, "conf": POINTS[:5, 0]}, "rows of confidence"),
        ({"points": POINTS, "conf": POINTS}, "'conf'"),
        ({"points": POINTS, "confidence": np.float32(0.5)}, "'confidence'"),
        ({"points": np.float64(1)}, "'points'"),
        ({"points": POINTS, "conf": POINTS[:, 0], "confidence": POINTS[:, 0]}, "both"),
        ({"points": POINTS, "colour": POINTS}, "not read here: 'colour'"),
    ],
)
def test_wrong_npz(arrays: dict[str, Any], message: str, tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", **arrays)
    with refused(message):
        read(tmp_path / "a.npz")


@pytest.mark.parametrize(
    "array",
    [POINTS.T, POINTS[:, 0], POINTS.astype(object), POINTS.astype("U9")],
    ids=lambda a: f"{a.dtype}{a.shape}",
)
def test_wrong_npy(array: Any, tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", array, allow_pickle=True)
    with refused("an array of"):
        opened(tmp_path / "a.npy")


def test_npy_that_is_cut_off_or_claims_too_much(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", POINTS)
    whole = (tmp_path / "a.npy").read_bytes()
    for wrong in (whole[:-1], whole.replace(b"(40, 3)", b"(4000000000000, 3)"), whole[:20]):
        (tmp_path / "b.npy").write_bytes(wrong)
        with refused(r"ends before|damaged"):
            opened(tmp_path / "b.npy")
    for shape in (b"(-4, 3)", b"(4e1, 3)", b"((((((("):
        (tmp_path / "b.npy").write_bytes(whole.replace(b"(40, 3)", shape))
        with pytest.raises(PredictionError):
            opened(tmp_path / "b.npy")


def test_points_beyond_the_memory_are_mapped(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", points=POINTS)
    assert len(read(tmp_path / "a.npz", limit_bytes=100)) == 40
    np.savez_compressed(tmp_path / "a.npz", points=POINTS)
    with refused("more than the limit"):
        read(tmp_path / "a.npz", limit_bytes=100)
