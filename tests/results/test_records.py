"""Records, held to the result beside them."""

from __future__ import annotations

import hashlib
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from airzoo_bench.core.errors import ResultError
from airzoo_bench.results.records import read_records, read_scored, write_csv
from airzoo_bench.results.result import read_result, write_result
from tests.statistics.support import ERROR, HIT, made_method, made_records, write_method, write_run

COLUMNS = (HIT, ERROR)
SCENES = {
    "east": {"recall@1": [1.0, 0.0, 1.0], "error_m": [0.1 + 0.2, np.inf, 1 / 3]},
    "west": {"recall@1": [0.0], "error_m": [1e-300]},
}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return write_method(tmp_path / "out", made_method(SCENES, COLUMNS))


def test_both_ways_to_the_last_digit(path, tmp_path):
    made, exact = made_records(SCENES), {"check_exact": True, "check_dtype": False}
    pd.testing.assert_frame_equal(read_records(path), made, **exact)
    names = ["NA", 'a,"b"', "007", "nan"]
    write_run(made_method(SCENES, COLUMNS).result, made.assign(query=names), tmp_path)
    assert read_records(tmp_path / "result.json")["query"].tolist() == sorted(names)


def test_records_of_scenes_are_named_by_them(tmp_path):
    made = made_method({scene: {"recall@1": [0.5]} for scene in SCENES})
    write_run(made.result, made.records.drop(columns="query"), tmp_path)
    assert read_records(tmp_path / "result.json")["query"].tolist() == ["east", "west"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda r: r.drop(columns="error_m"), "lacks the column error_m"),
        (lambda r: r.assign(error_m=[1.0, np.nan, 2.0, 3.0]), "error_m"),
        (lambda r: r.assign(scene="east"), "scenes"),
        (lambda r: r[1:], "scenes"),
        (lambda r: r.assign(query="same"), "query"),
        (lambda r: r.assign(error_m=[1.0, -3.0, 2.0, 3.0]), "error_m has a score of -3"),
        (lambda r: r.assign(**{"recall@1": [1, 0, 1.0001, 0]}), "recall@1 has a score of 1.0001"),
        (lambda r: r.assign(scene=["west", *r.scene[1:3], "east"]), "recall@1 is 1.0"),
        (lambda r: r.assign(error_m=[np.inf, np.inf, 0, 1e-300]), "error_m is inf"),
    ],
)
def test_records_that_cannot_be_of_the_result(change, message, tmp_path):
    made = made_method(SCENES, COLUMNS)
    write_run(made.result, change(made.records), tmp_path)
    with pytest.raises(ResultError, match=message):
        read_records(tmp_path / "result.json")


def test_results_and_records_that_were_edited(path):
    result = read_result(path)
    better = {**result.overall, "recall@1": 0.9}
    changes = {"scenes": dict.fromkeys(result.scenes, better), "overall": better, "pooled": better}
    write_result(path, result.model_copy(update=changes).with_checksum())
    with pytest.raises(ResultError, match=r"does not fit the result .*0\.9"):
        read_records(path)
    assert read_records(path, columns=["scene"])["query"].is_unique
    file = path.with_name("records.csv")
    file.write_text(file.read_text().replace("inf", "1.0"))
    with pytest.raises(ResultError, match=r"records\.csv: not the records of the result"):
        read_records(path)


def test_methods_of_the_same_name_get_their_file_s(tmp_path):
    files = [write_method(tmp_path / name, made_method(SCENES, COLUMNS)) for name in "ab"]
    other = write_method(tmp_path / "c", made_method(SCENES, COLUMNS, "Other"))
    names = [method.name for method in read_scored([*files, other])]
    assert names == ["Method (a)", "Method (b)", "Other"]


@pytest.mark.parametrize("columns", [(), ("error_m",), ("error_m", "weather", "absent")])
def test_only_the_columns_that_are_wanted(columns, tmp_path):
    records = made_records(SCENES).assign(weather="fog", pitch=1.0)
    write_run(made_method(SCENES, COLUMNS).result, records, tmp_path)
    path = tmp_path / "result.json"
    read = read_records(path, columns=columns)
    assert [*read] == ["scene", "query", *(c for c in columns if c != "absent")]
    pd.testing.assert_frame_equal(read, read_records(path)[[*read]], check_exact=True)


