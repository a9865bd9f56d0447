"""Ranked ids and positives as people hold them, into tile indices as the track ranks them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass
from numbers import Integral
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.api.arrays import floats, in_order, listed
from airzoo_bench.core.errors import ArgumentError, first_of
from airzoo_bench.geometry.arrays import Floats, Ints
from airzoo_bench.retrieval.truth import Positives, offsets_of

__all__ = [
    "Ids",
    "Lists",
    "gallery_row",
    "id_row",
    "id_rows",
    "indexed_lists",
    "paired_queries",
    "score_rows",
]

Ids = NDArray[Any]

_FEWEST_FLAGS = 3  # ids of a query are distinct, so that two at most are 0 or 1
_KINDS = {"i": "whole numbers", "u": "whole numbers", "U": "texts"}


@dataclass(frozen=True, eq=False)
class Lists:
    """Ranked lists (Q, K) of indices into a gallery, -1 beyond their ends, and positives."""

    ranked: Ints
    positives: Positives
    n_tiles: int


def paired_queries(ranked: Any, positives: Any) -> tuple[list[Any], Any, Any]:
    """Return the names of queries, and both arguments in their order."""
    if isinstance(ranked, Mapping) != isinstance(positives, Mapping):
        raise ArgumentError(
            "one is a mapping by query and the other is not",
            where="ranked_ids, positives",
            expected="both by query id, or both in one order of the queries",
        )
    if not isinstance(positives, Mapping):
        return list(range(_length("positives", positives))), ranked, positives
    strange = [query for query in ranked if query not in positives]
    if strange:
        raise ArgumentError(
            f"queries that positives lacks: {first_of(strange, len(ranked))}",
            where="ranked_ids",
            expected="no query beyond those of positives",
        )
    names = list(positives)
    return names, [ranked.get(name, ()) for name in names], list(positives.values())


def _length(name: str, rows: Any) -> int:
    try:
        return len(rows)
    except TypeError as error:
        raise ArgumentError(
            f"is {type(rows).__name__}", where=name, expected="a list of ids for each query"
        ) from error


def id_rows(name: str, rows: Any, count: int, *, unordered: bool = False) -> list[Ids]:
    """Return a number of rows of ids; a row may have any length."""
    rows = in_order(name, rows)
    given = np.asarray(rows) if hasattr(rows, "__array__") else rows
    if isinstance(given, str | bytes) or _length(name, given) != count:
        have = "text" if isinstance(given, str | bytes) else f"{len(given)} rows"
        raise ArgumentError(f"has {have}", where=name, expected=f"{count}, a row a query")
    return [id_row(f"{name}[{place}]", row, unordered=unordered) for place, row in enumerate(given)]


def id_row(name: str, values: Any, *, unordered: bool = False) -> Ids:
    """Return ids as integers or texts; only where their order says nothing may they be a set."""
    if isinstance(values, str | bytes) or not isinstance(values, Iterable):
        raise ArgumentError(
            f"is {values!r}", where=name, expected="several ids, such as ['a', 'b'] or [3, 5]"
        )
    values = values if unordered and isinstance(values, Set) else in_order(name, values)
    given = np.asarray(values) if hasattr(values, "__array__") else list(values)
    if unordered:
        _refuse_relevances(name, given)
    array = given if isinstance(given, np.ndarray) else _of_objects(name, given)
    if array.dtype.kind == "O":  # as pandas keeps texts
        array = _of_objects(name, array.ravel().tolist())
    if array.ndim != 1:
        raise ArgumentError(f"has shape {array.shape}", where=name, expected="ids in a row")
    if array.size and array.dtype.kind not in _KINDS:
        raise _unlike(name, str(array.dtype))
    return array if array.size else np.zeros(0, np.int64)


def _refuse_relevances(name: str, row: Ids | list[Any]) -> None:
    """Refuse a row that says 0 or 1 of every tile: its zeros and ones are no ids."""
    values = row.tolist() if isinstance(row, np.ndarray) else row
    numeric = (int, float, np.number, np.bool_)
    if len(values) >= _FEWEST_FLAGS and all(isinstance(v, numeric) and v in (0, 1) for v in values):
        raise ArgumentError(
            f"holds {len(values)} values that are all 0 or 1",
            where=name,
            expected="the ids that answer the query, each once",
            fix="np.flatnonzero(row), where the row says of every tile whether it is a positive",
        )


def _of_objects(name: str, values: list[Any]) -> Ids:
    """Make an array of ids of one kind; NumPy would turn numbers among texts into texts."""
    kinds = {str if isinstance(value, str) else type(value) for value in values}
    is_text, is_mixed = str in kinds, len(kinds) > 1
    if bool in kinds or (is_text and is_mixed):
        raise _unlike(name, " and ".join(sorted(kind.__name__ for kind in kinds)))
    try:
        array = np.array(values)
    except ValueError as error:
        raise _unlike(name, "lists of unequal lengths") from error
    if values and array.dtype.kind in "fO" and all(isinstance(value, Integral) for value in values):
        return _of_large_numbers(name, values)
    return array


def _of_large_numbers(name: str, values: list[Any]) -> Ids:
    """Keep ids from 2**63 on, which NumPy joins with smaller ones as float64."""
    if min(values) < 0 or max(values) >= 1 << 64:
        raise ArgumentError(
            f"holds whole numbers from {min(values)} to {max(values)}",
            where=name,
            expected="ids that one integer type of 64 bits holds",
            fix="make texts of them: str(id)",
        )
    return np.array(values, np.uint64)


def _unlike(name: str, found: str) -> ArgumentError:
    return ArgumentError(
        f"holds {found}", where=name, expected="ids that are all whole numbers, or all texts"
    )


def _one_kind(parts: Mapping[str, Sequence[Ids]]) -> None:
    """Refuse texts among whole numbers, which never match."""
    kinds = {
        _KINDS[row.dtype.kind]: name for name, rows in parts.items() for row in rows if len(row)
    }
    if len(kinds) > 1:
        raise ArgumentError(
            "; ".join(f"{name} holds {kind}" for kind, name in kinds.items()),
            where="ids",
            expected="the same kind of id everywhere",
            fix="turn one into the other: str(id), or int(id)",
        )


def _positive_rows(places: Sequence[Ints]) -> Positives:
    """Return the positives of queries from indices, each once."""
    distinct = [np.unique(place) for place in places]
    counts = np.array([len(place) for place in distinct], np.int64)
    tiles = np.concatenate([np.zeros(0, np.int64), *distinct]).astype(np.int32)
    return Positives(offsets_of(counts), tiles)


def gallery_row(ids: Any, count: int) -> Ids:
    """Return the ids of a number of tiles: their indices where no ids are given."""
    if ids is None:
        return np.arange(count)
    found = id_row("gallery_ids", ids)
    if len(found) != count:
        raise ArgumentError(
            f"has {len(found)} ids", where="gallery_ids", expected=f"{count}, one for each tile"
        )
    return found


def score_rows(scores: Any, ranked: Ints) -> Floats:
    """Return scores in the shape of the lists; what stands beyond a list's end does not count."""
    lists = [
        floats(f"scores[{place}]", row, (None,))
        for place, row in enumerate(listed("scores", scores))
    ]
    filled = np.full(ranked.shape, np.nan)
    lengths = [len(row) for row in lists]
    least = (ranked >= 0).sum(axis=1).tolist()
    fits = len(lists) == len(ranked) and all(
        low <= length <= ranked.shape[1] for low, length in zip(least, lengths, strict=True)
    )
    if not fits:
        raise ArgumentError(
            f"has {len(lists)} rows of {sorted(set(lengths))[:3]} numbers",
            where="scores",
            expected=f"{len(ranked)} rows, a number for each ranked id",
        )
    for row, values in zip(filled, lists, strict=True):
        row[: len(values)] = values
    return filled


