"""Answers while they are collected: which fields they have, and what all tracks ask of them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from airzoo_bench.api.arrays import in_order
from airzoo_bench.api.labels import same_index
from airzoo_bench.core.errors import PredictionError
from airzoo_bench.core.ids import IMAGE_SUFFIXES
from airzoo_bench.core.validation import nearest
from airzoo_bench.evaluation.prediction_files import write_predictions

__all__ = [
    "DESCRIPTOR",
    "FIELDS",
    "KINDS",
    "MATCHES",
    "PAIRS",
    "POSES",
    "RANKED",
    "Collector",
    "Fields",
    "Kind",
    "QueryCollector",
    "RowFile",
    "index_of",
]

Fields = Mapping[str, Any]
A = TypeVar("A")

_FLOATS = ("float16", "float32", "float64")


@dataclass(frozen=True)
class Kind:
    """A kind of answer: its track, the fields that it has, and those that it may have."""

    track: str
    needed: tuple[str, ...]
    optional: tuple[str, ...] = ()

    def fits(self, track: str, names: Collection[str]) -> bool:
        """Tell whether fields of these names are an answer of this kind."""
        fields = {*self.needed, *self.optional}
        return track == self.track and set(self.needed) <= set(names) <= fields

    def __str__(self) -> str:
        return " and ".join((*self.needed, *(f"perhaps {name}" for name in self.optional)))


RANKED = Kind("retrieval", ("ranked_ids",), ("scores",))
DESCRIPTOR = Kind("retrieval", ("descriptor",))
MATCHES = Kind("matching", ("query_xy", "map_xy"))
PAIRS = Kind("matching", ("query_xy", "points3d"))
POSES = Kind("matching", ("rotation", "centre"))
CLOUD = Kind("reconstruction", ("points",), ("colours",))
CAMERA = Kind("reconstruction", ("rotation", "centre"))
DEPTH = Kind("reconstruction", ("depth", "intrinsics", "rotation", "centre"), ("confidence",))
KINDS = (RANKED, DESCRIPTOR, MATCHES, PAIRS, POSES, CLOUD, CAMERA, DEPTH)
FIELDS = dict.fromkeys(name for kind in KINDS for name in (*kind.needed, *kind.optional))


class Collector(ABC):
    """The answers of one kind, collected one at a time."""

    @abstractmethod
    def add(self, name: str, fields: Fields) -> None:
        """Check an answer and keep it; after a UserError nothing of it is kept."""

    @abstractmethod
    def missing(self) -> tuple[str, ...]:
        """Return the ids that have no answer yet."""

    @abstractmethod
    def write(self, path: Path, protocol: str) -> None:
        """Write the prediction file; what cannot be scored as a whole is a PredictionError."""


class QueryCollector(Collector, Generic[A]):
    """Answers of queries, kept in memory.

    Parameters
    ----------
    ids : iterable of str
        Of all queries, in the order of the file.
    """

    def __init__(self, ids: Iterable[str]) -> None:
        self._queries = {name: row for row, name in enumerate(ids)}
        self._answers: dict[int, A] = {}

    def add(self, name: str, fields: Fields) -> None:
        """See `Collector.add`."""
        row = index_of(name, self._queries, "query of the benchmark")
        same_index({key: fields[key] for key in fields if key not in POSES.needed})
        self._answers[row] = self.checked(name, row, fields)

    def missing(self) -> tuple[str, ...]:
        """See `Collector.missing`."""
        return tuple(name for name, row in self._queries.items() if row not in self._answers)

    def write(self, path: Path, protocol: str) -> None:
        """See `Collector.write`."""
        rows = sorted(self._answers)
        ids = np.array([*self._queries], dtype=str)[rows]
        fields = self.fields([self._answers[row] for row in rows])
        write_predictions(path, protocol, {"query_ids": ids, **fields})

    @abstractmethod
    def checked(self, name: str, row: int, fields: Fields) -> A:
        """Return the answer to a query as it is kept."""

    @abstractmethod
    def fields(self, answers: list[A]) -> dict[str, NDArray[Any]]:
        """Return the fields of the prediction file other than the ids."""


class RowFile:
    """Up to `count` rows of one shape, in a file, so that they may be larger than memory.

    Parameters
    ----------
    path : Path
        Made with the first row.
    field : str
        What the rows are called in messages.
    count : int
    axes : int
        How many axes a row has.
    """

    def __init__(self, path: Path, field: str, count: int, axes: int) -> None:
        self._path, self._field, self._axes = path, field, axes
        self.there = np.zeros(count, np.bool_)
        self._rows: NDArray[np.floating[Any]] | None = None

    def check(self, values: ArrayLike) -> NDArray[np.floating[Any]]:
        """Return a row as it will be kept: floating point, of shape and type of the first.

        Raises
        ------
        UserError
            It is of another shape or type, is empty, or has no floating-point numbers.
        """
        row = np.asarray(in_order(self._field, values))
        if row.dtype.name not in _FLOATS or row.ndim != self._axes or not row.size:
            raise PredictionError(
                f"{self._field} is {row.dtype} of shape {row.shape}",
                expected=f"{', '.join(_FLOATS)} with {self._axes} axes, none of them empty",
            )
        if self._rows is not None and row.shape != self._rows.shape[1:]:
            raise PredictionError(
                f"{self._field} has shape {row.shape}",
                expected=f"{self._rows.shape[1:]}, the shape of the first",
            )
        if self._rows is not None and row.dtype != self._rows.dtype:
            raise PredictionError(
                f"{self._field} is {row.dtype}, and the first was {self._rows.dtype}",
                expected="one type for all, which keeps all digits",
                fix="np.asarray(values, np.float32) for each",
            )
        return row

    def put(self, index: int, row: NDArray[np.floating[Any]]) -> None:
        """Keep a row that `check` has returned, in the type of the first."""
        if self._rows is None:
            shape = (len(self.there), *row.shape)
            self._rows = np.memmap(self._path, row.dtype, "w+", shape=shape)
        self._rows[index] = row
        self.there[index] = True

    def packed(self) -> NDArray[np.floating[Any]]:
        """Return the rows that are there, (n, ...), in order, still on disk; the last call."""
        if self._rows is None:
            raise ValueError("no row was put")
        for target, source in enumerate(np.flatnonzero(self.there)):
            if target != source:
                self._rows[target] = self._rows[source]
        return self._rows[: int(self.there.sum())]


def index_of(name: str, known: Mapping[str, int], what: str) -> int:
    """Return the row of an id.

    Raises
    ------
    PredictionError
        It is none; the one that is meant, or the nearest are offered.
    """
    if name in known:
        return known[name]
    shown = str(name)[:80]
    meant = _without_ending(shown, known)
    raise PredictionError(
        f"{shown!r} is no {what}{'' if meant else nearest(shown, list(known))}",
        expected=f"an id such as {next(iter(known), 'scene/name')}",
        fix=repr(meant) if meant else None,
    )


def _without_ending(name: str, known: Mapping[str, int]) -> str | None:
    """Return the one id that is meant by the name of a file, with or without its scene."""
    path = PurePosixPath(name)
    stem = str(path.with_suffix("")) if path.suffix.lower() in IMAGE_SUFFIXES else name
    meant = [one for one in known if one == stem or one.endswith(f"/{stem}")]
    return meant[0] if stem and len(meant) == 1 else None
