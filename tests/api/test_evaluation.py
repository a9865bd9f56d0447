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


@pytest.mark.parametrize("function", [ab.evaluate, ab.check])
def test_tables_whose_ranks_are_sorted_as_texts(
    function: Any, data: Path, perfect: dict[str, Any]
) -> None:
    """As `pivot` leaves them: rank_1, rank_10, rank_2."""
    ids = np.array(perfect["ranked_ids"])
    table = pd.DataFrame(ids, columns=[f"rank_{k}" for k in range(1, ids.shape[1] + 1)])
    good = {**perfect, "protocol": "made-retrieval", "ranked_ids": table}
    function(good, data=data)
    for name in ("ranked_ids", "scores"):
        wrong = table if name == "ranked_ids" else table.map(lambda _: 0.5)
        wrong = wrong[[*wrong.columns[1:], wrong.columns[0]]]
        with pytest.raises(ab.ArgumentError, match=f"{name}: has the columns"):
            function({**good, name: wrong}, data=data)


def test_descriptors_whose_columns_differ(data: Path, perfect: dict[str, Any]) -> None:
    rows = pd.DataFrame(np.eye(3), columns=[*"abc"])
    arrays = {"protocol": "made-retrieval", "query_ids": perfect["query_ids"]}
    arrays |= {"query_descriptors": rows, "gallery_descriptors": rows[[*"cab"]]}
    with pytest.raises(ab.ArgumentError, match="have different columns"):
        ab.evaluate(arrays, data=data)


def test_coordinates_are_taken_by_their_names(
    data: Path, perfect: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    written: dict[str, Any] = {}
    monkeypatch.setattr("airzoo_bench.api.evaluation.write_npz", lambda _, one: written.update(one))
    table = pd.DataFrame([[1.0, 2.0]], columns=["y", "x"])
    with pytest.raises(ab.UserError):  # nothing was written
        ab.evaluate({"protocol": "made-matching", "query_xy": table}, data=data)
    assert written["query_xy"].tolist() == [[2.0, 1.0]]


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
    with pytest.raises(ab.ArgumentError, match="do not say which protocol"):
        ab.evaluate(perfect)
    with pytest.raises(ab.UserError, match="unknown protocol 'mada-retrieval'"):
        ab.evaluate(perfect, protocol="mada-retrieval")
    column = {**perfect, "query_ids": pd.Series(perfect["query_ids"])}
    assert ab.evaluate(column, protocol="made-retrieval").overall["recall@1"] == 1.0
    ragged = {**perfect, "ranked_ids": np.array([["a"], ["a", "b"]], dtype=object)}
    with pytest.raises(ab.ArgumentError, match="'ranked_ids' holds Python objects, or lists of"):
        ab.evaluate(ragged, protocol="made-retrieval")
