"""Prediction files as they are read, and the notes on them by `eval` and by `check` alike."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.evaluation.evaluate import Evaluation, check, evaluate
from airzoo_bench.evaluation.track import Run
from airzoo_bench.retrieval.predictions import (
    Descriptors,
    check_lists,
    check_predictions,
    read_retrieval,
)
from airzoo_bench.tables.layouts import method_table
from tests.support import MadeScene, made_protocol, write_benchmark, write_predictions


def test_ids_of_bytes_numbers_of_another_order_and_no_score_beside_an_empty_id(
    tmp_path: Path,
) -> None:
    arrays: dict[str, Any] = {"query_ids": np.array([b"e/a", b"e/b"]), "protocol": "p"}
    lists = {"ranked_ids": [["e/1", "e/2"], ["e/2", ""]], "scores": [[2, 1], [3, np.nan]]}
    gallery = np.asfortranarray(np.arange(6, dtype=">f4").reshape(3, 2))
    described = {"query_descriptors": np.eye(2), "gallery_descriptors": gallery}
    for fields in (lists, described | {"gallery_ids": ["e/1", "e/2", "e/3"]}):
        np.savez(tmp_path / "p.npz", **arrays, **fields)
        read = read_retrieval(tmp_path / "p.npz", 1 << 24)
        check_predictions(read)
        assert (read.protocol, read.query_ids.tolist()) == ("p", ["e/a", "e/b"])
    assert isinstance(read.content, Descriptors)
    np.testing.assert_array_equal(read.content.gallery, gallery)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_scores_fall_or_rise_and_the_fewer_lists_are_at_fault(sign: float) -> None:
    ids, names = np.array([["a", "b", "c"]] * 3), ["q0", "q1", "q2"]
    scores = sign * np.array([[3.0, 2.0, 1.0], [2.0, 2.0, 1.0], [9.0, 5.0, 5.0]])
    check_lists(ids, scores, names)
    scores[1] = scores[1, ::-1]
    with pytest.raises(PredictionError, match=r"1 of 3 \(q1\)"):
        check_lists(ids, scores, names)


# --- scored ---


def both(path: Path, data: Path, *words: str) -> Evaluation:
    """Return what `eval` finds, having held its notes to words and to those of `check`."""
    found, checked = evaluate(path, data=data), check(path, data=data)
    notes = list(found.result.notes)
    assert checked.errors == []
    assert [note for note in checked.notes if note in notes] == notes
    assert all(any(word in note for note in notes) for word in words)
    assert bool(words) == bool(notes)
    return found


def test_empty_and_short_lists_are_worst_and_counted(
    data: Path, tmp_path: Path, perfect: dict[str, Any]
) -> None:
    both(write_predictions(tmp_path / "q.npz", "made-retrieval", **perfect), data)
    lists, records = np.array(perfect["ranked_ids"]), []
    last = lists[:, ::-1]  # no positives
    for ranked in (last[:, :3], np.where(np.arange(lists.shape[1]) < 3, last, "")):
        arrays = {"query_ids": perfect["query_ids"], "ranked_ids": ranked}
        path = write_predictions(tmp_path / "p.npz", "made-retrieval", **arrays)
        found = both(path, data, "R@5")
        records.append(found.records)
        assert any("R@5" in note for note in method_table([found.result]).notes)
    assert records[0].equals(records[1])
    arrays = {"query_ids": perfect["query_ids"], "ranked_ids": lists[:, ::-1][:, :-1]}
    path = write_predictions(tmp_path / "p.npz", "made-retrieval", **arrays)
    found = both(path, data, "mAP")
    assert not any("mAP" in note for note in method_table([found.result]).notes)
    lists[1:3] = ""
    arrays = {"query_ids": perfect["query_ids"], "ranked_ids": lists}
    path = write_predictions(tmp_path / "p.npz", "made-retrieval", **arrays)
    found = both(path, data, "2 queries have an empty list")
    assert found.result.counts["east"]["empty_lists"] == 2
    assert found.result.counts["east"]["missing"] == 2
    assert (~found.records["answered"]).sum() == 2


@pytest.mark.parametrize(("rule", "share", "asked"), [("exclude", 1.0, 3), ("miss", 0.6, 5)])
def test_queries_that_no_tile_answers(tmp_path: Path, rule: str, share: float, asked: int) -> None:
    """Made by hand: `prepare` would have left two of the five out."""
    scene = MadeScene("east", [[0], [], [1], [], [2]], 3)
    made = made_protocol([scene])
    rules = made.ground_truth.model_copy(update={"without_positive": rule})
    made = made.model_copy(update={"ground_truth": rules})
    write_benchmark(tmp_path / "made", made, [scene])
    ranked = [[scene.tile(max(found, default=0))] for found in scene.positives]
    arrays = {"query_ids": scene.query_ids, "ranked_ids": ranked}
    path = write_predictions(tmp_path / "p.npz", "made-retrieval", **arrays)
    named = ["2 (east/q00001, east/q00003)"] if rule == "exclude" else []
    result = both(path, tmp_path, *named).result
    assert result.overall["recall@1"] == share
    assert result.counts["east"]["queries"] == asked
    assert result.counts["east"]["without_positive"] == 2


def test_gallery_rows_stand_in_any_order_whatever_the_memory(
    data: Path, tmp_path: Path, scenes: list[MadeScene]
) -> None:
    random = np.random.default_rng(2)
    arrays = {
        "query_ids": [q for s in scenes for q in s.query_ids][:1],
        "query_descriptors": random.standard_normal((1, 4_000)).astype(np.float32),
    }
    tiles = np.array([t for s in scenes for t in s.tile_ids])
    described = random.standard_normal((20, 4_000)).astype(np.float32)
    records = []
    for order in (np.arange(20), random.permutation(20)):
        gallery = {"gallery_ids": tiles[order], "gallery_descriptors": described[order]}
        path = write_predictions(tmp_path / "p.npz", "made-retrieval", **arrays, **gallery)
        for run in (Run(), Run(jobs=2), Run(100_000)):  # a scene has more bytes than the last
            records.append(evaluate(path, data=data, run=run).records)
    for one in records:
        pd.testing.assert_frame_equal(one, records[0])
