"""Records as CSV: the bytes that pandas writes, block by block, in a fraction of its time."""

from __future__ import annotations

import csv
import hashlib
import io
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["csv_blocks", "write_csv"]

_ROWS = 1 << 16  # written at a time
_QUOTED = '[,"\r\n]'
# Arrow writes as Python does, in a fraction of its time: numbers between these that are not whole,
_PLAIN = (1e-4, 1e9)
# those below the first of these, and those up to the second but for a zero: 1e-7 for 1e-07.
_SMALL = (1e-9, 1e-6)


def write_csv(records: pd.DataFrame, path: Path) -> str:
    """Write a table as CSV, each block while the next one is made."""
    digest = hashlib.sha256()
    with path.open("wb") as stream, ThreadPoolExecutor(1) as writer:

        def write(block: bytes) -> None:
            stream.write(block)
            digest.update(block)

        last: Future[None] | None = None
        for block in csv_blocks(records):
            if last is not None:
                last.result()
            last = writer.submit(write, block)
        if last is not None:
            last.result()
    return digest.hexdigest()


def csv_blocks(records: pd.DataFrame) -> Iterator[bytes]:
    r"""Yield a table as CSV in UTF-8, the titles first."""
    import pyarrow as pa

    yield _lines([_quoted(pa.array([str(name)], pa.large_string())) for name in records.columns])
    for start in range(0, len(records), _ROWS):
        block = records.iloc[start : start + _ROWS]
        yield _lines([_texts(block.iloc[:, place]) for place in range(block.shape[1])])


def _lines(columns: list[Any]) -> bytes:
    return _content(_joined([_joined(columns, ","), _text("")], "\n"))


def _content(texts: Any) -> bytes:
    """Return an array of texts as one."""
    _, offsets, content = texts.buffers()
    first, last = np.frombuffer(offsets, np.int64)[[texts.offset, texts.offset + len(texts)]]
    return bytes(memoryview(content)[first:last]) if last > first else b""


def _texts(column: pd.Series[Any]) -> Any:
    """Return a column as it is written, an array of large strings."""
    import pyarrow as pa
    import pyarrow.compute as pc

    kind = _column_kind(column)
    if kind == "bool":
        return pc.if_else(pa.array(column.to_numpy()), *map(_text, ("True", "False")))
    if kind == "int":
        return pa.array(column.to_numpy()).cast(pa.large_string())
    if kind == "float":
        return _floats(column.to_numpy())
    return _quoted(_texts_of(column))


def _column_kind(column: pd.Series[Any]) -> Literal["bool", "int", "float", "text"]:
    """Tell what the values of a column are written as."""
    kind = column.dtype.kind if isinstance(column.dtype, np.dtype) else "O"
    if column.dtype == np.float64:
        return "float"
    return "bool" if kind == "b" else "int" if kind in "iu" else "text"


def _texts_of(column: pd.Series[Any]) -> Any:
    """Return a column that is no column of plain numbers as an Arrow array of large strings."""
    import pyarrow as pa
    import pyarrow.compute as pc

    if isinstance(column.dtype, np.dtype) and column.dtype.kind != "O":
        return pa.array(_as_pandas_writes(column), pa.large_string())
    try:
        texts = pa.array(column, pa.large_string(), from_pandas=True)
    except (pa.ArrowTypeError, pa.ArrowInvalid):  # not of texts alone
        texts = pa.array(_as_pandas_writes(column), pa.large_string())
    if isinstance(texts, pa.ChunkedArray):  # as pandas keeps texts
        texts = texts.combine_chunks()
    return pc.fill_null(texts, _text(""))


def _joined(columns: list[Any], separator: str) -> Any:
    import pyarrow.compute as pc

    return pc.binary_join_element_wise(*columns, _text(separator))


def _text(value: str) -> Any:
    import pyarrow as pa

    return pa.scalar(value, pa.large_string())


def _floats(values: Any) -> Any:
    """Write each different value once, as Python does: scores of queries repeat."""
    import pyarrow as pa
    import pyarrow.compute as pc

    # By their bits, since 0.0 equals -0.0.
    found = pa.array(values.view(np.int64)).dictionary_encode()
    different = found.dictionary.to_numpy().view(np.float64)
    size = np.abs(different)
    plain = (size >= _PLAIN[0]) & (size < _PLAIN[1]) & (different != np.trunc(different))
    plain |= (size > 0.0) & (size < _SMALL[0])
    padded = (size >= _SMALL[0]) & (size < _SMALL[1])
    others = different[~(plain | padded)].tolist()
    written = (
        pa.array(different[plain]).cast(pa.large_string()),
        pc.replace_substring(pa.array(different[padded]).cast(pa.large_string()), "e-", "e-0"),
        pa.array(["" if one != one else repr(one) for one in others], pa.large_string()),
    )
    place = np.empty(len(different), np.int64)
    place[np.argsort(np.select([plain, padded], [0, 1], 2), kind="stable")] = np.arange(len(place))
    return pa.concat_arrays(written).take(pa.array(place[found.indices.to_numpy()]))


def _quoted(texts: Any) -> Any:
    import pyarrow.compute as pc

    content = _content(texts)
    if not any(mark in content for mark in (b",", b'"', b"\r", b"\n")):
        return texts
    special = pc.match_substring_regex(texts, _QUOTED)
    doubled = pc.replace_substring(texts, '"', '""')
    return pc.if_else(special, _joined([_text(""), doubled, _text("")], '"'), texts)


def _as_pandas_writes(column: pd.Series[Any]) -> list[str]:
    written = column.to_csv(index=False, header=False, lineterminator="\n")
    return [row[0] for row in csv.reader(io.StringIO(written, newline=""))]
