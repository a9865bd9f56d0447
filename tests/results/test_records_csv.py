"""Records as CSV: what is written is what pandas reads, which no one here wrote."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.results.records import write_csv

PLAIN = pd.DataFrame(
    {
        "id": ["a/1", "a/2", "a/3"],
        "score": [0.1 + 0.2, np.inf, 5e-324],
        "count": [1, -(2**63), 2**63 - 1],
        "failed": [True, False, True],
        "holed": [1.5, np.nan, 1e-7],
        "night": [True, None, False],
        "weather": pd.Categorical(["fog", "sun", "fog"]),
    }
)
AWKWARD = PLAIN.assign(id=['a,"b"', "a\r\nb", ""], mixed=[1, "x", None])


@pytest.mark.parametrize("table", [PLAIN, AWKWARD, PLAIN[:0]])
def test_pandas_reads_what_was_written(table: pd.DataFrame, tmp_path: Path) -> None:
    path = tmp_path / "records.csv"
    sha256 = write_csv(table, path)
    assert sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    read = pd.read_csv(path, keep_default_na=False, dtype=str)
    assert [*read] == [*table]
    for name in ("score", "holed"):
        numbers = [float(text or "nan") for text in read[name]]
        np.testing.assert_array_equal(numbers, table[name].to_numpy(float))
    for name in {"id", "count", "failed", "night", "weather", "mixed"} & {*table}:
        texts = ["" if value is None else str(value) for value in table[name].tolist()]
        assert read[name].tolist() == texts


def test_texts_stand_without_quotes_where_none_needs_them(tmp_path: Path) -> None:
    write_csv(PLAIN[["id", "count"]], tmp_path / "r.csv")
    assert (tmp_path / "r.csv").read_text().startswith("id,count\na/1,1\n")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_a_full_disk_is_an_error() -> None:
    with pytest.raises(OSError, match="No space left"):
        write_csv(pd.DataFrame({"id": range(100_000), "x": 0.5}), Path("/dev/full"))
