"""Results as JSON, both ways, and held to their checksum."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

from airzoo_bench.core.errors import ResultError
from airzoo_bench.results.result import Reference, read_result, write_result
from tests.results.made import result


def test_both_ways_to_the_last_digit(tmp_path: Path) -> None:
    made = result('Mé\u202ethod \\ " <b> \x1b[0m', **{"recall@1": 1 / 3})
    write_result(tmp_path / "result.json", made)
    read = read_result(tmp_path / "result.json")
    assert read == made
    assert read.overall["recall@1"] == 1 / 3
    assert read.overall["distance_m"] == math.inf
    assert read.predictions.method == 'Mé\ufffdthod \\ " <b> \ufffd[0m'


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('"Method"', '"method"'),
        ("0.30000000000000004", "0.30000000000000010"),
        ('"A note."', '"Another."'),
        ('"queries": 3', '"queries": 4'),
        ('"checksum": "', '"checksum": "0'),
    ],
)
def test_every_change_is_noticed(old: str, new: str, tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    write_result(path, result())
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(ResultError, match="changed after it was written"):
        read_result(path)


def without(*keys: str) -> dict[str, Any]:
    content: dict[str, Any] = json.loads(result().model_dump_json(by_alias=True))
    part = content
    for key in keys[:-1]:
        part = part[key]
    del part[keys[-1]]
    return content


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (without("track"), "key 'track' is missing"),
        (without("protocol", "fingerprint"), r"key 'protocol\.fingerprint' is missing"),
        (without("counts", "s"), "counts, titles and scores are not of the same scenes"),
        (without("counts", "s", "queries"), "no count of queries"),
        (without("versions", "airzoo-bench"), "version of airzoo-bench is not given"),
        (without("scenes", "s", "recall@1"), "do not fit the columns"),
    ],
)
def test_parts_that_do_not_fit(content: dict[str, Any], message: str, tmp_path: Path) -> None:
    (tmp_path / "result.json").write_text(json.dumps(content))
    with pytest.raises(ResultError, match=message):
        read_result(tmp_path / "result.json")


@pytest.mark.parametrize("text", ["", "{", "null", '{"schema": 2}', "[" * 100_000, '"\\ud800"'])
def test_what_is_no_result(text: str, tmp_path: Path) -> None:
    (tmp_path / "result.json").write_text(text)
    with pytest.raises(ResultError, match="not a result"):
        read_result(tmp_path / "result.json")


def chance(**changes: dict[str, Any]) -> Reference:
    values = {"recall@1": 0.25}
    parts: dict[str, Any] = {"scenes": {"s": values}, "overall": values, "pooled": values}
    return Reference.model_validate({"meaning": "A random order."} | parts | changes)


def test_references_are_kept_and_in_the_checksum(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    made = result().model_copy(update={"references": {"chance": chance()}}).with_checksum()
    assert made.checksum != result().checksum
    write_result(path, made)
    assert read_result(path).references == {"chance": chance()}
    path.write_text(path.read_text().replace("0.25", "0.05"))
    with pytest.raises(ResultError, match="changed after it was written"):
        read_result(path)


def test_a_result_of_a_version_without_references_is_read(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    write_result(path, result())
    content = json.loads(path.read_text())
    assert content.pop("references") == {}
    # As that version wrote it.
    assert content["checksum"] == "534c4d2bb46b689577a72e9f013c539ec783f46e722f6402f1391fe1cbbaaa0c"
    path.write_text(json.dumps(content))
    assert read_result(path) == result()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"scenes": {}}, "not of the same scenes"),
        ({"overall": {"distance_m": 3.0}}, "do not fit the columns"),
        ({"pooled": {"recall@1": 1.5}}, "above 1"),
    ],
)
def test_references_that_do_not_fit(changes: dict[str, Any], message: str, tmp_path: Path) -> None:
    references = {"chance": json.loads(chance(**changes).model_dump_json())}
    content = json.loads(result().model_dump_json(by_alias=True)) | {"references": references}
    (tmp_path / "result.json").write_text(json.dumps(content))
    with pytest.raises(ResultError, match=message):
        read_result(tmp_path / "result.json")
