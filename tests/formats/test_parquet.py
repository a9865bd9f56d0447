"""Hostile ``.parquet`` files: refused with one message, or read as what they are."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.formats.parquet import read_columns

COLUMNS = ("protocol", "query_ids", "ranked_ids", "scores")
IDS, RANKED = ["e/a", "e/ü"], [["e/t1", "e/t2"], ["e/t2", ""]]


def written(path: Path, **columns: Any) -> dict[str, Any]:
    pq.write_table(pa.table(columns), path)
    return read_columns(path, COLUMNS)


@pytest.mark.parametrize(
    ("ids", "ranked"),
    [
        (pa.array(IDS), pa.array(RANKED)),
        (pa.array(IDS, pa.large_string()), pa.array(RANKED, pa.large_list(pa.large_string()))),
        (pa.array(IDS).dictionary_encode(), pa.array(RANKED, pa.list_(pa.string(), 2))),
        (pa.array(IDS), pa.array(RANKED, pa.list_(pa.dictionary(pa.int8(), pa.string())))),
    ],
    ids=["plain", "large", "coded ids", "coded ranks"],
)
@pytest.mark.parametrize("kind", [pa.float16(), pa.float64()])
def test_reads_every_kind_of_text_and_number(ids, ranked, kind, tmp_path):
    scores = pa.array([[0.5, 0.25], [1.0, float("nan")]], pa.list_(kind))
    read = written(tmp_path / "x.parquet", query_ids=ids, ranked_ids=ranked, scores=scores)
    assert read["query_ids"].dtype.kind == "U"
    assert read["query_ids"].tolist() == IDS
    assert read["ranked_ids"].tolist() == RANKED
    np.testing.assert_array_equal(read["scores"], [[0.5, 0.25], [1.0, np.nan]])


@pytest.mark.parametrize("rows", [0, 1500])
def test_reads_row_groups_in_order(rows, tmp_path):
    ids = pa.array([f"e/{i}" for i in range(rows)], pa.string())
    table = pa.table({"query_ids": ids, "ranked_ids": pa.FixedSizeListArray.from_arrays(ids, 1)})
    pq.write_table(table, tmp_path / "x.parquet", row_group_size=400)
    read = read_columns(tmp_path / "x.parquet", COLUMNS)
    assert read["query_ids"].tolist() == ids.to_pylist()
    assert read["ranked_ids"].ravel().tolist() == ids.to_pylist()


# As a writer that does not look at its text would have it.
NOT_UTF8 = pa.StringArray.from_buffers(
    2, pa.py_buffer(bytes([0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0])), pa.py_buffer(b"\xff\xfe")
)
TWICE = pa.Table.from_arrays([pa.array(IDS), pa.array(IDS)], names=["query_ids"] * 2)
REFUSED: dict[str, tuple[Any, str]] = {
    "unknown column": ({"query_id": IDS}, r"'query_id'"),
    "a column twice": (TWICE, r"'query_ids'"),
    "null": ({"query_ids": ["e/a", None]}, "query_ids. has nulls, first in row 1"),
    "null list": ({"ranked_ids": [["a"], None]}, "ranked_ids. has nulls, first in row 1"),
    "null in a list": (
        {"ranked_ids": [["a", "b"], ["c", None]]},
        "ranked_ids. has nulls, first in row 1",
    ),
    "all null": ({"query_ids": [None, None]}, "nulls, first in row 0"),
    "ragged": ({"ranked_ids": [["a"], ["b", "c"]]}, "lists of 1 to 2 entries"),
    "nested": ({"ranked_ids": [[["a"]], [["b"]]]}, "'ranked_ids' has values of type list<"),
    "struct": ({"query_ids": [{"a": 1}, {"a": 2}]}, "'query_ids' has values of type struct"),
    "truth values": ({"query_ids": [True, False]}, "'query_ids' has values of type bool"),
    "bytes": ({"query_ids": [b"a", b"b"]}, "'query_ids' has values of type binary"),
    "huge text": ({"query_ids": ["x" * 100_000, "y"]}, "'query_ids' has a text of 100,000"),
    "not UTF-8": ({"query_ids": NOT_UTF8}, "UTF8"),
    **{f"bytes {n}": (raw, "parquet") for n, raw in enumerate((b"", b"PAR1" * 4, bytes(99)))},
}


@pytest.mark.parametrize("case", list(REFUSED))
def test_refused(case, tmp_path):
    content, message = REFUSED[case]
    path = tmp_path / "x.parquet"
    if isinstance(content, bytes):
        path.write_bytes(content)
    else:
        pq.write_table(pa.table(content) if isinstance(content, dict) else content, path)
    with pytest.raises(PredictionError, match=message) as caught:
        read_columns(path, COLUMNS)
    assert str(caught.value).startswith(str(path))
