"""Matrices in Zarr arrays (versions 2 and 3), which strangers may have written.

Every size is settled by the metadata before a chunk is opened: a chunk that unpacks to anything
else is refused without memory for it. Of the codecs only those are taken that can be held to that.
"""

from __future__ import annotations

import json
import math
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.core.files import read_text
from airzoo_bench.formats.budget import Budget

__all__ = ["ZarrMatrix"]

_METADATA = {3: "zarr.json", 2: ".zarray"}
_LONGEST_METADATA = 1 << 20
_TYPES = {f"float{bits}": f"f{bits // 8}" for bits in (16, 32, 64)}
_ENDS = {"little": "<", "big": ">"}
_STORED_MORE = 1 << 16  # bytes that packing may add
_BLOSC_HEADER = 16
_WRITE = "write it with zarr.create_array(..., compressors=zarr.codecs.ZstdCodec())"

Unpack = Callable[[bytes, int], bytes]


@dataclass(frozen=True)
class ZarrMatrix:
    """A matrix of floating point in chunks, none of which is read yet; small to send.

    Parameters
    ----------
    path : Path
        The array's folder.
    shape, chunk : tuple of int
        Of the matrix; of a chunk.
    dtype : str
        As stored, with its byte order.
    key : str
        The name of a chunk's file, to be formatted with its row and column.
    codec : str
        How chunks are packed; empty for not at all.
    """

    path: Path
    shape: tuple[int, int]
    chunk: tuple[int, int]
    dtype: str
    key: str
    codec: str

    @classmethod
    def open(cls, path: Path, budget: Budget) -> ZarrMatrix:
        """Read the metadata of an array.

        Parameters
        ----------
        path : Path
        budget : Budget
            What a band of chunks, as long as the rows are, may take in memory.

        Raises
        ------
        PredictionError
            It is no matrix of floating point in chunks that can be read here.
        """
        version = 3 if (path / _METADATA[3]).is_file() else 2
        file = path / _METADATA[version]
        text = read_text(file, PredictionError, "Zarr metadata", _LONGEST_METADATA)
        try:
            stated = json.loads(text)
            found = (_version_3 if version == 3 else _version_2)(path, stated)
        except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
            raise _unknown(file, f"its metadata are not understood ({error!r:.100})") from error
        band = found.chunk[0] * -(-found.shape[1] // found.chunk[1]) * found.chunk[1]
        size = 3 * band * np.dtype(found.dtype).itemsize  # packed, unpacked, and as rows
        budget.hold(path, "a band of chunks", size, "write chunks of fewer rows")
        return found

    def band(self, number: int) -> NDArray[np.floating[Any]]:
        """Return the rows of one band of chunks, by number.

        Raises
        ------
        PredictionError
            A chunk is missing, cut off or damaged.
        """
        first = number * self.chunk[0]
        rows = np.empty((min(self.chunk[0], self.shape[0] - first), self.shape[1]), self.dtype)
        for column, start in enumerate(range(0, self.shape[1], self.chunk[1])):
            part = rows[:, start : start + self.chunk[1]]
            part[...] = self._read(number, column)[: len(part), : part.shape[1]]
        return rows.astype(np.dtype(self.dtype).newbyteorder("="), copy=False)

    def _read(self, row: int, column: int) -> NDArray[np.floating[Any]]:
        file = self.path / self.key.format(row, column)
        size = math.prod(self.chunk) * np.dtype(self.dtype).itemsize
        try:
            if file.stat().st_size > size + _STORED_MORE + size // 8:
                raise ValueError("it is larger than what it should hold")
            data = _UNPACK[self.codec](file.read_bytes(), size)
            if len(data) != size:
                raise ValueError(f"it holds {len(data):,} bytes and not {size:,}")
        except FileNotFoundError as error:
            raise PredictionError(
                "the chunk is missing, which Zarr takes for zeros",
                where=file,
                expected="a file for each chunk of descriptors",
                fix="write or copy the array again; chunks of nothing but zeros are written with "
                "config={'write_empty_chunks': True}",
            ) from error
        except (ValueError, zlib.error, RuntimeError) as error:
            raise _damaged(file, str(error)) from error
        return np.frombuffer(data, self.dtype).reshape(self.chunk)


def _version_3(path: Path, stated: Mapping[str, Any]) -> ZarrMatrix:
    grid, keys = stated["chunk_grid"], stated["chunk_key_encoding"]
    separator = (keys.get("configuration") or {}).get("separator")
    if keys["name"] == "default":
        key = "c" + 2 * _separated("{}", separator or "/")
    elif keys["name"] == "v2":
        key = "{}" + _separated("{}", separator or ".")
    else:
        raise ValueError("unknown names of chunks")
    (endian, codec), rest = _codecs(stated["codecs"]), stated.get("storage_transformers")
    if grid["name"] != "regular" or rest:
        raise ValueError("irregular chunks, or storage transformers")
    dtype = _ENDS[endian] + _TYPES[stated["data_type"]]
    shape, chunk = stated["shape"], grid["configuration"]["chunk_shape"]
    return ZarrMatrix(path, *_sizes(shape, chunk), dtype, key, codec)


def _version_2(path: Path, stated: Mapping[str, Any]) -> ZarrMatrix:
    compressor, dtype = stated["compressor"], str(stated["dtype"])
    if stated.get("filters") or stated["order"] != "C":
        raise ValueError("filters, or columns first")
    if dtype[:1] not in "<>" or dtype[1:] not in _TYPES.values():
        raise ValueError(f"values of type {dtype[:20]}")
    key = "{}" + _separated("{}", stated.get("dimension_separator") or ".")
    codec = _known("" if compressor is None else compressor["id"])
    return ZarrMatrix(path, *_sizes(stated["shape"], stated["chunks"]), dtype, key, codec)


def _separated(key: str, separator: str) -> str:
    if separator not in ("/", "."):
        raise ValueError("unknown names of chunks")
    return separator + key


def _codecs(stated: list[Mapping[str, Any]]) -> tuple[str, str]:
    """Return the byte order, and how chunks are packed, of version 3."""
    first, *others = stated
    if first["name"] != "bytes" or len(others) > 1:
        raise ValueError(f"codecs {', '.join(str(one['name'])[:30] for one in stated[:5])}")
    endian = (first.get("configuration") or {}).get("endian", "little")
    return endian, _known(others[0]["name"] if others else "")


def _known(codec: object) -> str:
    if not isinstance(codec, str) or codec not in _UNPACK:
        raise ValueError(f"codec {str(codec)[:30]}")
    return codec


def _sizes(shape: list[int], chunk: list[int]) -> tuple[tuple[int, int], tuple[int, int]]:
    sizes = [*shape, *chunk]
    if len(shape) != 2 or len(chunk) != 2 or any(type(one) is not int for one in sizes):
        raise ValueError(f"shape {str(shape)[:40]} in chunks of {str(chunk)[:40]}")
    if min(shape) < 0 or min(chunk) < 1 or max(sizes) >= 1 << 48:
        raise ValueError(f"shape {str(shape)[:40]} in chunks of {str(chunk)[:40]}")
    return (shape[0], shape[1]), (chunk[0], chunk[1])


def _unzip(data: bytes, size: int) -> bytes:
    unpacked = zlib.decompressobj(32 + zlib.MAX_WBITS)  # of gzip or zlib, as the bytes say
    return unpacked.decompress(data, size + 1)


def _zstd(data: bytes, size: int) -> bytes:
    import pyarrow as pa

    try:
        unpacked: bytes = pa.Codec("zstd").decompress(data, size, asbytes=True)
    except (pa.ArrowException, OSError) as error:
        raise ValueError(str(error)) from error
    return unpacked


def _blosc(data: bytes, size: int) -> bytes:
    stated = int.from_bytes(data[4:8], "little"), int.from_bytes(data[12:16], "little")
    if len(data) < _BLOSC_HEADER or stated != (size, len(data)):
        raise ValueError("its header states another size")
    try:
        from numcodecs import blosc
    except ImportError as error:
        raise PredictionError(
            "its chunks are packed by blosc, which needs the zarr package",
            fix="pip install 'airzoo-bench[zarr]', or write them with zstd or gzip",
        ) from error
    return bytes(blosc.decompress(data))


_UNPACK: dict[str, Unpack] = {
    "": lambda data, _: data,
    "gzip": _unzip,
    "zlib": _unzip,
    "zstd": _zstd,
    "blosc": _blosc,
}


def _unknown(file: Path, why: str) -> PredictionError:
    return PredictionError(
        why,
        where=file,
        expected="an array (n, D) of float16, float32 or float64, its chunks plain or packed by "
        "zstd, gzip or blosc, without sharding, filters or checksums",
        fix=_WRITE,
    )


def _damaged(file: Path, why: str) -> PredictionError:
    return PredictionError(
        f"the chunk is damaged or cut off: {why[:200]}",
        where=file,
        fix="write or copy the array again",
    )
