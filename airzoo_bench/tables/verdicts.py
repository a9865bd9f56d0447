"""What comparisons show, in words."""

from __future__ import annotations

import math

from airzoo_bench.results.comparison import Pair
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.statistics.significance import LEVEL
from airzoo_bench.tables.method_table import as_shown
from airzoo_bench.tables.model import share_to_percent, show_number

__all__ = ["LEAST_P", "disagreement", "p_text", "sentence", "verdict"]

LEAST_P = 1e-4
"""A p-value below is shown as less than it."""

_OF_DIFFERENCE = {"share": "points", "m": "m", "deg": "deg"}


def verdict(pair: Pair) -> str:
    """Say what a pair shows in a word, at a level of 5 % after Holm's correction."""
    if pair.wins == pair.losses == 0:
        return "equal"
    if not pair.test.patterns or pair.p_floor > LEVEL:
        return "too few"
    if not pair.difference or pair.p_holm > LEVEL:
        return "unclear"
    return "better" if pair.is_better else "worse"


def sentence(pair: Pair, resampling: ResamplingConfig) -> str:
    """Say what a pair shows, with its numbers, at a level of 5 % after Holm's correction."""
    word, title = verdict(pair), pair.score.title
    if word == "equal":
        infinite = ", and both infinite" * (pair.difference is None)
        return f"{pair.method} and {pair.reference} are equal on {title} everywhere{infinite}."
    doubt = disagreement(pair)
    evidence = _span(pair, resampling) + _p_values(pair) + (f"; but {doubt}" if doubt else "")
    if word in ("better", "worse"):
        ahead, behind = _by_rank(pair)
        return f"{ahead} is better than {behind} on {title} by {_amount(pair)}{evidence}."
    both = f"{pair.method} and {pair.reference}"
    untold = {
        "unclear": f"{both} cannot be told apart on {title}",
        "too few": f"Too few to tell {both} apart on {title}",
    }
    if pair.difference is None:
        return f"{untold[word]}: both are infinite."
    return f"{untold[word]}: {_standing(pair)}{evidence}."


def _by_rank(pair: Pair) -> tuple[str, str]:
    names = (pair.method, pair.reference)
    return names if pair.is_better else names[::-1]


def _standing(pair: Pair) -> str:
    if pair.difference == 0:
        return "both have the same value"
    return f"{_by_rank(pair)[0]} is ahead by {_amount(pair)}"


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
            "the interval excludes 0, as p does before Holm's correction: "
            "intervals are not corrected for the number of methods"
        )
    return "the interval excludes 0: interval and test answer different questions"


def _amount(pair: Pair) -> str:
    value = abs(pair.difference or 0.0)
    if math.isinf(value):
        return "an infinite amount"
    return f"{_number(pair.score, value)} {_OF_DIFFERENCE[pair.score.unit]}"


def _number(score: ScoreColumn, value: float) -> str:
    return show_number(as_shown(score, value), 2)


def _span(pair: Pair, resampling: ResamplingConfig) -> str:
    """Return the interval as that of the amount by which the better one is ahead."""
    low, high = pair.interval.low, pair.interval.high
    if low is None or high is None:
        return " (no interval)"
    sign = -1 if (pair.difference or 0.0) < 0 else 1
    limits = sorted([sign * low + 0.0, sign * high + 0.0])
    first, last = (_number(pair.score, limit) for limit in limits)
    return f" ({share_to_percent(resampling.confidence):g} % interval {first} to {last})"


def _p_values(pair: Pair) -> str:
    text = f", p {_p(pair.test.p_value)}"
    if pair.p_holm != pair.test.p_value:
        text += f", after Holm {_p(pair.p_holm)}"
    return text if pair.p_mcnemar is None else f"{text}, McNemar {_p(pair.p_mcnemar)}"


def _p(value: float) -> str:
    return f"< {LEAST_P}" if value < LEAST_P else f"= {p_text(value)}"


def p_text(value: float) -> str:
    """Return a p-value as sentences say it."""
    return f"less than {LEAST_P}" if value < LEAST_P else f"{value:.4f}"
