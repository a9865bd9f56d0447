"""Fields of a prediction file by name, whatever kind of file it is."""

from __future__ import annotations

import mmap
import tempfile
from collections.abc import Callable, Collection, Iterator, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, UnreadableError, counted, first_of
from airzoo_bench.core.registry import resolve
from airzoo_bench.formats.npz import Budget, NpzFile

_PARQUET = "airzoo_bench.formats.parquet:ParquetFile"  # pyarrow takes a while to import
_TEMPLATE = "`airzoo-bench template` writes an example"
_LONGEST_ID = 256
_LONGEST_NAME = 64
_COPIES_OF_TEXT = 4  # that a run makes while it splits, sorts and compares ids
_CHECKED_ROWS = 1 << 14
_BLOCK_BYTES, _BLOCK_ROWS = 1 << 25, 1 << 15


class Arrays(Protocol):
    """Arrays of a file by name, read one at a time."""

    path: Path
    budget: Budget

    def names(self) -> set[str]:
        """Return the names of the fields."""

    def read(self, name: str) -> NDArray[Any]:
        """Read a field into memory."""

    def map(self, name: str) -> NDArray[Any]:
        """Map a field from disk where that is possible, else read it."""


def open_arrays(path: Path, limit_bytes: int, columns: tuple[str, ...] = ()) -> Arrays:
    """Open a prediction file."""
    if path.suffix == ".npz" and not path.is_dir():
        return NpzFile(path, limit_bytes)
    if path.suffix == ".parquet" and columns and not path.is_dir():
        opened: Arrays = resolve(_PARQUET)(path, limit_bytes, columns)
        return opened
    what = "a folder" if path.is_dir() else f"unknown kind of prediction file {path.suffix!r}"
    expected = ".npz or .parquet" if columns else ".npz"
    raise UnreadableError(what, where=path, expected=expected, fix=_TEMPLATE)


def check_fields(
    arrays: Arrays, needed: Collection[str], allowed: Collection[str], expected: str
) -> None:
    """Refuse a file that lacks a field, or has one that would be passed over."""
    names = arrays.names()
    missing = sorted(set(needed) - names)
    if missing:
        there = _list_names(names, allowed) or "none"
        what = f"lacks the field{'s' * (len(missing) > 1)} {', '.join(missing)} (it has: {there})"
        raise PredictionError(what, where=arrays.path, expected=expected, fix=_TEMPLATE)
    if unknown := names - set(allowed):  # a misspelt one would otherwise be passed over
        what = f"has fields that are not read here: {_list_names(unknown, allowed)}"
        expected = "only " + ", ".join(allowed)
        raise PredictionError(what, where=arrays.path, expected=expected, fix="leave them out")


def _list_names(names: Collection[str], known: Collection[str]) -> str:
    return ", ".join(name if name in known else repr(name[:80]) for name in sorted(names))


def protocol_name(arrays: Arrays) -> str | None:
    """Return the protocol that a file names, if it names one."""
    if "protocol" not in arrays.names():
        return None
    value = arrays.read("protocol")
    name = str(value.reshape(-1)[0]) if value.dtype.kind == "U" and value.size == 1 else "/"
    if len(name) > _LONGEST_NAME or {"/", "\\"} & set(name) or name.endswith(".toml"):
        # A file from a stranger must not choose which file of this computer is read.
        what = f"field 'protocol' is {str(value)[:80]!r}, which is no protocol's name"
        fix = "np.array('uav-visloc-retrieval'), or name a protocol's file with --protocol"
        raise PredictionError(what, where=arrays.path, fix=fix)
    return name


def texts(arrays: Arrays, name: str, ndim: int) -> NDArray[np.str_]:
    """Read a field of text of a number of dimensions."""
    values = arrays.read(name)
    if values.dtype.kind != "U" or values.ndim != ndim:
        raise wrong_type(
            arrays.path,
            name,
            values,
            expected=f"text with {counted(ndim, 'dimension')}, as `airzoo-bench template` has it",
            fix=f"np.array({name}, dtype=str); of numbers that count ids, np.array(ids)[{name}]",
        )
    copies = f"field '{name}' while its ids are compared"
    arrays.budget.hold(arrays.path, copies, values.nbytes * _COPIES_OF_TEXT)
    _check_characters(arrays.path, name, values)
    return values


