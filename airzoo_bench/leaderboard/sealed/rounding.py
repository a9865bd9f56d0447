"""How coarse the scores of a sealed benchmark are told.

Standard errors, of the mean over the queries of a scene:

- **shares** (recalls, average precision): that of a rate, which is the largest that values from 0
  to 1 with this mean can have; made from the score as it is told, so that it tells no more, with
  two more queries that score 0 and two that score 1, after Agresti and Coull (1998), so that a
  score of 0 or 1 has an error too;
- **means of errors**: of the sample;
- **medians**: a quarter of the width of the interval of order statistics that the binomial
  distribution gives for 95 %. Where its upper end is a failure, the error is not known, and the
  lower half decides how coarse the median is told;
- **over scenes**: of the unweighted mean of scenes that are independent of each other.

They are rounded upward to one digit. Scores are told in steps of half of that; for shares, of the
largest error that there can be with so many queries (that of a score of 0.5), so that steps tell
nothing. Where few queries make a share, steps are as large as what `FLIPS` queries can move it.
For medians and means of errors the digit is 1, 2 or 5.

Whether a score is told by the step below or above is drawn, the more likely the nearer it is: on
the mean it is right. Were it always the nearer one, who has found the edge between two steps would
learn one query by each try. The draw comes from the archive's salt and the scores of all
queries, or from the median: the same answers get the same score, and nobody can draw again.

Scenes of fewer than `LEAST_QUERIES` queries are not told by themselves.

**Reconstruction** has one record a scene, of millions of points: there is no sample in it, and no
query to be told. Shares are told in steps of a hundredth, distances to two digits; the error of
their mean over scenes is that of the scenes.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal

import numpy as np

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.leaderboard.answer import Estimate
from airzoo_bench.results.result import ScoreColumn

__all__ = [
    "FLIPS",
    "LEAST_QUERIES",
    "Spread",
    "drawn",
    "overall_estimate",
    "told",
    "told_alone",
]

FLIPS = 4
"""Steps are at least as large as what so many queries can move a share."""
LEAST_QUERIES = 10
"""Scenes of fewer queries are not told by themselves."""

_Z95 = 1.959964
_LEAST_SHARE_OF_VALUE = 0.01
_SCENE_SHARE_STEP = Decimal("0.01")
_ONE_UP, _TWO_UP = (Context(prec=digits, rounding=ROUND_CEILING) for digits in (1, 2))


@dataclass(frozen=True)
class Spread:
    """A score and how uncertain it is.

    Attributes
    ----------
    value : float
        It may be infinite.
    error : float or None
        Standard error; None where it is not known.
    width : float
        The error that steps are made from; `error`, where that is known.
    move : float
        What `FLIPS` queries can move the value at most; 0 where that has no bound.
    most : float
        The largest value that there can be.
    draw : float
        From 0 to 1, of which step is told; at 0.5 it is the nearer one.
    """

    value: float
    error: float | None
    width: float
    move: float
    most: float = math.inf
    draw: float = 0.5

    @classmethod
    def of(cls, values: Floats, column: ScoreColumn, draw: float = 0.5) -> Spread:
        """Take the spread of a score over the queries of a scene, (N,) with N at least 1."""
        count = len(values)
        if column.average == "median":
            return replace(_of_median(values), draw=draw)
        mean = float(np.mean(values))
        if column.unit == "share":
            return _of_share(mean, count, draw)
        if math.isinf(mean) or count < 2:
            return cls(mean, None, abs(mean), 0.0, draw=draw)
        error = _not_zero(float(values.std(ddof=1)) / math.sqrt(count), mean)
        return cls(mean, error, error, 0.0, draw=draw)


def told(spread: Spread) -> Estimate:
    """Round a score, and its standard error upward to one digit."""
    error = None if spread.error is None else _up(spread.error, _ONE_UP)
    if math.isinf(spread.value):
        return Estimate(value=None, standard_error=None)
    width = _up(spread.width, _ONE_UP)
    if math.isinf(spread.most):
        width = _up_to_few(width)
    step = max(width / 2, _up(spread.move, _TWO_UP))
    stated = None if error is None else float(error)
    value = min(_stepped(spread.value, step, spread.draw), spread.most)
    return Estimate(value=value, standard_error=stated, step=float(step))


def told_alone(value: float, column: ScoreColumn, error: float | None = None) -> Estimate:
    """Round a score that one record makes."""
    if math.isinf(value):
        return Estimate(value=None, standard_error=None)
    step = _SCENE_SHARE_STEP
    if column.unit != "share":
        digits = Decimal(value).adjusted() - 1 if value else -2
        step = Decimal(1).scaleb(digits)
    stated = None if error is None or math.isinf(error) else float(_up(error, _ONE_UP))
    return Estimate(value=_stepped(value, step), standard_error=stated, step=float(step))


def drawn(salt: str, name: str, values: Floats) -> float:
    """Draw a number from 0 to 1 for a score, from a secret salt and what the score is made of."""
    digest = hashlib.blake2b(name.encode() + b"\0", digest_size=7, key=bytes.fromhex(salt))
    digest.update((np.round(values, 6) + 0.0).astype("<f8").tobytes())
    return int.from_bytes(digest.digest(), "big") / (1 << 56)


def overall_estimate(value: float, scenes: Sequence[Spread], draw: float = 0.5) -> Spread:
    """Take the spread of the unweighted mean over scenes."""
    count = len(scenes)
    errors = [scene.error for scene in scenes]
    known = [error for error in errors if error is not None]
    error = math.hypot(*known) / count if len(known) == count else None
    width = math.hypot(*(scene.width for scene in scenes)) / count
    move = max(scene.move for scene in scenes) / count
    return Spread(value, error, width, move, scenes[0].most, draw)


def _of_share(mean: float, count: int, draw: float) -> Spread:
    whole = Spread(mean, None, 0.5 / math.sqrt(count), FLIPS / count, 1.0, draw)
    rate = told(whole).value if count >= LEAST_QUERIES else 0.5
    rate = ((rate or 0.0) * count + 2) / (count + 4)
    return replace(whole, error=math.sqrt(rate * (1 - rate) / count))


def _of_median(values: Floats) -> Spread:
    ranked, count = np.sort(values), len(values)
    middle = float(np.median(values))
    if math.isinf(middle):
        return Spread(middle, None, math.inf, 0.0)
    reach = _Z95 * math.sqrt(count) / 2
    low = float(ranked[max(0, math.floor(count / 2 - reach))])
    high = float(ranked[min(count - 1, math.ceil(count / 2 + reach))])
    if math.isinf(high):
        return Spread(middle, None, _not_zero((middle - low) / _Z95, middle), 0.0)
    error = _not_zero((high - low) / (2 * _Z95), middle)
    return Spread(middle, error, error, 0.0)


def _not_zero(error: float, value: float) -> float:
    return max(error, _LEAST_SHARE_OF_VALUE * abs(value))


def _up(number: float, context: Context) -> Decimal:
    return context.create_decimal(repr(number))


def _up_to_few(width: Decimal) -> Decimal:
    """Round one digit up to 1, 2, 5 or 10, so that steps are mostly those of a similar sample."""
    unit = Decimal(1).scaleb(width.adjusted())
    return next(unit * digit for digit in (1, 2, 5, 10) if width <= unit * digit)


def _stepped(value: float, step: Decimal, draw: float = 0.5) -> float:
    """Return the multiple of a step below or above; at a draw of 0.5 the nearer one."""
    if not step:
        return value
    times = (Decimal(repr(value)) / step + Decimal(draw)).to_integral_value(ROUND_FLOOR)
    return float(times * step)
