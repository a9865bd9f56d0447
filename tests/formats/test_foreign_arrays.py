"""HDF5, MATLAB and PyTorch: what their writers wrote comes back, and what is damaged is refused."""

from __future__ import annotations

import os
import pickle
import zipfile
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.io
from numpy.typing import NDArray

from airzoo_bench.core.errors import BenchmarkError, PredictionError
from airzoo_bench.formats.foreign_arrays import (
    Hdf5File,
    dataset_names,
    mat_names,
    read_mat,
    read_tensors,
)

LIMIT = 1 << 26
ARRAYS: dict[str, NDArray[Any]] = {
    "a/b.jpg/keypoints": np.arange(14, dtype=np.float16).reshape(7, 2),
    "a/b.jpg/image_size": np.array([640, 480]),
    "a/c.jpg/matches0": np.array([-1, 3], np.int16),
    "a/c.jpg/none": np.zeros((0, 2), np.float32),
    "big": np.arange(5, dtype=">f8"),
}


def write_hdf5(path: Path, libver: str, **options: Any) -> Path:
    with h5py.File(path, "w", libver=libver) as file:
        for name, values in ARRAYS.items():
            file.create_dataset(name, data=values, **(options if values.size > 2 else {}))
    return path


@pytest.mark.parametrize(
    ("libver", "options"), [("earliest", {}), ("latest", {}), ("earliest", {"chunks": True})]
)
def test_arrays_of_hdf5_come_back(tmp_path: Path, libver: str, options: dict[str, Any]) -> None:
    path = write_hdf5(tmp_path / "x.h5", libver, **options)
    file = Hdf5File(path, LIMIT)
    assert sorted(file.names()) == sorted(ARRAYS)
    for name, values in ARRAYS.items():
        found = file.read(name)
        assert found.dtype == values.dtype.newbyteorder("=")
        np.testing.assert_array_equal(found, values)
    assert dataset_names(path, 2) == file.names()[:2]


def write_virtual(file: h5py.File) -> None:
    layout = h5py.VirtualLayout((9,), "f8")
    layout[:] = h5py.VirtualSource("o.h5", "x", (9,))
    file.create_virtual_dataset("x", layout)


@pytest.mark.parametrize(
    "write",
    [
        lambda file: file.create_dataset("x", (9,), "f8", external=[("o.bin", 0, 72)]),
        lambda file: file.create_dataset("x", (9,), "f8"),  # which is never written
        lambda file: file.create_dataset("x", data=np.zeros(5000), compression="gzip"),
        lambda file: file.create_dataset("x", data=["a", "b"]),
        lambda file: file.create_dataset("x", (1 << 30,), "f8", chunks=(1024,)),
        lambda file: file.create_dataset("y", data=1.0),
        write_virtual,
    ],
)
def test_refusals_of_hdf5(tmp_path: Path, write: Any) -> None:
    with h5py.File(tmp_path / "x.h5", "w") as file:
        write(file)
    with pytest.raises(PredictionError, match=r"x\.h5.*'x'"):
        Hdf5File(tmp_path / "x.h5", LIMIT).read("x")


def test_memory_of_hdf5_is_bounded(tmp_path: Path) -> None:
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
@pytest.mark.parametrize("libver", ["earliest", "latest"])
def test_hdf5_that_is_cut_off_is_refused(tmp_path: Path, libver: str, share: float) -> None:
    path = write_hdf5(tmp_path / "x.h5", libver)
    path.write_bytes(path.read_bytes()[: int(path.stat().st_size * share)])
    assert len(dataset_names(path, 3)) <= 3
    with pytest.raises(PredictionError):
        [file.read(name) for file in [Hdf5File(path, LIMIT)] for name in file.names()]


