"""Scoring a submission again: what agrees with what was claimed, and what does not."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.evaluation.evaluate import evaluate
from airzoo_bench.evaluation.track import Run
from airzoo_bench.leaderboard.checks import check_submission
from airzoo_bench.leaderboard.rescoring import (
    Rescored,
    claim_differences,
    pipeline_errors,
    rescore,
    score_range,
)
from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import Result, ScoreColumn, write_result
from tests.leaderboard.submission.support import checked, submission, write, write_board
from tests.statistics.support import CHAMFER, ERROR, HIT, SOFT, made_method


@pytest.fixture
def home(tmp_path: Path, perfect: Any) -> Path:
    write_board(tmp_path / "board")
    return write(tmp_path / "board", perfect)


def scored(home: Path, data: Path) -> Rescored:
    return rescore(checked(home, data), data=data, run=Run())


def result_of(home: Path, data: Path) -> Result:
    return evaluate(home / "preds.npz", data=data, method="SALAD").result


def lowered(result: Result, by: float, versions: dict[str, str] | None = None) -> Result:
    """Return a result with one score lower everywhere, as sound as any other."""
    key = result.columns[0].key
    parts = {
        "scenes": {scene: s | {key: s[key] - by} for scene, s in result.scenes.items()},
        "overall": result.overall | {key: result.overall[key] - by},
        "pooled": result.pooled | {key: result.pooled[key] - by},
    }
    update = parts | {"versions": versions or result.versions}
    return result.model_copy(update=update).with_checksum()


def test_what_was_claimed_is_found_again(home: Path, data: Path) -> None:
    found = scored(home, data)
    assert (found.agrees, found.lines) == (None, ("no result was claimed",))
    assert found.evaluation.result.predictions.method == "SALAD"
    for by in (0.0, 5e-10):  # rounding is no difference
        write_result(home / "result.json", lowered(result_of(home, data), by))
        found = scored(home, data)
        assert (found.agrees, found.lines) == (True, ("every score is as claimed",))


def test_retrieval_has_one_number_whatever_the_versions(home: Path, data: Path) -> None:
    result = result_of(home, data)
    versions = result.versions | {"scipy": "0.1"}
    write_result(home / "result.json", lowered(result, 1e-6, versions))
    found = scored(home, data)
    assert not found.agrees
    title = found.evaluation.result.columns[0].title
    parts = ("in scene east", "in scene west", "over scenes", "over all queries")
    claims = [f"{title} {part}: claimed 0.999999, re-scored 1" for part in parts]
    assert found.lines == (*claims, "the re-scored numbers stand")
    assert claims[0] in str(found.errors[0])


def test_another_truth_is_no_claim(home: Path, data: Path) -> None:
    result = result_of(home, data)
    truth = result.truth.model_copy(update={"fingerprint": "0" * 64})
    write_result(home / "result.json", result.model_copy(update={"truth": truth}).with_checksum())
    found = scored(home, data)
    assert not found.agrees
    assert "truth" in str(found.errors[0])


def test_a_claim_of_other_scenes_or_scores_is_refused(home: Path, data: Path) -> None:
    result = result_of(home, data)
    first, *rest = result.columns
    fewer = {
        "scenes": {scene: _without(s, first.key) for scene, s in result.scenes.items()},
        "overall": _without(result.overall, first.key),
        "pooled": _without(result.pooled, first.key),
        "references": {},
        "columns": tuple(rest),
    }
    renamed = {
        "scenes": {f"{scene}x": s for scene, s in result.scenes.items()},
        "counts": {f"{scene}x": c for scene, c in result.counts.items()},
        "truth": result.truth.model_copy(
            update={"scene_titles": {f"{s}x": t for s, t in result.truth.scene_titles.items()}}
        ),
        "references": {},
    }
    for changes, said in ((fewer, first.key), (renamed, "eastx")):
        write_result(home / "result.json", result.model_copy(update=changes).with_checksum())
        found = scored(home, data)
        assert not found.agrees
        assert "the claimed result.json has other" in str(found.errors[0])
        assert said in str(found.errors[0])


def _without(scores: dict[str, float], key: str) -> dict[str, float]:
    return {name: value for name, value in scores.items() if name != key}


def test_poses_that_are_the_prior_belong_to_its_class(home: Path, data: Path) -> None:
    result = result_of(home, data)
    counts = {scene: c | {"near_prior": 2} for scene, c in result.counts.items()}
    result = result.model_copy(update={"counts": counts})
    [error] = pipeline_errors(submission(), result)
    assert "4 of 10 poses are the photo's own prior" in str(error)
    says = submission(pipeline={"stages": "single-stage", "uses": ["prior"]})
    assert not list(pipeline_errors(says, result))


def test_nothing_is_scored_without_predictions(home: Path, data: Path, tmp_path: Path) -> None:
    (home / "preds.npz").unlink()
    found = check_submission(home, write_board(tmp_path / "board"), data)
    with pytest.raises(SubmissionError, match="there are no predictions to score"):
        rescore(found, data=data, run=Run())


FIVE, FOUR = [5.0, 1.0, 4.0, 2.0, 3.0], [4.0, 1.0, 3.0, 2.0]


@pytest.mark.parametrize(
    ("values", "column", "moved", "expected"),
    [
        ([1, 1, 0, 0], HIT, 1, (0.25, 0.75)),
        ([1, 0.5, 0, 0, 0.5], SOFT, 2, (0.0, 0.8)),
        ([1, 0.5], HIT, 0, (0.75, 0.75)),
        (FIVE, ERROR, 1, (2, 4)),
        (FIVE, ERROR, 2, (1, 5)),
        (FIVE, ERROR, 0, (3, 3)),
        (FOUR, ERROR, 1, (1.5, 3.5)),  # of two middle ones the mean
        ([1, 3], ERROR, 1, (0.5, math.inf)),
        ([1, math.inf, math.inf], ERROR, 1, (1, math.inf)),
        ([2, 10], CHAMFER, 1, (1, 11)),
        ([0.6], SOFT, 0.001, (0.599, 0.601)),  # a scene's F1
        ([20], CHAMFER, 0.001, (19.98, 20.02)),
    ],
)
def test_range_by_hand(
    values: list[float], column: ScoreColumn, moved: float, expected: tuple[float, float]
) -> None:
    assert score_range(np.array(values), column, moved) == pytest.approx(expected)


SIZES, MOST = {"large": 2_999, "small": 40}, {"large": 2, "small": 1}


def answered(moved: dict[str, int]) -> Scored:
    """Return matching whose errors are all different, some far off on another machine."""
    scenes = {}
    for scene, size in SIZES.items():
        errors = np.linspace(1, 2, size)
        errors[: moved.get(scene, 0)] = 99.0
        hits = (errors < 90).astype(float)
        scenes[scene] = {"error_m": errors.tolist(), "recall@1": hits.tolist()}
    made = made_method(scenes, (ERROR, HIT))
    return replace(made, result=made.result.model_copy(update={"track": "matching"}))


@pytest.mark.parametrize("scene", SIZES)
def test_so_many_queries_may_be_answered_otherwise_and_no_more(scene: str) -> None:
    here = answered({})
    as_many = [*claim_differences(answered(MOST).result, here)]
    assert len(as_many) == 8
    assert not any(one.matters for one in as_many)
    more = answered(MOST | {scene: MOST[scene] + 1}).result
    refused = {(one.part, one.key) for one in claim_differences(more, here) if one.matters}
    assert {(scene, "error_m"), (scene, "recall@1")} <= refused
    assert not refused & {(other, key) for other in SIZES for key in ("error_m", "recall@1")} - {
        (scene, "error_m"),
        (scene, "recall@1"),
    }
