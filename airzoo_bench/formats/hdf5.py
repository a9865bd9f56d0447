"""HDF5 files by pyfive: datasets of numbers that the file holds itself.

Numbers are read here once the size that a dataset states was held against that of the file;
external storage, virtual datasets and filters are refused.
"""

from __future__ import annotations

import itertools
import math
import mmap
from collections.abc import Iterator
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pyfive
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, UnreadableError, readable
from airzoo_bench.formats.npz import Budget

_MAGIC = b"\x89HDF\r\n\x1a\n"
_BYTES_OF_OBJECT = 12_000  # of memory, what pyfive keeps of a group or dataset
_CONTIGUOUS, _VIRTUAL, _NOWHERE = 1, 3, (1 << 64) - 1


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
        if stream.read(len(_MAGIC)) != _MAGIC:
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


def _readable(path: Path) -> AbstractContextManager[None]:
    what = "damaged or cut off, or HDF5 of a kind that is not read here"
    return readable(path, what, expected="an HDF5 file as h5py writes it")
