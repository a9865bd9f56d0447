"""Notes beside the scores, by `eval` and by `check` alike, and what records tell of lists."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.evaluation.evaluate import Evaluation, check, evaluate
from airzoo_bench.retrieval.ranking import Ranking
from tests.retrieval.ranking_support import records_of
from tests.support import MadeScene, made_protocol, made_truth, write_benchmark, write_predictions


def both(path: Path, data: Path, *words: str) -> Evaluation:
    """Return what `eval` finds, having held its notes to words and to those of `check`."""
    found, checked = evaluate(path, data=data), check(path, data=data)
    notes = list(found.result.notes)
    assert checked.errors == []
    assert [note for note in checked.notes if note in notes] == notes
    assert all(any(word in note for note in notes) for word in words)
    assert bool(words) == bool(notes)
    return found


def test_empty_lists_are_counted_as_missing(
    data: Path, tmp_path: Path, perfect: dict[str, Any]
) -> None:
    whole = write_predictions(tmp_path / "q.npz", "made-retrieval", **perfect)
    both(whole, data)
    ranked = np.array(perfect["ranked_ids"])
    ranked[1:3] = ""
    arrays = {"query_ids": perfect["query_ids"], "ranked_ids": ranked}
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


def test_ranks_that_short_lists_lack_score_nothing(
    data: Path, tmp_path: Path, perfect: dict[str, Any]
) -> None:
    lists, results = np.array(perfect["ranked_ids"]), []
    filled = np.where(np.arange(lists.shape[1]) < 3, lists, "")
    for ranked in (lists[:, :3], filled):
        arrays = {"query_ids": perfect["query_ids"], "ranked_ids": ranked}
        path = write_predictions(tmp_path / "p.npz", "made-retrieval", **arrays)
        results.append(evaluate(path, data=data).records)
    assert results[0].equals(results[1])


def test_ties_and_scorers_that_say_nothing(
    data: Path, tmp_path: Path, scenes: list[MadeScene]
) -> None:
    queries = [q for s in scenes for q in s.query_ids]
    arrays = {
        "query_ids": queries,
        "query_descriptors": np.random.default_rng(0).standard_normal((len(queries), 4)),
        "gallery_ids": [t for s in scenes for t in s.tile_ids],
        "gallery_descriptors": np.ones((20, 4)),
    }
    path = write_predictions(tmp_path / "p.npz", "made-retrieval", **arrays)
    both(path, data, "10 queries depend on ties", "10 queries give all tiles the same score")


def test_the_first_tiles_are_named_rank_by_rank_down_to_the_deepest_recall() -> None:
    scene = MadeScene("east", [[3], [0], [1, 2]], 9)
    tiles = np.array([[3, 1, 8, 7, 6, 5, 4], [2, 0, -1, -1, -1, -1, -1], [-1] * 7], np.int32)
    settings, ranking = made_protocol([scene]).scores, Ranking(tiles, np.zeros(3, bool))
    assert settings.recall_at == (1, 3, 5)
    records = records_of(made_truth(scene), ranking, settings, np.array([True, True, False]))
    names = [f"tile@{rank}" for rank in range(1, 6)]
    assert [name for name in records if str(name).startswith("tile@")] == names
    assert records[names].to_numpy().tolist() == [
        ["east/t00003", "east/t00001", "east/t00008", "east/t00007", "east/t00006"],
        ["east/t00002", "east/t00000", "", "", ""],
        [""] * 5,
    ]
    assert records["ranked"].tolist() == [7, 2, 0]
    assert records["first_hit_rank"].tolist() == [1, 2, 0]
