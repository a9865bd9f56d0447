"""Records, held to the result beside them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.errors import ResultError, UsageError
from airzoo_bench.records import Scored, read_records, read_scored
from airzoo_bench.result import read_result, write_result
from airzoo_bench.runner.common import Evaluation, save
from tests.statistics.support import ERROR, HIT, made_method, made_records, write_method

COLUMNS = (HIT, ERROR)
SCENES = {
    "east": {"recall@1": [1.0, 0.0, 1.0], "error_m": [0.1 + 0.2, np.inf, 1 / 3]},
    "west": {"recall@1": [0.0], "error_m": [1e-300]},
}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return write_method(tmp_path / "out", made_method(SCENES, COLUMNS))


def test_both_ways_to_the_last_digit(path):
    pd.testing.assert_frame_equal(
        read_records(path), made_records(SCENES), check_exact=True, check_dtype=False
    )


def test_other_columns_and_awkward_names(tmp_path):
    records = made_records(SCENES).assign(
        query=["NA", 'a,"b"', "007", "nan"],
        weather=["fog", "", None, "NA"],
        pitch=[1.5, None, 3, 4],
    )
    made = made_method(SCENES, COLUMNS)
    save(Evaluation(made.result, records), tmp_path)
    read = read_records(tmp_path / "result.json")
    assert read["query"].tolist() == ["007", "NA", 'a,"b"', "nan"]
    assert read["weather"].isna().tolist() == [True, False, True, False]
    assert read["weather"].tolist()[3] == "NA"
    assert np.isnan(read["pitch"].tolist()[2])


def test_records_of_scenes_are_named_by_them(tmp_path):
    made = made_method(SCENES, COLUMNS)
    of_scenes = made.records.groupby("scene", as_index=False).first().drop(columns="query")
    save(Evaluation(made.result, of_scenes), tmp_path)
    assert read_records(tmp_path / "result.json")["query"].tolist() == ["east", "west"]


def test_the_order_of_rows_does_not_matter(tmp_path, path):
    made = made_method(SCENES, COLUMNS)
    turned = Scored(made.name, made.result, made.records[::-1])
    other = write_method(tmp_path / "turned", turned)
    pd.testing.assert_frame_equal(read_records(other), read_records(path))


def test_edited_records_are_refused(path):
    file = path.with_name("records.csv")
    file.write_text(file.read_text().replace("inf", "1.0"))
    with pytest.raises(ResultError, match=r"records\.csv: not the records of the result"):
        read_records(path)


def test_records_of_another_result_are_refused(path, tmp_path):
    other = write_method(tmp_path / "b", made_method({"east": {"recall@1": [1.0]}}))
    path.with_name("records.csv").write_bytes(other.with_name("records.csv").read_bytes())
    with pytest.raises(ResultError, match="not the records of the result"):
        read_records(path)


def test_an_edited_hash_is_refused(path):
    content = json.loads(path.read_text())
    path.write_text(json.dumps(content | {"records_sha256": "0" * 64}))
    with pytest.raises(ResultError, match="its content was changed"):
        read_records(path)


def test_missing_records(path):
    path.with_name("records.csv").unlink()
    with pytest.raises(ResultError, match=r"records\.csv: no such file"):
        read_records(path)


def test_a_result_without_records(tmp_path):
    write_result(tmp_path / "result.json", made_method(SCENES, COLUMNS).result)
    with pytest.raises(ResultError, match="does not say which records belong to it"):
        read_records(tmp_path / "result.json")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda r: r.drop(columns="error_m"), "has no column error_m"),
        (lambda r: r.drop(columns="scene"), "has no column scene"),
        (lambda r: r.assign(error_m=[1.0, np.nan, 2.0, 3.0]), "error_m: a score is not a number"),
        (lambda r: r.assign(error_m=list("abcd")), "error_m: a score is not a number"),
        (lambda r: r.assign(scene="east"), "its scenes are not those"),
        (lambda r: r.assign(query="same"), "a query stands twice"),
    ],
)
def test_records_that_cannot_be_of_the_result(change, message, tmp_path):
    made = made_method(SCENES, COLUMNS)
    save(Evaluation(made.result, change(made.records)), tmp_path)
    with pytest.raises(ResultError, match=message):
        read_records(tmp_path / "result.json")


def test_methods_of_the_same_name_get_their_file_s(tmp_path):
    files = [write_method(tmp_path / name, made_method(SCENES, COLUMNS)) for name in "ab"]
    other = write_method(tmp_path / "c", made_method(SCENES, COLUMNS, "Other"))
    names = [method.name for method in read_scored([*files, other])]
    assert names == [f"Method ({files[0]})", f"Method ({files[1]})", "Other"]


def test_the_same_file_twice(path):
    with pytest.raises(UsageError, match="named twice"):
        read_scored([path, path.parent / ".." / "out" / "result.json"])


def test_a_saved_result_is_intact_and_knows_its_records(path):
    saved = read_result(path)
    assert len(saved.records_sha256) == 64
    assert saved.scenes == made_method(SCENES, COLUMNS).result.scenes
