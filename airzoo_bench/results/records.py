"""Records: a row a query or scene, read from next to their result and compared with it."""

from __future__ import annotations

import csv
import hashlib
import io
import math
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from airzoo_bench.core.errors import ResultError
from airzoo_bench.core.plurals import counted
from airzoo_bench.results.files import method_names, records_path, result_paths
from airzoo_bench.results.result import SHARE_SLACK, Result, ScoreColumn, read_result
from airzoo_bench.results.scores import Score, Summary, summarise

if TYPE_CHECKING:
    import pandas as pd

    from airzoo_bench.geometry.arrays import Floats

__all__ = ["Scored", "checked_records", "read_records", "read_scored"]

_SCORE_AGAIN = "score the predictions again with `airzoo-bench eval ... --out DIR`"
_BLOCK_BYTES = 8 << 20
# Scores are averaged in the order of the rows, which need not be that of the time of writing.
_ROUNDING = 1e-9

# As pandas writes numbers. What only looks like one, such as a sequence "007" or "1e5", is a text.
_INTEGER = "^-?(0|[1-9][0-9]{0,17})$"
_NUMBER = r"^-?((0|[1-9][0-9]*)(\.[0-9]+)?(e[+-][0-9]{2,3})?|inf)$"
_TRUTH = "^(True|False)$"


@dataclass(frozen=True)
class Scored:
    """A method's name, with the file's where several have the same, its result and its records."""

    name: str
    result: Result
    records: pd.DataFrame


def read_scored(paths: Sequence[Path], columns: Collection[str] | None = None) -> list[Scored]:
    """Read results with their records.

    Parameters
    ----------
    paths : sequence of Path
        Of results, or of the folders that hold one.
    columns : collection of str, optional
        See `read_records`.

    Raises
    ------
    UsageError
        A file is named twice.
    ResultError
        See `read_result` and `read_records`.
    """
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
        raise ResultError("does not say which records belong to it", where=path, fix=_SCORE_AGAIN)
    if not file.is_file():
        raise ResultError(
            "no such file",
            where=file,
            expected="the records that were written next to result.json",
            fix="keep both in one folder (records of a.json may be called a.records.csv), or "
            + _SCORE_AGAIN,
        )
    content = file.read_bytes()
    if hashlib.sha256(content).hexdigest() != result.records_sha256:
        raise ResultError(
            "not the records of the result next to it: the checksum does not fit",
            where=file,
            expected="the file as `airzoo-bench eval` wrote it together with result.json",
            fix=_SCORE_AGAIN,
        )
    scores = [column.key for column in result.columns]
    wanted = _wanted(_column_names(content, file), scores, columns, file)
    records = _parsed(content, wanted, scores, file)
    return checked_records(records, result, file)


def _column_names(content: bytes, file: Path) -> list[str]:
    try:
        stream = io.TextIOWrapper(io.BytesIO(content), "utf-8", newline="")
        names = next(csv.reader(stream), [])
    except (UnicodeDecodeError, csv.Error) as error:
        raise ResultError(f"not a table: {error}", where=file, fix=_SCORE_AGAIN) from error
    for name, times in Counter(names).items():
        if times > 1:
            raise ResultError(f"has {times} columns {name}", where=file, fix=_SCORE_AGAIN)
    return names


def _wanted(
    names: list[str], scores: list[str], columns: Collection[str] | None, file: Path
) -> list[str]:
    """Return the columns to read, in their order; those that every result has must be there."""
    lacking = [name for name in ("scene", *scores) if name not in names]
    if lacking:
        raise ResultError(f"has no column {', '.join(lacking)}", where=file, fix=_SCORE_AGAIN)
    if columns is None:
        return names
    return [name for name in names if name in ("scene", "query") or name in columns]


