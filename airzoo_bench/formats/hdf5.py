"""HDF5 files by pyfive: datasets of numbers that the file holds itself.

Numbers are read here once the size that a dataset states was held against that of the file;
external storage, virtual datasets and filters are refused.
"""

from __future__ import annotations

import itertools
import math
import mmap
import struct
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np
import pyfive
from numpy.typing import NDArray
from pyfive.core import InvalidHDF5File

from airzoo_bench.core.errors import PredictionError, UnreadableError
from airzoo_bench.formats.budget import Budget

__all__ = ["Hdf5File", "dataset_names"]

_MAGIC = b"\x89HDF\r\n\x1a\n"
_KINDS = "biuf"
_DEEPEST = 16
_BYTES_OF_OBJECT = 12_000  # of memory, what pyfive keeps of a group or dataset
_CONTIGUOUS, _VIRTUAL, _NOWHERE = 1, 3, (1 << 64) - 1
# What pyfive, which checks little, raises over damaged bytes.
_DAMAGE = (
    *(ArithmeticError, AssertionError, AttributeError, EOFError, LookupError, MemoryError),
    *(InvalidHDF5File, NameError, OSError, RuntimeError, TypeError, ValueError, struct.error),
)


class Hdf5File:
    """The datasets of an HDF5 file by their full names, read one at a time.

    Parameters
    ----------
    path : Path
        The file.
    limit_bytes : int
        The most that its structure and the arrays that are read may take in memory together.

    Raises
    ------
    UnreadableError
        It is no HDF5 file.
    PredictionError
        It is damaged, or holds more groups and datasets than fit the limit.
    """

    def __init__(self, path: Path, limit_bytes: int) -> None:
        self.path = path
        self.budget = Budget(limit_bytes)
        self._size = path.stat().st_size if path.is_file() else 0
        self._datasets: dict[str, pyfive.Dataset] = {}
        with _damage(path), path.open("rb") as stream:
            for count, (name, dataset) in enumerate(_walk(_open(path, stream))):
                self.budget.hold(path, "its groups and datasets", count * _BYTES_OF_OBJECT)
                if dataset is not None:
                    self._datasets[name] = dataset

    def names(self) -> list[str]:
        """Return the full names of the datasets, such as ``a/b/keypoints``."""
        return list(self._datasets)

    def __contains__(self, name: object) -> bool:
        return name in self._datasets

    def read(self, name: str) -> NDArray[Any]:
        """Read a dataset of numbers into memory."""
        if name not in self._datasets:
            raise PredictionError(f"has no dataset {name[:200]!r}", where=self.path)
        with _damage(self.path), self.path.open("rb") as stream:
            return self._read(self._datasets[name], f"dataset {name[:200]!r}", stream)

    def _read(self, dataset: pyfive.Dataset, what: str, stream: IO[bytes]) -> NDArray[Any]:
        dtype, shape = np.dtype(dataset.dtype), tuple(map(int, dataset.shape))
        if dtype.kind not in _KINDS:
            raise PredictionError(f"{what} holds no numbers but {dtype}", where=self.path)
        if dataset.id.filter_pipeline:
            raise PredictionError(
                f"{what} is compressed",
                where=self.path,
                expected="datasets as h5py writes them by default, without filters",
                fix="write it anew: h5repack -f NONE OLD.h5 NEW.h5",
            )
        nbytes = math.prod(shape) * dtype.itemsize
        if min(shape, default=0) < 0 or nbytes > self._size:
            raise _damaged(
                self.path, f"{what} states {nbytes:,} bytes, the file has {self._size:,}"
            )
        self.budget.hold(self.path, what, nbytes)
        layout = dataset.id.layout_class
        start = dataset.id.data_offset if layout == _CONTIGUOUS and nbytes else 0
        if layout == _VIRTUAL or start == _NOWHERE:
            raise PredictionError(
                f"the numbers of {what} are not in the file: it is virtual, has external storage, "
                "or was never written",
                where=self.path,
                expected="datasets whose numbers the file holds itself",
                fix="copy them into one file: new[name] = old[name][...] in h5py",
            )
        if layout == _CONTIGUOUS:
            stream.seek(start)
            return _filled(stream, dtype, shape)
        values: NDArray[Any] = np.array(dataset[...], dtype=dtype.newbyteorder("="))
        return values


def dataset_names(path: Path, most: int) -> list[str]:
    """Return the names of the first few datasets; none of what is no HDF5 file or is damaged."""
    if not path.is_file():
        return []
    found = []
    try:
        with _damage(path), path.open("rb") as stream:
            for name, dataset in itertools.islice(_walk(_open(path, stream)), 8 * most):
                if dataset is not None:
                    found.append(name)
                if len(found) == most:
                    break
    except PredictionError:
        return found
    return found


def _open(path: Path, stream: IO[bytes]) -> pyfive.Group:
    if stream.read(len(_MAGIC)) != _MAGIC:
        raise UnreadableError("no HDF5 file", where=path, expected="a file that h5py wrote")
    # A map closes with the last dataset that reads from it.
    return pyfive.File(mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ))


def _walk(root: pyfive.Group) -> Iterator[tuple[str, pyfive.Dataset | None]]:
    """Yield the groups (None) and datasets of a file, depth first, with their full names."""
    waiting = [(iter(root), root, "")]
    while waiting:
        members, group, before = waiting[-1]
        member = next(members, None)
        if member is None:
            waiting.pop()
            continue
        found = group.get_lazy_view(member)
        if isinstance(found, pyfive.Group):
            if len(waiting) == _DEEPEST:
                raise ValueError(f"groups are nested more than {_DEEPEST} deep")
            waiting.append((iter(found), found, f"{before}{member}/"))
        yield before + member, found if isinstance(found, pyfive.Dataset) else None


def _filled(stream: IO[bytes], dtype: np.dtype[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    values = np.empty(shape, dtype)
    if values.nbytes:
        view = memoryview(values.reshape(-1).view(np.uint8).data)
        if stream.readinto(view) != len(view):  # type: ignore[attr-defined]
            raise EOFError("the file ends before the data does")
    return values.astype(dtype.newbyteorder("="), copy=False)


@contextmanager
def _damage(path: Path) -> Iterator[None]:
    """Say of what pyfive cannot read that the file is damaged."""
    try:
        with warnings.catch_warnings(action="ignore"), np.errstate(all="ignore"):
            yield
    except _DAMAGE as error:
        raise _damaged(path, f"{type(error).__name__}: {str(error)[:200]}") from error


def _damaged(path: Path, reason: str) -> PredictionError:
    return PredictionError(
        f"damaged or cut off, or HDF5 of a kind that is not read here: {reason}",
        where=path,
        expected="an HDF5 file as h5py writes it",
        fix="write or copy the file again",
    )
