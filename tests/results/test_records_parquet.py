"""Records as Parquet: read as the CSV is, deterministic, and bounded where they are hostile."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from airzoo_bench.core.errors import ResultError
from airzoo_bench.results import records_reading
from airzoo_bench.results.files import RecordsKind, records_path
from airzoo_bench.results.records import read_records
from airzoo_bench.results.records_parquet import write_parquet
from airzoo_bench.results.result import read_result, write_result
from tests.statistics.support import ERROR, HIT, made_method, made_records, write_run
from tests.support import run_main

COLUMNS = (HIT, ERROR)
SCENES = {
    "east": {"recall@1": [1.0, 0.0, 1.0], "error_m": [0.1 + 0.2, np.inf, 1 / 3]},
    "west": {"recall@1": [0.0], "error_m": [1e-300]},
}


def awkward() -> pd.DataFrame:
    """Return records with every kind of column that records have."""
    return made_records(SCENES).assign(
        query=["NA", 'a,"b"', "007", "nan"],
        answered=[True, False, True, True],
        rank=[1, 0, 3, 2],
        weather=["fog", "", None, "NA"],
        pitch=[1.5, None, 3, 4],
        sequence=["1", "2", "3", "4"],
        time_ns=np.arange(4) + 1_700_000_000_123_456_789,
        cell=np.arange(4, dtype=np.uint64) + np.uint64(2**63),
        small=np.arange(4, dtype=np.uint64),
        digits=[f"2024010112345678900{k}" for k in range(4)],
        half=np.array([0.1, 0.2, 0.3, np.nan], np.float32),
        mixed=[1, "two", None, 3.5],
        nothing=[None, None, None, None],
    )


def written(folder: Path, kind: RecordsKind, records: pd.DataFrame) -> Path:
    write_run(made_method(SCENES, COLUMNS).result, records, folder, kind)
    return folder / "result.json"


def with_table(path: Path, table: pa.Table, **options: Any) -> Path:
    """Put another table in place of the records, with the checksum that it has."""
    file = path.with_name("records.parquet")
    pq.write_table(table, file, **options)
    digest = hashlib.sha256(file.read_bytes()).hexdigest()
    write_result(path, read_result(path).with_records(digest))
    return path


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return written(tmp_path / "out", RecordsKind.PARQUET, made_records(SCENES))


def test_both_kinds_are_read_alike(tmp_path: Path) -> None:
    files = [written(tmp_path / kind, kind, awkward()) for kind in RecordsKind]
    assert [records_path(file).name for file in files] == ["records.csv", "records.parquet"]
    for columns in (None, ["weather", "error_m"]):
        one, other = (read_records(file, columns=columns) for file in files)
        pd.testing.assert_frame_equal(one, other, check_exact=True)


def test_blocks_follow_each_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("airzoo_bench.results.records_parquet.ROWS", 3)
    cut = written(tmp_path / "cut", RecordsKind.PARQUET, awkward())
    whole = written(tmp_path / "whole", RecordsKind.CSV, awkward())
    pd.testing.assert_frame_equal(read_records(cut), read_records(whole), check_exact=True)
    assert pq.ParquetFile(cut.with_name("records.parquet")).num_row_groups == 2


def test_the_same_records_are_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_parquet(awkward(), tmp_path / name)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()
    metadata = pq.read_metadata(tmp_path / "a")
    assert metadata.metadata is None
    assert metadata.created_by.startswith("parquet-cpp-arrow version ")


def test_another_kind_takes_the_place_of_the_first(path: Path) -> None:
    written(path.parent, RecordsKind.CSV, made_records(SCENES))
    assert {file.name for file in path.parent.iterdir()} == {"result.json", "records.csv"}
    read_records(path)


@pytest.mark.parametrize("kind", RecordsKind)
def test_records_that_another_run_left_are_not_read(tmp_path: Path, kind: RecordsKind) -> None:
    """As where a run is copied over another: the result says by its checksum which are its own."""
    file = written(tmp_path / "out", kind, made_records(SCENES))
    other = next(one for one in RecordsKind if one is not kind)
    left = written(tmp_path / "left", other, made_records(SCENES).iloc[::-1])
    left.with_name(other.file).rename(file.with_name(other.file))
    assert records_path(file).name == kind.file
    read_records(file)
    file.with_name(kind.file).unlink()
    with pytest.raises(ResultError, match="the checksum does not fit"):
        read_records(file)


def test_records_beside_other_results(path: Path, tmp_path: Path) -> None:
    mine = tmp_path / "mine.json"
    path.rename(mine)
    path.with_name("records.parquet").rename(tmp_path / "mine.records.parquet")
    (tmp_path / "records.csv").write_text("of another result")
    pd.testing.assert_frame_equal(read_records(mine), made_records(SCENES), check_dtype=False)


def test_edited_records_are_refused(path: Path) -> None:
    file = path.with_name("records.parquet")
    pq.write_table(pq.read_table(file), file, compression="none")
    with pytest.raises(ResultError, match=r"records\.parquet: not the records of the result"):
        read_records(path)


def changed(path: Path, name: str, values: pa.Array) -> pa.Table:
    table = pq.read_table(path.with_name("records.parquet"))
    return table.set_column(table.column_names.index(name), name, values)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (pa.array(["a", "1", "1", "1"]), "error_m: a score is not a number"),
        (pa.array([None, 1.0, 1.0, 1.0]), "error_m: a score is not a number"),
        (pa.array([[1.0], [1.0], [1.0], [1.0]]), "column 'error_m' has values of type list"),
        (pa.array([1.0, 1.0, 1.0, -1.0]), "error_m: a score is -1"),
    ],
)
def test_scores_that_are_none(path: Path, values: pa.Array, message: str) -> None:
    with_table(path, changed(path, "error_m", values))
    with pytest.raises(ResultError, match=message):
        read_records(path)


def test_a_column_that_is_lacking(path: Path) -> None:
    table = pq.read_table(path.with_name("records.parquet"))
    with_table(path, table.drop_columns("error_m"))
    with pytest.raises(ResultError, match=r"records\.parquet: has no column error_m"):
        read_records(path)


def test_damaged_files(path: Path) -> None:
    file = path.with_name("records.parquet")
    content = file.read_bytes()
    random, refused = np.random.default_rng(0), 0
    for case in range(200):
        spoiled = bytearray(content)
        for place in random.integers(0, len(content), 3).tolist():
            spoiled[place] ^= 1 << random.integers(8)
        file.write_bytes(spoiled[: random.integers(1, len(content))] if case % 4 == 0 else spoiled)
        digest = hashlib.sha256(file.read_bytes()).hexdigest()
        write_result(path, read_result(path).with_records(digest))
        try:
            read_records(path)
        except ResultError:
            refused += 1
    assert refused > 100


def test_a_long_text_stated_very_often(path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(records_reading, "_MOST_BYTES", 10 << 20)
    rows = 50_000
    texts = pa.DictionaryArray.from_arrays(pa.array([0] * rows, pa.int32()), pa.array(["x" * 5000]))
    columns = {"scene": texts, "query": texts}
    columns |= {name: pa.array(np.zeros(rows)) for name in ("recall@1", "error_m")}
    with_table(path, pa.table(columns))
    assert path.with_name("records.parquet").stat().st_size < 20_000
    with pytest.raises(ResultError, match="more than the limit"):
        read_records(path)


def test_every_command_reads_them(
    path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    same = written(tmp_path / "csv", RecordsKind.CSV, made_records(SCENES))
    shown = []
    for result in (path, same):
        assert run_main("table", result.parent, "--intervals", "--format", "csv") == 0
        shown.append(capsys.readouterr().out)
        assert run_main("report", result.parent, "--out", tmp_path / "report.html") == 0
    assert shown[0] == shown[1]
    assert "R@1" in shown[0]