def _parsed(content: bytes, wanted: list[str], scores: list[str], file: Path) -> pd.DataFrame:
    import pyarrow as pa

    try:
        table = _read(content, {name: name in scores for name in wanted})
    except pa.ArrowInvalid as error:
        raise _refusal(content, [name for name in wanted if name in scores], error, file) from error
    data = {
        name: table[name] if name in (*scores, "scene", "query") else _with_type(table[name])
        for name in wanted
    }
    records: pd.DataFrame = pa.table(data).to_pandas()
    if "query" not in records:
        records.insert(1, "query", records["scene"])
    return records


def _read(content: bytes, is_score: dict[str, bool]) -> Any:
    """Read columns as numbers or texts; Arrow rounds as IEEE 754 asks, to the nearest."""
    import pyarrow as pa
    from pyarrow import csv as arrow_csv

    types = {name: pa.float64() if score else pa.string() for name, score in is_score.items()}
    return arrow_csv.read_csv(
        pa.BufferReader(content),
        read_options=arrow_csv.ReadOptions(block_size=_BLOCK_BYTES),
        parse_options=arrow_csv.ParseOptions(newlines_in_values=True),
        convert_options=arrow_csv.ConvertOptions(
            column_types=types,
            include_columns=list(types),
            null_values=[""],
            strings_can_be_null=True,
        ),
    )


def _refusal(content: bytes, scores: list[str], error: Exception, file: Path) -> ResultError:
    """Name the score that is not a number, if that is what is wrong."""
    import pyarrow as pa

    for name in scores:
        try:
            _read(content, {name: False})
            _read(content, {name: True})
        except pa.ArrowInvalid as cause:
            if "conversion error" in str(cause):
                return _no_number(name, file)
            break
    return ResultError(f"not a table: {error}", where=file, fix=_SCORE_AGAIN)


def _no_number(key: str, file: object) -> ResultError:
    return ResultError("a score is not a number", where=f"{file}, {key}", fix=_SCORE_AGAIN)


def _with_type(texts: Any) -> Any:
    """Turn texts into what they were before they were written, where that is beyond doubt."""
    import pyarrow as pa
    from pyarrow import compute

    def all_are(pattern: str) -> bool:
        matches = compute.match_substring_regex(texts, pattern)
        return bool(compute.all(matches, min_count=0).as_py())

    if texts.null_count == 0 and all_are(_INTEGER):
        return texts.cast(pa.int64())
    if all_are(_NUMBER):
        return texts.cast(pa.float64())
    if texts.null_count == 0 and all_are(_TRUTH):
        return compute.equal(texts, "True")
    return texts


def checked_records(records: pd.DataFrame, result: Result, file: object) -> pd.DataFrame:
    """Return records sorted by ``query``, where they give the averages that a result states.

    Raises
    ------
    ResultError
        They do not: one of the two was edited, or they are of different runs. `file` is named.
    """
    columns = [column for column in result.columns if column.key in records]
    for column in columns:
        _check_values(records[column.key].to_numpy(np.float64), column, file)
    _check_sums(records, columns, result, file)
    return records.sort_values("query", ignore_index=True)


def _check_values(values: Floats, column: ScoreColumn, file: object) -> None:
    if np.isnan(values).any() or np.isneginf(values).any():
        raise _no_number(column.key, file)
    most = 1.0 + SHARE_SLACK if column.unit == "share" else np.inf
    wrong = values[(values < 0) | (values > most)]
    if wrong.size:
        raise ResultError(
            f"a score is {wrong[0]:g}",
            where=f"{file}, {column.key}",
            expected="0 to 1" if column.unit == "share" else "0 or more",
            fix=_SCORE_AGAIN,
        )


def _check_sums(
    records: pd.DataFrame, columns: Sequence[ScoreColumn], result: Result, file: object
) -> None:
    """Hold the numbers of queries and the averages of records against those of their result."""
    import pandas as pd

    rows, found = pd.factorize(records["scene"])
    if (rows < 0).any() or set(found) != set(result.scenes) or not records["query"].is_unique:
        raise ResultError(
            "its scenes are not those of the result, or a query stands twice",
            where=file,
            fix=_SCORE_AGAIN,
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
        fix=_SCORE_AGAIN,
    )
