"""Descriptors by image, queries and tiles together: by its name, each is the one or the other."""

from __future__ import annotations

import os
import shutil
import tempfile
import weakref
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from airzoo_bench.core.errors import PredictionError, counted, first_of
from airzoo_bench.core.files import cannot_write, temporary_file
from airzoo_bench.readers.retrieval import NamedRows, SceneImages, join

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from airzoo_bench.formats.budget import Budget
    from airzoo_bench.retrieval.predictions import RetrievalPredictions

__all__ = ["read_bag"]

_BYTES_OF_NAME = 400  # of memory, for a name and what stands for it
_DOUBLE = 8


@dataclass(frozen=True)
class _Sorted:
    """Numbers of images by what they are, in the order of their ids, and these."""

    ids: dict[int, str]
    queries: list[int]
    tiles: list[int]
    others: list[int]


def read_bag(
    path: Path,
    names: Sequence[str],
    read: Callable[[int], NDArray[Any]],
    images: SceneImages,
    budget: Budget,
) -> tuple[RetrievalPredictions, tuple[str, ...]]:
    """Read the descriptors of queries into memory; those of tiles too, or into a temporary file."""
    budget.hold(path, "the names of its images", len(names) * _BYTES_OF_NAME)
    sort = _sort(path, names, images)
    queries = _rows(path, names, sort.queries, read, budget, "the descriptors of queries")
    tiles = _rows(path, names, sort.tiles, read, budget, None)
    parts = [
        NamedRows(_ids(sort, some), rows)
        for some, rows in ((sort.queries, queries), (sort.tiles, tiles))
    ]
    notes: tuple[str, ...] = ()
    if sort.others:
        named = first_of(names[number][-80:] for number in sort.others)
        notes = (f"images that are neither queries nor tiles, left aside: {named}",)
    return join(path, parts[:1], parts[1:]), notes


def _sort(path: Path, names: Sequence[str], images: SceneImages) -> _Sorted:
    photos = _found(images.queries, names, path)
    squares = _found(images.tiles, names, path)
    both = [name for name, one, other in zip(names, photos, squares, strict=True) if one and other]
    if both:
        raise PredictionError(
            f"could be a query or a tile: {first_of([repr(name[:200]) for name in both])}",
            where=path,
            expected="names that mean one image each",
            fix="keep the folders of queries and tiles in the names",
        )
    for kind, found in (("query", photos), ("tile", squares)):
        if not any(found):
            raise PredictionError(
                f"describes no {kind} of the protocol: {first_of(map(repr, names))}",
                where=path,
                expected="a descriptor for each query and each tile",
                fix="describe both folders; a method that takes *.jpg only passes over .JPG and "
                ".png",
            )
    either = [one or other for one, other in zip(photos, squares, strict=True)]
    ids = {number: one for number, one in enumerate(either) if one is not None}
    by_id = sorted(ids, key=lambda number: ids[number])
    return _Sorted(
        ids,
        [number for number in by_id if photos[number]],
        [number for number in by_id if squares[number]],
        [number for number in range(len(names)) if number not in ids],
    )


def _found(known: Any, names: Sequence[str], path: Path) -> list[str | None]:
    """Return the id of each name; where it is none of them, all are None."""
    try:
        strange = not any(map(known.find, names))
    except PredictionError as error:
        raise error.inside(path) from error
    if strange:
        return [None] * len(names)
    found: list[str | None] = known.find_all(names, path)
    return found


def _ids(sort: _Sorted, some: Sequence[int]) -> NDArray[np.str_]:
    import numpy as np

    return np.array([sort.ids[number] for number in some], dtype=str)


def _rows(
    path: Path,
    names: Sequence[str],
    some: Sequence[int],
    read: Callable[[int], NDArray[Any]],
    budget: Budget,
    what: str | None,
) -> NDArray[np.floating[Any]]:
    """Read descriptors into one array, of the first one's length and type."""
    import numpy as np

    first = read(some[0]).reshape(-1)
    if first.dtype.kind not in "biuf" or first.dtype.itemsize > _DOUBLE or not first.size:
        raise PredictionError(
            f"{names[some[0]][:200]!r} has {first.size:,} numbers of type {first.dtype}",
            where=path,
            expected="descriptors: numbers of at most 64 bits",
            fix="write the file again",
        )
    shape = (len(some), first.size)
    needed = shape[0] * shape[1] * (first.itemsize + _DOUBLE)
    each = (_row(path, names, some[0], number, read, first) for number in some)
    room = shutil.disk_usage(tempfile.gettempdir()).free // 2
    too_much = sum(budget.taken.values()) + needed > budget.limit_bytes
    if what is None and too_much and needed <= room:
        return _on_disk(each, shape, first.dtype)
    budget.hold(path, what or "the descriptors of tiles", needed)
    rows = np.empty(shape, first.dtype)
    for row, one in enumerate(each):
        rows[row] = one
    return rows


def _row(
    path: Path,
    names: Sequence[str],
    model: int,
    number: int,
    read: Callable[[int], NDArray[Any]],
    first: NDArray[Any],
) -> NDArray[Any]:
    one = read(number).reshape(-1)
    if one.shape != first.shape or one.dtype != first.dtype:
        raise PredictionError(
            f"{names[number][:200]!r} has {counted(one.size, 'number')} of type {one.dtype}, "
            f"{names[model][:200]!r} has {first.size:,} of type {first.dtype}",
            where=path,
            expected="descriptors of one method",
            fix="describe all images with one model",
        )
    return one


def _on_disk(
    rows: Iterator[NDArray[Any]], shape: tuple[int, int], dtype: np.dtype[Any]
) -> NDArray[np.floating[Any]]:
    """Write rows to a temporary file, which goes with the array that maps it."""
    import numpy as np

    place = Path(tempfile.gettempdir())
    with ExitStack() as kept:
        try:
            handle, file = kept.enter_context(temporary_file(place / "descriptors"))
            with os.fdopen(handle, "wb") as stream:
                for row in rows:
                    stream.write(np.ascontiguousarray(row).data)
        except OSError as error:
            raise cannot_write(place, error) from error
        mapped = np.memmap(file, dtype, "r", shape=shape)
        weakref.finalize(mapped, kept.pop_all().close)
    return mapped
