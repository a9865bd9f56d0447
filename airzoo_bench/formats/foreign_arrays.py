"""Arrays in files of other tools: HDF5 by pyfive, MATLAB 5 by scipy.io, tensors of PyTorch.

Numbers of HDF5 are read once the size that a dataset states was held against that of the file;
external storage, virtual datasets and filters are refused. Tensors are read without PyTorch and
without running what their file holds: a zip of a pickle and of the numbers of each tensor.
"""

from __future__ import annotations

import io
import itertools
import math
import mmap
import pickle
import zipfile
from collections.abc import Iterator
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pyfive
import scipy.io
from numpy.typing import NDArray

from airzoo_bench.core.errors import BenchmarkError, PredictionError, UnreadableError, readable
from airzoo_bench.formats.npz import Budget

_HDF5_MAGIC, _MAT_MAGIC = b"\x89HDF\r\n\x1a\n", b"MATLAB 5.0 MAT-file"
_BYTES_OF_OBJECT = 12_000  # of memory, what pyfive keeps of a group or dataset
_CONTIGUOUS, _VIRTUAL, _NOWHERE = 1, 3, (1 << 64) - 1
_STORAGES = {
    **{"HalfStorage": "<f2", "FloatStorage": "<f4", "DoubleStorage": "<f8", "ByteStorage": "<u1"},
    **{"CharStorage": "<i1", "ShortStorage": "<i2", "IntStorage": "<i4", "LongStorage": "<i8"},
}


class Hdf5File:
    """The datasets of an HDF5 file by their full names, read one at a time.

    Its structure and the arrays that are read take `limit_bytes` of memory together at most.
    """

    def __init__(self, path: Path, limit_bytes: int) -> None:
        self.path = path
        self.budget = Budget(limit_bytes)
        self._datasets: dict[str, pyfive.Dataset] = {}
        with _readable(path):
            for count, (name, found) in enumerate(_walk(_open(path), "")):
                self.budget.hold(path, "its groups and datasets", count * _BYTES_OF_OBJECT)
                if isinstance(found, pyfive.Dataset):
                    self._datasets[name] = found

    def names(self) -> list[str]:
        """Return the full names of the datasets, such as ``a/b/keypoints``."""
        return list(self._datasets)

    def __contains__(self, name: object) -> bool:
        return name in self._datasets

    def read(self, name: str) -> NDArray[Any]:
        """Read a dataset of numbers into memory."""
        what = f"dataset {name[:200]!r}"
        if name not in self._datasets:
            raise PredictionError(f"has no {what}", where=self.path)
        dataset, size = self._datasets[name], self.path.stat().st_size
        with _readable(self.path):
            dtype, shape = np.dtype(dataset.dtype), tuple(map(int, dataset.shape))
            nbytes, layout = math.prod(shape) * dtype.itemsize, dataset.id.layout_class
            start = dataset.id.data_offset if layout == _CONTIGUOUS and nbytes else 0
            if dtype.kind not in "biuf":
                raise TypeError(f"{what} holds no numbers but {dtype}")
            if dataset.id.filter_pipeline:
                raise TypeError(f"{what} is compressed: h5repack -f NONE OLD.h5 NEW.h5 undoes it")
            if layout == _VIRTUAL or start == _NOWHERE:
                raise TypeError(f"{what} is virtual, has external storage, or was never written")
            if min(shape, default=0) < 0 or nbytes > size:
                raise ValueError(f"{what} states {nbytes:,} bytes, the file has {size:,}")
            self.budget.hold(self.path, what, nbytes)
            if layout != _CONTIGUOUS:
                return np.asarray(np.array(dataset[...]), dtype.newbyteorder("="))
            flat = np.fromfile(self.path, dtype, math.prod(shape), offset=start)
            return np.asarray(flat.reshape(shape), dtype.newbyteorder("="))


def dataset_names(path: Path, most: int) -> list[str]:
    """Return the names of the first few datasets; none if the file is damaged or no HDF5."""
    found: list[str] = []
    with suppress(PredictionError), _readable(path):
        for name, one in itertools.islice(_walk(_open(path), ""), 8 * most):
            if isinstance(one, pyfive.Dataset) and len(found) < most:
                found.append(name)
    return found


