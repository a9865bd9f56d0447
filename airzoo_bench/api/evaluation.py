"""Scoring and checking predictions of a benchmark, from files or from arrays."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.api.arrays import in_order, path_of, text_of
from airzoo_bench.api.labels import in_axis_order, ranks_in_order, same_columns, same_index
from airzoo_bench.api.results import Result
from airzoo_bench.benchmark.mirrored import data_here
from airzoo_bench.core.errors import ArgumentError, UserError
from airzoo_bench.core.files import atomic_write, write_npz
from airzoo_bench.evaluation.evaluate import check as find_errors
from airzoo_bench.evaluation.evaluate import evaluate as score
from airzoo_bench.evaluation.opening import ReadBy
from airzoo_bench.evaluation.track import Run
from airzoo_bench.results.records import checked_records
from airzoo_bench.storage.mirror import here
from airzoo_bench.storage.urls import is_url

__all__ = ["Check", "check", "evaluate"]

_DESCRIPTORS = ("query_descriptors", "gallery_descriptors")
_RANKS = ("ranked_ids", "scores")

Predictions = str | Path | Mapping[str, Any]


def evaluate(
    predictions: Predictions,
    *,
    protocol: str | None = None,
    data: str | Path | None = None,
    method: str | None = None,
    reader: str | None = None,
    names: str | Path | None = None,
    jobs: int = 2,
    max_memory: int = 2 << 30,
) -> Result:
    """Score predictions on a benchmark folder, as ``airzoo-bench eval`` does.

    Parameters
    ----------
    predictions : path or mapping of str to array-like
        A prediction file, folder or archive; or the fields of one, as docs/predictions.md names
        them (of reconstruction a path).
    protocol : str, optional
        Name or path of a protocol; by default the predictions' own.
    data : path, optional
        The benchmark folder, or the folder that holds it; by default ``AIRZOO_BENCH_DATA``, else a
        cache folder.
    method : str, optional
        What tables call it; by default the file's name.
    reader : str, optional
        What reads files as a method writes them, by name; by default found from their content.
    names : path, optional
        A list of images, a line each, in the order in which the method saw them.
    jobs : int
        Threads; the numbers do not depend on it.
    max_memory : int
        The most that the predictions may make the run hold, in bytes.

    Returns
    -------
    Result
        Scores by scene and overall, with `records`; it shows itself as a table.

    Raises
    ------
    UserError
        The predictions, the protocol or the benchmark folder are not as they must be.

    Examples
    --------
    >>> evaluate("nowhere.npz")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    ...
    airzoo_bench.core.errors.UnreadableError: nowhere.npz: no such prediction file...
    """
    used = text_of("protocol", protocol)
    with _as_path(predictions, used) as path:
        done = score(
            path,
            data=_folder(data),
            protocol=used,
            method=text_of("method", method),
            run=Run(memory_bytes=max_memory, jobs=jobs),
            read_by=_read_by(reader, names),
        )
    records = done.records
    if "query" not in records:
        records = records.assign(query=records["scene"])
    name = done.result.predictions.method
    return Result(name, done.result, checked_records(records, done.result, name))


def _read_by(reader: str | None, names: str | Path | None) -> ReadBy:
    return ReadBy(reader, None if names is None else Path(names))


@dataclass(frozen=True)
class Check:
    """What is wrong with predictions, and what one may wish to know.

    Attributes
    ----------
    errors : tuple of UserError
        What `evaluate` would refuse.
    notes : tuple of str
    """

    errors: tuple[UserError, ...]
    notes: tuple[str, ...]

    @property
    def ok(self) -> bool:
        """Whether nothing is wrong."""
        return not self.errors

    def __repr__(self) -> str:
        said = [*map(str, self.errors), *(f"note: {note}" for note in self.notes)]
        return "\n".join(said) or "nothing wrong was found"

    def _repr_html_(self) -> str:
        from html import escape

        return f"<pre>{escape(repr(self))}</pre>"


def check(
    predictions: Predictions,
    *,
    protocol: str | None = None,
    data: str | Path | None = None,
    reader: str | None = None,
    names: str | Path | None = None,
    max_memory: int = 2 << 30,
) -> Check:
    """Find all that is wrong with predictions, without scoring them.

    Parameters
    ----------
    predictions, protocol, data, reader, names, max_memory : optional
        See `evaluate`. Without the benchmark folder all is done that can be.

    Returns
    -------
    Check
        It shows itself as a list of sentences.

    Raises
    ------
    UserError
        There is nothing to check: no such file, or no protocol that is known.

    Examples
    --------
    >>> check({"query_ids": ["city/1"]})  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    ...
    airzoo_bench.core.errors.ArgumentError: predictions as arrays do not say...
    """
    used = text_of("protocol", protocol)
    with _as_path(predictions, used) as path:
        found = find_errors(
            path,
            data=_folder(data),
            protocol=used,
            run=Run(memory_bytes=max_memory),
            read_by=_read_by(reader, names),
        )
    return Check(tuple(found.errors), tuple(found.notes))


def _folder(data: str | Path | None) -> Path:
    return data_here(data if data is None or is_url(data) else path_of("data", data))


def _field(name: str, values: Any) -> NDArray[Any]:
    """Return a field as an array of numbers or text; columns of pandas hold text as objects."""
    ordered = in_order(name, values)
    ordered = in_axis_order(ordered) if hasattr(ordered, "columns") else ordered
    try:
        array = np.asarray(ordered)
    except ValueError as error:
        raise ArgumentError(
            f"field {name!r} cannot be an array: {error}",
            expected="rows of one length",
            fix="fill shorter lists with empty ids",
        ) from error
    if array.dtype != np.dtype(object):
        return array
    if not all(isinstance(value, str) for value in array.ravel()):
        raise ArgumentError(
            f"field {name!r} holds Python objects, or lists of different lengths",
            expected="an array of numbers or text",
            fix="np.array(values, dtype=str) for ids",
        )
    return array.astype(str)


@contextmanager
def _as_path(predictions: Predictions, protocol: str | None) -> Iterator[Path]:
    """Give the path of predictions; arrays are written to a file first, as a user would."""
    if isinstance(predictions, str | Path):
        yield here(predictions)
        return
    if not isinstance(predictions, Mapping):
        raise ArgumentError(
            f"predictions are of type {type(predictions).__name__}",
            expected="a path, or a dict of the fields of a prediction file",
        )
    of_gallery = {name: rows for name, rows in predictions.items() if name.startswith("gallery")}
    same_index({name: rows for name, rows in predictions.items() if name not in of_gallery})
    same_index(of_gallery)
    same_columns({name: rows for name, rows in predictions.items() if name in _DESCRIPTORS})
    for name in _RANKS:
        ranks_in_order(name, predictions.get(name))
    fields = {name: _field(name, values) for name, values in predictions.items()}
    if protocol is None and "protocol" not in fields:
        raise ArgumentError(
            "predictions as arrays do not say which protocol they are for",
            expected="protocol=, or a field 'protocol', with the name of one",
            fix="`airzoo-bench protocols` lists them",
        )
    with TemporaryDirectory() as folder:
        path = Path(folder, "predictions.npz")
        with atomic_write(path) as stream:
            write_npz(stream, fields)
        yield path
