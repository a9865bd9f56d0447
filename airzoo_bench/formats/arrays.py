"""Fields of a prediction file by name, whatever kind of file it is."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, UnreadableError, counted, first_of
from airzoo_bench.core.registry import resolve
from airzoo_bench.formats.npz import Budget, NpzFile

_PARQUET = "airzoo_bench.formats.parquet:ParquetFile"  # pyarrow takes a while to import
_LONGEST_ID = 256
_LONGEST_NAME = 64
_BYTES_OF_DOUBLE = 8
_COPIES_OF_TEXT = 4  # that a run makes while it splits, sorts and compares ids
_BLOCK_ROWS = 1 << 14


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
    kinds = ".npz or .parquet" if columns else ".npz"
    if path.is_dir():
        raise UnreadableError("a folder, not a prediction file", where=path, expected=kinds)
    if path.suffix == ".npz":
        return NpzFile(path, limit_bytes)
    if path.suffix == ".parquet" and columns:
        opened: Arrays = resolve(_PARQUET)(path, limit_bytes, columns)
        return opened
    raise UnreadableError(
        f"unknown kind of prediction file {path.suffix!r}",
        where=path,
        expected=kinds,
        fix="`airzoo-bench template` writes an example",
    )


def check_fields(
    arrays: Arrays, needed: Collection[str], allowed: Collection[str], expected: str
) -> None:
    """Refuse a file that lacks a field, or has one that would be passed over."""
    names = arrays.names()
    missing = sorted(set(needed) - names)
    if missing:
        there = _listed(names, allowed) or "none"
        raise PredictionError(
            f"lacks the field{'s' * (len(missing) > 1)} {', '.join(missing)} (it has: {there})",
            where=arrays.path,
            expected=expected,
            fix="`airzoo-bench template` writes an example",
        )
    unknown = {name for name in names if name not in allowed}
    if unknown:
        raise PredictionError(
            f"has fields that are not read here: {_listed(unknown, allowed)}",
            where=arrays.path,
            expected="only " + ", ".join(allowed),
            fix="rename or leave them out; a misspelt field would otherwise be passed over",
        )


def _listed(names: Collection[str], known: Collection[str]) -> str:
    return ", ".join(name if name in known else repr(name[:80]) for name in sorted(names))


def protocol_name(arrays: Arrays) -> str | None:
    """Return the protocol that a file names, if it names one."""
    if "protocol" not in arrays.names():
        return None
    value = arrays.read("protocol")
    if value.dtype.kind != "U" or value.size != 1:
        raise PredictionError(
            f"field 'protocol' is {value.dtype} of shape {value.shape}",
            where=arrays.path,
            expected="one text, such as protocol='uav-visloc-retrieval'",
        )
    name = str(value.reshape(-1)[0])
    if len(name) > _LONGEST_NAME or "/" in name or "\\" in name or name.endswith(".toml"):
        # A file from a stranger must not choose which file of this computer is read.
        raise PredictionError(
            f"field 'protocol' is {name[:80]!r}, which is no protocol's name",
            where=arrays.path,
            expected="a name, such as 'uav-visloc-retrieval'",
            fix="name a protocol's file with --protocol",
        )
    return name


def texts(arrays: Arrays, name: str, ndim: int) -> NDArray[np.str_]:
    """Read a field of text of a number of dimensions."""
    values = arrays.read(name)
    if values.dtype.kind != "U" or values.ndim != ndim:
        raise wrong_type(
            arrays.path,
            name,
            values,
            expected=f"text with {ndim} dimension{'s'[: ndim - 1]}",
            fix=f"np.array({name}, dtype=str), with ids such as `airzoo-bench template` writes",
        )
    copies = f"field '{name}' while its ids are compared"
    arrays.budget.hold(arrays.path, copies, values.nbytes * _COPIES_OF_TEXT)
    _check_characters(arrays.path, name, values)
    return values


def _check_characters(path: Path, name: str, ids: NDArray[np.str_]) -> None:
    """Refuse ids that could forge a line of a message, steer a terminal, or fill a screen."""
    rows: list[int] = []
    for start in range(0, len(ids), _BLOCK_ROWS):
        block = ids[start : start + _BLOCK_ROWS]
        some = block.reshape(-1).tolist()
        if not ("".join(some).isprintable() and max(map(len, some), default=0) <= _LONGEST_ID):
            a_row = len(some) // len(block)
            wrong = [not one.isprintable() or len(one) > _LONGEST_ID for one in some]
            rows += (start + np.unique(np.flatnonzero(wrong) // a_row)).tolist()
    if rows:
        raise PredictionError(
            f"ids that are longer than {_LONGEST_ID} characters or hold some that do not print "
            f"in {first_of(rows, len(ids), noun='row')}, counted from 0",
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
        raise wrong_type(
            arrays.path,
            name,
            values,
            expected=f"numbers of at most 64 bits, of shape ({sides})",
            fix=f"np.asarray({name}, dtype=np.float64), or np.float32, of that shape",
        )
    if not mapped and values.dtype != np.float64:
        what = f"field '{name}' in double precision"
        arrays.budget.hold(arrays.path, what, values.size * _BYTES_OF_DOUBLE)
    return values if mapped else as_floating(values)


def as_floating(values: NDArray[Any]) -> NDArray[np.floating[Any]]:
    """Return numbers as floating point, which those of 16 bits or less lose nothing by."""
    if values.dtype.kind == "f":
        return values
    return values.astype(np.float32 if values.dtype.itemsize <= 2 else np.float64)


def wrong_type(
    path: Path, name: str, values: NDArray[Any], *, expected: str, fix: str
) -> PredictionError:
    """Make the error of a field of another type or shape."""
    return PredictionError(
        f"field '{name}' is {values.dtype} of shape {values.shape}",
        where=path,
        expected=expected,
        fix=fix,
    )


def check_length(arrays: Arrays, name: str, values: NDArray[Any], rows: int) -> None:
    """Refuse a field that does not have a row for each id."""
    if len(values) != rows:
        ids = "gallery_ids" if name.startswith("gallery") else "query_ids"
        raise PredictionError(
            f"field '{name}' has {counted(len(values), 'row')}, '{ids}' has {rows:,}",
            where=arrays.path,
            expected="a row an id, in the same order",
            fix="write the rows and their ids together",
        )
