"""Scoring a submission against a sealed truth."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from airzoo_bench.benchmark.folder import Benchmark, find_benchmark
from airzoo_bench.core.errors import SubmissionError, UserError
from airzoo_bench.core.registry import TRACKS
from airzoo_bench.evaluation.evaluate import Evaluation, check, evaluate
from airzoo_bench.evaluation.opening import ReadBy
from airzoo_bench.evaluation.track import Run
from airzoo_bench.leaderboard.answer import Estimate, SealedAnswer
from airzoo_bench.leaderboard.rescoring import pipeline_errors
from airzoo_bench.leaderboard.sealed.rounding import (
    LEAST_QUERIES,
    Spread,
    drawn,
    overall_estimate,
    told,
    told_alone,
)
from airzoo_bench.leaderboard.sealed.unsealing import clear_truth, opened_truth
from airzoo_bench.leaderboard.submission import Submission
from airzoo_bench.protocol.lookup import find_protocol
from airzoo_bench.results.result import ScoreColumn

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["OpenedTruthError", "ToScore", "score_predictions", "score_sealed", "told_of"]

_Told = tuple[dict[str, dict[str, Estimate]], dict[str, Estimate]]


class OpenedTruthError(SubmissionError):
    """Why predictions are refused once the truth is open: that too is an answer, and a try."""


class ToScore(Protocol):
    """A submission that was checked, see `checks.CheckedSubmission`."""

    @property
    def submission(self) -> Submission | None:
        """What it states."""

    @property
    def predictions(self) -> Path | None:
        """Where its predictions lie."""

    @property
    def read_by(self) -> ReadBy:
        """How they are read."""


def score_sealed(
    checked: ToScore,
    archive: Path,
    key: Any,
    *,
    data: Path,
    run: Run = Run(),  # noqa: B008 - frozen
) -> SealedAnswer:
    """Score a submission, and tell of it what does not tell the truth."""
    submission, predictions = checked.submission, checked.predictions
    if submission is None or predictions is None:
        raise SubmissionError("there are no predictions to score")
    return score_predictions(
        predictions,
        submission.protocol,
        submission.method,
        archive,
        key,
        data=data,
        read_by=checked.read_by,
        run=run,
        stated=submission,
    )


def score_predictions(
    predictions: Path,
    protocol: str,
    method: str,
    archive: Path,
    key: Any,
    *,
    data: Path,
    read_by: ReadBy = ReadBy(),  # noqa: B008 - frozen
    run: Run = Run(),  # noqa: B008 - frozen
    stated: Submission | None = None,
) -> SealedAnswer:
    """Score predictions that need not belong to a submission; see `score_sealed`."""
    public = find_benchmark(find_protocol(protocol, data).benchmark, data, sealed=True)
    clear_truth()
    # What can be said of predictions without the truth is said before it is opened.
    given: dict[str, Any] = {"protocol": protocol, "run": run, "read_by": read_by}
    for error in check(predictions, data=public.folder, **given).errors:
        raise error
    with opened_truth(public.folder, archive, key) as truth:
        try:
            evaluation = evaluate(predictions, data=truth.folder, method=method, **given)
        except UserError:
            # What it says may come from the truth.
            raise OpenedTruthError(
                "cannot be scored, for a reason that only the truth shows, and that is not told",
                where=predictions,
                fix="ask the host, who has the truth and can score it by `airzoo-bench eval`",
            ) from None
        for error in () if stated is None else pipeline_errors(stated, evaluation.result):
            raise OpenedTruthError(error.what, expected=error.expected, fix=error.fix)
        return _answer(evaluation, public, truth.salt)


def _answer(evaluation: Evaluation, public: Benchmark, salt: str) -> SealedAnswer:
    result = evaluation.result
    columns = tuple(column for column in result.columns if column.headline)
    scenes, overall = told_of(evaluation, columns, salt)
    sealed = public.file.sealed
    return SealedAnswer(
        schema=1,
        track=result.track,
        protocol=result.protocol.name,
        protocol_version=result.protocol.version,
        protocol_fingerprint=result.protocol.fingerprint,
        benchmark=result.truth.benchmark,
        truth_commitment="" if sealed is None else sealed.commitment,
        method=result.predictions.method,
        predictions_sha256=result.predictions.sha256,
        columns=columns,
        queries={scene: counts["queries"] for scene, counts in result.counts.items()},
        scene_titles=result.truth.scene_titles,
        scenes=scenes,
        overall=overall,
        versions=result.versions,
    )


def told_of(evaluation: Evaluation, columns: tuple[ScoreColumn, ...], salt: str) -> _Told:
    """Round the scores of scenes and overall."""
    if TRACKS.get(evaluation.result.track).unit == "scene":
        return _told_scenes(evaluation, columns)
    records = evaluation.records
    rows = {scene: records[records["scene"] == scene] for scene in evaluation.result.scenes}
    spreads = {
        scene: {one.key: _spread(of, one, f"{scene} {one.key}", salt) for one in columns}
        for scene, of in rows.items()
    }
    scenes = {
        scene: {key: told(spread) for key, spread in found.items()}
        for scene, found in spreads.items()
        if len(rows[scene]) >= LEAST_QUERIES
    }
    overall = {}
    for one in columns:
        parts = [found[one.key] for found in spreads.values()]
        draw = drawn(salt, one.key, np.array([part.draw for part in parts]))
        overall[one.key] = told(overall_estimate(evaluation.result.overall[one.key], parts, draw))
    return scenes, overall


def _spread(rows: pd.DataFrame, column: ScoreColumn, name: str, salt: str) -> Spread:
    values = rows[column.key].to_numpy(np.float64)
    # Most queries move no median: then it is drawn as before.
    told_from = np.median(values, keepdims=True) if column.average == "median" else values
    return Spread.of(values, column, drawn(salt, name, told_from))


def _told_scenes(evaluation: Evaluation, columns: tuple[ScoreColumn, ...]) -> _Told:
    result = evaluation.result
    scenes = {
        scene: {one.key: told_alone(scores[one.key], one) for one in columns}
        for scene, scores in result.scenes.items()
    }
    overall = {}
    for one in columns:
        values = np.array([scores[one.key] for scores in result.scenes.values()])
        known = len(values) > 1 and bool(np.isfinite(values).all())
        error = float(values.std(ddof=1)) / math.sqrt(len(values)) if known else None
        overall[one.key] = told_alone(result.overall[one.key], one, error)
    return scenes, overall
