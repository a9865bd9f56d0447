"""Parquet of every writer is read; what is refused is in tests/goldens/refusals.txt."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from airzoo_bench.formats.parquet import read_columns

COLUMNS = ("protocol", "query_ids", "ranked_ids", "scores")
IDS, RANKED = ["e/a", "e/ü"], [["e/t1", "e/t2"], ["e/t2", ""]]


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
def test_reads_every_kind_of_text_and_number(ids, ranked, kind, tmp_path) -> None:
    scores = pa.array([[0.5, 0.25], [1.0, float("nan")]], pa.list_(kind))
    table = pa.table({"query_ids": ids, "ranked_ids": ranked, "scores": scores})
    pq.write_table(table, tmp_path / "x.parquet")
    read = read_columns(tmp_path / "x.parquet", COLUMNS)
    assert read["query_ids"].dtype.kind == "U"
    assert read["query_ids"].tolist() == IDS
    assert read["ranked_ids"].tolist() == RANKED
    np.testing.assert_array_equal(read["scores"], [[0.5, 0.25], [1.0, np.nan]])


@pytest.mark.parametrize("rows", [0, 1500])
def test_reads_row_groups_in_order(rows, tmp_path) -> None:
    ids = pa.array([f"e/{i}" for i in range(rows)], pa.string())
    table = pa.table({"query_ids": ids, "ranked_ids": pa.FixedSizeListArray.from_arrays(ids, 1)})
    pq.write_table(table, tmp_path / "x.parquet", row_group_size=400)
    read = read_columns(tmp_path / "x.parquet", COLUMNS)
    assert read["query_ids"].tolist() == ids.to_pylist()
    assert read["ranked_ids"].ravel().tolist() == ids.to_pylist()
