"""Records: a row a query or scene, read from beside their result and held to it."""

from __future__ import annotations

import hashlib
import io
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.errors import ResultError, UsageError
from airzoo_bench.result import Result, read_result

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Scored", "read_records", "read_scored"]

_SCORE_AGAIN = "score the predictions again with `airzoo-bench eval ... --out DIR`"


@dataclass(frozen=True)
class Scored:
    """A method's result and records.

    Attributes
    ----------
    name : str
        The method's, with the file's where several methods have the same.
    result : Result
    records : DataFrame
        See `read_records`.
    """

    name: str
    result: Result
    records: pd.DataFrame


def read_scored(paths: Sequence[Path]) -> list[Scored]:
    """Read results with their records.

    Raises
    ------
    UsageError
        A file is named twice.
    ResultError
        See `read_result` and `read_records`.
    """
    for path, times in Counter(path.resolve() for path in paths).items():
        if times > 1:
            raise UsageError("named twice", where=path, mend="name each result once")
    results = [read_result(path) for path in paths]
    names = Counter(result.predictions.method for result in results)
    return [
        Scored(
            method if names[method] == 1 else f"{method} ({path})",
            result,
            read_records(path, result),
        )
        for path, result in zip(paths, results, strict=True)
        for method in [result.predictions.method]
    ]


def read_records(path: Path, result: Result | None = None) -> pd.DataFrame:
    """Read the ``records.csv`` that stands beside a result.

    Parameters
    ----------
    path : Path
        Of the result.
    result : Result, optional
        Its content, where it was read before.

    Returns
    -------
    DataFrame
        The columns of the file, sorted by ``query``, which is the scene where records are of
        scenes. Scores are numbers, +inf included.

    Raises
    ------
    ResultError
        They are missing, were changed, or are not those of the result.
    """
    result = read_result(path) if result is None else result
    file = path.with_name("records.csv")
    if not result.records_sha256:
        raise ResultError("does not say which records belong to it", where=path, mend=_SCORE_AGAIN)
    if not file.is_file():
        raise ResultError(
            "no such file",
            where=file,
            expected="the records that were written beside result.json",
            mend=f"keep both in one folder, or {_SCORE_AGAIN}",
        )
    content = file.read_bytes()
    if hashlib.sha256(content).hexdigest() != result.records_sha256:
        raise ResultError(
            "not the records of the result beside it: the checksum does not fit",
            where=file,
            expected="the file as `airzoo-bench eval` wrote it together with result.json",
            mend=_SCORE_AGAIN,
        )
    return _checked(_parsed(content, result), result, file)


def _parsed(content: bytes, result: Result) -> pd.DataFrame:
    import pandas as pd

    heads = pd.read_csv(io.BytesIO(content), nrows=0).columns
    # A scene or query may be called "NA"; elsewhere an empty field has no value. Scores are
    # read as text: not every pandas reads numbers to the last digit.
    texts = {"scene", "query", *(column.key for column in result.columns)} & set(heads)
    records = pd.read_csv(
        io.BytesIO(content),
        dtype=dict.fromkeys(texts, str),
        keep_default_na=False,
        na_values={head: [""] for head in heads if head not in texts},
    )
    if "query" not in records and "scene" in records:
        records.insert(1, "query", records["scene"])
    return records


def _checked(records: pd.DataFrame, result: Result, file: Path) -> pd.DataFrame:
    needed = ["scene", "query", *(column.key for column in result.columns)]
    lacking = [name for name in needed if name not in records]
    if lacking:
        raise ResultError(f"has no column {', '.join(lacking)}", where=file, mend=_SCORE_AGAIN)
    scores = {c.key: _numbers(records[c.key].tolist(), c.key, file) for c in result.columns}
    if set(records["scene"]) != set(result.scenes) or not records["query"].is_unique:
        raise ResultError(
            "its scenes are not those of the result, or a query stands twice",
            where=file,
            mend=_SCORE_AGAIN,
        )
    return records.assign(**scores).sort_values("query", ignore_index=True)


def _numbers(texts: list[str], key: str, file: Path) -> NDArray[np.float64]:
    try:
        values = np.array([float(text) for text in texts], np.float64)
    except ValueError:
        values = np.array([np.nan])
    if np.isnan(values).any() or np.isneginf(values).any():
        raise ResultError("a score is not a number", where=f"{file}, {key}", mend=_SCORE_AGAIN)
    return values