def _check_characters(path: Path, name: str, ids: NDArray[np.str_]) -> None:
    """Refuse ids that could forge a line of a message, steer a terminal, or fill a screen."""
    for start in range(0, len(ids), _CHECKED_ROWS):
        block = ids[start : start + _CHECKED_ROWS]
        some = block.reshape(-1).tolist()
        if "".join(some).isprintable() and max(map(len, some), default=0) <= _LONGEST_ID:
            continue
        wrong = [not one.isprintable() or len(one) > _LONGEST_ID for one in some]
        rows = start + np.unique(np.flatnonzero(wrong) // (len(some) // len(block)))
        raise PredictionError(
            f"ids that are longer than {_LONGEST_ID} characters or hold some that do not print "
            f"in {first_of(rows.tolist(), len(ids), noun='row')}, counted from 0",
            where=f"{path}, field '{name}'",
            expected=f"at most {_LONGEST_ID} printable characters",
            fix="take the ids from the benchmark; `airzoo-bench template` writes them",
        )


def numbers(
    arrays: Arrays, name: str, shape: tuple[int | None, ...], *, mapped: bool = False
) -> NDArray[np.floating[Any]]:
    """Read a field of numbers; None in `shape` means any length above 0."""
    values = arrays.map(name) if mapped else arrays.read(name)
    is_number = values.dtype.kind in "biuf" and values.dtype.itemsize <= 8
    fits = len(shape) == values.ndim and all(
        want == have or (want is None and have > 0)
        for want, have in zip(shape[1:], values.shape[1:], strict=False)
    )
    if not (is_number and fits):
        sides = ", ".join("any" if want is None else str(want) for want in shape)
        expected = f"numbers of at most 64 bits, of shape ({sides})"
        fix = f"np.asarray({name}, dtype=np.float64), or np.float32, of that shape"
        raise wrong_type(arrays.path, name, values, expected=expected, fix=fix)
    if mapped:
        return values
    if values.dtype != np.float64:
        arrays.budget.hold(arrays.path, f"field '{name}' in double precision", values.size * 8)
    return as_floating(values)


def as_floating(values: NDArray[Any]) -> NDArray[np.floating[Any]]:
    """Return numbers as floating point, exact for integers of 16 bits or less."""
    if values.dtype.kind == "f":
        return values
    return values.astype(np.float32 if values.dtype.itemsize <= 2 else np.float64)


def wrong_type(
    path: Path, name: str, values: NDArray[Any], *, expected: str, fix: str
) -> PredictionError:
    """Make the error of a field of another type or shape."""
    what = f"field '{name}' is {values.dtype} of shape {values.shape}"
    return PredictionError(what, where=path, expected=expected, fix=fix)


def check_length(arrays: Arrays, name: str, values: NDArray[Any], rows: int) -> None:
    """Refuse a field that does not have a row for each id."""
    if len(values) != rows:
        ids = "gallery_ids" if name.startswith("gallery") else "query_ids"
        what = f"field '{name}' has {counted(len(values), 'row')}, '{ids}' has {rows:,}"
        what += ": is it transposed?" * (values.shape[1:2] == (rows,))
        raise PredictionError(what, where=arrays.path, expected="a row an id, in the same order")


def row_blocks(
    rows: NDArray[Any], memory_bytes: int = 8 * _BLOCK_BYTES, most_rows: int = _BLOCK_ROWS
) -> Iterator[tuple[int, NDArray[Any]]]:
    """Yield (first row, rows) in order; pages of a map that were read leave the memory."""
    row_bytes = max(1, rows.shape[1] * max(rows.dtype.itemsize, 4))
    step = max(1, min(min(_BLOCK_BYTES, memory_bytes // 8) // row_bytes, most_rows))
    for start in range(0, len(rows), step):
        yield start, np.asarray(rows[start : start + step])
        release_pages(rows)


def release_pages(rows: Any) -> None:
    """Let go of the pages of a mapped file, which count as memory of the process."""
    pages = getattr(rows, "_mmap", None)  # a copy in another process has none
    if pages is not None and rows.mode != "c" and hasattr(mmap, "MADV_DONTNEED"):
        pages.madvise(mmap.MADV_DONTNEED)


def temporary_array(shape: tuple[int, ...], dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return an array that is mapped from a file without a name, which goes with it."""
    with tempfile.TemporaryFile() as file:
        file.truncate(int(np.prod(shape)) * dtype.itemsize)
        return np.memmap(file, dtype, "r+", shape=shape)


def gather(places: Sequence[object], read: Callable[[int], NDArray[Any]]) -> NDArray[Any]:
    """Read the array of each place, all of one shape and type, into a temporary array."""
    first = read(0)
    if not first.size:
        raise PredictionError("has no numbers", where=places[0])
    whole = temporary_array((len(places), *first.shape), first.dtype)
    for row, place in enumerate(places):
        one = read(row) if row else first
        if one.shape != first.shape or one.dtype != first.dtype:
            what = f"is {one.dtype} of shape {one.shape}"
            expected = f"{first.dtype} of shape {first.shape}, as in {places[0]}"
            raise PredictionError(what, where=place, expected=expected)
        whole[row] = one
    return whole


# --- ids of queries and tiles: scene/name ---


def check_ids(ids: NDArray[np.str_], where: str) -> None:
    """Refuse ids without a scene or a name, repeated ids, and none."""
    place = np.char.find(ids, "/")
    unscened = ids[(place <= 0) | (place == np.char.str_len(ids) - 1)]
    unique, counts = np.unique(ids, return_counts=True)
    faults = {"without a scene or a name": unscened, "more than once": unique[counts > 1]}
    for fault, wrong in faults.items():
        if wrong.size or not ids.size:
            listed = first_of(map(repr, wrong.tolist()), len(ids))
            what = f"ids {fault}: {listed}" if ids.size else "holds no id"
            expected = "scene/name, such as city/DJI_0001, each once"
            raise PredictionError(what, where=where, expected=expected)


def rows_among(names: NDArray[np.str_], known: NDArray[np.str_]) -> NDArray[np.intp]:
    """Return the row of each name among known ones, -1 for the others."""
    letters = max(1, *(texts.dtype.itemsize // 4 for texts in (names, known)))

    def as_bytes(texts: NDArray[np.str_]) -> Any:
        # A text in NumPy ends in as many NUL as it is shorter: values of one width are compared.
        filled = np.ascontiguousarray(texts, f"<U{letters}")
        parts = [None, pa.py_buffer(filled)]
        return pa.FixedSizeBinaryArray.from_buffers(pa.binary(letters * 4), len(filled), parts)

    found = pc.index_in(as_bytes(names), value_set=as_bytes(known))
    return np.asarray(pc.fill_null(found, -1).to_numpy(), np.intp)
