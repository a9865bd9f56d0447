"""Prediction files with a row a query: what the tracks share in reading, checking and writing."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, UsageError
from airzoo_bench.core.files import atomic_write, write_npz
from airzoo_bench.formats.arrays import Arrays, check_fields, protocol_name, texts

__all__ = [
    "Fields",
    "QueryPredictions",
    "check_npz",
    "errors_of",
    "read_fields",
    "write_predictions",
]

C = TypeVar("C")


@dataclass(frozen=True, eq=False)
class QueryPredictions(Generic[C]):
    """A prediction file with a row a query, as read.

    Attributes
    ----------
    protocol : str or None
        The protocol that the file names.
    query_ids : (Q,) str
        ``scene/name``.
    content : C
        What is predicted for these queries.
    """

    path: Path
    protocol: str | None
    query_ids: NDArray[np.str_]
    content: C


@dataclass(frozen=True)
class Fields(Generic[C]):
    """One of the forms that predictions of a track can have: its fields, and how to read them.

    Attributes
    ----------
    needed, optional : tuple of str
        Besides ``query_ids`` and ``protocol``. A file that has the field `marker` has this form.
    read : callable
        Takes the file's arrays and its query ids.
    """

    marker: str
    needed: tuple[str, ...]
    optional: tuple[str, ...]
    read: Callable[[Arrays, NDArray[np.str_]], C]


def read_fields(arrays: Arrays, forms: tuple[Fields[C], ...], expected: str) -> QueryPredictions[C]:
    """Read predictions in the one form that a file has."""
    found = [form for form in forms if form.marker in arrays.names()]
    if len(found) > 1:
        raise PredictionError(
            f"holds {' and '.join(form.marker for form in found)}, and they could disagree",
            where=arrays.path,
            expected=expected,
            fix="keep one of them",
        )
    form = (*found, forms[0])[0]
    allowed = ("protocol", "query_ids", *form.needed, *form.optional)
    check_fields(arrays, ("query_ids", *form.needed), allowed, expected)
    ids = texts(arrays, "query_ids", 1)
    content = form.read(arrays, ids)
    return QueryPredictions(arrays.path, protocol_name(arrays), ids, content)


def errors_of(checks: Iterable[Callable[[], None]]) -> Iterator[PredictionError]:
    """Run checks that raise, and yield what they raise."""
    for check in checks:
        try:
            check()
        except PredictionError as error:
            yield error


def check_npz(out: Path) -> None:
    """Refuse, before any work, an output name that does not end in ``.npz``."""
    if out.suffix != ".npz":
        raise UsageError("predictions are written as .npz", where=out, fix=f"name it {out}.npz")


def write_predictions(out: Path, protocol: str, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write the arrays of predictions and the name of their protocol as one ``.npz``."""
    with atomic_write(out) as stream:
        write_npz(stream, {"protocol": np.array(protocol), **arrays})
