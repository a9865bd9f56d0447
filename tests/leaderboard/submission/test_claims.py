"""Claimed results: what another machine may find otherwise, and what is refused."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.evaluation.track import Run
from airzoo_bench.leaderboard.checks import check_claim, check_pipeline
from airzoo_bench.leaderboard.scoring import score_submission
from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import Result, write_result
from tests.leaderboard.submission.support import checked, submission, write, write_board
from tests.statistics.support import ERROR, HIT, made_method


def lowered(result: Result, by: float) -> Result:
    """Return a result with one score lower everywhere, as sound as any other."""
    key = result.columns[0].key
    parts = {
        "scenes": {scene: s | {key: s[key] - by} for scene, s in result.scenes.items()},
        "overall": result.overall | {key: result.overall[key] - by},
        "pooled": result.pooled | {key: result.pooled[key] - by},
    }
    return result.model_copy(update=parts).with_checksum()


def test_retrieval_has_one_number_on_any_machine(tmp_path: Path, data: Path, perfect: Any) -> None:
    write_board(tmp_path / "board")
    home = write(tmp_path / "board", perfect)
    scored, lines, errors = score_submission(checked(home, data), data, Run())
    assert (lines, errors) == ([], [])
    for by, refused in ((0.0, 0), (5e-10, 0), (1e-6, 1)):  # rounding is no difference
        write_result(home / "result.json", lowered(scored.result, by))
        _, lines, errors = score_submission(checked(home, data), data, Run())
        assert (len(lines), len(errors)) == (refused, refused)
    assert lines == ["R@1: claimed 0.999999, re-scored 1"]
    truth = scored.result.truth.model_copy(update={"fingerprint": "0" * 64})
    other = scored.result.model_copy(update={"truth": truth}).with_checksum()
    _, error = check_claim(other, Scored("SALAD", scored.result, scored.records))
    assert error is not None


def answered(moved: int, size: int) -> Scored:
    """Return matching whose errors are all different, some far off on another machine."""
    errors = np.linspace(1, 2, size)
    errors[:moved] = 99.0
    hits = (errors < 90).astype(float)
    scenes = {"east": {"error_m": errors.tolist(), "recall@1": hits.tolist()}}
    made = made_method(scenes, (ERROR, HIT))
    return replace(made, result=made.result.model_copy(update={"track": "matching"}))


@pytest.mark.parametrize(("size", "most"), [(2_999, 2), (40, 1)])
def test_so_many_queries_may_be_answered_otherwise_and_no_more(size: int, most: int) -> None:
    here = answered(0, size)
    assert check_claim(answered(most, size).result, here)[1] is None
    lines, error = check_claim(answered(most + 1, size).result, here)
    assert error is not None
    assert len(lines) == 2


def test_a_median_of_failures_is_infinite_on_both_machines() -> None:
    here = answered(30, 40)
    far = made_method({"east": {"error_m": [math.inf] * 40, "recall@1": [0.0] * 40}}, (ERROR, HIT))
    both = replace(here, result=far.result, records=far.records)
    assert check_claim(both.result, both) == ([], None)


def test_poses_that_are_the_prior_belong_to_its_class() -> None:
    result = answered(0, 10).result
    counts = {scene: c | {"near_prior": 2} for scene, c in result.counts.items()}
    result = result.model_copy(update={"counts": counts})
    assert "2 of 10 poses are the photo's own prior" in str(check_pipeline(submission(), result))
    uses = submission(pipeline={"stages": "single-stage", "uses": ["prior"]})
    assert check_pipeline(uses, result) is None
