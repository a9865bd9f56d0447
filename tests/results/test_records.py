"""Records, held to the result beside them."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.core.errors import ResultError
from airzoo_bench.results.records import read_methods, read_records, write_csv
from airzoo_bench.results.result import read_result, write_result
from tests.statistics.support import ERROR, HIT, made_method, made_records, write_method, write_run

COLUMNS = (HIT, ERROR)
RANDOM = np.random.default_rng(0).exponential(1.0, 500) ** 40
SCENES = {
    "east": {"recall@1": [1.0, 0.0, 1.0], "error_m": [0.1 + 0.2, np.inf, 1 / 3]},
    "west": {"recall@1": [0.0] * 501, "error_m": [1e-300, *RANDOM.tolist()]},
}
MADE, RECORDS = made_method(SCENES, COLUMNS), made_records(SCENES)


def read(folder: Path, records: pd.DataFrame, columns: Any = None) -> pd.DataFrame:
    write_run(MADE.result, records, folder)
    return read_records(folder / "result.json", columns=columns)


def test_scores_are_read_to_the_last_bit(tmp_path: Path) -> None:
    same: Any = {"check_exact": True, "check_dtype": False}
    pd.testing.assert_frame_equal(read(tmp_path, RECORDS), RECORDS, **same)
    names = ["NA", 'a,"b"', "007", "nan", *RECORDS["query"][4:]]
    assert read(tmp_path, RECORDS.assign(query=names))["query"].tolist() == sorted(names)
    more = RECORDS.assign(weather="fog", pitch=1.0)
    for columns in ((), ("error_m",), ("error_m", "weather", "absent")):
        found = [*read(tmp_path, more, columns)]
        assert found == ["scene", "query", *(c for c in columns if c != "absent")]


def test_records_of_scenes_are_named_by_them(tmp_path: Path) -> None:
    made = made_method({scene: {"recall@1": [0.5]} for scene in SCENES})
    write_run(made.result, made.records.drop(columns="query"), tmp_path)
    assert read_records(tmp_path / "result.json")["query"].tolist() == ["east", "west"]


def assigned(name: str, *first: float) -> pd.DataFrame:
    """Return the records with other values in the first rows of a column."""
    return RECORDS.assign(**{name: [*first, *RECORDS[name][len(first) :]]})


FAULTS = {
    "lacks the column error_m": RECORDS.drop(columns="error_m"),
    "error_m has a score of nan|lacks|score": assigned("error_m", 1.0, np.nan),
    "its scenes": RECORDS.assign(scene="east"),
    "how many queries": RECORDS[1:],
    "a query": RECORDS.assign(query="same"),
    "error_m has a score of -3": assigned("error_m", -3.0),
    "recall@1 has a score of 1.0001": assigned("recall@1", 1.0001),
    "recall@1 is 0.33": assigned("recall@1", 0.0),
    "error_m is inf": assigned("error_m", np.inf, np.inf, 0.0),
}


@pytest.mark.parametrize("message", FAULTS)
def test_records_that_cannot_be_of_the_result(message: str, tmp_path: Path) -> None:
    with pytest.raises(ResultError, match=message):
        read(tmp_path, FAULTS[message])


def test_results_and_records_that_were_edited(tmp_path: Path) -> None:
    path = write_method(tmp_path, MADE)
    result = read_result(path)
    better = {**result.overall, "recall@1": 0.9}
    changes = {"scenes": dict.fromkeys(SCENES, better), "overall": better, "pooled": better}
    write_result(path, result.model_copy(update=changes).with_checksum())
    with pytest.raises(ResultError, match=r"does not fit the result .*0\.9"):
        read_records(path)
    file = path.with_name("records.csv")
    file.write_text(file.read_text().replace("inf", "1.0"))
    with pytest.raises(ResultError, match=r"records\.csv: not the records of the result"):
        read_records(path)


def test_methods_of_the_same_name_get_their_file_s(tmp_path: Path) -> None:
    files = [write_method(tmp_path / name, MADE) for name in "ab"]
    other = write_method(tmp_path / "c", made_method(SCENES, COLUMNS, "Other"))
    names = [method.name for method in read_methods([*files, other.parent])]
    assert names == ["Method (a)", "Method (b)", "Other"]
    with pytest.raises(ResultError, match=r"a folder without a result\.json"):
        read_methods([tmp_path])


TYPES = {
    "int": ["1 -20 0", "1700000000123456789 1700000000123456790 -3"],
    "float": ["0.1 -1e-05 inf", "1 - 3"],
    "bool": ["True False True"],
    "str": [
        *("007 008 009", "1e5 2e5 3e5", "NA nan null", "2024-01-01 2024-01-02 2024-01-03"),
        *("1_000 ~2 +3", "9223372036854775807 9223372036854775808 2", "1700000000123456789 - 2"),
    ],
}


def test_types_are_those_that_were_written(tmp_path: Path) -> None:
    made, read_as = made_method({"1e5": {"recall@1": [1.0, 0.0, 1.0]}}), {"bool": "True".__eq__}
    kinds = {text: kind for kind, texts in TYPES.items() for text in texts}
    cells = {text: ["" if t == "-" else t for t in text.split()] for text in kinds}
    write_run(made.result, made.records.assign(**cells), tmp_path)
    records = read_records(tmp_path / "result.json")
    assert records["scene"].tolist() == ["1e5"] * 3
    for text, kind in kinds.items():
        change: Any = read_as.get(kind) or {"int": int, "float": float, "str": str}[kind]
        assert records[text].dropna().tolist() == [change(t) for t in cells[text] if t], text
        assert records[text].dtype.kind == {"str": "O"}.get(kind, kind[0])


HEAD = "scene,query,recall@1"
HOSTILE = [
    *("", f"{HEAD}\n", f"{HEAD},scene\ns,s/a,1,t\ns,s/b,0,t\n", f"{HEAD}\ns,s/a,1,9\ns,s/b,0\n"),
    *(f"{HEAD}\ns,s/a,1\ns,s/b,{score}\n" for score in ("", "nan", "-inf", "9" * 20_000_000)),
    *(f"{HEAD}\ns,,1\ns,s/b,0\n", f"{HEAD}\n,s/a,1\n,s/b,0\n"),
    f"{HEAD},{'x' * 200_000}\ns,s/a,1,\ns,s/b,0,\n",
    *(HEAD.encode() + b"\ns,s/\xff,1\ns,s/b,0\n", b"\xff" + HEAD.encode() + b"\ns,s/a,1\n"),
]


@pytest.mark.parametrize("text", HOSTILE, ids=range(13))
def test_hostile_files_end_in_one_message(text: str | bytes, tmp_path: Path) -> None:
    content = text if isinstance(text, bytes) else text.encode()
    (tmp_path / "records.csv").write_bytes(content)
    result, path = made_method({"s": {"recall@1": [1.0, 0.0]}}).result, tmp_path / "result.json"
    write_result(path, result.with_checksum(records_sha256=hashlib.sha256(content).hexdigest()))
    with pytest.raises(ResultError, match=r"records\.csv"):
        read_records(path)


def test_pandas_reads_what_was_written(tmp_path: Path) -> None:
    values: Any = {"id": ["a/1", "a/2", "a/3"], "score": [0.1 + 0.2, np.inf, 5e-324]}
    values |= {"count": [1, -(2**63), 2**63 - 1], "night": [True, None, False]}
    plain = pd.DataFrame(values | {"weather": pd.Categorical(["fog", "sun", "fog"])})
    awkward = plain.assign(id=['a,"b"', "a\r\nb", ""], mixed=[1, "x", None])
    for number, table in enumerate((plain, awkward, plain[:0])):
        file = tmp_path / str(number)
        assert write_csv(table, file) == hashlib.sha256(file.read_bytes()).hexdigest()
        # Texts stand without quotes where none needs them.
        assert ('"' in file.read_text()) == (table is awkward)
        found = pd.read_csv(file, keep_default_na=False, dtype=str)
        assert found.pop("score").astype(float).tolist() == table["score"].tolist()
        for name in found:
            texts = ["" if value is None else str(value) for value in table[name].tolist()]
            assert found[name].tolist() == texts
