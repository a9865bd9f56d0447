"""Records as CSV: byte for byte what pandas writes, which no one here wrote."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airzoo_bench.results import records
from airzoo_bench.results.records import csv_blocks, write_csv

TEXTS = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\r"), max_size=5)
COLUMNS = {
    "float": st.floats(),
    "single": st.floats(width=32),
    "int": st.integers(-(2**63), 2**63 - 1),
    "bool": st.booleans(),
    "text": TEXTS,
    "holed": st.none() | TEXTS,
    "mixed": st.none() | TEXTS | st.booleans() | st.integers(-(2**70), 2**70),
    "date": st.datetimes(pd.Timestamp(1900, 1, 1), pd.Timestamp(2100, 1, 1)),
}


def written(table: pd.DataFrame) -> str:
    return b"".join(csv_blocks(table)).decode()


@st.composite
def tables(draw: st.DrawFn) -> pd.DataFrame:
    rows = draw(st.integers(0, 12))
    kinds = draw(st.lists(st.sampled_from(sorted(COLUMNS)), min_size=2, max_size=6))
    names = draw(st.lists(TEXTS, min_size=len(kinds), max_size=len(kinds)))
    columns = [
        pd.Series(
            draw(st.lists(COLUMNS[kind], min_size=rows, max_size=rows)),
            dtype={
                "float": float,
                "single": np.float32,
                "int": np.int64,
                "bool": bool,
                "mixed": object,
            }.get(kind),
        )
        for kind in kinds
    ]
    table = pd.concat(columns, axis=1)
    table.columns = pd.Index(names)
    return table


@given(table=tables())
def test_the_bytes_are_those_of_pandas(table: pd.DataFrame) -> None:
    assert written(table) == table.to_csv(index=False, lineterminator="\n")


def test_blocks_join_without_a_seam(monkeypatch: pytest.MonkeyPatch) -> None:
    random = np.random.default_rng(0)
    table = pd.DataFrame({"id": [f"a/{i}" for i in range(100)], "x": random.normal(size=100)})
    table.loc[7, "x"] = np.inf
    table.loc[8, "x"] = np.nan
    table.loc[9, "x"] = -0.0
    table.loc[10, "x"] = 0.0
    monkeypatch.setattr(records, "_ROWS", 7)
    assert written(table) == table.to_csv(index=False, lineterminator="\n")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
@pytest.mark.parametrize("rows", [3, 10_000])
def test_a_full_disk_is_told(rows: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(records, "_ROWS", 1000)
    with pytest.raises(OSError, match="No space left"):
        write_csv(pd.DataFrame({"id": range(rows), "x": 0.5}), Path("/dev/full"))


def test_a_carriage_return_is_quoted_whatever_the_version_of_python() -> None:
    assert written(pd.DataFrame({"a": ["x\ry"], "b": [1]})) == 'a,b\n"x\ry",1\n'
