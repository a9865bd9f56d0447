"""Records: a row a query or scene, read from next to their result and compared with it."""

from __future__ import annotations

import hashlib
import math
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from airzoo_bench.core.errors import ResultError, counted
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.results.files import method_names, records_path, result_paths
from airzoo_bench.results.records_csv import SCORE_AGAIN, column_names, no_number, read_table
from airzoo_bench.results.result import SHARE_SLACK, Result, ScoreColumn, read_result
from airzoo_bench.results.scores import Score, summarise
from airzoo_bench.storage.mirror import fetched

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

    Of a file's columns are read ``scene``, ``query`` and those of `columns`, or all where left out;
    the checksum is that of the whole file. Rows are sorted by ``query``, which is the scene where
    records are of scenes. Scores are float64, the same to the last bit as when they were written,
    +inf included. Other columns are numbers or booleans where every field is written like one, else
    texts; an empty field has no value. Refused are records of another checksum, number of queries
    or average of a score that is read.
    """
    result = read_result(path) if result is None else result
    file = records_path(path)
    content = _read_content(path, file, result)
    scores = [column.key for column in result.columns]
    names = column_names(file)
    for name, times in Counter(names).items():
        if times > 1:
            raise ResultError(f"has {times} columns {name}", where=file, fix=SCORE_AGAIN)
    lacking = [name for name in ("scene", *scores) if name not in names]
    if lacking:
        raise ResultError(f"has no column {', '.join(lacking)}", where=file, fix=SCORE_AGAIN)
    if columns is not None:
        names = [name for name in names if name in ("scene", "query") or name in columns]
    records: pd.DataFrame = read_table(file, content, names, scores).to_pandas()
    if "query" not in records:
        records.insert(1, "query", records["scene"])
    return checked_records(records, result, file)


def _read_content(path: Path, file: Path, result: Result) -> bytes:
    """Read the bytes of records and hold them to the checksum that their result states."""
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
    if hashlib.sha256(content).hexdigest() != result.records_sha256:
        # In a mirror, it may be what an upload of that time had left.
        content = fetched(file, anew=True).read_bytes()
        if hashlib.sha256(content).hexdigest() != result.records_sha256:
            raise ResultError(
                "not the records of the result next to it: the checksum does not fit",
                where=file,
                expected="the file as `airzoo-bench eval` wrote it together with result.json",
                fix=SCORE_AGAIN,
            )
    return content


def checked_records(records: pd.DataFrame, result: Result, file: object) -> pd.DataFrame:
    """Return records sorted by ``query``, where they give the averages that a result states."""
    columns = [column for column in result.columns if column.key in records]
    for column in columns:
        _check_values(records[column.key].to_numpy(np.float64), column, file)
    rows, scenes = pd.factorize(records["scene"])
    queries = records["query"]
    is_of_scenes = (rows >= 0).all() and set(scenes) == set(result.scenes)
    if not is_of_scenes or queries.isna().any() or not queries.is_unique:
        raise ResultError(
            "its scenes are not those of the result, or a query stands twice or has no name",
            where=file,
            fix=SCORE_AGAIN,
        )
    for scene, count in zip(scenes, np.bincount(rows).tolist(), strict=True):
        expected = result.counts[scene]["queries"]
        if count != expected:
            raise _unlike(f"scene {scene} has {counted(count, 'query')}", expected, file)
    # Numbers in place of names: a scene's rows are found much faster.
    numbered = records[[column.key for column in columns]].assign(scene=rows)
    _check_averages(numbered, list(scenes), result, file)
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


def _check_averages(
    numbered: pd.DataFrame, scenes: list[str], result: Result, file: object
) -> None:
    """Hold the averages of records, with numbers of scenes, against those of their result."""
    scores = [
        Score(c.key, c.title, c.unit, c.higher_is_better, c.average)
        for c in result.columns
        if c.key in numbered
    ]
    summary = summarise(numbered, scores, [*range(len(scenes))])
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
