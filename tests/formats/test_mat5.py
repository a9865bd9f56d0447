"""MATLAB 5 files, held against scipy, which wrote them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.io

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.formats.mat5 import mat_names, read_mat

PLENTY = 1 << 30


@pytest.mark.parametrize("compressed", [False, True])
def test_arrays_are_those_of_scipy(compressed: bool, tmp_path: Path) -> None:
    random, path = np.random.default_rng(0), tmp_path / "a.mat"
    arrays = {
        "small": np.array([[7]], np.int16),
        "f8": random.standard_normal((3, 5)),
        "cube": random.standard_normal((2, 3, 4)).astype(np.float32),
        "text": np.array(["a", "bcd", "ef"]),
        "cell": np.array([{"a": 1}, "x"], dtype=object),
        "complex": np.array([[1j]]),
        "none": np.zeros((0, 0)),
    }
    scipy.io.savemat(path, arrays, do_compression=compressed)
    oracle = scipy.io.loadmat(path)
    assert mat_names(path) == set(arrays)
    for name in ("small", "f8", "cube", "none"):
        found = read_mat(path, name, "biuf", PLENTY)
        assert np.array_equal(found, oracle[name])
        assert found.dtype == oracle[name].dtype
    assert read_mat(path, "text", "U", PLENTY).tolist() == [t.rstrip() for t in oracle["text"]]
    for name in ("text", "f8", "cell", "complex"):
        with pytest.raises(PredictionError, match="holds no"):
            read_mat(path, name, "U" if name == "f8" else "biuf", PLENTY)
    with pytest.raises(PredictionError, match="more than the limit"):
        read_mat(path, "f8", "biuf", 100)


def test_a_file_that_is_cut_off(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "a.mat", {"a": np.ones((3, 5))})
    whole = (tmp_path / "a.mat").read_bytes()
    for length in (0, 100, 140, len(whole) // 2, len(whole) - 8):
        (tmp_path / "a.mat").write_bytes(whole[:length])
        with pytest.raises(PredictionError):
            read_mat(tmp_path / "a.mat", "a", "biuf", PLENTY)
