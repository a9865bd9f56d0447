"""Data common to all blocks, in a file that other processes of this machine map."""

from __future__ import annotations

import mmap
import pickle
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

_LEAST_BYTES = 1 << 20  # of an array that is mapped


class _Pickler(pickle.Pickler):
    """Pickles a large array as a map of its file; one that is in memory gets a file in `folder`."""

    folder: Path

    def reducer_override(self, value: Any) -> Any:
        is_array = isinstance(value, np.ndarray) and value.flags.forc
        if not is_array or value.dtype.hasobject or value.nbytes < _LEAST_BYTES:
            return NotImplemented
        if getattr(value, "filename", None) is None or value.mode != "r":
            path = self.folder / f"{len([*self.folder.iterdir()])}.npy"
            np.save(path, value)
            value = np.load(path, mmap_mode="r")
        # A view begins anywhere in its map, and that at a page of the file.
        begin = value.offset - value.offset % mmap.ALLOCATIONGRANULARITY
        begin += value.ctypes.data - np.frombuffer(value._mmap, np.uint8).ctypes.data
        order = "C" if value.flags.c_contiguous else "F"
        return np.memmap, (value.filename, value.dtype, "r", begin, value.shape, order)


@contextmanager
def write_shared(shared: Any) -> Iterator[str]:
    """Write what blocks share to a file that is there until the context ends; yield its path."""
    with TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        file = Path(folder, "shared.pickle")
        with file.open("wb") as stream:
            pickler = _Pickler(stream, pickle.HIGHEST_PROTOCOL)
            pickler.folder = file.parent
            pickler.dump(shared)
        yield str(file)


@lru_cache(maxsize=1)
def load_shared(file: str) -> Any:
    """Load what `write_shared` has written in this run."""
    with Path(file).open("rb") as stream:
        return pickle.load(stream)  # noqa: S301 - of this run
