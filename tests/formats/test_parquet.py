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
def test_reads_every_kind_of_text(ids: Any, ranked: Any, tmp_path: Path) -> None:
    read = written(tmp_path / "x.parquet", query_ids=ids, ranked_ids=ranked)
    assert read["query_ids"].dtype.kind == "U"
    assert read["query_ids"].tolist() == IDS
    assert read["ranked_ids"].tolist() == RANKED


@pytest.mark.parametrize("kind", [pa.float16(), pa.float32(), pa.float64()])
def test_reads_numbers(kind: Any, tmp_path: Path) -> None:
    scores = pa.array([[0.5, 0.25], [1.0, float("nan")]], pa.list_(kind))
    read = written(tmp_path / "x.parquet", query_ids=IDS, scores=scores)
    np.testing.assert_array_equal(read["scores"], [[0.5, 0.25], [1.0, np.nan]])


def test_reads_many_batches_and_row_groups_in_order(tmp_path: Path) -> None:
    ids = [f"e/{i}" for i in range(150_000)]
    table = pa.table({"query_ids": ids, "ranked_ids": [[i] for i in ids]})
    pq.write_table(table, tmp_path / "x.parquet", row_group_size=40_000)
    read = read_columns(tmp_path / "x.parquet", COLUMNS)
    assert read["query_ids"].tolist() == ids
    assert read["ranked_ids"][:, 0].tolist() == ids


def test_no_rows(tmp_path: Path) -> None:
    empty = pa.array([], pa.list_(pa.string()))
    read = written(tmp_path / "x.parquet", query_ids=pa.array([], pa.string()), ranked_ids=empty)
    assert read["query_ids"].shape == (0,)


REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "unknown column": ({"query_id": IDS}, r"unknown.*'query_id'"),
    "null": (
        {"query_ids": ["e/a", None]},
        "query_ids. has nulls, first in row 1",
    ),
    "null list": (
        {"ranked_ids": [["a"], None]},
        "ranked_ids. has nulls, first in row 1",
    ),
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
    "huge text": ({"query_ids": ["x" * 100_000, "y"]}, "has a text of 100,000 characters"),
}


@pytest.mark.parametrize("case", list(REFUSED))
def test_refused(case: str, tmp_path: Path) -> None:
    columns, message = REFUSED[case]
    with pytest.raises(PredictionError, match=message) as caught:
        written(tmp_path / "x.parquet", **columns)
    assert str(caught.value).startswith(str(tmp_path / "x.parquet"))
    assert caught.value.expected


def test_a_column_twice(tmp_path: Path) -> None:
    table = pa.Table.from_arrays([pa.array(IDS), pa.array(IDS)], names=["query_ids"] * 2)
    pq.write_table(table, tmp_path / "x.parquet")
    with pytest.raises(PredictionError, match="there twice"):
        read_columns(tmp_path / "x.parquet", COLUMNS)


def test_text_that_is_not_utf8(tmp_path: Path) -> None:
    # As a writer that does not look at its text would have it.
    bad = pa.StringArray.from_buffers(
        2, pa.py_buffer(bytes([0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0])), pa.py_buffer(b"\xff\xfe")
    )
    pq.write_table(pa.table({"query_ids": bad}), tmp_path / "x.parquet")
    with pytest.raises(PredictionError, match=r"not a readable parquet file: .*UTF8"):
        read_columns(tmp_path / "x.parquet", COLUMNS)


@pytest.mark.parametrize("content", [b"", b"PAR1", b"PAR1" * 4, b"hello, I am a csv", bytes(99)])
def test_not_parquet(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "x.parquet").write_bytes(content)
    with pytest.raises(PredictionError, match=r"not a readable parquet file: ."):
        read_columns(tmp_path / "x.parquet", COLUMNS)
