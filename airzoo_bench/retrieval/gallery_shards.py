"""Predictions as a folder: one npz, and the gallery's descriptors in shards beside it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, first_of
from airzoo_bench.core.files import read_text
from airzoo_bench.core.plurals import counted
from airzoo_bench.formats.arrays import FIELDS, check_characters
from airzoo_bench.formats.budget import Budget
from airzoo_bench.formats.npy import map_floats
from airzoo_bench.formats.npz import NpzFile
from airzoo_bench.formats.parquet import read_columns
from airzoo_bench.retrieval.descriptor_files import COLUMN, ParquetRows, ZarrRows
from airzoo_bench.retrieval.descriptor_rows import RowParts, Rows, RowSource

__all__ = ["GALLERY", "ShardedArrays"]

GALLERY = "gallery"
"""The folder that holds the shards."""
_IDS, _ROWS = "gallery_ids", "gallery_descriptors"
_TEXT, _TABLE = ".txt", ".ids.parquet"
_MOST_SHARDS = 100_000
_LONGEST_ID = 256
_BYTES_OF_TEXT = 64  # that a text takes in Python besides its letters
_EXPECTED = (
    "NAME.npy or NAME.zarr with its ids in NAME.txt or NAME.ids.parquet, or NAME.parquet with the "
    f"columns id and {COLUMN}"
)

Read = Callable[[Path, Budget], Rows]


@dataclass(frozen=True)
class _Shard:
    """A shard as it was read: its file, its ids, its rows."""

    path: Path
    ids: NDArray[np.str_]
    rows: Rows


class ShardedArrays:
    """Arrays of a folder; see `formats.arrays.Arrays`.

    Parameters
    ----------
    path : Path
        The folder: ``predictions.npz`` has all fields but those of the gallery.
    limit_bytes : int
        The most that the arrays may take in memory together; rows of the gallery stay in files.

    Raises
    ------
    PredictionError
        A shard is damaged, has no ids or others than its rows, or does not go with the others.
    """

    def __init__(self, path: Path, limit_bytes: int) -> None:
        self.path = path
        self._fields = NpzFile(path / FIELDS, limit_bytes)
        self.budget = self._fields.budget
        both = {_IDS, _ROWS} & self._fields.names()
        if both:
            raise PredictionError(
                f"has {' and '.join(sorted(both))}, and there are shards too",
                where=path / FIELDS,
                expected=f"the gallery in {GALLERY}/ alone",
                fix="leave one of them out",
            )
        self._shards = [_read_shard(file, self.budget) for file in _files(path / GALLERY)]
        _check_alike(self._shards)
        _check_once(self._shards)

    def names(self) -> set[str]:
        """See `Arrays`."""
        return self._fields.names() | {_IDS, _ROWS}

    def read(self, name: str) -> NDArray[Any]:
        """See `Arrays`."""
        if name == _IDS:
            return np.concatenate([shard.ids for shard in self._shards])
        return self._fields.read(name)

    def map(self, name: str) -> Any:
        """See `Arrays`; descriptors of the gallery are `Rows`."""
        if name == _ROWS:
            return RowParts(tuple(shard.rows for shard in self._shards))
        return self._fields.map(name)


def _files(folder: Path) -> list[Path]:
    """Return the files of the shards, in the order of their names."""
    entries = sorted(folder.iterdir()) if folder.is_dir() else []
    shards = [one for one in entries if _kind(one) is not None]
    stems = {one.stem for one in shards}
    known = {*shards, *(one for one in entries if _of_ids(one) in stems)}
    lone = [one for one in entries if one not in known or not (one.is_file() or one.is_dir())]
    if lone:
        raise PredictionError(
            "ids of a shard that is missing" if _of_ids(lone[0]) else "is no shard",
            where=lone[0],
            expected=_EXPECTED,
            fix="write or copy the shard again, or take this away",
        )
    if not shards or len(shards) > _MOST_SHARDS:
        raise PredictionError(
            f"has {counted(len(shards), 'shard')}", where=folder, expected=_EXPECTED
        )
    return shards


def _kind(path: Path) -> Read | None:
    """Return what reads the rows of a shard; None of what is none."""
    if path.name.endswith(_TABLE):
        return None
    return _KINDS.get(path.suffix)


def _of_ids(path: Path) -> str | None:
    """Return the stem of the shard that a file has the ids of."""
    if path.name.endswith(_TABLE):
        return path.name.removesuffix(_TABLE)
    return path.stem if path.suffix == _TEXT else None


def _read_shard(path: Path, budget: Budget) -> _Shard:
    own = Budget(budget.limit_bytes)
    rows = _KINDS[path.suffix](path, own)
    if rows.dtype.kind != "f" or rows.dtype.itemsize > 8 or not rows.shape[1]:
        raise PredictionError(
            f"the shard has type {rows.dtype} and shape {rows.shape}",
            where=path,
            expected="descriptors of float16, float32 or float64, a row a tile",
        )
    place, ids = _ids_of(path, own)
    budget.hold(place, f"ids of {path.name}", ids.nbytes)
    if len(ids) != len(rows):
        raise PredictionError(
            f"the shard has {counted(len(rows), 'row')}, and {place.name} "
            f"{counted(len(ids), 'id')}",
            where=path,
            expected="an id for each row, in the same order",
            fix="write both again, together",
        )
    check_characters(place, "id", ids)
    return _Shard(path, ids, rows)


def _ids_of(path: Path, budget: Budget) -> tuple[Path, NDArray[np.str_]]:
    text, table = path.with_suffix(_TEXT), path.with_suffix(_TABLE)
    if path.suffix == ".parquet":
        return path, _column(path, budget, (COLUMN,))
    if text.is_file() == table.is_file():
        raise PredictionError(
            f"the shard has {'two files' if text.is_file() else 'no file'} of ids",
            where=path,
            expected=f"{text.name} with an id a line, or {table.name} with a column id",
            fix="write the ids of its rows beside it",
        )
    return (text, _lines(text, budget)) if text.is_file() else (table, _column(table, budget, ()))


def _column(path: Path, budget: Budget, passed_over: tuple[str, ...]) -> NDArray[np.str_]:
    ids = read_columns(path, ("id",), budget, passed_over).get("id")
    if ids is None or ids.dtype.kind != "U" or ids.ndim != 1:
        raise PredictionError("has no column 'id' of text", where=path, expected="an id a row")
    return ids


def _lines(path: Path, budget: Budget) -> NDArray[np.str_]:
    size = path.stat().st_size
    budget.hold(path, "its text", 4 * size)
    lines = read_text(path, PredictionError, "list of ids", max(size, 1)).splitlines()
    longest = max(map(len, lines), default=1)
    if longest > _LONGEST_ID:
        raise PredictionError(
            f"has a line of {longest:,} characters",
            where=path,
            expected=f"an id a line, at most {_LONGEST_ID} characters",
        )
    budget.hold(path, "its ids", len(lines) * (4 * longest + _BYTES_OF_TEXT))
    return np.array(lines, dtype=str)


def _map(path: Path, budget: Budget) -> Rows:
    del budget
    array = map_floats(path)
    if array.ndim != 2:
        raise PredictionError(
            f"the shard has shape {array.shape}", where=path, expected="(n, D), a row a tile"
        )
    return RowSource.of(array)


_KINDS: dict[str, Read] = {".npy": _map, ".parquet": ParquetRows.open, ".zarr": ZarrRows.open}


def _check_alike(shards: list[_Shard]) -> None:
    """Refuse shards of other widths or types than the first one's."""
    first = shards[0]
    for shard in shards:
        ours, theirs = (
            f"{one.rows.shape[1]:,} numbers of {one.rows.dtype}" for one in (shard, first)
        )
        if ours != theirs:
            raise PredictionError(
                f"the shard has {ours} a row, and {first.path.name} {theirs}",
                where=shard.path,
                expected="one width and one type in all shards",
                fix="describe all tiles with the same model, and save them alike",
            )


def _check_once(shards: list[_Shard]) -> None:
    """Refuse a tile that is described in two shards; of one shard, `check_ids` refuses it."""
    import pandas as pd

    ids = pd.Index(np.concatenate([shard.ids for shard in shards]))
    if ids.is_unique:
        return
    place = np.repeat(np.arange(len(shards)), [len(shard.ids) for shard in shards])
    twice = np.unique(ids[ids.duplicated()].to_numpy(str))
    both = np.flatnonzero(ids == twice[0])[:2]
    one, other = (shards[place[row]].path for row in both)
    raise PredictionError(
        f"describes {counted(len(twice), 'tile')} that {'it' if one == other else one.name} "
        f"describes too: {first_of(twice)}",
        where=other,
        expected="each tile once in all shards",
        fix="write each tile into one shard",
    )
