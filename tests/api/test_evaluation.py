"""Scoring and checking from Python is what the command line does."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import airzoo_bench as ab
from tests.support import run_main, write_predictions


@pytest.fixture
def path(tmp_path: Path, perfect: dict[str, Any]) -> Path:
    return write_predictions(tmp_path / "mine.npz", "made-retrieval", **perfect)


def test_as_the_command_line(data: Path, path: Path, tmp_path: Path) -> None:
    assert run_main("eval", "retrieval", path, "--out", tmp_path / "out", "--method", "mine") == 0
    one, other = ab.evaluate(path), ab.load_result(tmp_path / "out")
    assert one.name == other.name == "mine"
    assert one.result.scenes == other.result.scenes
    pd.testing.assert_frame_equal(one.to_frame(), other.to_frame())
    assert repr(one) == repr(other)
    assert "R@1" in one._repr_html_()
    assert one.overall["recall@1"] == 1.0


def test_arrays_score_as_their_file(data: Path, path: Path, perfect: dict[str, Any]) -> None:
    one = ab.evaluate(perfect, protocol="made-retrieval", data=data, method="mine")
    other = ab.evaluate(path)
    pd.testing.assert_frame_equal(one.to_frame(), other.to_frame())
    pd.testing.assert_frame_equal(one.records, other.records)
    assert ab.compare([one, ab.evaluate(path, method="theirs")]) is not None
    named = {**perfect, "protocol": "made-retrieval"}
    assert ab.evaluate(named, data=data).overall == other.overall


def test_a_check(data: Path, perfect: dict[str, Any]) -> None:
    found = ab.check(perfect, protocol="made-retrieval")
    assert found.ok
    assert repr(found) == "nothing wrong was found"
    fewer = {name: values[:-1] for name, values in perfect.items()}
    noted = ab.check(fewer, protocol="made-retrieval")
    assert noted.ok
    assert "west/q00003" in noted.notes[0]
    twice = {**perfect, "query_ids": [perfect["query_ids"][0], *perfect["query_ids"][:-1]]}
    refused = ab.check(twice, protocol="made-retrieval")
    assert not refused.ok
    assert "more than once" in repr(refused)
    with pytest.raises(ab.UserError, match="more than once"):
        ab.evaluate(twice, protocol="made-retrieval")


def test_arguments_that_cannot_be(data: Path, perfect: dict[str, Any]) -> None:
    with pytest.raises(ab.ArgumentError, match="protocol"):
        ab.evaluate(perfect)
    with pytest.raises(ab.UserError, match="mada-retrieval"):
        ab.evaluate(perfect, protocol="mada-retrieval")
    column = {**perfect, "query_ids": pd.Series(perfect["query_ids"])}
    assert ab.evaluate(column, protocol="made-retrieval").overall["recall@1"] == 1.0
    ragged = {**perfect, "ranked_ids": np.array([["a"], ["a", "b"]], dtype=object)}
    with pytest.raises(ab.ArgumentError, match="ranked_ids"):
        ab.evaluate(ragged, protocol="made-retrieval")
