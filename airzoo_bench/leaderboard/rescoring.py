"""Scoring a submission again, and comparing its claimed result with the scores."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from airzoo_bench.core.errors import (
    ResultError,
    SubmissionError,
    UserError,
    agreeing,
    counted,
    first_of,
)
from airzoo_bench.evaluation.evaluate import Evaluation, evaluate
from airzoo_bench.evaluation.track import Run
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.leaderboard.checks import CheckedSubmission
from airzoo_bench.leaderboard.submission import Submission
from airzoo_bench.results.comparable import check_comparable
from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import Result, ScoreColumn

__all__ = ["Rescored", "claim_differences", "pipeline_errors", "rescore", "score_range"]

_SAME = 1e-9  # scores that differ by no more differ by rounding alone
_MOVED = 1e-3  # the part of a scene's queries that another machine may answer otherwise
_OVERALL, _POOLED = "over scenes", "over all queries"
_NEAR_PRIOR = 0.01
_SHOWN = 5


class Difference(NamedTuple):
    """A score whose claimed value is another one, and whether the submission is refused for it."""

    part: str
    key: str
    said: str
    matters: bool


@dataclass(frozen=True, eq=False)
class Rescored:
    """A submission, scored again.

    `agrees` says whether the claimed result does, None without one, `lines` how, in sentences.
    """

    evaluation: Evaluation
    agrees: bool | None
    lines: tuple[str, ...]
    errors: tuple[UserError, ...]


def rescore(checked: CheckedSubmission, *, data: Path, run: Run) -> Rescored:
    """Score a submission, and compare its claim."""
    submission, predictions = checked.submission, checked.predictions
    if submission is None or predictions is None:
        raise SubmissionError(
            "there are no predictions to score",
            where=checked.folder,
            fix="mend the errors of `airzoo-bench submission check`, or add --fetch",
        )
    evaluation = evaluate(
        predictions,
        data=data,
        protocol=submission.protocol,
        method=submission.method,
        run=run,
        read_by=checked.read_by,
    )
    errors = (*pipeline_errors(submission, evaluation.result),)
    if checked.claimed is None:
        return Rescored(evaluation, None, ("no result was claimed",), errors)
    scored = Scored(submission.method, evaluation.result, evaluation.records)
    lines, refusal = _compare(checked.claimed, scored)
    return Rescored(evaluation, refusal is None, lines, (*filter(None, [refusal]), *errors))


def _compare(claimed: Result, scored: Scored) -> tuple[tuple[str, ...], UserError | None]:
    """Return the comparison in sentences, and the error if the claim does not stand."""
    try:
        check_comparable(("claimed", "re-scored"), (claimed, scored.result))
        _check_parts(claimed, scored.result)
    except ResultError as error:
        return (f"claimed and re-scored differ: {error.what}",), error
    differences = [*claim_differences(claimed, scored)]
    if not differences:
        return ("every score is as claimed",), None
    lines = (*(one.said for one in differences), "the re-scored numbers stand")
    refused = [one.said for one in differences if one.matters]
    if not refused:
        return lines, None
    more = [f"and {len(refused) - _SHOWN} more"] if len(refused) > _SHOWN else []
    return lines, SubmissionError(
        f"{counted(len(refused), 'score')} of the claimed result.json cannot be found again:\n    "
        + "\n    ".join([*refused[:_SHOWN], *more]),
        expected="the scores of these predictions on any machine; docs/submission.md says how near",
        fix="score the predictions of this folder again with `airzoo-bench eval ... --out DIR`, "
        "or leave result.json out: CI scores anyway",
    )


def _check_parts(claimed: Result, result: Result) -> None:
    """Refuse a claim about other scenes or scores: its fingerprints may be typed by anyone."""
    for what, says, is_ in (
        ("scenes", {*claimed.scenes}, {*result.scenes}),
        ("scores", {*claimed.overall}, {*result.overall}),
    ):
        if says != is_:
            raise ResultError(
                f"the claimed result.json has other {what}: {first_of(sorted(says ^ is_))}",
                expected=f"the {what} that `airzoo-bench eval` gives by this protocol",
                fix="score the predictions again with this version, or leave result.json out",
            )


def claim_differences(claimed: Result, scored: Scored) -> Iterator[Difference]:
    """Yield the scores whose claimed value is another one, by whatever versions."""
    result = scored.result
    parts = {scene: (claimed.scenes[scene], result.scenes[scene]) for scene in result.scenes}
    parts[_OVERALL] = claimed.overall, result.overall
    parts[_POOLED] = claimed.pooled, result.pooled
    ranges = {column.key: _ranges(scored, column) for column in result.columns}
    for part, (says, is_) in parts.items():
        for column in result.columns:
            one, two = says[column.key], is_[column.key]
            if one != two and abs(one - two) > _SAME:
                low, high = ranges[column.key][part]
                where = part if part in (_OVERALL, _POOLED) else f"in scene {part}"
                said = f"{column.title} {where}: claimed {one:.9g}, re-scored {two:.9g}"
                matters = not low - _SAME <= one <= high + _SAME
                yield Difference(part, column.key, said, matters)


def _ranges(scored: Scored, column: ScoreColumn) -> dict[str, tuple[float, float]]:
    """Return between which numbers a score may lie on another machine, by part."""
    result, of_scene = scored.result, scored.records["scene"].to_numpy(str)
    values = scored.records[column.key].to_numpy(np.float64)
    own = {scene: values[of_scene == scene] for scene in result.scenes}
    moved = {scene: _moved(result, len(part)) for scene, part in own.items()}
    found = {scene: score_range(part, column, moved[scene]) for scene, part in own.items()}
    low, high = np.mean([*found.values()], axis=0).tolist()
    pooled = score_range(values, column, sum(moved.values()))
    return found | {_OVERALL: (low, high), _POOLED: pooled}


def _moved(result: Result, count: int) -> float:
    """Return how many of a scene's queries another machine may answer otherwise."""
    if result.track == "retrieval":  # no score of it depends on a machine
        return 0
    return max(1, int(_MOVED * count)) if result.unit == "query" else _MOVED


def score_range(values: Floats, column: ScoreColumn, moved: float) -> tuple[float, float]:
    """Return the limits of a score when `moved` queries are answered otherwise."""
    if column.average == "median":
        steps = math.ceil(moved)
        ordered = np.concatenate([np.zeros(steps), np.sort(values), np.full(steps, np.inf)])
        middle = np.array([(len(values) - 1) // 2, len(values) // 2])
        return float(ordered[middle].mean()), float(ordered[middle + 2 * steps].mean())
    largest = 1.0 if column.unit == "share" else float(values.max())
    mean, reach = float(values.mean()), moved * largest / len(values)
    return mean - reach, mean + reach


def pipeline_errors(submission: Submission, result: Result) -> Iterator[UserError]:
    """Yield an error where predictions are the prior and the submission does not say so."""
    near = sum(counts.get("near_prior", 0) for counts in result.counts.values())
    total = sum(counts["queries"] for counts in result.counts.values())
    if near > _NEAR_PRIOR * total and "prior" not in submission.pipeline.uses:
        yield SubmissionError(
            f"{near:,} of {counted(total, 'pose')} {agreeing(near, 'is', 'are')} the photo's own "
            "prior, which pipeline.uses does not name",
            expected='uses = ["prior"] where GPS and gimbal angles are used, also as a fallback',
            fix='add "prior" to pipeline.uses, or leave queries without an answer out',
        )
