"""What is told of predictions that were scored against a sealed truth, and what stays."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.core.errors import PredictionError, SubmissionError
from airzoo_bench.evaluation.evaluate import evaluate
from airzoo_bench.leaderboard import sealed_scoring, sealing
from airzoo_bench.leaderboard.data_branch import SealedAnswer
from airzoo_bench.leaderboard.sealed_scoring import round_score, score_sealed
from airzoo_bench.results.result import ScoreColumn
from tests.api.place import NAME
from tests.leaderboard.sealed.conftest import SALT, SealedField
from tests.support import HANGS_S, run_main

TRACKS = ("retrieval", "matching", "reconstruction")
SHARE, MEDIAN, MEAN = (
    ScoreColumn(
        key="s", title="S", unit=unit, higher_is_better=True, average=average, headline=True
    )
    for unit, average in (("share", "mean"), ("m", "median"), ("m", "mean"))
)


@pytest.fixture(scope="module")
def predictions(sealed: SealedField, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    home = tmp_path_factory.mktemp("predictions")
    made = {track: home / (track if track == TRACKS[2] else f"{track}.npz") for track in TRACKS}
    for track, path in made.items():
        arguments = ("--data", sealed.public, "--out", path)
        assert run_main("template", f"{NAME}-{track}", *arguments) == 0
    return made


def scored(sealed: SealedField, track: str, path: Path) -> SealedAnswer:
    data = sealed.public
    return score_sealed(path, f"{NAME}-{track}", "M", sealed.archive, sealed.key, data=data)


@pytest.mark.parametrize("track", TRACKS)
def test_only_rounded_overall_scores_are_told(
    track: str, sealed: SealedField, predictions: dict[str, Path]
) -> None:
    answer = scored(sealed, track, predictions[track])
    whole = evaluate(predictions[track], data=sealed.folder, method="M")
    shown = {column.key for column in whole.result.columns if column.headline}
    assert set(answer.overall) == shown == {column.key for column in answer.columns}
    for key, estimate in answer.overall.items():
        true = whole.result.overall[key]
        if estimate.value is None:
            assert not np.isfinite(true)
        else:
            assert estimate.step is not None
            assert abs(estimate.value - true) <= estimate.step / 2 + 1e-12 or estimate.value == 1
    text = answer.model_dump_json(by_alias=True)
    for secret in (whole.result.truth.fingerprint, whole.result.records_sha256 or "no", SALT):
        assert secret not in text
    assert not {"notes", "records", "counts", "references"} & set(json.loads(text))
    assert SealedAnswer.model_validate_json(text) == answer


def test_bad_predictions_are_refused_before_the_truth_is_opened(
    sealed: SealedField, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sealed_scoring, "opened_truth", None)
    path = tmp_path / "preds.npz"
    np.savez(path, query_ids=["x/a"], ranked_ids=[[f"{NAME}/b", *[""] * 99]])
    with pytest.raises(PredictionError, match="none of its query ids"):
        scored(sealed, "retrieval", path)


def test_no_error_tells_of_the_truth(
    sealed: SealedField, predictions: dict[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise PredictionError("45.1 degrees off the truth")

    monkeypatch.setattr(sealed_scoring, "evaluate", fail)
    with pytest.raises(SubmissionError) as caught:
        scored(sealed, "retrieval", predictions["retrieval"])
    assert "45.1" not in str(caught.value)
    assert caught.value.__cause__ is None


_SCRIPT = """
import sys, time
from pathlib import Path
from airzoo_bench import __main__
from airzoo_bench.cli import main
from airzoo_bench.leaderboard import sealed_scoring, sealing
memory, predictions, protocol, archive, data = sys.argv[1:]
sealed_scoring._truth_home = lambda: Path(memory)
def wait(*_, **__):
    print("open", flush=True)
    time.sleep(600)