@pytest.mark.parametrize(
    ("texts", "kind"),
    [
        (["1", "-20", "0"], "i"),
        (["0.1", "-1e-05", "inf"], "f"),
        (["1", "", "3"], "f"),
        (["True", "False", "True"], "b"),
        (["007", "008", "009"], "O"),
        (["1e5", "2e5", "3e5"], "O"),
        (["NA", "nan", "null"], "O"),
        (["2024-01-01", "2024-01-02", "2024-01-03"], "O"),
        (["1_000", " 2", "+3"], "O"),
        (["1700000000123456789", "1700000000123456790", "-3"], "i"),
        (["9223372036854775807", "9223372036854775808", "2"], "O"),
        (["1700000000123456789", "", "2"], "O"),
    ],
)
def test_types_are_those_that_were_written(texts, kind, tmp_path):
    scenes = {"1e5": {"recall@1": [1.0, 0.0, 1.0]}}
    made = made_method(scenes)
    write_run(made.result, made.records.assign(condition=texts), tmp_path)
    read = read_records(tmp_path / "result.json")
    assert read["scene"].tolist() == ["1e5"] * 3
    found = read["condition"]
    assert found.dtype.kind == kind
    assert found.isna().tolist() == [text == "" for text in texts]
    if kind == "i":
        assert found.tolist() == [int(text) for text in texts]
    elif kind == "O":
        assert found.dropna().tolist() == [text for text in texts if text]
    else:
        expected = [text == "True" if kind == "b" else float(text or "nan") for text in texts]
        np.testing.assert_array_equal(found.to_numpy(float), np.array(expected, float))


HEAD = "scene,query,recall@1"
HOSTILE = [
    *("", f"{HEAD}\n", f"{HEAD},scene\ns,s/a,1,t\ns,s/b,0,t\n", f"{HEAD}\ns,s/a,1,9\ns,s/b,0\n"),
    *(f"{HEAD}\ns,s/a,1\ns,s/b,{score}\n" for score in ("", "nan", "-inf", "9" * 20_000_000)),
    *(f"{HEAD}\ns,,1\ns,s/b,0\n", f"{HEAD}\n,s/a,1\n,s/b,0\n"),
    f"{HEAD},{'x' * 200_000}\ns,s/a,1,\ns,s/b,0,\n",
    *(HEAD.encode() + b"\ns,s/\xff,1\ns,s/b,0\n", b"\xff" + HEAD.encode() + b"\ns,s/a,1\n"),
]


@pytest.mark.parametrize("text", HOSTILE, ids=range(13))
def test_hostile_files_end_in_one_message(text, tmp_path):
    content = text if isinstance(text, bytes) else text.encode()
    (tmp_path / "records.csv").write_bytes(content)
    result = made_method({"s": {"recall@1": [1.0, 0.0]}}).result
    path = tmp_path / "result.json"
    write_result(path, result.with_records(hashlib.sha256(content).hexdigest()))
    with pytest.raises(ResultError, match=r"records\.csv"):
        read_records(path)


@settings(deadline=None, max_examples=50)
@given(st.lists(st.floats(0.0, 1e300), min_size=1, max_size=30))
def test_scores_are_read_to_the_last_bit(values):
    with tempfile.TemporaryDirectory() as folder:
        made = made_method({"s": {"error_m": values}}, (ERROR,))
        path = write_method(Path(folder), made)
        read = read_records(path)["error_m"].to_numpy()
    assert read.tobytes() == made.records["error_m"].to_numpy(float).tobytes()


# --- written by Arrow, read by pandas, which no one here wrote ----------------------------------

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
def test_pandas_reads_what_was_written(table, tmp_path):
    path = tmp_path / "records.csv"
    assert write_csv(table, path) == hashlib.sha256(path.read_bytes()).hexdigest()
    # Texts stand without quotes where none needs them.
    assert ('"' in path.read_text()) == (table is AWKWARD)
    read = pd.read_csv(path, keep_default_na=False, dtype=str)
    assert [*read] == [*table]
    for name in ("score", "holed"):
        numbers = [float(text or "nan") for text in read[name]]
        np.testing.assert_array_equal(numbers, table[name].to_numpy(float))
    for name in {"id", "count", "failed", "night", "weather", "mixed"} & {*table}:
        texts = ["" if value is None else str(value) for value in table[name].tolist()]
        assert read[name].tolist() == texts
