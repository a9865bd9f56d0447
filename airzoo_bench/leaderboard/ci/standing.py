"""Where a method stands on the board: its table, its range of ranks, its last version."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from airzoo_bench.core.errors import ResultError, UserError
from airzoo_bench.evaluation.evaluate import Evaluation
from airzoo_bench.leaderboard.ci.artifact import SceneScores, Shown, Standing
from airzoo_bench.leaderboard.ci.data_branch import DataBranch
from airzoo_bench.leaderboard.ci.git import BoardError
from airzoo_bench.leaderboard.known import Place
from airzoo_bench.leaderboard.runs import newest_runs
from airzoo_bench.leaderboard.submission import SUBMISSION_FILE, read_public_submission
from airzoo_bench.results.best import value_of
from airzoo_bench.results.comparable import check_comparable, check_same_queries
from airzoo_bench.results.records import Scored, read_scored
from airzoo_bench.results.result import ScoreColumn, read_result
from airzoo_bench.results.sampling import make_sample, score_intervals
from airzoo_bench.statistics.pair_tests import pair_p_values, resamples_for
from airzoo_bench.statistics.rank_ranges import correct_pairs, rank_ranges
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.statistics.significance import LEVEL

__all__ = ["standing_of"]

_RESAMPLING = ResamplingConfig(resamples=2000)


def standing_of(
    evaluation: Evaluation, place: Place, branch: DataBranch, work: Path, beside: Collection[str]
) -> dict[str, Any]:
    """Return the rows and the standing of a method, as an artifact has them.

    Parameters
    ----------
    evaluation : Evaluation
    place : Place
        The submission's.
    branch : DataBranch
        With the runs of the others.
    work : Path
        A folder to read these from.
    beside : collection of str
        Folders of the submissions that the board shows beside this one; the branch also keeps runs
        of what was withdrawn or superseded.
    """
    table = f"runs/{place.benchmark}/{place.track}"
    branch.export(work, table)
    runs = newest_runs(work / table)
    own = Scored(evaluation.result.predictions.method, evaluation.result, evaluation.records)
    columns = [column for column in own.result.columns if column.headline]
    last = runs.pop(place.folder, None)
    before = None if last is None else _comparable(own, last)
    shown = [run for folder, run in runs.items() if folder in beside]
    others = [found for run in shown if (found := _comparable(own, run)) is not None]
    return {
        "rows": tuple(_rows(own, columns, before)),
        "standing": _standing(own, others, columns[0]),
    }


def _comparable(own: Scored, run: Path) -> Scored | None:
    """Return a run that measures the same, under the method's name on the board."""
    if not (run / "result.json").is_file():
        return None
    try:
        result = read_result(run / "result.json")
        name = read_public_submission(run / SUBMISSION_FILE).method
    except UserError as error:
        raise BoardError(f"a run of the board cannot be read: {error}") from error
    try:
        check_comparable([own.name, name], [own.result, result])
        [found] = read_scored([run])
        other = Scored(name, found.result, found.records)
        check_same_queries([own, other])
    except ResultError:  # of another version of the protocol or the truth
        return None
    return other


def _rows(own: Scored, columns: Sequence[ScoreColumn], before: Scored | None) -> list[SceneScores]:
    found = score_intervals(own, columns, _RESAMPLING)
    result, rows = own.result, []
    for scene in (*result.scenes, None):
        intervals = found.overall if scene is None else found.groups.get(scene, [])
        spans = dict(zip([c.key for c in columns], intervals, strict=bool(intervals)))
        numbers = [result.counts[one]["queries"] for one in result.scenes if scene in (None, one)]
        scores = {}
        for column in columns:
            span = spans.get(column.key)
            scores[column.key] = Shown(
                value=_finite(value_of(own, column, scene)),
                low=None if span is None else _finite(span.low),
                high=None if span is None else _finite(span.high),
                before=None if before is None else _finite(value_of(before, column, scene)),
            )
        title = "average" if scene is None else result.truth.scene_titles[scene]
        rows.append(SceneScores(title=title, queries=sum(numbers), scores=scores))
    return rows


def _standing(own: Scored, others: Sequence[Scored], column: ScoreColumn) -> Standing:
    """Rank the method among the others as the board does, from the same draws."""
    methods = [own, *others]
    resampling = ResamplingConfig(resamples_for(len(methods)))
    corrected = correct_pairs(pair_p_values(make_sample(methods, [column]), resampling))
    values = np.array([value_of(method, column) for method in methods])
    ranges = rank_ranges(values, corrected, higher_is_better=column.higher_is_better)
    told = corrected[0, 1:] <= LEVEL
    alike = [method.name for method, apart in zip(others, told, strict=True) if not apart]
    return Standing(
        score=column.title,
        first=int(ranges[0, 0]),
        last=int(ranges[0, 1]),
        methods=len(methods),
        alike=tuple(sorted(alike)),
    )


def _finite(value: float | None) -> float | None:
    return None if value is None or math.isinf(value) else float(value)