def indexed_lists(ranked: Sequence[Ids], positives: Sequence[Ids], gallery: Ids | None) -> Lists:
    """Turn ids into their places among all ids, sorted: rows of a gallery as the track has it."""
    parts = {"ranked_ids": ranked, "positives": positives}
    _one_kind(parts if gallery is None else {**parts, "gallery_ids": [gallery]})
    rest = [] if gallery is None else [gallery]
    given = [row for row in (*ranked, *positives, *rest) if len(row)]
    if {row.dtype.kind for row in given} == {"i", "u"}:  # which NumPy joins as float64
        given = [row.astype(object) for row in given]
    known, place = np.unique(np.concatenate(given or [np.zeros(0)]), return_inverse=True)
    ended = known == ("" if known.dtype.kind == "U" else -1)
    index = np.cumsum(~ended) - 1
    index[ended] = -1
    lengths = [len(row) for row in (*ranked, *positives)]
    rows = np.split(index[place], np.cumsum(lengths))
    wanted = rows[len(ranked) : -1]
    _check_positives(wanted)
    if gallery is not None:
        _check_grades(wanted, len(gallery))
        _check_gallery(gallery, rows[-1], known[~ended])
    matrix = np.full((len(ranked), max(map(len, ranked), default=0)), -1, np.int64)
    for row, found in zip(matrix, rows, strict=False):
        row[: len(found)] = found
    return Lists(matrix, _positive_rows(wanted), int((~ended).sum()))


def _check_positives(rows: Sequence[Ints]) -> None:
    ended = [place for place, row in enumerate(rows) if (row < 0).any()]
    if ended:
        raise ArgumentError(
            f"holds -1 or an empty id for queries {first_of(ended, len(rows))}",
            where="positives",
            expected="ids of the gallery",
        )


def _check_grades(rows: Sequence[Ints], count: int) -> None:
    """Refuse rows with a value for each tile: ids are not repeated, grades of relevance are."""
    repeated = [place for place, row in enumerate(rows) if len(np.unique(row)) < len(row) == count]
    if repeated:
        raise ArgumentError(
            f"holds ids twice, and as many as the gallery, for queries "
            f"{first_of(repeated, len(rows))}",
            where="positives",
            expected="the ids that answer the query, each once",
            fix="np.flatnonzero(row), where the row says of every tile how relevant it is",
        )


def _check_gallery(gallery: Ids, places: Ints, known: Ids) -> None:
    if len(np.unique(places)) < len(places) or (places < 0).any():
        raise ArgumentError(
            "holds an id twice, or an empty one", where="gallery_ids", expected="each id once"
        )
    strange = np.delete(known, places)
    if strange.size:
        raise ArgumentError(
            f"ids that gallery_ids lacks: {first_of(strange.tolist())}",
            where="ranked_ids, positives",
            expected=f"ids such as {gallery[0]}" if len(gallery) else "ids of gallery_ids",
        )
