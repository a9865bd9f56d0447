"""Scoring a submission again, and comparing what its submitter found with it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

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
from airzoo_bench.leaderboard.baselines import Remade, remake
from airzoo_bench.leaderboard.checks import CheckedSubmission
from airzoo_bench.leaderboard.submission import Submission
from airzoo_bench.results.comparable import check_comparable, version_notes
from airzoo_bench.results.comparison import score_intervals
from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import Result, ScoreColumn
from airzoo_bench.statistics.samples import ResamplingConfig

__all__ = [
    "Difference",
    "Rescored",
    "claim_differences",
    "pipeline_errors",
    "rescore",
    "score_range",
]

SAME = 1e-9
"""Scores that differ by no more differ by rounding alone."""
_MOVED = 1e-3
"""The part of a scene's queries that another machine may answer otherwise; one query at least."""
OVERALL, POOLED = "over scenes", "over all queries"
_NEAR_PRIOR = 0.01
_SHOWN = 5
_NAMES = ("claimed", "re-scored")


@dataclass(frozen=True)
class Difference:
    """A score that its submitter found to be another.

    Attributes
    ----------
    part : str
        The scene's id, or "over scenes", or "over all queries".
    key, title : str
        Of the score.
    claimed, rescored : float
    matters : bool
        Whether the submission is refused for it.
    """

    part: str
    key: str
    title: str
    claimed: float
    rescored: float
    matters: bool

    def __str__(self) -> str:
        where = self.part if self.part in (OVERALL, POOLED) else f"in scene {self.part}"
        return f"{self.title} {where}: claimed {self.claimed:.9g}, re-scored {self.rescored:.9g}"


@dataclass(frozen=True, eq=False)
class Rescored:
    """A submission, scored again.

    Attributes
    ----------
    evaluation : Evaluation
        What stands on the board.
    claimed : Result or None
    differences : tuple of Difference
        In scores by more than `SAME`, scene by scene.
    errors : tuple of UserError
        Why the submission is refused, after all: what was claimed is not so, or the pipeline is
        not of the class that it says.
    lines : tuple of str
        What is to be said of the comparison, for a comment or a terminal.
    remade : Remade or None
        Of a submission by the suite's own baseline, where it was made again.
    """

    evaluation: Evaluation
    claimed: Result | None = None
    differences: tuple[Difference, ...] = ()
    errors: tuple[UserError, ...] = ()
    lines: tuple[str, ...] = ()
    remade: Remade | None = None

    @property
    def agrees(self) -> bool:
        """Whether the submission stands."""
        return not self.errors


def rescore(
    checked: CheckedSubmission,
    *,
    data: Path,
    run: Run,
    make_again: bool = False,
) -> Rescored:
    """Score a submission, and compare what it claims."""
    submission, predictions = checked.submission, checked.predictions
    if submission is None or predictions is None:
        raise SubmissionError(
            "there are no predictions to score",
            where=checked.folder,
            fix="mend what `airzoo-bench submission check` says, or fetch them with --fetch",
        )
    evaluation = evaluate(
        predictions,
        data=data,
        protocol=submission.protocol,
        method=submission.method,
        run=run,
        read_by=checked.read_by,
    )
    track = evaluation.result.track
    result = evaluation.result
    scored = Scored(submission.method, result, evaluation.records)
    found = _compared(checked.claimed, scored)
    remade = None
    if make_again and submission.baseline is not None:
        agrees = partial(_agrees, scored)
        remade = remake(submission, track, predictions, agrees, data=data, run=run)
    return Rescored(
        evaluation,
        checked.claimed,
        found.differences,
        (*found.errors, *pipeline_errors(submission, result)),
        (*found.lines, *_remade_lines(remade, result)),
        remade,
    )


@dataclass(frozen=True)
class _Compared:
    differences: tuple[Difference, ...] = ()
    errors: tuple[UserError, ...] = ()
    lines: tuple[str, ...] = field(default=())


def _compared(claimed: Result | None, scored: Scored) -> _Compared:
    """Compare what was claimed with what was found."""
    if claimed is None:
        return _Compared(lines=("no result was claimed",))
    try:
        check_comparable(_NAMES, (claimed, scored.result))
        _check_parts(claimed, scored.result)
    except ResultError as error:
        return _Compared(errors=(error,), lines=(f"claimed and re-scored differ: {error.what}",))
    differences = tuple(claim_differences(claimed, scored))
    lines = [*map(str, differences)] or ["every score is as claimed"]
    lines += _version_notes(claimed, scored.result)
    if differences:
        lines.append("the re-scored numbers stand")
    refused = [one for one in differences if one.matters]
    return _Compared(differences, (_refusal(refused),) if refused else (), tuple(lines))


