"""HDF5: what h5py writes, in both layouts, is read as it is; what is damaged is refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.formats.hdf5 import Hdf5File, dataset_names

LIMIT = 1 << 26
ARRAYS: dict[str, NDArray[Any]] = {
    "a/b.jpg/keypoints": np.arange(14, dtype=np.float16).reshape(7, 2),
    "a/b.jpg/image_size": np.array([640, 480]),
    "a/c.jpg/matches0": np.array([-1, 3], np.int16),
    "a/c.jpg/none": np.zeros((0, 2), np.float32),
    "big": np.arange(5, dtype=">f8"),
}


def written(path: Path, libver: str, **options: Any) -> Path:
    with h5py.File(path, "w", libver=libver) as file:
        for name, values in ARRAYS.items():
            file.create_dataset(name, data=values, **(options if values.size > 2 else {}))
    return path


@pytest.mark.parametrize(
    ("libver", "options"), [("earliest", {}), ("latest", {}), ("earliest", {"chunks": True})]
)
def test_arrays_come_back(tmp_path: Path, libver: str, options: dict[str, Any]) -> None:
    path = written(tmp_path / "x.h5", libver, **options)
    file = Hdf5File(path, LIMIT)
    assert sorted(file.names()) == sorted(ARRAYS)
    for name, values in ARRAYS.items():
        found = file.read(name)
        assert found.dtype == values.dtype.newbyteorder("=")
        np.testing.assert_array_equal(found, values)
    assert dataset_names(path, 2) == file.names()[:2]


OUTSIDE = {"shape": (9,), "dtype": "f8", "external": [("o.bin", 0, 72)]}


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("elsewhere", OUTSIDE),
        ("unwritten", {"shape": (9,), "dtype": "f8"}),
        ("zipped", {"data": np.zeros(5000), "compression": "gzip"}),
        ("text", {"data": ["a", "b"]}),
        ("sparse", {"shape": (1 << 30,), "dtype": "f8", "chunks": (1024,)}),
        ("absent", None),
        ("virtual", None),
    ],
)
def test_refusals(tmp_path: Path, name: str, options: dict[str, Any] | None) -> None:
    path = tmp_path / "x.h5"
    with h5py.File(path, "w") as file:
        if options is not None:
            file.create_dataset(name, **options)
        elif name == "virtual":
            layout = h5py.VirtualLayout((9,), "f8")
            layout[:] = h5py.VirtualSource("o.h5", "x", (9,))
            file.create_virtual_dataset(name, layout)
    with pytest.raises(PredictionError, match=rf"x\.h5.*'{name}'"):
        Hdf5File(path, LIMIT).read(name)


def test_memory_is_bounded(tmp_path: Path) -> None:
    path = tmp_path / "x.h5"
    with h5py.File(path, "w") as file:
        file["x"] = np.zeros(10_000)
        for number in range(20):
            file.create_group(f"many/{number}")
    with pytest.raises(PredictionError, match="dataset 'x': 80,000 bytes"):
        Hdf5File(path, 300_000).read("x")
    with pytest.raises(PredictionError, match="more than the limit"):
        Hdf5File(path, 100_000)


def test_groups_in_circles_end(tmp_path: Path) -> None:
    path = tmp_path / "x.h5"
    with h5py.File(path, "w") as file:
        file["a/b/c"] = np.zeros(3)
        file["a/b/up"] = file["a"]
        file["soft"] = h5py.SoftLink("/soft")
    with pytest.raises(PredictionError, match=r"x\.h5"):
        Hdf5File(path, LIMIT)
    assert "a/b/c" in dataset_names(path, 1)


@pytest.mark.parametrize("share", [0, 0.001, 0.3, 0.6, 0.95])
@pytest.mark.parametrize("libver", ["earliest", "latest", "text"])
def test_a_damaged_file_is_refused(tmp_path: Path, libver: str, share: float) -> None:
    path = tmp_path / "x.h5"
    if libver == "text":
        path.write_bytes(b"text" * 100)
    else:
        written(path, libver)
    path.write_bytes(path.read_bytes()[: int(path.stat().st_size * share)])
    assert len(dataset_names(path, 3)) <= 3
    with pytest.raises(PredictionError):
        [file.read(name) for file in [Hdf5File(path, LIMIT)] for name in file.names()]
