"""What is told of predictions that were scored against a sealed truth, and what stays."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from airzoo_bench.core.errors import PredictionError, SubmissionError
from airzoo_bench.evaluation.evaluate import evaluate
from airzoo_bench.evaluation.opening import ReadBy
from airzoo_bench.leaderboard.answer import SealedAnswer
from airzoo_bench.leaderboard.sealed import scoring
from airzoo_bench.leaderboard.sealed.scoring import score_predictions, score_sealed, told_of
from airzoo_bench.leaderboard.submission import Submission
from tests.api.place import NAME
from tests.leaderboard.sealed.conftest import SALT, SealedField
from tests.support import HANGS_S, run_main

TRACKS = ("retrieval", "matching", "reconstruction")


@dataclass
class Handed:
    """A submission that was checked."""

    submission: Submission | None
    predictions: Path | None
    read_by: ReadBy = field(default_factory=ReadBy)


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
    return score_predictions(path, f"{NAME}-{track}", "M", sealed.archive, sealed.key, data=data)


@pytest.mark.parametrize("track", TRACKS)
def test_what_is_told(track: str, sealed: SealedField, predictions: dict[str, Path]) -> None:
    answer = scored(sealed, track, predictions[track])
    whole = evaluate(predictions[track], data=sealed.folder, method="M")
    shown = {column.key for column in whole.result.columns if column.headline}
    assert set(answer.overall) == shown
    assert {column.key for column in answer.columns} == shown
    for key, estimate in answer.overall.items():
        true = whole.result.overall[key]
        if estimate.value is None:
            assert not np.isfinite(true)
        else:
            assert estimate.step is not None
            assert abs(estimate.value - true) <= estimate.step
    # Five queries are too few to be told by themselves; a reconstruction has no queries.
    assert set(answer.scenes) == ({NAME} if track == "reconstruction" else set())
    text = answer.model_dump_json(by_alias=True)
    for secret in (whole.result.truth.fingerprint, whole.result.records_sha256 or "no", SALT):
        assert secret not in text
    assert not {"notes", "records", "counts", "references"} & set(json.loads(text))
    assert SealedAnswer.model_validate_json(text) == answer


def test_a_submission_is_scored_alike(sealed: SealedField, predictions: dict[str, Path]) -> None:
    path = predictions["retrieval"]
    stated = Submission.model_construct(protocol=f"{NAME}-retrieval", method="M")
    handed = Handed(stated, path)
    answer = score_sealed(handed, sealed.archive, sealed.key, data=sealed.public)
    assert answer == scored(sealed, "retrieval", path)
    with pytest.raises(SubmissionError, match="no predictions"):
        score_sealed(Handed(stated, None), sealed.archive, sealed.key, data=sealed.public)


def test_many_queries_are_told_by_scene(sealed: SealedField, predictions: dict[str, Path]) -> None:
    whole = evaluate(predictions["retrieval"], data=sealed.folder)
    repeated = pd.concat([whole.records] * 12, ignore_index=True)
    object.__setattr__(whole, "records", repeated)
    columns = tuple(column for column in whole.result.columns if column.headline)
    scenes, overall = told_of(whole, columns, SALT)
    assert set(scenes) == {NAME}
    assert set(scenes[NAME]) == set(overall)


def test_bad_predictions_are_refused_before_the_truth_is_opened(
    sealed: SealedField, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(scoring, "opened_truth", None)
    path = tmp_path / "preds.npz"
    np.savez(path, query_ids=["x/a"], ranked_ids=[[f"{NAME}/b", *[""] * 99]])
    with pytest.raises(PredictionError, match="none of its query ids"):
        scored(sealed, "retrieval", path)


def test_no_error_tells_of_the_truth(
    sealed: SealedField, predictions: dict[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise PredictionError("45.1 degrees off the truth")

    monkeypatch.setattr(scoring, "evaluate", fail)
    with pytest.raises(SubmissionError) as caught:
        scored(sealed, "retrieval", predictions["retrieval"])
    assert "45.1" not in str(caught.value)
    assert caught.value.__cause__ is None


_SCRIPT = """
import sys, time
from pathlib import Path
from airzoo_bench.__main__ import main
from airzoo_bench.leaderboard.sealed import scoring, unsealing
unsealing.memory_folder = lambda folder=Path(sys.argv.pop(1)): folder
def wait(*_, **__):
    print("open", flush=True)
    time.sleep(600)
scoring.evaluate = wait
main()
"""


@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGINT])
def test_a_stopped_run_leaves_no_truth(
    how: signal.Signals, sealed: SealedField, predictions: dict[str, Path], tmp_path: Path
) -> None:
    memory = tmp_path / "memory"
    memory.mkdir()
    key = tmp_path / "key.txt"
    key.write_text(str(sealed.key))
    arguments = ("--protocol", f"{NAME}-retrieval", "--data", sealed.public, "--key", key)
    call = ("seal-score", predictions["retrieval"], "--archive", sealed.archive, *arguments)
    process = subprocess.Popen(
        [sys.executable, "-c", _SCRIPT, *map(str, (memory, *call))],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )
    assert process.stdout is not None
    assert process.stdout.readline() == b"open\n"
    assert list(memory.glob(".airzoo-truth.*"))
    process.send_signal(how)
    assert process.wait(HANGS_S) in (143, 130)
    process.stdout.close()
    assert not list(memory.iterdir())
