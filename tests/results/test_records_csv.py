"""Records as CSV: byte for byte what pandas writes, which no one here wrote."""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from airzoo_bench.results import records_csv
from airzoo_bench.results.records_csv import csv_blocks, write_csv

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
    monkeypatch.setattr(records_csv, "_ROWS", 7)
    assert written(table) == table.to_csv(index=False, lineterminator="\n")


def test_a_file_has_its_blocks_in_order(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(records_csv, "_ROWS", 7)
    table = pd.DataFrame({"id": range(1000), "x": np.arange(1000) / 7})
    checksum = write_csv(table, tmp_path / "records.csv")
    content = (tmp_path / "records.csv").read_bytes()
    assert content.decode() == table.to_csv(index=False, lineterminator="\n")
    assert checksum == sha256(content).hexdigest()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
@pytest.mark.parametrize("rows", [3, 10_000])
def test_a_full_disk_is_told(rows: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(records_csv, "_ROWS", 1000)
    with pytest.raises(OSError, match="No space left"):
        write_csv(pd.DataFrame({"id": range(rows), "x": 0.5}), Path("/dev/full"))


def test_numbers_of_every_size_are_written_as_python_writes_them() -> None:
    random = np.random.default_rng(1)
    parts = [
        *(10.0**k * f for k in range(-12, 20) for f in (1, 1.5, 9.999999999999999, 0.3)),
        *np.nextafter(10.0 ** np.arange(-12, 20), 0.0),
        *(2.0**k for k in range(-70, 70)),
        *np.exp(random.uniform(-40, 40, 20_000)),
        *10.0 ** random.uniform(-323, -3, 20_000),
        *random.uniform(0, 1, 20_000),
        *np.round(random.uniform(0, 1e5, 20_000), 3),
        *(0.0, np.inf, np.nan, 5e-324, 1.7976931348623157e308),
    ]
    values = np.array([*parts, *(-part for part in parts)])
    texts = written(pd.DataFrame({"x": values, "y": 0})).splitlines()[1:]
    assert texts == [",0" if v != v else f"{v!r},0" for v in values.tolist()]


def test_single_precision_without_any_value() -> None:
    table = pd.DataFrame({"x": np.full(3, np.nan, np.float32), "y": 1})
    assert written(table) == table.to_csv(index=False, lineterminator="\n")


def test_a_carriage_return_is_quoted_whatever_the_version_of_python() -> None:
    assert written(pd.DataFrame({"a": ["x\ry"], "b": [1]})) == 'a,b\n"x\ry",1\n'
