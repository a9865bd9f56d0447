"""Predictions with a row a query, of all scenes in one file: read, assigned to scenes, written."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, UsageError, counted, first_of
from airzoo_bench.core.files import atomic_write, write_npz
from airzoo_bench.core.ids import rows_among
from airzoo_bench.core.validation import nearest
from airzoo_bench.evaluation.track import Assignment
from airzoo_bench.formats.arrays import Arrays, check_fields, protocol_name, texts
from airzoo_bench.protocol.model import Protocol

C = TypeVar("C")

_SHOWN = 3
_SHOWN_LETTERS = 80


@dataclass(frozen=True, eq=False)
class QueryPredictions(Generic[C]):
    """A prediction file with a row a query: N ids ``scene/name``, and the predicted `content`."""

    path: Path
    protocol: str | None
    query_ids: NDArray[np.str_]
    content: C


class QueryPart(NamedTuple):
    """The predictions of all scenes, and the row of each query of one scene, -1 for none."""

    predictions: Any
    rows: NDArray[np.intp]


def assign_queries(
    predictions: QueryPredictions[Any], truths: Sequence[Any], protocol: Protocol
) -> Assignment:
    """Find the row that answers each query."""
    ids, notes = predictions.query_ids, []
    wanted = [truth.queries["id"].to_numpy(str) for truth in truths]
    asked = np.concatenate(wanted)
    found = rows_among(asked, ids)
    if (found < 0).all():
        raise PredictionError(
            f"none of its query ids belongs to {protocol.benchmark}: {first_of(ids, len(ids))}",
            where=f"{predictions.path}, field 'query_ids'",
            expected=f"ids such as {asked[0]}: scenes as the protocol has them, no file's ending",
            fix="name the right protocol with --protocol; `airzoo-bench template` writes the ids",
        )
    missing, strange = asked[found < 0], np.delete(ids, found[found >= 0])
    ends = np.cumsum([len(some) for some in wanted])[:-1]
    parts = [QueryPart(predictions, rows) for rows in np.split(found, ends)]
    if missing.size:
        named = first_of(missing, len(asked), _SHOWN)
        notes.append(f"queries that the predictions lack, scored at their worst: {named}")
    if strange.size:
        shown = [
            repr(name[:_SHOWN_LETTERS]) + nearest(name, missing.tolist(), 1)
            for name in strange[:_SHOWN].tolist()
        ]
        named = first_of([*shown, *strange[_SHOWN:]], shown=_SHOWN)
        notes.append(f"ids of the predictions that are no queries, left aside: {named}")
    covered = f"{len(asked) - len(missing):,} of {counted(len(asked), 'query')}"
    return Assignment(parts, covered, notes, len(strange))


class Fields(NamedTuple, Generic[C]):
    """A form that predictions of a track can have; a file with the field `marker` has this form.

    `needed` and `optional` are fields besides ``query_ids`` and ``protocol``; `read` takes the
    file's arrays and its query ids.
    """

    marker: str
    needed: tuple[str, ...]
    optional: tuple[str, ...]
    read: Callable[[Arrays, NDArray[np.str_]], C]


def read_fields(arrays: Arrays, forms: tuple[Fields[C], ...], expected: str) -> QueryPredictions[C]:
    """Read predictions in the one form that a file has."""
    found = [form for form in forms if form.marker in arrays.names()]
    if len(found) > 1:
        what = f"holds {' and '.join(form.marker for form in found)}, and they could disagree"
        raise PredictionError(what, where=arrays.path, expected=expected, fix="keep one of them")
    form = (*found, forms[0])[0]
    allowed = ("protocol", "query_ids", *form.needed, *form.optional)
    check_fields(arrays, ("query_ids", *form.needed), allowed, expected)
    ids = texts(arrays, "query_ids", 1)
    return QueryPredictions(arrays.path, protocol_name(arrays), ids, form.read(arrays, ids))


def check_npz(out: Path) -> None:
    """Refuse, before any work, an output name that does not end in ``.npz``."""
    if out.suffix != ".npz":
        raise UsageError("predictions are written as .npz", where=out, fix=f"name it {out}.npz")


def write_predictions(out: Path, protocol: str, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write the arrays of predictions and the name of their protocol as one ``.npz``."""
    with atomic_write(out) as stream:
        write_npz(stream, {"protocol": np.array(protocol), **arrays})
