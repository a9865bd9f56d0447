"""What is said beside the scores, by `eval` and by `check` alike, and the chance level."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.evaluation.evaluate import check, evaluate
from tests.support import MadeScene, made_protocol, write_benchmark, write_predictions


def both(path: Path, data: Path) -> list[str]:
    """Return the notes of `eval`, having held those of `check` to them."""
    notes = list(evaluate(path, data=data).result.notes)
    checked = check(path, data=data)
    assert checked.errors == []
    assert [note for note in checked.notes if note in notes] == notes
    return notes


def has(notes: list[str], *words: str) -> bool:
    return any(all(word in note for word in words) for note in notes)


def test_empty_lists_are_counted_as_missing(
    data: Path, tmp_path: Path, perfect: dict[str, Any]
) -> None:
    ranked = np.array(perfect["ranked_ids"])
    ranked[1:3] = ""
    path = write_predictions(
        tmp_path / "p.npz", "made-retrieval", query_ids=perfect["query_ids"], ranked_ids=ranked
    )
    assert has(both(path, data), "2 queries have an empty list")
    evaluation = evaluate(path, data=data)
    assert evaluation.result.counts["east"]["empty_lists"] == 2
    assert evaluation.result.counts["east"]["missing"] == 2
    assert (~evaluation.records["answered"]).sum() == 2


def test_lists_that_end_before_their_positives_are_said(
    data: Path, tmp_path: Path, scenes: list[MadeScene], perfect: dict[str, Any]
) -> None:
    lists = []
    for scene in scenes:
        for found in scene.positives:
            wrong = [t for t in range(scene.n_tiles) if t not in found]
            lists.append([scene.tile(t) for t in wrong[:5]])
    path = write_predictions(
        tmp_path / "p.npz", "made-retrieval", query_ids=perfect["query_ids"], ranked_ids=lists
    )
    assert has(both(path, data), "10 lists end without all positives")
    whole = write_predictions(tmp_path / "q.npz", "made-retrieval", **perfect)
    assert both(whole, data) == []


@pytest.mark.parametrize("rule", ["exclude", "miss"])
def test_queries_that_no_tile_answers(tmp_path: Path, rule: str) -> None:
    """Made by hand: `prepare` would have left two of the five out."""
    scene = MadeScene("east", [[0], [], [1], [], [2]], 3)
    made = made_protocol([scene])
    rules = made.ground_truth.model_copy(update={"without_positive": rule})
    made = made.model_copy(update={"ground_truth": rules})
    write_benchmark(tmp_path / "made", made, [scene])
    ranked = [[scene.tile(max(found, default=0))] for found in scene.positives]
    path = write_predictions(
        tmp_path / "p.npz", "made-retrieval", query_ids=scene.query_ids, ranked_ids=ranked
    )
    result = evaluate(path, data=tmp_path).result
    share, counts = {"exclude": (1.0, 3), "miss": (0.6, 5)}[rule]
    assert result.overall["recall@1"] == share
    assert result.counts["east"]["queries"] == counts
    assert result.counts["east"]["without_positive"] == 2
    named = has(both(path, tmp_path), "2 (east/q00001, east/q00003)")
    assert named == (rule == "exclude")


@pytest.mark.parametrize("depth", [1, 3, 4])
def test_ranks_that_short_lists_lack_score_nothing(
    data: Path, tmp_path: Path, perfect: dict[str, Any], depth: int
) -> None:
    lists = np.array(perfect["ranked_ids"])
    filled = np.where(np.arange(lists.shape[1]) < depth, lists, "")
    results = []
    for name, ranked in (("short", lists[:, :depth]), ("filled", filled)):
        arrays = {"query_ids": perfect["query_ids"], "ranked_ids": ranked}
        path = write_predictions(tmp_path / f"{name}.npz", "made-retrieval", **arrays)
        results.append(evaluate(path, data=data))
    assert results[0].records.equals(results[1].records)


def test_ties_and_scorers_that_say_nothing_are_noted_by_check_too(
    data: Path, tmp_path: Path, scenes: list[MadeScene]
) -> None:
    queries = [q for s in scenes for q in s.query_ids]
    arrays = {
        "query_ids": queries,
        "query_descriptors": np.random.default_rng(0).standard_normal((len(queries), 4)),
        "gallery_ids": [t for s in scenes for t in s.tile_ids],
        "gallery_descriptors": np.ones((20, 4)),
    }
    notes = both(write_predictions(tmp_path / "p.npz", "made-retrieval", **arrays), data)
    assert has(notes, "10 queries depend on ties")
    assert has(notes, "10 queries give all tiles the same score")
