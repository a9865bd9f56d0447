"""Records: a row a query or scene, as CSV next to their result, and checked against it.

Scores are written and read to the last bit. Arrow does both, in a fraction of the time of pandas.
"""

from __future__ import annotations

import csv
import hashlib
import math
from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
from pyarrow import csv as arrow_csv

from airzoo_bench.core.errors import ResultError
from airzoo_bench.core.files import sha256_of
from airzoo_bench.results.result import (
    SHARE_SLACK,
    Result,
    ScoreColumn,
    method_names,
    read_result,
    result_paths,
    summarise,
)
from airzoo_bench.storage.urls import ensure_file

_FIX = "score the predictions again with `airzoo-bench eval ... --out DIR`"
# Scores are averaged in the order of the rows, which need not be that of the time of writing.
_ROUNDING = 1e-9

# "007", "1e5", and an integer of which a float64 would lose digits only look like numbers.
_KINDS = (
    ("^-?(0|[1-9][0-9]*)$", pa.int64()),
    (r"^-?((0|[1-9][0-9]{0,14})|(0|[1-9][0-9]*)(\.[0-9]+|(\.[0-9]+)?e[+-][0-9]{1,3})|inf)$", None),
    ("^(True|False)$", pa.bool_()),
)


@dataclass(frozen=True)
class Method:
    """A method's name, with the file's where several have the same, its result and its records."""

    name: str
    result: Result
    records: pd.DataFrame


def read_methods(
    paths: Sequence[str | Path], columns: Collection[str] | None = None
) -> list[Method]:
    """Read results with their records."""
    files = result_paths(paths)
    results = [read_result(path) for path in files]
    names = method_names(files, results)
    return [
        Method(name, result, read_records(path, result, columns))
        for name, path, result in zip(names, files, results, strict=True)
    ]


def read_records(
    path: Path, result: Result | None = None, columns: Collection[str] | None = None
) -> pd.DataFrame:
    """Read the records next to a result, sorted by ``query``: all columns, or some besides names.

    Scores are float64, the same to the last bit as when they were written, +inf included. Other
    columns are numbers or booleans where every field is written like one, else texts.
    """
    result = read_result(path) if result is None else result
    file = ensure_file(path.with_name("records.csv"))  # of a URL, a copy too
    if not file.is_file():
        raise ResultError("the result has no records beside it", where=file, fix=_FIX)
    content = file.read_bytes()
    if hashlib.sha256(content).hexdigest() != result.records_sha256:
        what = "not the records of the result next to it: the checksum does not fit"
        raise ResultError(what, where=file, fix=_FIX)
    scores = [column.key for column in result.columns]
    names = column_names(file)
    if lacking := [name for name in ("scene", *scores) if names.count(name) != 1]:
        raise ResultError(f"lacks the column {', '.join(lacking)}", where=file, fix=_FIX)
    if columns is not None:
        names = [name for name in names if name in ("scene", "query") or name in columns]
    types = {name: pa.float64() if name in scores else pa.string() for name in names}
    converting = arrow_csv.ConvertOptions(
        column_types=types, include_columns=names, null_values=[""], strings_can_be_null=True
    )
    parsing = arrow_csv.ParseOptions(newlines_in_values=True)
    reading = arrow_csv.ReadOptions(block_size=8 << 20)
    try:
        table = arrow_csv.read_csv(pa.BufferReader(content), reading, parsing, converting)
    except pa.ArrowInvalid as error:
        raise ResultError(f"not a table of scores: {error}", where=file, fix=_FIX) from error
    known = {*scores, "scene", "query"}
    typed = {name: table[name] if name in known else _with_type(table[name]) for name in names}
    records: pd.DataFrame = pa.table(typed).to_pandas()
    if "query" not in records:
        records.insert(1, "query", records["scene"])
    return check_records(records, result, file)


def column_names(file: Path) -> list[str]:
    """Return the columns of a file of records, in their order."""
    try:
        with file.open(encoding="utf-8", newline="") as stream:
            return next(csv.reader(stream), [])
    except (UnicodeDecodeError, csv.Error) as error:
        raise ResultError(f"not a table: {error}", where=file, fix=_FIX) from error


