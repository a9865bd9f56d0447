"""The whole path from a prediction file to a result, in process."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.evaluation.run_files import save
from airzoo_bench.results.result import Result, read_result, write_result
from tests.evaluation.scored import score
from tests.statistics.support import made_method, write_method
from tests.support import (
    MadeScene,
    files_below,
    made_protocol,
    made_truth,
    run_main,
    write_predictions,
)


def test_overall_is_the_unweighted_mean_of_scenes(
    data: Path, tmp_path: Path, perfect: dict[str, Any]
) -> None:
    # All 6 queries of east are answered, none of the 4 of west: 1/2 over scenes, 6/10 pooled.
    half = {key: rows[:6] for key, rows in perfect.items()}
    result = score(write_predictions(tmp_path / "p.npz", "made-retrieval", **half), data).result
    assert result.scenes["east"]["recall@1"] == 1.0
    assert result.scenes["west"]["recall@1"] == 0.0
    assert result.overall["recall@1"] == 0.5
    assert result.pooled["recall@1"] == 0.6
    assert result.counts["west"]["missing"] == 4
    assert any("scored at their worst: 4 of 10 (" in note for note in result.notes)


def test_a_missing_query_is_infinitely_far(
    data: Path, tmp_path: Path, perfect: dict[str, Any]
) -> None:
    one = {key: rows[:1] for key, rows in perfect.items()}
    evaluation = score(write_predictions(tmp_path / "p.npz", "made-retrieval", **one), data)
    records = evaluation.records.set_index("query")
    assert records.loc["east/q00000", "distance_m"] < 1e-6
    assert np.isinf(records.loc["east/q00001", "distance_m"])
    assert np.isinf(evaluation.result.overall["distance_m"])
    save(evaluation, tmp_path / "out")
    assert np.isinf(read_result(tmp_path / "out" / "result.json").overall["distance_m"])


def test_extra_queries_are_counted_and_left_aside(
    data: Path, tmp_path: Path, perfect: dict[str, Any]
) -> None:
    one = {"query_ids": "east/unknown", "ranked_ids": perfect["ranked_ids"][0]}
    more = {key: [*rows, one[key]] for key, rows in perfect.items()}
    result = score(write_predictions(tmp_path / "p.npz", "made-retrieval", **more), data).result
    assert (result.extra_queries, result.overall["recall@1"]) == (1, 1.0)


def test_neither_the_order_of_the_file_nor_the_run_changes_a_byte(
    data: Path, tmp_path: Path, perfect: dict[str, Any]
) -> None:
    turned = {key: rows[::-1] for key, rows in perfect.items()}
    for name, arrays in (("a", perfect), ("b", perfect), ("c", turned)):
        path = write_predictions(tmp_path / "p.npz", "made-retrieval", **arrays)
        save(score(path, data), tmp_path / name)
    for name, others in (("result.json", "b"), ("records.csv", "bc")):
        for other in others:
            same = (tmp_path / other / name).read_bytes()
            assert (tmp_path / "a" / name).read_bytes() == same


def test_fingerprints_see_what_can_change_a_score(scenes: list[MadeScene]) -> None:
    chosen = made_protocol(scenes)
    values = chosen.model_dump(by_alias=True)
    reworded = type(chosen).model_validate(values | {"title": "other words", "summary": "other"})
    stricter = type(chosen).model_validate(
        values | {"scores": values["scores"] | {"recall_at": (1, 2)}}
    )
    assert reworded.fingerprint == chosen.fingerprint
    assert stricter.fingerprint != chosen.fingerprint
    moved = MadeScene("east", [[q, q + 2] for q in range(6)], 12)
    assert made_truth(moved).fingerprint != made_truth(scenes[0]).fingerprint
    assert made_truth(scenes[0]).fingerprint == made_truth(scenes[0]).fingerprint


def test_a_changed_protocol_does_not_pass_for_its_namesake(
    data: Path, tmp_path: Path, perfect: dict[str, Any]
) -> None:
    path = write_predictions(tmp_path / "p.npz", "made-retrieval", **perfect)
    known = next(data.rglob("made-retrieval.toml")).read_text()
    for old, new, notes in (
        ('ap = "precision"', 'ap = "hits"', ("scores.ap is precision against hits",)),
        ('title = "', 'title = "My own ', ()),
    ):
        assert old in known
        mine = tmp_path / "mine.toml"
        mine.write_text(known.replace(old, new))
        found = score(path, data, protocol=str(mine)).result.notes
        assert len(found) == len(notes)
        for note, part in zip(found, notes, strict=True):
            assert part in note
            assert "not the made-retrieval that all have" in note


def test_a_run_replaces_an_earlier_one_and_says_so(
    data: Path, tmp_path: Path, perfect: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "mymethod"
    before = write_method(out, made_method({"east": {"recall@1": [1.0]}}))
    left = json.loads(before.read_text()) | {"track": "matching"}
    write_result(before, Result.model_validate(left).with_checksum())
    for name in ("alignment.json", "notes.txt"):
        (out / name).touch()
    (out / "figures").mkdir()
    path = write_predictions(tmp_path / "p.npz", "made-retrieval", **perfect)
    assert run_main("eval", "retrieval", tmp_path / "none.npz", "--out", out) == 2
    said = capsys.readouterr().err
    assert "none.npz: no such prediction file" in said
    assert ".npz or .parquet" in said  # all that the track takes
    assert "takes its place" not in said  # of nothing, since it cannot begin
    assert run_main("eval", "retrieval", path, "--data", data, "--out", out) == 0
    said = capsys.readouterr().err
    assert f"{out} holds a run" in said
    assert f"wrote {out / 'result.json'}, {out / 'records.csv'} of method mymethod" in said
    assert files_below(out) == {"result.json", "records.csv", "notes.txt"}
    assert read_result(out / "result.json").predictions.method == "mymethod"
    assert run_main("eval", "retrieval", path, "--data", data, "--out", out, "--method", "M") == 0
    assert read_result(out / "result.json").predictions.method == "M"
