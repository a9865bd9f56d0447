"""From a file to the retrieval track's prediction type."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.errors import PredictionError
from airzoo_bench.readers.npz import NpzFile
from airzoo_bench.readers.parquet import read_columns
from airzoo_bench.retrieval.predictions import FIELDS, Descriptors, RankedIds, RetrievalPredictions

__all__ = ["read_retrieval"]

_DESCRIPTORS = {"query_descriptors", "gallery_ids", "gallery_descriptors"}


class _Arrays(Protocol):
    """Arrays of a file by name, read one at a time."""

    path: Path

    def names(self) -> set[str]: ...
    def read(self, name: str) -> NDArray[Any]: ...
    def map(self, name: str) -> NDArray[Any]: ...


class _Npz:
    def __init__(self, path: Path, limit_bytes: int) -> None:
        self.path = path
        self._file = NpzFile(path, limit_bytes)
        self.read, self.map = self._file.read, self._file.map

    def names(self) -> set[str]:
        return set(self._file.entries)


class _Parquet:
    def __init__(self, path: Path, limit_bytes: int) -> None:
        self.path = path
        columns = ("protocol", "query_ids", "ranked_ids", "scores")
        self._arrays = read_columns(path, columns, limit_bytes)

    def names(self) -> set[str]:
        return set(self._arrays)

    def read(self, name: str) -> NDArray[Any]:
        array = self._arrays[name]
        if name != "protocol":
            return array
        named = np.unique(array)
        if named.size > 1:
            raise PredictionError(f"column 'protocol' names {named.size}", where=self.path)
        return named.reshape(-1)[:1].reshape(()) if named.size else np.array("")

    map = read


def read_retrieval(path: Path, limit_bytes: int) -> RetrievalPredictions:
    """Read a prediction file of the retrieval track.

    Parameters
    ----------
    path : Path
        ``.npz`` or ``.parquet``.
    limit_bytes : int
        The most that one array may take in memory.

    Raises
    ------
    PredictionError
        Another kind of file, a field is missing, or has a wrong type or shape.
    """
    arrays = _open(path, limit_bytes)
    names = arrays.names()
    _check_names(path, names)
    query_ids = _texts(arrays, "query_ids", 1)
    claim = (
        _read_ranked(arrays, len(query_ids))
        if "ranked_ids" in names
        else _read_descriptors(arrays, len(query_ids))
    )
    return RetrievalPredictions(path, _protocol_name(arrays), query_ids, claim)


def _open(path: Path, limit_bytes: int) -> _Arrays:
    if path.is_dir():
        raise PredictionError("a folder, not a prediction file", where=path)
    if path.suffix == ".npz":
        return _Npz(path, limit_bytes)
    if path.suffix == ".parquet":
        return _Parquet(path, limit_bytes)
    raise PredictionError(
        f"unknown kind of prediction file {path.suffix!r}",
        where=path,
        expected=".npz or .parquet",
        mend="`airzoo-bench template` writes an example",
    )


def _check_names(path: Path, names: set[str]) -> None:
    ranked, described = "ranked_ids" in names, bool(names & {"query_descriptors"})
    if ranked and described:
        raise PredictionError(
            "holds both ranked_ids and query_descriptors, and they could disagree",
            where=path,
            mend="keep one of the two",
        )
    needed = {"query_ids"} | (_DESCRIPTORS if described else {"ranked_ids"})
    missing = sorted(needed - names)
    if missing:
        there = ", ".join(sorted(names)) or "none"
        raise PredictionError(
            f"lacks the field{'s' * (len(missing) > 1)} {', '.join(missing)} (it has: {there})",
            where=path,
            expected="query_ids with ranked_ids, or with " + ", ".join(sorted(_DESCRIPTORS)),
            mend="`airzoo-bench template` writes an example",
        )
    unknown = sorted(names - set(FIELDS))
    if unknown:
        raise PredictionError(
            f"has unknown fields: {', '.join(unknown)}",
            where=path,
            expected="only " + ", ".join(FIELDS),
            mend="rename or leave them out; a misspelt field would otherwise be passed over",
        )


def _protocol_name(arrays: _Arrays) -> str | None:
    if "protocol" not in arrays.names():
        return None
    value = arrays.read("protocol")
    if value.dtype.kind != "U" or value.size != 1:
        raise PredictionError(
            f"field 'protocol' is {value.dtype} of shape {value.shape}",
            where=arrays.path,
            expected="one text, such as protocol='uav-visloc-retrieval'",
        )
    return str(value.reshape(-1)[0])


def _read_ranked(arrays: _Arrays, rows: int) -> RankedIds:
    ids = _texts(arrays, "ranked_ids", 2)
    _check_length(arrays, "ranked_ids", ids, rows)
    if "scores" not in arrays.names():
        return RankedIds(ids, None)
    scores = _numbers(arrays, "scores", mapped=False)
    if scores.shape != ids.shape:
        raise PredictionError(
            f"field 'scores' has shape {scores.shape}",
            where=arrays.path,
            expected=f"the shape of ranked_ids, {ids.shape}",
        )
    return RankedIds(ids, scores.astype(np.float64))


def _read_descriptors(arrays: _Arrays, rows: int) -> Descriptors:
    gallery_ids = _texts(arrays, "gallery_ids", 1)
    queries = _numbers(arrays, "query_descriptors", mapped=False)
    gallery = _numbers(arrays, "gallery_descriptors", mapped=True)
    _check_length(arrays, "query_descriptors", queries, rows)
    _check_length(arrays, "gallery_descriptors", gallery, len(gallery_ids))
    return Descriptors(queries, gallery_ids, gallery)


def _texts(arrays: _Arrays, name: str, ndim: int) -> NDArray[np.str_]:
    values = arrays.read(name)
    if values.dtype.kind != "U" or values.ndim != ndim:
        raise _wrong_type(arrays.path, name, values, f"text with {ndim} dimension{'s'[: ndim - 1]}")
    return values


def _numbers(arrays: _Arrays, name: str, *, mapped: bool) -> NDArray[np.floating[Any]]:
    values = arrays.map(name) if mapped else arrays.read(name)
    if values.dtype.kind != "f" or values.ndim != 2 or values.shape[1] == 0:
        raise _wrong_type(arrays.path, name, values, "floating point with 2 dimensions")
    return values


def _wrong_type(path: Path, name: str, values: NDArray[Any], expected: str) -> PredictionError:
    return PredictionError(
        f"field '{name}' is {values.dtype} of shape {values.shape}", where=path, expected=expected
    )


def _check_length(arrays: _Arrays, name: str, values: NDArray[Any], rows: int) -> None:
    if len(values) != rows:
        ids = "gallery_ids" if name.startswith("gallery") else "query_ids"
        raise PredictionError(
            f"field '{name}' has {len(values):,} rows, '{ids}' has {rows:,}",
            where=arrays.path,
            expected="a row an id, in the same order",
        )
