"""The table of a file of records: scores as numbers, the rest as it was."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import pyarrow as pa
from pyarrow import compute
from pyarrow import csv as arrow_csv

from airzoo_bench.core.errors import ResultError

__all__ = ["SCORE_AGAIN", "column_names", "no_number", "read_table"]

SCORE_AGAIN = "score the predictions again with `airzoo-bench eval ... --out DIR`"
_BLOCK_BYTES = 8 << 20

# As pandas writes numbers. What only looks like one, such as a sequence "007" or "1e5", is a text,
# and so are integers of which a float64 would lose digits.
_INTEGER = "^-?(0|[1-9][0-9]*)$"
_NUMBER = r"^-?((0|[1-9][0-9]{0,14})|(0|[1-9][0-9]*)(\.[0-9]+|(\.[0-9]+)?e[+-][0-9]{2,3})|inf)$"
_TRUTH = "^(True|False)$"


def column_names(file: Path) -> list[str]:
    """Return the columns of a file of records, in their order."""
    try:
        with file.open(encoding="utf-8", newline="") as stream:
            return next(csv.reader(stream), [])
    except (UnicodeDecodeError, csv.Error) as error:
        raise _no_table(file, error) from error


def read_table(file: Path, content: bytes, names: Sequence[str], scores: Sequence[str]) -> Any:
    """Read columns of records as an Arrow table; Arrow rounds to the nearest, as IEEE 754 asks."""
    types = {name: pa.float64() if name in scores else pa.string() for name in names}
    try:
        table = arrow_csv.read_csv(
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
    except pa.ArrowInvalid as error:
        place = re.search(r"column #(\d+): .*conversion error to double", str(error))
        if place is not None:
            raise no_number(column_names(file)[int(place[1])], file) from error
        raise _no_table(file, error) from error
    as_read = (*scores, "scene", "query")
    return pa.table({n: table[n] if n in as_read else _with_type(table[n]) for n in names})


def _no_table(file: Path, error: Exception) -> ResultError:
    return ResultError(f"not a table: {error}", where=file, fix=SCORE_AGAIN)


def no_number(key: str, file: object) -> ResultError:
    """Make the error of a score that is none."""
    return ResultError("a score is not a number", where=f"{file}, {key}", fix=SCORE_AGAIN)


def _with_type(texts: Any) -> Any:
    """Turn texts into what they were before they were written, where that is beyond doubt."""

    def all_are(pattern: str) -> bool:
        matches = compute.match_substring_regex(texts, pattern)
        return bool(compute.all(matches, min_count=0).as_py())

    if texts.null_count == 0 and all_are(_INTEGER):
        for kind in (pa.int64(), pa.uint64()):
            with suppress(pa.ArrowInvalid):  # too large
                return texts.cast(kind)
        return texts
    if all_are(_NUMBER):
        return texts.cast(pa.float64())
    if texts.null_count == 0 and all_are(_TRUTH):
        return compute.equal(texts, "True")
    return texts