def _with_type(texts: Any) -> Any:
    """Turn texts into what they were before they were written, where that is beyond doubt."""
    for pattern, kind in _KINDS:
        parts = (pc.match_substring_regex(t, pattern) for t in (texts.slice(0, 1), texts))
        fits = kind is None or texts.null_count == 0  # only floating point has no value
        if fits and all(pc.all(part, min_count=0).as_py() for part in parts):
            with suppress(pa.ArrowInvalid):  # too large
                return texts.cast(kind or pa.float64())
    return texts


def check_records(records: pd.DataFrame, result: Result, file: object) -> pd.DataFrame:
    """Return records sorted by ``query``, where they give the averages that a result states."""
    columns = [column for column in result.columns if column.key in records]
    rows, scenes = pd.factorize(records["scene"])
    queries = {scene: counts["queries"] for scene, counts in result.counts.items()}
    faults = []
    if records["scene"].value_counts(dropna=False).to_dict() != queries:
        faults.append("its scenes, or how many queries they have, are not those of the result")
    elif records["query"].isna().any() or not records["query"].is_unique:
        faults.append("a query has no name, or is there twice")
    for column in columns:
        values = records[column.key].to_numpy(np.float64)
        most = 1.0 + SHARE_SLACK if column.unit == "share" else np.inf
        wrong = values[~((values >= 0) & (values <= most))]
        faults += [f"{column.key} has a score of {one:g}" for one in wrong[:1]]
    if not faults:
        # Numbers in place of names: a scene's rows are found much faster.
        numbered = records[[column.key for column in columns]].assign(scene=rows)
        found = summarise(numbered, columns, range(len(scenes)))
        own = [*found.scenes.values(), found.overall, found.pooled]
        stated = [*(result.scenes[scene] for scene in scenes), result.overall, result.pooled]
        faults = [
            f"does not fit the result next to it: {key} is {value!r}, not {there[key]!r}"
            for here, there in zip(own, stated, strict=True)
            for key, value in here.items()
            if not math.isclose(value, there[key], rel_tol=_ROUNDING)
        ]
    if faults:
        raise ResultError(faults[0], where=file, fix=_FIX)
    return records.sort_values("query", ignore_index=True)


def write_csv(records: pd.DataFrame, path: Path) -> str:
    """Write a table as CSV, and return its SHA-256."""
    table = pa.table({name: _writable(records[name]) for name in records.columns})
    title = StringIO()
    csv.writer(title, lineterminator="\n").writerow(table.column_names)
    for quoting in ("none", "needed"):  # with quotes only where a text holds a comma or a quote
        options = arrow_csv.WriteOptions(include_header=False, quoting_style=quoting)
        with suppress(pa.ArrowInvalid), path.open("wb") as stream:
            stream.write(title.getvalue().encode())
            arrow_csv.write_csv(table, stream, options)
            break
    return sha256_of(path)


def _writable(column: pd.Series[Any]) -> Any:
    """Return a column as Arrow writes it; of several types, as texts."""
    try:
        values = pa.Array.from_pandas(column)
    except (pa.ArrowTypeError, pa.ArrowInvalid):
        values = pa.Array.from_pandas(column.where(column.isna(), column.astype(str)))
    return pc.if_else(values, "True", "False") if pa.types.is_boolean(values.type) else values


def join_records(
    parts: Sequence[pd.DataFrame], scores: Sequence[ScoreColumn]
) -> tuple[list[ScoreColumn], pd.DataFrame]:
    """Return the scores that any scene has, and all records: the worst where a scene lacks one."""
    records = pd.concat(parts, ignore_index=True)
    found = [score for score in scores if score.headline or score.key in records]
    lacking = {
        score.key: 0.0 if score.higher_is_better else np.inf
        for score in found
        if not all(score.key in part for part in parts)
    }
    return found, records.fillna(lacking) if lacking else records
