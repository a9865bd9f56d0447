"""Tables of benchmark folders that people made by hand: what is wrong is named to the cell."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.benchmark.tables import read_table
from airzoo_bench.core.errors import BenchmarkError


@pytest.mark.parametrize(
    ("cells", "said"),
    [
        ("a,1,x.jpg\nb,one,y.jpg\n", r"column 'x', row 2: 'one'\n  expected: a number, at most"),
        ("a,1_0,x.jpg\n", r"column 'x', row 1: '1_0'\n"),
        ("a,inf,x.jpg\n", r"column 'x', row 1: 'inf'\n"),
        ("a,1e300,x.jpg\n", r"column 'x', row 1: '1e300'\n"),
        ("a,1,\n", r"column 'image', row 1: nothing\n  expected: text"),
        ("a,1,a.jpg\na,1,b.jpg\n", r"column 'id', row 2: 'a'\n  expected: each id once"),
        ("a\u202eb,1,a.jpg\n", r"column 'id', row 1: 'a\\u202eb'\n"),
        ("a,,a.jpg\n", r"column 'x', row 1: nothing\n  expected: a number"),
    ],
)
def test_the_cell_is_named(cells: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "queries.csv"
    path.write_text("id,x,image\n" + cells, encoding="utf-8")
    with pytest.raises(BenchmarkError, match=rf"queries.csv: {said}"):
        read_table(path, ("id", "x", "image"), complete=("x",))


def test_whole_numbers_are_whole(tmp_path: Path) -> None:
    path = tmp_path / "crops.csv"
    path.write_text("id,crop_x\na,3\nb,3.0\n")
    assert read_table(path, ("id",))["crop_x"].tolist() == [3, 3]
    path.write_text("id,crop_x\na,3.5\nb,\nc,7\n")
    with pytest.raises(BenchmarkError, match=r"column 'crop_x', row 1: '3.5'; row 2: nothing\n"):
        read_table(path, ("id",))


def test_numbers_are_rounded_correctly(tmp_path: Path) -> None:
    numbers = np.random.default_rng(0).random(500) * 1e6
    path = tmp_path / "queries.csv"
    pd.DataFrame({"id": [f"q{n}" for n in range(500)], "x": numbers}).to_csv(path, index=False)
    np.testing.assert_array_equal(read_table(path, ("id",))["x"], numbers)


def test_names_of_digits_stay_what_they_are(tmp_path: Path) -> None:
    """The sequences 007 and 7 are two, as are the commits 1e5 and 100000."""
    path = tmp_path / "queries.csv"
    path.write_text(
        "id,sequence,commit,wind,share,gusts,fog,serial\n"
        "a,007,1e5,.5,1e-5,,True,0\nb,7,100000,2,0.25,3,False,10\n"
    )
    table = read_table(path, ("id",))
    assert table["sequence"].tolist() == ["007", "7"]
    assert table["commit"].tolist() == ["1e5", "100000"]
    assert table["wind"].tolist() == [0.5, 2.0]
    assert table["share"].tolist() == [1e-5, 0.25]
    assert np.isnan(table["gusts"][0])
    assert table["fog"].tolist() == [True, False]
    assert table["serial"].tolist() == [0, 10]


def test_degrees_are_degrees(tmp_path: Path) -> None:
    path = tmp_path / "tiles.parquet"
    pd.DataFrame({"id": ["a", "b"], "lat_min": [0, 256], "x": [0, 256]}).to_parquet(path)
    with pytest.raises(BenchmarkError, match=r"column 'lat_min', row 2: 256\n.*at most 90 in size"):
        read_table(path, ("id",))
