"""Tensors in files of ``torch.save``, read without PyTorch and without running what they hold.

Such a file is a zip of a pickle, which `torch_pickles` interprets, and of the numbers of each
tensor.
"""

from __future__ import annotations

import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.formats.torch_pickles import Storage, UnreadableError, unpickled

__all__ = ["read_tensors"]

_LIMIT_BYTES = 16 << 20
_PICKLE_BYTES = 1 << 20
_MOST_MEMBERS = 10_000
_ZIP = b"PK\x03\x04"


def read_tensors(path: Path) -> dict[str, Any]:
    """Read a dictionary that ``torch.save`` wrote.

    Parameters
    ----------
    path : Path
        Up to 16 MiB, and the pickle in it up to 1 MiB.

    Returns
    -------
    dict of str to value
        Tensors as arrays; numbers, texts, lists and dictionaries as they are.

    Raises
    ------
    BenchmarkError
        The file is missing, damaged, in the layout before PyTorch 1.6, or holds anything else.
    """
    if not path.is_file():
        raise BenchmarkError("no such file", where=path, expected="a file of torch.save")
    try:
        return _read(path)
    except (
        UnreadableError,
        ValueError,
        zipfile.BadZipFile,
        NotImplementedError,
        EOFError,
    ) as error:
        raise BenchmarkError(
            f"cannot be read as tensors: {str(error)[:200]}",
            where=path,
            expected="a dictionary of tensors, numbers and texts, as torch.save writes it",
            fix="download it again if it is not whole; or where you trust it, write it anew:\n"
            "            torch.save(dict(torch.load(f, weights_only=True)), f)",
        ) from error


def _read(path: Path) -> dict[str, Any]:
    with path.open("rb") as stream:
        start = stream.read(len(_ZIP))
    if path.stat().st_size > _LIMIT_BYTES:
        raise UnreadableError(f"it is larger than {_LIMIT_BYTES:,} bytes")
    if start != _ZIP:
        old = start.startswith(b"\x80")
        raise UnreadableError(
            "a pickle, such as PyTorch wrote before 1.6" if old else "no file of torch.save"
        )
    with zipfile.ZipFile(path) as archive:
        pack = _Pack.of(archive)
        value = unpickled(pack.member("data.pkl", _PICKLE_BYTES), pack.numbers, _LIMIT_BYTES)
    if not isinstance(value, dict):
        raise UnreadableError("it holds no dictionary")
    return value


@dataclass(frozen=True, eq=False)
class _Pack:
    """The members of a zip, below its one folder."""

    archive: zipfile.ZipFile
    infos: dict[str, zipfile.ZipInfo]
    root: str

    @classmethod
    def of(cls, archive: zipfile.ZipFile) -> _Pack:
        listed = archive.infolist()
        infos = {info.filename: info for info in listed}
        if len(listed) > _MOST_MEMBERS or len(infos) < len(listed):
            raise UnreadableError("its zip has too many members, or two of one name")
        roots = [name.removesuffix("data.pkl") for name in infos if name.endswith("/data.pkl")]
        if len(roots) != 1:
            raise UnreadableError("its zip has no data.pkl, or several")
        return cls(archive, infos, roots[0])

    def member(self, name: str, most: int) -> bytes:
        """Return the bytes of a member, which must be stored as they are: no bomb is."""
        info = self.infos.get(self.root + name)
        if info is None:
            raise UnreadableError(f"its zip lacks {name[:40]}")
        if info.compress_type != zipfile.ZIP_STORED or info.flag_bits & 1:
            raise UnreadableError(f"{name[:40]} is compressed or encrypted")
        if not info.file_size == info.compress_size <= most:
            raise UnreadableError(f"{name[:40]} has {info.file_size:,} bytes")
        return self.archive.read(info)

    def numbers(self, storage: Storage) -> NDArray[Any]:
        """Return all numbers of a storage, as one row."""
        named = self.root + "byteorder" in self.infos
        order = ">" if named and self.member("byteorder", 16) == b"big" else "<"
        kind = np.dtype(order + storage.kind)
        stored = self.member(f"data/{storage.key}", storage.count * kind.itemsize)
        if len(stored) != storage.count * kind.itemsize:
            raise UnreadableError(f"a tensor lacks some of its {storage.count:,} numbers")
        return np.frombuffer(stored, kind)
