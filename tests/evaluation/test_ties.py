"""Ties: a constant scorer gains nothing, whatever the form of its file or the order of its rows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.evaluation.evaluate import evaluate
from airzoo_bench.evaluation.track import Run
from tests.support import MadeScene, made_protocol, write_benchmark, write_predictions

N_TIED = 300
SCENE = MadeScene("s", [[q, q + 5] for q in range(4)], N_TIED)


def constant_predictions() -> dict[str, dict[str, Any]]:
    """Every way of saying the same of all tiles, with the tile that answers in the first place."""
    lists = [[SCENE.tile(t) for t in [q, *range(q), *range(q + 1, N_TIED)]] for q in range(4)]
    found: dict[str, dict[str, Any]] = {}
    for listed in (5, 20, 100, 101, N_TIED):
        ranked = [row[:listed] for row in lists]
        found[f"ids {listed}"] = {"ranked_ids": ranked, "scores": np.ones((4, listed))}
    short = [[*row[:3], "", ""] for row in lists]
    found["ids 3"] = {"ranked_ids": short, "scores": np.ones((4, 5))}
    for dtype in (np.float16, np.float32, np.float64):
        found[f"equal {dtype.__name__}"] = {
            "query_descriptors": np.random.default_rng(0).standard_normal((4, 8)).astype(dtype),
            "gallery_ids": SCENE.tile_ids,
            "gallery_descriptors": np.ones((N_TIED, 8), dtype),
        }
    return found


def test_constant_scorers_of_every_form_score_exactly_nothing(tmp_path: Path) -> None:
    chosen = made_protocol([SCENE])
    scores = chosen.scores.model_dump() | {"descriptor_metric": "cosine"}
    values = chosen.model_dump(by_alias=True) | {"scores": scores}
    write_benchmark(tmp_path / "data" / "made", type(chosen).model_validate(values), [SCENE])
    for form, arrays in constant_predictions().items():
        path = tmp_path / f"{form}.npz"
        write_predictions(path, "made-retrieval", query_ids=SCENE.query_ids, **arrays)
        result = evaluate(path, data=tmp_path / "data").result
        assert result.overall.pop("distance_m") == np.inf, form
        assert set(result.overall.values()) == {0.0}, form
        assert result.counts["s"]["tie_dependent"] == 4, form


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
    evaluation = evaluate(path, data=tmp_path / "data")
    assert (evaluation.result.overall["map"], evaluation.result.overall["mrr"]) == (0.0, 0.0)
    assert evaluation.records["ranked"].tolist() == [100]
    assert evaluation.records["tie_dependent"].tolist() == [True]


@pytest.mark.parametrize("jobs", [1, 2])
def test_gallery_rows_may_stand_in_any_order(
    data: Path, tmp_path: Path, scenes: list[MadeScene], jobs: int
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
        records.append(evaluate(path, data=data, run=Run(jobs=jobs)).records)
    pd.testing.assert_frame_equal(*records)
