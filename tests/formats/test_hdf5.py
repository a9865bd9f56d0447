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
LIBVERS = ["earliest", "latest"]
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


@pytest.mark.parametrize(
    ("name", "options", "words"),
    [
        (
            "elsewhere",
            {"shape": (9,), "dtype": "f8", "external": [("o.bin", 0, 72)]},
            "'elsewhere'",
        ),
        ("unwritten", {"shape": (9,), "dtype": "f8"}, "'unwritten'"),
        ("zipped", {"data": np.zeros(5000), "compression": "gzip"}, "is compressed"),
        ("text", {"data": ["a", "b"]}, "holds no numbers"),
        ("sparse", {"shape": (1 << 30,), "dtype": "f8", "chunks": (1024,)}, "the file has"),
        ("absent", None, "has no dataset 'absent'"),
    ],
)
def test_refusals(tmp_path: Path, name: str, options: dict[str, Any] | None, words: str) -> None:
    path = tmp_path / "x.h5"
    with h5py.File(path, "w") as file:
        if options is not None:
            file.create_dataset(name, **options)
    with pytest.raises(PredictionError, match=words):
        Hdf5File(path, LIMIT).read(name)


def test_virtual_datasets_are_refused(tmp_path: Path) -> None:
    path, layout = tmp_path / "x.h5", h5py.VirtualLayout((9,), "f8")
    layout[:] = h5py.VirtualSource("o.h5", "x", (9,))
    with h5py.File(path, "w") as file:
        file.create_virtual_dataset("virtual", layout)
    with pytest.raises(PredictionError, match=r"x\.h5.*'virtual'"):
        Hdf5File(path, LIMIT).read("virtual")


def test_memory_is_bounded(tmp_path: Path) -> None:
    path = tmp_path / "x.h5"
    with h5py.File(path, "w") as file:
        file["x"] = np.zeros(10_000)
        file.create_group("many")
        for number in range(20):
            file.create_group(f"many/{number}")
    with pytest.raises(PredictionError, match="dataset 'x': 80,000 bytes"):
        Hdf5File(path, 300_000).read("x")
    with pytest.raises(PredictionError, match="its groups and datasets"):
        Hdf5File(path, 100_000)


def test_groups_in_circles_end(tmp_path: Path) -> None:
    path = tmp_path / "x.h5"
    with h5py.File(path, "w") as file:
        file["a/b/c"] = np.zeros(3)
        file["a/b/up"] = file["a"]
        file["soft"] = h5py.SoftLink("/soft")
        file["lost"] = h5py.SoftLink("/nowhere")
    with pytest.raises(PredictionError, match="recursion"):
        Hdf5File(path, LIMIT)
    assert "a/b/c" in dataset_names(path, 1)


@pytest.mark.parametrize("content", [b"", b"\x89HDF\r\n\x1a\n", b"text" * 100])
def test_what_is_no_hdf5(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "x.h5"
    path.write_bytes(content)
    assert dataset_names(path, 3) == []
    with pytest.raises(PredictionError, match=r"no HDF5|damaged"):
        Hdf5File(path, LIMIT)
    assert dataset_names(tmp_path, 3) == []


@pytest.mark.parametrize("libver", LIBVERS)
@pytest.mark.parametrize("share", [0.3, 0.6, 0.95])
def test_a_file_that_is_cut_off_is_refused(tmp_path: Path, libver: str, share: float) -> None:
    path = written(tmp_path / "x.h5", libver)
    path.write_bytes(path.read_bytes()[: int(path.stat().st_size * share)])
    with pytest.raises(PredictionError):
        [file.read(name) for file in [Hdf5File(path, LIMIT)] for name in file.names()]
