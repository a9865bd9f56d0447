"""What comparisons show, in words."""

from __future__ import annotations

import math

from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.statistics.comparison import Pair
from airzoo_bench.statistics.corrections import LEVEL
from airzoo_bench.statistics.samples import Plan
from airzoo_bench.tables.entries import as_shown
from airzoo_bench.tables.model import share_to_percent, show_number
from airzoo_bench.tables.printed_comparison import Bounds

__all__ = [
    "LEAST_P",
    "bounds_verdict",
    "disagreement",
    "is_decidable",
    "sentence",
    "verdict",
]


LEAST_P = 1e-4
"""A p-value below is shown as less than it."""

_OF_DIFFERENCE = {"share": "points", "m": "m", "deg": "deg"}


def is_decidable(pair: Pair) -> bool:
    """Whether enough units differ for any p-value to be a finding."""
    if pair.wins + pair.losses == 0:
        return True
    return pair.test.patterns > 0 and pair.p_floor <= LEVEL


def verdict(pair: Pair) -> str:
    """Say what a pair shows in a word, at a level of 5 % after Holm's correction.

    Returns
    -------
    str
        "better" or "worse" than the reference; "equal" where both have the same value; "too few"
        where too few units differ for a finding whatever their values; else "unclear".
    """
    if not pair.difference:
        return "equal"
    if not is_decidable(pair):
        return "too few"
    if pair.p_holm > LEVEL:
        return "unclear"
    return "better" if pair.is_better else "worse"


def sentence(pair: Pair, plan: Plan) -> str:
    """Say what a pair shows, with its numbers, at a level of 5 % after Holm's correction."""
    score = pair.score
    if pair.difference is None:
        return f"{pair.method} and {pair.reference} both have an infinite {score.title}."
    names = (pair.method, pair.reference) if pair.is_better else (pair.reference, pair.method)
    sign = 1 if pair.difference > 0 else -1
    amount = _amount(score, abs(pair.difference))
    evidence = f"{_span(pair, sign, plan)}{_p_values(pair)}"
    if pair.wins == pair.losses == 0:
        return f"{pair.method} and {pair.reference} are equal on {score.title} everywhere."
    if pair.difference == 0:
        return f"{pair.method} and {pair.reference} have the same {score.title}{evidence}."
    if pair.p_holm <= LEVEL:
        return (
            f"{names[0]} is better than {names[1]} on {score.title} by {amount}{evidence}"
            f"{_but(pair)}."
        )
    return (
        f"{pair.method} and {pair.reference} cannot be told apart on {score.title}: "
        f"{names[0]} is ahead by {amount}{evidence}{_but(pair)}."
    )


def _but(pair: Pair) -> str:
    doubt = disagreement(pair)
    return f"; but {doubt}" if doubt else ""


def disagreement(pair: Pair) -> str:
    """Say where the interval of a difference and the verdict point different ways; else empty."""
    low, high = pair.interval.low, pair.interval.high
    if low is None or high is None:
        return ""
    holds_0, word = low <= 0 <= high, verdict(pair)
    if word in ("better", "worse") and holds_0:
        return "the interval holds 0"
    if word != "unclear" or holds_0:
        return ""
    if pair.test.p_value <= LEVEL:
        return (
            "the interval leaves 0 out, as p does before Holm: "
            "intervals are not corrected for the number of methods"
        )
    return "the interval leaves 0 out: it and the test ask different things"


def _amount(score: ScoreColumn, value: float) -> str:
    if math.isinf(value):
        return "an infinite amount"
    return f"{_number(score, value)} {_OF_DIFFERENCE[score.unit]}"


def _number(score: ScoreColumn, value: float) -> str:
    return show_number(as_shown(score, value), 2)


def _span(pair: Pair, sign: int, plan: Plan) -> str:
    low, high = pair.interval.low, pair.interval.high
    if low is None or high is None:
        return " (no interval)"
    limits = sorted([sign * low + 0.0, sign * high + 0.0])
    first, last = (_number(pair.score, limit) for limit in limits)
    return f" ({share_to_percent(plan.confidence):g} % interval {first} to {last})"


def _p_values(pair: Pair) -> str:
    text = f", p {_p(pair.test.p_value)}"
    if pair.p_holm != pair.test.p_value:
        text += f", after Holm {_p(pair.p_holm)}"
    return text if pair.p_mcnemar is None else f"{text}, McNemar {_p(pair.p_mcnemar)}"


def _p(value: float) -> str:
    return f"< {LEAST_P}" if value < LEAST_P else f"= {_shown(value)}"


def bounds_verdict(first: str, second: str, bounds: Bounds) -> str:
    """Say in one sentence what two printed hit rates show."""
    least, most = bounds.least[2], bounds.most[2]
    ahead, behind = (first, second) if float(first) > float(second) else (second, first)
    if most <= LEVEL:
        at_most = "at most " * (most >= LEAST_P) + _shown(most)
        return f"{ahead} % is better than {behind} %, whichever the queries are: p {at_most}."
    if least > LEVEL:
        return (
            f"{ahead} % and {behind} % cannot be told apart, whichever the queries are: "
            f"p at least {_shown(least)}."
        )
    return (
        f"Whether {ahead} % is better than {behind} % depends on the queries: p lies between "
        f"{_shown(least)} and {_shown(most)}; compare the results themselves."
    )


def _shown(value: float) -> str:
    return f"less than {LEAST_P}" if value < LEAST_P else f"{value:.4f}"
