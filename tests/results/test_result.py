"""Results as JSON, both ways and held to their checksum, and the averages of records in them."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.core.errors import ResultError
from airzoo_bench.results.result import Reference, Result, read_result, summarise, write_result
from tests.statistics.support import ERROR, HIT, small_result

LEVEL = {"recall@1": 0.25}
CHANCE = Reference(meaning="A random order.", scenes={"s": LEVEL}, overall=LEVEL, pooled=LEVEL)


def beside_chance(method: str = "Method") -> Result:
    made = small_result(method, **{"recall@1": 1 / 3})
    return made.model_copy(update={"references": {"chance": CHANCE}}).with_checksum()


def test_both_ways_to_the_last_digit(tmp_path: Path) -> None:
    made, path = beside_chance('Mé\u202ethod \\ " <b> \x1b[0m'), tmp_path / "result.json"
    write_result(path, made)
    read = read_result(path)
    assert read == made
    assert read.overall == {"recall@1": 1 / 3, "distance_m": math.inf}
    assert read.references == {"chance": CHANCE}
    assert read.predictions.method == 'Mé\ufffdthod \\ " <b> \ufffd[0m'


TEXT = beside_chance().model_dump_json(by_alias=True, indent=1)
EDITS = {
    '"Method"': '"method"',
    "0.3333333333333333": "0.3333333333333334",
    '"A note."': '"Another."',
    '"queries": 3': '"queries": 4',
    '"checksum": "': '"checksum": "0',
    "0.25": "0.05",
}


def changed(*keys: str, **values: Any) -> str:
    """Return the result with other values in a part, or without the last of its keys."""
    content = part = json.loads(TEXT)
    for key in keys if values else keys[:-1]:
        part = part[key]
    part.update(values)
    if not values:
        del part[keys[-1]]
    return json.dumps(content)


BAD = [
    *((TEXT.replace(*edit, 1), "changed after it was written") for edit in EDITS.items()),
    *((text, "not a result") for text in ("", "{", "null", '{"schema": 2}', '"\\ud800"')),
    ("[" * 100_000, "not a result"),
    (changed("track"), "key 'track' is missing"),
    (changed("protocol", "fingerprint"), r"key 'protocol\.fingerprint' is missing"),
    (changed("counts", "s"), "not of the same scenes"),
    (changed("counts", "s", "queries"), "no count of queries"),
    (changed("counts", "s", queries=2**53 - 1), "changed after it was written"),
    (changed("counts", "s", queries=2**53), "queries"),
    (changed("versions", "airzoo-bench"), "version of airzoo-bench is not given"),
    (changed("scenes", "s", "recall@1"), "do not fit the columns"),
    (changed("references", "chance", scenes={}), "not of the same scenes"),
    (changed("references", "chance", overall={"x": 3.0}), "do not fit the columns"),
    (changed("references", "chance", pooled={"recall@1": 1.5}), "above 1"),
]


@pytest.mark.parametrize(("text", "message"), BAD, ids=range(len(BAD)))
def test_what_is_no_result_or_was_changed(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "result.json").write_text(text)
    with pytest.raises(ResultError, match=message):
        read_result(tmp_path / "result.json")


def test_a_result_of_a_version_without_references_is_read(tmp_path: Path) -> None:
    content = json.loads(small_result().model_dump_json(by_alias=True))
    assert content.pop("references") == {}
    # As that version wrote it.
    assert content["checksum"] == "534c4d2bb46b689577a72e9f013c539ec783f46e722f6402f1391fe1cbbaaa0c"
    (tmp_path / "result.json").write_text(json.dumps(content))
    assert read_result(tmp_path / "result.json") == small_result()


def test_averages_by_hand() -> None:
    records = pd.DataFrame({"scene": list("eeeew"), "recall@1": [1.0, 0, 0, 0, 1]})
    records["error_m"] = records["recall@1"]
    found = summarise(records, [HIT, ERROR], ["w", "e"])
    assert list(found.scenes) == ["w", "e"]
    assert found.scenes["e"] == {"recall@1": 0.25, "error_m": 0.0}
    # Scenes count alike, of medians too; pooled, rows do.
    assert found.overall == {"recall@1": 0.625, "error_m": 0.5}
    assert found.pooled == {"recall@1": 0.4, "error_m": 0.0}
    failed = records.assign(error_m=[1, 2, np.inf, np.inf, np.inf])
    assert summarise(failed, [ERROR], ["e"]).overall == {"error_m": np.inf}
    for lost in (records.assign(error_m=np.nan), records[4:]):
        with pytest.raises(ValueError, match="error_m: no record, or NaN"):
            summarise(lost, [ERROR], ["e"])
    # Sums of single precision would lose half of the digits.
    single = np.array([0.1, 0.2, 0.4, 7.0], np.float32)
    found = summarise(pd.DataFrame({"scene": "s", "recall@1": single}), [HIT], ["s"])
    assert found.overall["recall@1"] == pytest.approx(sum(single.tolist()) / 4, rel=1e-15)
