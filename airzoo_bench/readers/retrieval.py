"""From a file to the retrieval track's prediction type."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.errors import PredictionError, first_of
from airzoo_bench.readers.npz import NpzFile
from airzoo_bench.readers.parquet import read_columns
from airzoo_bench.retrieval.predictions import FIELDS, Descriptors, RankedIds, RetrievalPredictions

__all__ = ["read_retrieval"]

_DESCRIPTORS = {"query_descriptors", "gallery_ids", "gallery_descriptors"}
_RANKED = {"ranked_ids", "scores"}
_LONGEST_ID = 256
_LONGEST_NAME = 64
_BLOCK_CODES = 1 << 22
_N_CODES = 0x110000


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
            raise PredictionError(
                f"column 'protocol' names {first_of([repr(str(one)[:80]) for one in named])}",
                where=self.path,
                expected="the same protocol in every row",
                mend="write a file for each protocol",
            )
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
        raise PredictionError(
            "a folder, not a prediction file", where=path, expected=".npz or .parquet"
        )
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
    ranked, described = "ranked_ids" in names, "query_descriptors" in names
    if ranked and described:
        raise PredictionError(
            "holds both ranked_ids and query_descriptors, and they could disagree",
            where=path,
            mend="keep one of the two",
        )
    needed = {"query_ids"} | (_DESCRIPTORS if described else {"ranked_ids"})
    missing = sorted(needed - names)
    if missing:
        there = _listed(names) or "none"
        raise PredictionError(
            f"lacks the field{'s' * (len(missing) > 1)} {', '.join(missing)} (it has: {there})",
            where=path,
            expected="query_ids with ranked_ids, or with " + ", ".join(sorted(_DESCRIPTORS)),
            mend="`airzoo-bench template` writes an example",
        )
    used = {"protocol", "query_ids"} | (_DESCRIPTORS if described else _RANKED)
    unknown = names - used
    if unknown:
        raise PredictionError(
            f"has fields that are not read here: {_listed(unknown)}",
            where=path,
            expected="only " + ", ".join(name for name in FIELDS if name in used),
            mend="rename or leave them out; a misspelt field would otherwise be passed over",
        )


def _listed(names: set[str]) -> str:
    return ", ".join(name if name in FIELDS else repr(name[:80]) for name in sorted(names))


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
    name = str(value.reshape(-1)[0])
    if len(name) > _LONGEST_NAME or "/" in name or "\\" in name or name.endswith(".toml"):
        # A file from a stranger must not choose which file of this computer is read.
        raise PredictionError(
            f"field 'protocol' is {name[:80]!r}, which is no protocol's name",
            where=arrays.path,
            expected="a name, such as 'uav-visloc-retrieval'",
            mend="name a protocol's file with --protocol",
        )
    return name


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
            mend="give a score for each ranked tile",
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
        raise _wrong_type(
            arrays.path,
            name,
            values,
            expected=f"text with {ndim} dimension{'s'[: ndim - 1]}",
            mend=f"np.array({name}, dtype=str), with ids such as City/DJI_0001",
        )
    _check_characters(arrays.path, name, values)
    return values


def _check_characters(path: Path, name: str, ids: NDArray[np.str_]) -> None:
    """Refuse ids that could forge a line of a message, steer a terminal, or fill a screen."""
    if not ids.size:
        return
    codes = np.ascontiguousarray(ids).view(np.uint32).reshape(*ids.shape, -1)
    step = max(1, _BLOCK_CODES // codes[0].size)
    blocks = [slice(start, start + step) for start in range(0, len(ids), step)]
    unprintable = np.concatenate([_unprintable(codes[b], ids[b]) for b in blocks])
    long = np.concatenate([np.char.str_len(ids[b]) > _LONGEST_ID for b in blocks])
    for wrong, what, expected in (
        (unprintable, "characters that do not print", "printable characters only"),
        (long, f"more than {_LONGEST_ID} characters", f"at most {_LONGEST_ID} characters"),
    ):
        rows = np.flatnonzero(wrong.reshape(len(ids), -1).any(axis=1)).tolist()
        if rows:
            raise PredictionError(
                f"ids with {what} in {first_of(rows, len(ids))} rows, counted from 0",
                where=f"{path}, field '{name}'",
                expected=expected,
                mend="take the ids from the benchmark; `airzoo-bench template` writes them",
            )


def _unprintable(codes: NDArray[np.uint32], ids: NDArray[np.str_]) -> NDArray[np.bool_]:
    used = np.zeros(_N_CODES, np.bool_)
    used[codes] = True
    bad = [code for code in np.flatnonzero(used[1:]) + 1 if not chr(code).isprintable()]
    nul_inside: NDArray[np.bool_] = np.count_nonzero(codes, axis=-1) != np.char.str_len(ids)
    return np.logical_or(nul_inside, np.isin(codes, bad).any(axis=-1)) if bad else nul_inside


def _numbers(arrays: _Arrays, name: str, *, mapped: bool) -> NDArray[np.floating[Any]]:
    values = arrays.map(name) if mapped else arrays.read(name)
    is_float = values.dtype.kind == "f" and values.dtype.itemsize <= 8
    if not is_float or values.ndim != 2 or (values.shape[1] == 0 and name != "scores"):
        raise _wrong_type(
            arrays.path,
            name,
            values,
            expected="floating point of 16, 32 or 64 bits, with 2 dimensions, neither of them 0",
            mend=f"np.asarray({name}, dtype=np.float32), a row an id",
        )
    return values


def _wrong_type(
    path: Path, name: str, values: NDArray[Any], *, expected: str, mend: str
) -> PredictionError:
    return PredictionError(
        f"field '{name}' is {values.dtype} of shape {values.shape}",
        where=path,
        expected=expected,
        mend=mend,
    )


def _check_length(arrays: _Arrays, name: str, values: NDArray[Any], rows: int) -> None:
    if len(values) != rows:
        ids = "gallery_ids" if name.startswith("gallery") else "query_ids"
        raise PredictionError(
            f"field '{name}' has {len(values):,} rows, '{ids}' has {rows:,}",
            where=arrays.path,
            expected="a row an id, in the same order",
            mend="write the rows and their ids together",
        )