def _open(path: Path) -> pyfive.Group:
    with path.open("rb") as stream:
        if stream.read(len(_HDF5_MAGIC)) != _HDF5_MAGIC:
            raise UnreadableError("no HDF5 file", where=path, expected="a file that h5py wrote")
        # The map closes with the last dataset that reads from it.
        return pyfive.File(mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ))


def _walk(group: pyfive.Group, before: str) -> Iterator[tuple[str, Any]]:
    """Yield the groups and datasets of a file, depth first, with their full names."""
    for member in group:
        found = group.get_lazy_view(member)
        yield before + member, found
        if isinstance(found, pyfive.Group):
            yield from _walk(found, f"{before}{member}/")


def mat_names(path: Path) -> set[str]:
    """Return the names of the arrays of a MATLAB 5 file."""
    with _readable(path), path.open("rb") as stream:
        if stream.read(len(_MAT_MAGIC)) != _MAT_MAGIC:
            raise ValueError("no MATLAB 5 file; version 7.3 is HDF5")
        return {name for name, _, _ in scipy.io.whosmat(path)}


def read_mat(path: Path, name: str, kinds: str, limit_bytes: int) -> NDArray[Any]:
    """Read an array of one of some kinds in C order; of text, lines without blanks at the end."""
    mat_names(path)
    with _readable(path):
        values = scipy.io.loadmat(path, variable_names=[name], chars_as_strings=True)[name]
        if not isinstance(values, np.ndarray) or values.dtype.kind not in kinds:
            raise TypeError(f"variable {name!r} holds no array of the type that is needed")
    # The file has columns first: while these become rows, both are there.
    Budget(limit_bytes).hold(path, f"variable {name!r}", 2 * values.nbytes)
    if values.dtype.kind == "U":
        return np.char.rstrip(values.reshape(-1), " \0")
    return np.ascontiguousarray(values, values.dtype.newbyteorder("="))


def _readable(path: Path) -> AbstractContextManager[None]:
    what = "damaged or cut off, or of a kind that is not read here"
    expected = "HDF5 as h5py writes it, or arrays and text as scipy.io.savemat writes them"
    return readable(path, what, expected=expected)


def read_tensors(path: Path) -> dict[str, Any]:
    """Read a dictionary that ``torch.save`` wrote."""
    what = "cannot be read as tensors"
    fix = "download it again, or torch.save(dict(torch.load(f, weights_only=True)), f) of it"
    expected = "a dictionary of tensors, numbers and texts, as torch.save writes it since 1.6"
    with (
        readable(path, what, kind=BenchmarkError, expected=expected, fix=fix),
        zipfile.ZipFile(path) as archive,
    ):
        value = _Tensors(archive).load()
        if not isinstance(value, dict):
            raise TypeError("it holds no dictionary")
        return value


class _Tensors(pickle.Unpickler):
    """Makes numbers, texts, tensors, and lists and dictionaries of them, and knows nothing else."""

    def __init__(self, archive: zipfile.ZipFile) -> None:
        (found,) = [name for name in archive.namelist() if name.endswith("/data.pkl")]
        self._archive, self._root = archive, found.removesuffix("data.pkl")
        super().__init__(io.BytesIO(archive.read(found)))

    def find_class(self, module: str, name: str, /) -> Any:
        if (module, name) == ("torch._utils", "_rebuild_tensor_v2"):
            return _tensor
        if (module, name) == ("collections", "OrderedDict"):
            return dict
        if module == "torch" and name in _STORAGES:
            return _STORAGES[name]
        raise ValueError(f"its pickle names {module}.{name}, which is no tensor of numbers")

    def persistent_load(self, pid: Any) -> NDArray[Any]:
        _, kind, key, _, count = pid
        return np.frombuffer(self._archive.read(f"{self._root}data/{key}"), np.dtype(kind), count)


def _tensor(
    flat: NDArray[Any], offset: int, shape: tuple[int, ...], strides: tuple[int, ...], *_: Any
) -> NDArray[Any]:
    """Return the view of its numbers that a tensor is; NumPy refuses one that reaches beyond."""
    steps = [stride * flat.itemsize for stride in strides]
    return np.ndarray(shape, flat.dtype, flat.data, offset * flat.itemsize, steps)
