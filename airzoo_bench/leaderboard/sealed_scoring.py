"""Scoring against a sealed truth, and how coarse the answer is.

Told are the headline scores over all scenes, in steps of half their standard error: that of a mean
of independent scenes. Within a scene it is

- of **shares** that of a rate with two more queries at 0 and two at 1 (Agresti and Coull 1998), of
  the told score; steps are those of the largest error that so many queries can have, and not
  smaller than what `FLIPS` queries of the smallest scene move;
- of **means of errors** that of the sample;
- of **medians** a quarter of the width of the binomial 95 % interval of order statistics. Where its
  upper end is a failure the error is not known, and the lower half decides the step.

Errors are rounded upward to one digit; of medians and means of errors to 1, 2 or 5. Reconstruction
has one record a scene: shares are told to a hundredth, distances to two digits.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from decimal import ROUND_CEILING, Context, Decimal
from pathlib import Path
from typing import Any

import numpy as np

from airzoo_bench.benchmark.folder import find_benchmark
from airzoo_bench.core.errors import SubmissionError, UserError
from airzoo_bench.evaluation.track import Run
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.leaderboard.answers import Answer, Row, Score, head_of, now
from airzoo_bench.leaderboard.checks import CheckedSubmission
from airzoo_bench.leaderboard.sealing import commitment_of, opened_truth
from airzoo_bench.results.result import ScoreColumn

FLIPS = 4
"""Steps are at least as large as what so many queries of the smallest scene can move a share."""

_Z95 = 1.959964
_LEAST_SHARE_OF_VALUE = 0.01


class OpenedTruthError(SubmissionError):
    """Why predictions are refused once the truth is open: that too is an answer, and a try."""


def score_sealed(
    checked: CheckedSubmission, tree: str, archive: Path, key: Any, data: Path, run: Run
) -> Answer:
    """Score a checked submission, and tell of it what does not tell the truth."""
    public = find_benchmark(checked.folder.resolve().parts[-3], data, sealed=True)
    with opened_truth(public.folder, archive, key) as truth:
        try:
            evaluation = checked.score(truth, run)
        except SubmissionError as error:  # of its pipeline
            raise OpenedTruthError(error.what, fix=error.fix) from None
        except UserError:  # its message may come from the truth
            what = "cannot be scored, for a reason that only the truth shows, and that is not told"
            fix = "ask the host, who has the truth and can score it by `airzoo-bench eval`"
            raise OpenedTruthError(what, fix=fix) from None
    result, records = evaluation.result, evaluation.records
    of_scene = records["scene"].to_numpy(str)
    columns, scores = tuple(column for column in result.columns if column.headline), {}
    for column in columns:
        values = records[column.key].to_numpy(np.float64)
        scenes = [values[of_scene == scene] for scene in result.scenes]
        value, spread, _ = round_score(result.overall[column.key], scenes, column, result.unit)
        low = high = None
        if spread is not None and math.isfinite(value):
            most = 1.0 if column.unit == "share" else math.inf
            low, high = max(0.0, value - _Z95 * spread), min(most, value + _Z95 * spread)
        scores[column.key] = Score(value=value, low=low, high=high, standard_error=spread)
    truth_of = {"benchmark_version": None, "truth": commitment_of(public), "sealed": True}
    return Answer(
        tree=tree,
        scored=now(),
        version=result.versions["airzoo-bench"],
        head=head_of(result).model_copy(update=truth_of | {"unit": "query"}),
        columns=columns,
        row=Row(kind="sealed", method=result.predictions.method, scores=scores),
        about_intervals="95 % intervals: the rounded score and 1.96 rounded standard errors.",
    )


def round_score(
    value: float, scenes: Sequence[Floats], column: ScoreColumn, unit: str = "query"
) -> tuple[float, float | None, float]:
    """Round the mean over scenes of a score, made of the values of their queries.

    Return it, its standard error if it is known, and the step of which it is a multiple.
    """
    if math.isinf(value):
        return value, None, 0.0
    count, sizes = len(scenes), np.array([len(values) for values in scenes])
    error: float | None = None
    if unit == "scene":
        digits = Decimal(1).scaleb(Decimal(value).adjusted() - 1 if value else -2)
        step = Decimal("0.01") if column.unit == "share" else digits
        shown, values = _nearest(value, step), np.concatenate(scenes)
        if count > 1 and np.isfinite(values).all():
            error = float(values.std(ddof=1)) / math.sqrt(count)
    elif column.unit == "share" and column.average == "mean":
        width = _up(math.hypot(*(0.5 / np.sqrt(sizes))) / count)
        step = max(width / 2, _up(FLIPS / float(sizes.min()) / count, 2))
        shown = min(_nearest(value, step), 1.0)
        rates = (shown * sizes + 2) / (sizes + 4)
        error = math.hypot(*np.sqrt(rates * (1 - rates) / sizes)) / count
    else:
        spreads = [_spread(values, column) for values in scenes]
        width = _up(math.hypot(*(wide for _, wide in spreads)) / count)
        unit_of = Decimal(1).scaleb(width.adjusted())
        # 1, 2, 5 or 10: steps are mostly those of a similar sample.
        step = next(unit_of * digit for digit in (1, 2, 5, 10) if width <= unit_of * digit) / 2
        shown = _nearest(value, step)
        known = [error for error, _ in spreads if error is not None]
        error = math.hypot(*known) / count if len(known) == count else None
    return shown, None if error is None else float(_up(error)), float(step)


def _spread(values: Floats, column: ScoreColumn) -> tuple[float | None, float]:
    """Return the standard error of a scene's score, if it is known, and a width for steps."""
    count = len(values)
    value = float(np.median(values) if column.average == "median" else values.mean())
    least = _LEAST_SHARE_OF_VALUE * abs(value)
    if column.average == "median":
        ranked, reach = np.sort(values), _Z95 * math.sqrt(count) / 2
        low = float(ranked[max(0, math.floor(count / 2 - reach))])
        high = float(ranked[min(count - 1, math.ceil(count / 2 + reach))])
        if math.isinf(high):
            return None, max((value - low) / _Z95, least)
        error = max((high - low) / (2 * _Z95), least)
    elif count < 2:
        return None, abs(value)
    else:
        error = max(float(values.std(ddof=1)) / math.sqrt(count), least)
    return error, error


def _up(number: float, digits: int = 1) -> Decimal:
    return Context(digits, ROUND_CEILING).create_decimal(repr(float(number)))


def _nearest(value: float, step: Decimal) -> float:
    return float(round(Decimal(repr(value)) / step) * step) if step else value
