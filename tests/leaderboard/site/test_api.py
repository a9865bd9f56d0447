"""The API's dataclasses, its description, and JSON that any reader takes."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path

import pytest

from airzoo_bench.leaderboard.site import api
from tests.leaderboard.site.make_sample import sample

DOC = Path(__file__).parents[3] / "docs" / "leaderboard-api.md"
CLASSES = [
    getattr(api, name) for name in api.__all__ if dataclasses.is_dataclass(getattr(api, name))
]


@pytest.mark.parametrize("kind", CLASSES)
def test_every_field_is_described(kind: type) -> None:
    text = DOC.read_text(encoding="utf-8")
    missing = [f.name for f in dataclasses.fields(kind) if f"`{f.name}`" not in text]
    assert not missing


def test_the_version_is_that_of_the_path() -> None:
    assert f"`site/api/v{api.API}/`" in DOC.read_text(encoding="utf-8")


def test_json_has_no_number_that_is_none() -> None:
    value = {"a": math.inf, "b": [-math.inf, 1.5], "c": None, "d": "<b>"}
    found = api.as_json(value)
    assert found == {"a": "Infinity", "b": ["-Infinity", 1.5], "c": None, "d": "<b>"}
    assert json.loads(json.dumps(sample(5), allow_nan=False))["board.json"]["api"] == api.API