def _version_notes(claimed: Result, result: Result) -> list[str]:
    """Say which versions differ, of the packages that there are, however long the claim is."""
    versions = {name: claimed.versions.get(name, "unknown")[:20] for name in result.versions}
    known = claimed.model_copy(update={"versions": versions})
    return version_notes(_NAMES, (known, result))


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
    """Yield the scores that were claimed otherwise than they were found, by whatever versions."""
    result, ranges = scored.result, _ranges(scored)
    parts = {scene: (claimed.scenes[scene], result.scenes[scene]) for scene in result.scenes}
    parts |= {OVERALL: (claimed.overall, result.overall), POOLED: (claimed.pooled, result.pooled)}
    for part, (says, is_) in parts.items():
        for column in result.columns:
            one, two = says[column.key], is_[column.key]
            if one == two or abs(one - two) <= SAME:
                continue
            low, high = ranges[part, column.key]
            matters = not low - SAME <= one <= high + SAME
            yield Difference(part, column.key, column.title, one, two, matters)


def _ranges(scored: Scored) -> dict[tuple[str, str], tuple[float, float]]:
    """Return between which numbers each score may lie on another machine, by part and key."""
    found: dict[tuple[str, str], tuple[float, float]] = {}
    result = scored.result
    of_scene = scored.records["scene"].to_numpy(str)
    for column in result.columns:
        values = scored.records[column.key].to_numpy(np.float64)
        own = {scene: values[of_scene == scene] for scene in result.scenes}
        moved = {scene: _moved(result, len(part)) for scene, part in own.items()}
        scenes = {scene: score_range(part, column, moved[scene]) for scene, part in own.items()}
        low, high = np.mean([*scenes.values()], axis=0).tolist()
        pooled = score_range(values, column, sum(moved.values()))
        parts = scenes | {OVERALL: (low, high), POOLED: pooled}
        found |= {(part, column.key): limits for part, limits in parts.items()}
    return found


def _moved(result: Result, count: int) -> float:
    """Return how many of a scene's queries another machine may answer otherwise."""
    if result.track == "retrieval":  # no score of it depends on a machine
        return 0
    return max(1, int(_MOVED * count)) if result.unit == "query" else _MOVED


def score_range(values: Floats, column: ScoreColumn, moved: float) -> tuple[float, float]:
    """Return between which numbers a score stays when so many queries are answered otherwise."""
    if column.average == "median":
        steps = math.ceil(moved)
        ordered = np.concatenate([np.zeros(steps), np.sort(values), np.full(steps, np.inf)])
        middle = np.array([(len(values) - 1) // 2, len(values) // 2])
        return float(ordered[middle].mean()), float(ordered[middle + 2 * steps].mean())
    largest = 1.0 if column.unit == "share" else float(values.max())
    mean, reach = float(values.mean()), moved * largest / len(values)
    return mean - reach, mean + reach


def _agrees(scored: Scored, other: Result) -> bool:
    """Whether another result is within the intervals of this one, as features may be rounded."""
    columns = scored.result.columns
    found = score_intervals(scored, columns, ResamplingConfig(resamples=2_000)).overall
    for column, one in zip(columns, found, strict=True):
        value = scored.result.overall[column.key]
        low = value - SAME if one.low is None else one.low
        high = value + SAME if one.high is None else one.high
        if not low <= other.overall[column.key] <= high:
            return False
    return True


def _refusal(refused: list[Difference]) -> SubmissionError:
    more = [f"and {len(refused) - _SHOWN} more"] if len(refused) > _SHOWN else []
    return SubmissionError(
        f"{counted(len(refused), 'score')} of the claimed result.json cannot be found again:\n    "
        + "\n    ".join([*map(str, refused[:_SHOWN]), *more]),
        expected="what these predictions score on any machine, docs/submission.md says how nearly",
        fix="score the predictions of this folder again with `airzoo-bench eval ... --out DIR`, "
        "or leave result.json out: CI scores anyway",
    )


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


def _remade_lines(remade: Remade | None, result: Result) -> Iterator[str]:
    if remade is None:
        return
    queries = sum(counts["queries"] for counts in result.counts.values())
    same = (
        "the same to the last byte" if remade.same_bytes else "not the same bytes here, but scores"
    )
    if not remade.alike:
        same = "they score otherwise, so this time is not that of the method and is not shown"
    yield (
        f"the baseline made the predictions again: {same}; {remade.seconds:.1f} s with all "
        f"preparation, {remade.seconds / queries:.3f} s a query"
    )