@pytest.mark.parametrize("compressed", [False, True])
def test_arrays_of_matlab_are_those_of_scipy(compressed: bool, tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    arrays = {
        "small": np.array([[7]], np.int16),
        "f8": np.random.default_rng(0).standard_normal((3, 5)),
        "cube": np.arange(24, dtype=np.float32).reshape(2, 3, 4),
        "text": np.array(["a", "bcd", "ef"]),
        "cell": np.array([{"a": 1}, "x"], dtype=object),
        "complex": np.array([[1j]]),
        "none": np.zeros((0, 0)),
    }
    scipy.io.savemat(path, arrays, do_compression=compressed)
    oracle = scipy.io.loadmat(path)
    assert mat_names(path) == set(arrays)
    for name in ("small", "f8", "cube", "none"):
        found = read_mat(path, name, "biuf", LIMIT)
        assert np.array_equal(found, oracle[name])
        assert found.dtype == oracle[name].dtype
    assert read_mat(path, "text", "U", LIMIT).tolist() == [t.rstrip() for t in oracle["text"]]
    for name in ("text", "f8", "cell", "complex"):
        with pytest.raises(PredictionError, match="holds no"):
            read_mat(path, name, "U" if name == "f8" else "biuf", LIMIT)
    with pytest.raises(PredictionError, match="more than the limit"):
        read_mat(path, "f8", "biuf", 100)
    whole = path.read_bytes()
    for length in (0, 100, 140, len(whole) // 2, len(whole) - 8):
        path.write_bytes(whole[:length])
        with pytest.raises(PredictionError):
            read_mat(path, "none", "biuf", LIMIT)


C2W = np.arange(12, dtype="<f4").reshape(3, 4) / 8
TENSORS = {"<f4": "Float", "<f8": "Double", "<i8": "Long"}


def plain(value: Any) -> bytes:
    """Return the part of a pickle that makes a plain value."""
    return pickle.dumps(value, 2)[2:-1]


def tensor(key: int, kind: str, count: int, shape: Any, strides: Any, offset: int = 0) -> bytes:
    """Return the part of a pickle that makes a tensor, as PyTorch writes it."""
    storage = b"(" + plain("storage") + f"ctorch\n{TENSORS[kind]}Storage\n".encode()
    storage += plain(str(key)) + plain("cpu") + plain(count) + b"tQ"
    rest = b"".join(map(plain, (offset, shape, strides, False)))
    return (
        b"ctorch._utils\n_rebuild_tensor_v2\n("
        + storage
        + rest
        + b"ccollections\nOrderedDict\n)RtR"
    )


def save_tensors(path: Path, fields: dict[str, bytes], **members: bytes) -> Path:
    """Write a dictionary as ``torch.save`` does, its values as parts of a pickle."""
    content = b"".join(plain(name) + part for name, part in fields.items())
    return write_archive(
        path, {"data.pkl": b"\x80\x02}(" + content + b"u.", "byteorder": b"little"} | members
    )


def write_archive(path: Path, members: dict[str, bytes], method: int = zipfile.ZIP_STORED) -> Path:
    with zipfile.ZipFile(path, "w", method) as archive:
        for name, data in members.items():
            archive.writestr(f"{path.stem}/{name}", data)
    return path


MATRIX = tensor(0, "<f4", 12, (3, 4), (4, 1))
STORED = {"data/0": C2W.tobytes()}


def test_a_dictionary_of_tensors_comes_back(tmp_path: Path) -> None:
    fields = {"W": plain(4096), "name": plain("Sci-Art"), "scale": plain(215.5), "c2w": MATRIX}
    fields["lens"] = b"](" + tensor(1, "<f8", 2, (2,), (1,)) + plain(None) + plain(True) + b"e"
    fields["scalar"] = tensor(2, "<i8", 1, (), ())
    fields["view"] = tensor(0, "<f4", 12, (2, 2), (2, 4), offset=4)  # of the same storage
    more = {"data/1": np.array([0.5, -0.25]).tobytes(), "data/2": np.array([2**40]).tobytes()}
    found = read_tensors(save_tensors(tmp_path / "1.pt", fields, **STORED, **more))
    assert (found["W"], found["name"], found["scale"]) == (4096, "Sci-Art", 215.5)
    assert found["c2w"].dtype == np.float32
    np.testing.assert_array_equal(found["c2w"], C2W)
    np.testing.assert_array_equal(found["lens"][0], [0.5, -0.25])
    assert found["lens"][1:] == [None, True]
    assert found["scalar"].shape == ()
    assert found["scalar"] == 2**40
    np.testing.assert_array_equal(found["view"], C2W[1:, ::2].T)


class Hostile:
    """Something that makes a folder when it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = str(path)

    def __reduce__(self) -> Any:
        return os.mkdir, (self.path,)


@pytest.mark.parametrize("protocol", [0, 2, 4])
def test_code_among_tensors_is_refused_and_never_run(tmp_path: Path, protocol: int) -> None:
    touched = tmp_path / "touched"
    hostile = pickle.dumps({"c2w": Hostile(touched)}, protocol)
    with pytest.raises(BenchmarkError, match=r"evil\.pt"):
        read_tensors(write_archive(tmp_path / "evil.pt", {"data.pkl": hostile}))
    assert not touched.exists()


WRONG: dict[str, tuple[bytes, dict[str, bytes]]] = {
    "another function": (MATRIX.replace(b"tensor_v2", b"parameter"), STORED),
    "another module": (MATRIX.replace(b"ctorch\n", b"cnumpy\n"), STORED),
    "a shape beyond the numbers": (tensor(0, "<f4", 12, (9, 4), (4, 1)), STORED),
    "strides beyond them": (tensor(0, "<f4", 12, (3, 4), (9, 1)), STORED),
    "a negative shape": (tensor(0, "<f4", 12, (-1, 4), (4, 1)), STORED),
    "numbers cut off": (MATRIX, {"data/0": b"12"}),
    "no numbers": (MATRIX, {}),
    "a class": (pickle.dumps(Path("b"), 2)[2:-1], {}),
    "no dictionary": (b"", {"data.pkl": pickle.dumps([1], 2)}),
    "cut off": (b"", {"data.pkl": b"\x80\x02}("}),
    "a mark too few": (b"", {"data.pkl": b"\x80\x02u."}),
}


@pytest.mark.parametrize("name", WRONG)
def test_damaged_tensors_are_refused_by_name(tmp_path: Path, name: Any) -> None:
    part, members = WRONG[name]
    with pytest.raises(BenchmarkError, match=r"000001\.pt"):
        read_tensors(save_tensors(tmp_path / "000001.pt", {"c2w": part}, **members))


def test_old_files_of_tensors_and_bombs_are_refused(tmp_path: Path) -> None:
    bomb = write_archive(tmp_path / "bomb.pt", {"data.pkl": bytes(1 << 20)}, zipfile.ZIP_DEFLATED)
    old = tmp_path / "old.pt"  # before PyTorch 1.6
    old.write_bytes(pickle.dumps(0x1950A86A20F9469CFC6C, 2))
    for path in (bomb, old):
        with pytest.raises(BenchmarkError, match=r"weights_only=True"):
            read_tensors(path)
