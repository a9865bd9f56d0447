"""Records as CSV, both ways.

Written are the bytes that pandas writes, block by block, in a fraction of its time; read are scores
as numbers to the last bit, and the rest as it was.
"""

from __future__ import annotations

import csv
import hashlib
import io
import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
from pyarrow import csv as arrow_csv

from airzoo_bench.core.errors import ResultError

__all__ = ["SCORE_AGAIN", "column_names", "csv_blocks", "no_number", "read_table", "write_csv"]

SCORE_AGAIN = "score the predictions again with `airzoo-bench eval ... --out DIR`"
_BLOCK_BYTES = 8 << 20

# As pandas writes numbers. What only looks like one, such as a sequence "007" or "1e5", is a text,
# and so are integers of which a float64 would lose digits.
_INTEGER = "^-?(0|[1-9][0-9]*)$"
_NUMBER = r"^-?((0|[1-9][0-9]{0,14})|(0|[1-9][0-9]*)(\.[0-9]+|(\.[0-9]+)?e[+-][0-9]{2,3})|inf)$"
_TRUTH = "^(True|False)$"

_ROWS = 1 << 16  # written at a time
_PLAIN = (1e-4, 1e9)  # Arrow writes as Python does between these, numbers that are not whole


def write_csv(records: pd.DataFrame, path: Path) -> str:
    """Write a table as CSV, and return its SHA-256."""
    digest = hashlib.sha256()
    with path.open("wb") as stream:
        for block in csv_blocks(records):
            stream.write(block)
            digest.update(block)
    return digest.hexdigest()


def csv_blocks(records: pd.DataFrame) -> Iterator[bytes]:
    """Yield a table as CSV in UTF-8, the titles first."""
    yield _lines([_quoted(pa.array([str(name)], pa.large_string())) for name in records.columns])
    for start in range(0, len(records), _ROWS):
        block = records.iloc[start : start + _ROWS]
        yield _lines([_texts(block.iloc[:, place]) for place in range(block.shape[1])])


def _lines(columns: list[Any]) -> bytes:
    return _content(_join([_join(columns, ","), _text("")], "\n"))


def _join(columns: list[Any], separator: str) -> Any:
    return pc.binary_join_element_wise(*columns, _text(separator))


def _text(value: str) -> Any:
    return pa.scalar(value, pa.large_string())


def _content(texts: Any) -> bytes:
    """Return an array of texts as one."""
    _, offsets, content = texts.buffers()
    first, last = np.frombuffer(offsets, np.int64)[[texts.offset, texts.offset + len(texts)]]
    return bytes(memoryview(content)[first:last]) if last > first else b""


def _texts(column: pd.Series[Any]) -> Any:
    """Return a column as it is written, an array of large strings."""
    kind = column.dtype.kind if isinstance(column.dtype, np.dtype) else "O"
    if column.dtype == np.float64:
        return _write_floats(column.to_numpy())
    if kind == "b":
        return pc.if_else(pa.array(column.to_numpy()), _text("True"), _text("False"))
    if kind in "iu":
        return pa.array(column.to_numpy()).cast(pa.large_string())
    try:
        texts = pa.array(
            column if kind == "O" else column.astype(object), pa.large_string(), from_pandas=True
        )
    except (pa.ArrowTypeError, pa.ArrowInvalid):  # not of texts alone
        written = column.to_csv(index=False, header=False, lineterminator="\n")
        rows = csv.reader(io.StringIO(written, newline=""))
        texts = pa.array([row[0] for row in rows], pa.large_string())
    if isinstance(texts, pa.ChunkedArray):  # as pandas keeps texts
        texts = texts.combine_chunks()
    return _quoted(pc.fill_null(texts, _text("")))


def _write_floats(values: Any) -> Any:
    """Write each different value once, as Python does: scores of queries repeat."""
    # By their bits, since 0.0 equals -0.0.
    found = pa.array(values.view(np.int64)).dictionary_encode()
    different = found.dictionary.to_numpy().view(np.float64)
    size = np.abs(different)
    plain = (size >= _PLAIN[0]) & (size < _PLAIN[1]) & (different != np.trunc(different))
    others = ["" if value != value else repr(value) for value in different[~plain].tolist()]
    by_arrow = pa.array(different).cast(pa.large_string())
    replaced = pa.array(others, pa.large_string())
    return pc.replace_with_mask(by_arrow, pa.array(~plain), replaced).take(found.indices)


def _quoted(texts: Any) -> Any:
    content = _content(texts)
    if not any(mark in content for mark in (b",", b'"', b"\r", b"\n")):
        return texts
    doubled = _join([_text(""), pc.replace_substring(texts, '"', '""'), _text("")], '"')
    return pc.if_else(pc.match_substring_regex(texts, '[,"\r\n]'), doubled, texts)


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
        matches = pc.match_substring_regex(texts, pattern)
        return bool(pc.all(matches, min_count=0).as_py())

    if texts.null_count == 0 and all_are(_INTEGER):
        for kind in (pa.int64(), pa.uint64()):
            with suppress(pa.ArrowInvalid):  # too large
                return texts.cast(kind)
        return texts
    if all_are(_NUMBER):
        return texts.cast(pa.float64())
    if texts.null_count == 0 and all_are(_TRUTH):
        return pc.equal(texts, "True")
    return texts
