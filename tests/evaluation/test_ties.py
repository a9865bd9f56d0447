"""Ties: a constant scorer gains nothing, whatever the form of its file or the order of its rows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.evaluation.track import Run
from tests.evaluation.scored import score
from tests.support import MadeScene, made_protocol, write_benchmark, write_predictions

N_TIED = 300


def constant_predictions(scene: MadeScene) -> dict[str, dict[str, Any]]:
    """Every way of saying the same of all tiles, with the tile that answers in the first place."""
    random = np.random.default_rng(0)
    n = len(scene.positives)
    lists = [[scene.tile(t) for t in [q, *range(q), *range(q + 1, N_TIED)]] for q in range(n)]
    ids = {"query_ids": scene.query_ids}
    predictions = {}
    for listed in (5, 20, 100, 101, N_TIED):
        ranked = [row[:listed] for row in lists]
        predictions[f"ids {listed}"] = ids | {"ranked_ids": ranked, "scores": np.ones((n, listed))}
    short = [[*row[:3], "", ""] for row in lists]
    predictions["ids 3"] = ids | {"ranked_ids": short, "scores": np.ones((n, 5))}
    described = ids | {"gallery_ids": scene.tile_ids}
    for dtype in (np.float16, np.float32, np.float64):
        queries = random.standard_normal((n, 8)).astype(dtype)
        predictions[f"equal {dtype.__name__}"] = described | {
            "query_descriptors": queries,
            "gallery_descriptors": np.ones((N_TIED, 8), dtype),
        }
    return predictions


@pytest.mark.parametrize("form", constant_predictions(MadeScene("s", [[0]], N_TIED)))
def test_constant_scorers_of_every_form_score_exactly_nothing(form: str, tmp_path: Path) -> None:
    scene = MadeScene("s", [[q, q + 5] for q in range(4)], N_TIED)
    chosen = made_protocol([scene])
    chosen = type(chosen).model_validate(
        chosen.model_dump(by_alias=True)
        | {"scores": chosen.scores.model_dump() | {"descriptor_metric": "cosine"}}
    )
    write_benchmark(tmp_path / "data" / "made", chosen, [scene])
    path = write_predictions(
        tmp_path / "p.npz", "made-retrieval", **constant_predictions(scene)[form]
    )
    result = score(path, tmp_path / "data").result
    assert result.overall.pop("distance_m") == np.inf
    assert set(result.overall.values()) == {0.0}
    assert result.counts["s"]["tie_dependent"] == 4


def test_a_tie_is_broken_before_a_list_is_cut(tmp_path: Path) -> None:
    # One tile is told apart and wrong; 299 tie, and the one that answers stands second.
    scene = MadeScene("s", [[7]], N_TIED)
    write_benchmark(tmp_path / "data" / "made", made_protocol([scene]), [scene])
    others = [scene.tile(t) for t in range(N_TIED) if t not in (7, 40)]
    path = write_predictions(
        tmp_path / "p.npz",
        "made-retrieval",
        query_ids=scene.query_ids,
        ranked_ids=[[scene.tile(40), scene.tile(7), *others]],
        scores=[[1.0, *[0.5] * (N_TIED - 1)]],
    )
    evaluation = score(path, tmp_path / "data")
    assert evaluation.result.overall["map"] == 0.0
    assert evaluation.result.overall["mrr"] == 0.0
    assert evaluation.records["ranked"].tolist() == [100]
    assert evaluation.records["tie_dependent"].tolist() == [True]


def test_gallery_rows_may_stand_in_any_order(
    data: Path, tmp_path: Path, scenes: list[MadeScene]
) -> None:
    random = np.random.default_rng(2)
    arrays = {
        "query_ids": [q for s in scenes for q in s.query_ids],
        "query_descriptors": random.standard_normal((10, 4)).astype(np.float32),
    }
    tiles = np.array([t for s in scenes for t in s.tile_ids])
    described = random.standard_normal((20, 4)).astype(np.float32)
    records = []
    for order in (np.arange(20), random.permutation(20)):
        gallery = {"gallery_ids": tiles[order], "gallery_descriptors": described[order]}
        path = write_predictions(tmp_path / "p.npz", "made-retrieval", **arrays, **gallery)
        records.append(score(path, data, run=Run(jobs=2)).records)
    pd.testing.assert_frame_equal(*records)
