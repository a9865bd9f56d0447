"""Tensors in files of ``torch.save``, read without PyTorch and without running what they hold.

Such a file is a zip of a pickle and of the numbers of each tensor.
"""

from __future__ import annotations

import io
import math
import pickle
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import BenchmarkError, readable

_NAMES = ("Half", "Float", "Double", "Byte", "Char", "Short", "Int", "Long")
_CODES = ("<f2", "<f4", "<f8", "<u1", "<i1", "<i2", "<i4", "<i8")
_STORAGES = {f"{name}Storage": code for name, code in zip(_NAMES, _CODES, strict=True)}


def read_tensors(path: Path) -> dict[str, Any]:
    """Read a dictionary that ``torch.save`` wrote."""
    with (
        readable(
            path,
            "cannot be read as tensors",
            kind=BenchmarkError,
            expected="a dictionary of tensors, numbers and texts, as torch.save writes it since "
            "PyTorch 1.6",
            fix="download it again if it is not whole; or where you trust it, write it anew:\n"
            "            torch.save(dict(torch.load(f, weights_only=True)), f)",
        ),
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
        self._storages: dict[str, NDArray[Any]] = {}
        order = self._root + "byteorder"
        if order in archive.namelist() and archive.read(order) != b"little":
            raise ValueError("its numbers are big-endian")
        super().__init__(io.BytesIO(self._member("data.pkl")))

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
        if key not in self._storages:
            stored = self._member(f"data/{key}")
            self._storages[key] = np.frombuffer(stored, np.dtype(kind), count)
        return self._storages[key]

    def _member(self, name: str) -> bytes:
        info = self._archive.getinfo(self._root + name)
        if info.compress_type != zipfile.ZIP_STORED:
            raise ValueError(f"{name} is compressed")
        return self._archive.read(info)


def _tensor(
    flat: NDArray[Any], offset: int, shape: tuple[int, ...], strides: tuple[int, ...], *_: Any
) -> NDArray[Any]:
    """Return the view of its numbers that a tensor is; NumPy refuses one that reaches beyond."""
    if math.prod(shape) > flat.size or min((offset, *shape, *strides)) < 0:
        raise ValueError("a tensor is larger than its numbers")
    steps = [stride * flat.itemsize for stride in strides]
    return np.ndarray(shape, flat.dtype, flat.data, offset * flat.itemsize, steps)
