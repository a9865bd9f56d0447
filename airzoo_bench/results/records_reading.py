"""The table of a file of records: scores as numbers, the rest as it was."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

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
    """Read columns of records."""
    import pyarrow as pa

    plain = [name for name in names if name in scores]
    table = _from_csv(file, content, names, plain)
    as_text = (*plain, "scene", "query")
    return pa.table(
        {name: table[name] if name in as_text else _with_type(table[name]) for name in names}
    )


def _from_csv(file: Path, content: bytes, names: Sequence[str], scores: Sequence[str]) -> Any:
    import pyarrow as pa

    try:
        return _read_csv(content, {name: name in scores for name in names})
    except pa.ArrowInvalid as error:
        raise _refusal(content, scores, error, file) from error


def _read_csv(content: bytes, is_score: dict[str, bool]) -> Any:
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


def _refusal(content: bytes, scores: Sequence[str], error: Exception, file: Path) -> ResultError:
    """Name the score that is not a number, if that is what is wrong."""
    import pyarrow as pa

    for name in scores:
        try:
            _read_csv(content, {name: False})
            _read_csv(content, {name: True})
        except pa.ArrowInvalid as cause:
            if "conversion error" in str(cause):
                return no_number(name, file)
            break
    return _no_table(file, error)


def _no_table(file: Path, error: Exception) -> ResultError:
    return ResultError(f"not a table: {error}", where=file, fix=SCORE_AGAIN)


def no_number(key: str, file: object) -> ResultError:
    """Make the error of a score that is none."""
    return ResultError("a score is not a number", where=f"{file}, {key}", fix=SCORE_AGAIN)


def _with_type(texts: Any) -> Any:
    """Turn texts into what they were before they were written, where that is beyond doubt."""
    import pyarrow as pa
    from pyarrow import compute

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
