"""What stays gives the numbers that were recorded (README.md)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.goldens.compare import compare
from tests.goldens.refusals import Refusal, problem, refusals
from tests.goldens.run import CASES, load, machine, observe, unpack


@pytest.mark.parametrize("name", CASES)
def test_numbers_are_those_that_were_recorded(name: str, tmp_path: Path) -> None:
    old = load(name)
    assert old["values"], f"record it: python -m tests.goldens --record {name}"
    new = observe(name, tmp_path)
    broken, allowed = compare(old["values"], new, old["machine"] == machine())
    print(*allowed, sep="\n")  # noqa: T201 - each query beyond the tolerance
    assert not broken, "\n".join(broken)


def test_on_another_machine_one_query_in_a_thousand_may_move() -> None:
    def solved(*errors: float) -> dict[str, Any]:
        records = {"query": [*"abc"], "error_m": [*errors]}
        return {"eval": {"kind": "matches", "records": records, "overall": sum(errors)}}

    old = solved(1.0, 2.0, 3.0)
    assert compare(old, solved(1.0, 2.0 + 9e-7, 3.0), True) == ([], [])
    one, two = solved(1.0, 2.0, 3.5), solved(1.0, 2.5, 3.5)
    lines = ["eval: records: error_m[2]: 3.0 -> 3.5", "eval: overall: 6.0 -> 6.5"]
    assert compare(old, one, False) == ([], lines)
    assert compare(old, one, True) == (lines, [])
    assert len(compare(old, two, False)[0]) == 3
    assert compare({"eval": {"recall": 0.5}}, {"eval": {"recall": 0.5 + 2e-9}}, False)[0]
    assert compare({"eval": {"recall": 0.5}}, {"eval": {}}, False)[0]


REFUSALS = refusals()


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folders = {one.inputs: tmp_path_factory.mktemp(one.inputs) for one in REFUSALS}
    for name, folder in folders.items():
        unpack(name, folder)
    return folders


@pytest.mark.parametrize("one", REFUSALS, ids=lambda one: f"{one.inputs}: {one.name}")
def test_bad_inputs_are_refused_by_name(
    one: Refusal, sound: dict[str, Path], tmp_path: Path
) -> None:
    assert not (fault := problem(one, sound[one.inputs], tmp_path / "spoilt")), fault
