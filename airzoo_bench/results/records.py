"""Records: a row a query or scene, read from next to their result and compared with it."""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from airzoo_bench.core.errors import ResultError
from airzoo_bench.core.plurals import counted
from airzoo_bench.results.files import method_names, records_path, result_paths
from airzoo_bench.results.records_reading import (
    SCORE_AGAIN,
    column_names,
    no_number,
    read_table,
)
from airzoo_bench.results.result import SHARE_SLACK, Result, ScoreColumn, read_result
from airzoo_bench.results.scores import Score, Summary, summarise
from airzoo_bench.storage.mirror import fetched

if TYPE_CHECKING:
    import pandas as pd

    from airzoo_bench.geometry.arrays import Floats

__all__ = ["Scored", "checked_records", "read_records", "read_scored"]

# Scores are averaged in the order of the rows, which need not be that of the time of writing.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Scored:
    """A method's name, with the file's where several have the same, its result and its records."""

    name: str
    result: Result
    records: pd.DataFrame


def read_scored(paths: Sequence[Path], columns: Collection[str] | None = None) -> list[Scored]:
    """Read results with their records."""
    files = result_paths(paths)
    results = [read_result(path) for path in files]
    names = method_names(files, results, by_protocol=False)
    return [
        Scored(name, result, read_records(path, result, columns))
        for name, path, result in zip(names, files, results, strict=True)
    ]


def read_records(
    path: Path, result: Result | None = None, columns: Collection[str] | None = None
) -> pd.DataFrame:
    """Read the records that stand next to a result, see `airzoo_bench.results.files.records_path`.

    Parameters
    ----------
    path : Path
        Of the result.
    result : Result, optional
        Its content, where it was read before.
    columns : collection of str, optional
        What to read besides ``scene`` and ``query``; all where left out. Names that the file does
        not have are passed over. The checksum is that of the whole file all the same.

    Returns
    -------
    DataFrame
        In the order of the file's columns, sorted by ``query``, which is the scene where records
        are of scenes. Scores are float64, the same to the last bit as when they were written,
        +inf included. Other columns are numbers or booleans where every field is written like
        one, else texts; an empty field has no value.

    Raises
    ------
    ResultError
        They are missing, were changed, or are not those of the result: another checksum, number
        of queries or average of a score that is read.
    """
    result = read_result(path) if result is None else result
    file = records_path(path)
    if not result.records_sha256:
        raise ResultError("does not say which records belong to it", where=path, fix=SCORE_AGAIN)
    if not file.is_file():
        raise ResultError(
            "no such file",
            where=file,
            expected="the records that were written next to result.json",
            fix="keep both in one folder (records of a.json may be called a.records.csv), or "
            + SCORE_AGAIN,
        )
    content = file.read_bytes()
    if not _is_of(result, content):  # in a mirror, it may be what an upload of that time had left
        content = fetched(file, anew=True).read_bytes()
    if not _is_of(result, content):
        raise ResultError(
            "not the records of the result next to it: the checksum does not fit",
            where=file,
            expected="the file as `airzoo-bench eval` wrote it together with result.json",
            fix=SCORE_AGAIN,
        )
    scores = [column.key for column in result.columns]
    wanted = _wanted(column_names(file), scores, columns, file)
    records: pd.DataFrame = read_table(file, content, wanted, scores).to_pandas()
    if "query" not in records:
        records.insert(1, "query", records["scene"])
    return checked_records(records, result, file)


def _is_of(result: Result, content: bytes) -> bool:
    return hashlib.sha256(content).hexdigest() == result.records_sha256


def _wanted(
    names: list[str], scores: list[str], columns: Collection[str] | None, file: Path
) -> list[str]:
    """Return the columns to read, in their order; those that every result has must be there."""
    for name, times in Counter(names).items():
        if times > 1:
            raise ResultError(f"has {times} columns {name}", where=file, fix=SCORE_AGAIN)
    lacking = [name for name in ("scene", *scores) if name not in names]
    if lacking:
        raise ResultError(f"has no column {', '.join(lacking)}", where=file, fix=SCORE_AGAIN)
    if columns is None:
        return names
    return [name for name in names if name in ("scene", "query") or name in columns]


def checked_records(records: pd.DataFrame, result: Result, file: object) -> pd.DataFrame:
    """Return records sorted by ``query``, where they give the averages that a result states."""
    columns = [column for column in result.columns if column.key in records]
    for column in columns:
        _check_values(records[column.key].to_numpy(np.float64), column, file)
    _check_sums(records, columns, result, file)
    return records.sort_values("query", ignore_index=True)


def _check_values(values: Floats, column: ScoreColumn, file: object) -> None:
    if np.isnan(values).any() or np.isneginf(values).any():
        raise no_number(column.key, file)
    most = 1.0 + SHARE_SLACK if column.unit == "share" else np.inf
    wrong = values[(values < 0) | (values > most)]
    if wrong.size:
        raise ResultError(
            f"a score is {wrong[0]:g}",
            where=f"{file}, {column.key}",
            expected="0 to 1" if column.unit == "share" else "0 or more",
            fix=SCORE_AGAIN,
        )


def _check_sums(
    records: pd.DataFrame, columns: Sequence[ScoreColumn], result: Result, file: object
) -> None:
    """Hold the numbers of queries and the averages of records against those of their result."""
    import pandas as pd

    rows, found = pd.factorize(records["scene"])
    queries = records["query"]
    is_of_scenes = (rows >= 0).all() and set(found) == set(result.scenes)
    if not is_of_scenes or queries.isna().any() or not queries.is_unique:
        raise ResultError(
            "its scenes are not those of the result, or a query stands twice or has no name",
            where=file,
            fix=SCORE_AGAIN,
        )
    for scene, count in zip(found, np.bincount(rows).tolist(), strict=True):
        expected = result.counts[scene]["queries"]
        if count != expected:
            raise _unlike(f"scene {scene} has {counted(count, 'query')}", expected, file)
    # Numbers in place of names: a scene's rows are found much faster.
    scores = [Score(c.key, c.title, c.unit, c.higher_is_better, c.average) for c in columns]
    numbered = records[[column.key for column in columns]].assign(scene=rows)
    summary = summarise(numbered, scores, [*range(len(found))])
    _check_averages(summary, list(found), result, file)


def _check_averages(summary: Summary, scenes: list[str], result: Result, file: object) -> None:
    by_scene = zip(scenes, summary.scenes.values(), strict=True)
    parts = {f"in scene {scene}": (values, result.scenes[scene]) for scene, values in by_scene}
    parts["over scenes"] = (summary.overall, result.overall)
    parts["over all queries"] = (summary.pooled, result.pooled)
    for part, (values, expected) in parts.items():
        for key, value in values.items():
            if not math.isclose(value, expected[key], rel_tol=_ROUNDING):
                raise _unlike(f"{key} {part} is {value!r}", expected[key], file)


def _unlike(what: str, expected: float, file: object) -> ResultError:
    return ResultError(
        f"does not fit the result next to it: {what}",
        where=file,
        expected=f"{expected!r}, as the result has it",
        fix=SCORE_AGAIN,
    )
