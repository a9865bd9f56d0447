"""Scoring a submission again: what agrees with what was claimed, and what does not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.evaluation.evaluate import evaluate
from airzoo_bench.evaluation.parts import Resources
from airzoo_bench.leaderboard.checks import check_submission
from airzoo_bench.leaderboard.rescoring import Rescored, pipeline_errors, rescore
from airzoo_bench.results.result import Result, write_result
from tests.leaderboard.submission.support import checked, submission, write, write_board


@pytest.fixture
def home(tmp_path: Path, perfect: Any) -> Path:
    write_board(tmp_path / "board")
    return write(tmp_path / "board", perfect)


def scored(home: Path, data: Path) -> Rescored:
    return rescore(checked(home, data), data=data, resources=Resources())


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


def test_nothing_claimed(home: Path, data: Path) -> None:
    found = scored(home, data)
    assert found.agrees
    assert found.claimed is None
    assert found.lines == ("no result was claimed",)
    assert found.evaluation.result.predictions.method == "SALAD"


def test_what_was_claimed_is_found_again(home: Path, data: Path) -> None:
    write_result(home / "result.json", result_of(home, data))
    found = scored(home, data)
    assert found.agrees
    assert not found.differences
    assert found.lines == ("every score is as claimed",)


def test_the_same_versions_give_the_same_number(home: Path, data: Path) -> None:
    write_result(home / "result.json", lowered(result_of(home, data), 1e-6))
    found = scored(home, data)
    assert not found.agrees
    title = found.evaluation.result.columns[0].title
    assert [(one.part, one.title) for one in found.differences] == [
        ("east", title),
        ("west", title),
        ("over scenes", title),
        ("over all queries", title),
    ]
    message = str(found.errors[0])
    assert "4 scores of the claimed result.json cannot be found again" in message
    assert f"{title} in scene east: claimed 0.999999, re-scored 1" in message


def test_rounding_is_no_difference(home: Path, data: Path) -> None:
    write_result(home / "result.json", lowered(result_of(home, data), 5e-10))
    assert scored(home, data).agrees


def test_other_versions_may_round_within_the_interval(home: Path, data: Path) -> None:
    versions = result_of(home, data).versions | {"scipy": "0.1"}
    write_result(home / "result.json", lowered(result_of(home, data), 0.01, versions))
    found = scored(home, data)
    assert found.agrees
    assert found.differences
    assert any("scipy" in line for line in found.lines)
    assert "the re-scored numbers stand" in found.lines
    write_result(home / "result.json", lowered(result_of(home, data), 0.9, versions))
    found = scored(home, data)
    assert not found.agrees
    assert "within the interval of the re-scored number" in str(found.errors[0])


def test_a_claim_of_a_million_packages_is_no_million_lines(home: Path, data: Path) -> None:
    versions = result_of(home, data).versions | {"scipy": "\x1b[2J" * 99}
    versions |= {f"package{number}": "1" for number in range(1000)}
    write_result(home / "result.json", lowered(result_of(home, data), 0.0, versions))
    found = scored(home, data)
    assert found.agrees
    assert len(found.lines) == 3
    assert max(map(len, found.lines)) < 200


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
        rescore(found, data=data, resources=Resources())