sealed_scoring.evaluate = wait
places = Path(archive), sealing.read_key()
main.main = lambda: sealed_scoring.score_sealed(
    Path(predictions), protocol, "M", *places, data=Path(data)
)
__main__.main()
"""


@pytest.mark.parametrize(
    "how", [signal.SIGTERM, pytest.param(signal.SIGINT, marks=pytest.mark.slow)]
)
def test_a_stopped_run_leaves_no_truth(
    how: signal.Signals, sealed: SealedField, predictions: dict[str, Path], tmp_path: Path
) -> None:
    memory = tmp_path / "memory"
    memory.mkdir()
    call = (memory, predictions["retrieval"], f"{NAME}-retrieval", sealed.archive, sealed.public)
    process = subprocess.Popen(
        [sys.executable, "-c", _SCRIPT, *map(str, call)],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=os.environ
        | {"PYTHONPATH": os.pathsep.join(sys.path), sealing.KEY_VARIABLE: str(sealed.key)},
    )
    assert process.stdout is not None
    assert process.stdout.readline() == b"open\n"
    assert list(memory.glob(".airzoo-truth.*"))
    process.send_signal(how)
    assert process.wait(HANGS_S) in (143, 130)
    process.stdout.close()
    assert not list(memory.iterdir())


# --- how coarse ---


@pytest.mark.parametrize("column", [SHARE, MEDIAN, MEAN], ids=["share", "median", "mean"])
@pytest.mark.parametrize("count", [20, 60, 300])
def test_errors_are_those_of_repeated_samples(column: ScoreColumn, count: int) -> None:
    draws = np.random.default_rng(1).random((2000, 2, count))
    values = (draws < 0.4).astype(float) if column is SHARE else -np.log1p(-draws)
    average = np.median if column is MEDIAN else np.mean
    means = average(values, axis=2).mean(axis=1)
    found = [
        round_score(float(mean), [*row], column) for mean, row in zip(means, values, strict=True)
    ]
    stated = np.array([one.standard_error for one in found], float)
    # Order statistics of few queries are careful, and digits are rounded upward.
    assert 0.9 < np.sqrt(np.mean(stated**2)) / np.std(means) < 2


def test_steps_by_hand() -> None:
    """Two scenes of 60: an error of up to 0.0645 each, 0.0456 of both, upward 0.05; half is 0.025.

    But 4 queries of a scene move the mean by 4 / 60 / 2 = 0.0333, upward 0.034: 15 such steps are
    0.51. The rate with 4 more queries in a scene is (0.51 x 60 + 2) / 64 = 0.509; its error is
    (0.509 x 0.491 / 60) ** 0.5 = 0.0645, of both 0.0456: 0.05.
    """
    half = np.repeat((0.0, 1.0), 30)
    found = round_score(0.5, [half, half], SHARE)
    assert (found.value, found.step, found.standard_error) == (0.51, 0.034, 0.05)
    large = round_score(0.5, [np.repeat((0.0, 1.0), 5000)], SHARE)
    assert (large.value, large.step, large.standard_error) == (0.5, 0.0025, 0.005)
    for value in (0.0, 1.0):
        perfect = round_score(value, [np.full(100, value)], SHARE)
        assert (perfect.value, perfect.standard_error) == (value, 0.02)


def test_failures() -> None:
    values = np.array([1.0, 2.0, 3.0, *[math.inf] * 5])
    nothing = {"value": None, "standard_error": None, "step": None}
    assert round_score(math.inf, [values], MEDIAN).model_dump() == nothing
    half = np.array([*range(1, 12), *[math.inf] * 9], float)
    found = round_score(float(np.median(half)), [half], MEDIAN)
    assert found.value is not None
    assert found.standard_error is None
    assert found.step is not None


def test_a_scene_of_one_query_is_not_read_off_the_mean() -> None:
    """Four queries of it would move the mean of 11 scenes by 4/11: so coarse is the mean then."""
    random = np.random.default_rng(2)
    others = [(random.random(200) < 0.5).astype(float) for _ in range(10)]
    answers = set()
    for hit in (0.0, 1.0):
        scenes = [*others, np.array([hit])]
        answers.add(
            round_score(float(np.mean([one.mean() for one in scenes])), scenes, SHARE).value
        )
    assert len(answers) == 1


@pytest.mark.parametrize("column", [SHARE, MEDIAN], ids=["share", "median"])
def test_one_query_mostly_changes_nothing(column: ScoreColumn) -> None:
    random, same = np.random.default_rng(3), 0
    for _ in range(400):
        values = random.exponential(1.0, 60)
        if column is SHARE:
            values = (random.random(60) < random.uniform(0.1, 0.9)).astype(float)
        other, place = values.copy(), random.integers(60)
        other[place] = 1.0 - other[place] if column is SHARE else random.exponential(1.0)
        average = np.median if column is MEDIAN else np.mean
        same += round_score(float(average(values)), [values], column) == round_score(
            float(average(other)), [other], column
        )
    assert same >= 400 * 0.7
