"""Tables of benchmark folders that people made by hand.

Cells that are refused are in tests/goldens/refusals.txt.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from airzoo_bench.benchmark.tables import read_table


def test_whole_numbers_are_whole(tmp_path: Path) -> None:
    path = tmp_path / "crops.csv"
    path.write_text("id,crop_x\na,3\nb,3.0\n")
    assert read_table(path, ("id",))["crop_x"].tolist() == [3, 3]


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
