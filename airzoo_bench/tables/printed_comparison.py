"""What printed numbers alone can say: two hit rates on the same queries, without the queries.

McNemar's test needs to know on how many queries only one method is right. Two printed rates give
the difference of the two numbers only, so p has bounds: it is least where one method is right
wherever the other is, and greatest where their hits overlap as little as they can.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.plurals import counted
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.statistics.significance import LEVEL, mcnemar
from airzoo_bench.tables.model import Cell, Column, Row, Table, share_to_percent
from airzoo_bench.tables.printed.numbers import (
    MOST_DECIMALS,
    Rounded,
    count_text,
    decimal_text,
    parse_number,
    possible_counts,
)
from airzoo_bench.tables.verdicts import LEAST_P, p_text

__all__ = [
    "Bounds",
    "bounds_table",
    "bounds_verdict",
    "hit_rate_interval",
    "hits_that_print",
    "printed_bounds",
]

_MOST_PAIRS = 1_000_000


@dataclass(frozen=True)
class Bounds:
    """What is possible for two printed rates on the same queries.

    Attributes
    ----------
    counts : (range, range)
        Hits of each method that round to what is printed.
    least, most : (int, int, float)
        Queries that only the first method hits, that only the second hits, and McNemar's p.
    """

    queries: int
    counts: tuple[range, range]
    least: tuple[int, int, float]
    most: tuple[int, int, float]


def printed_bounds(first: str, second: str, queries: int) -> Bounds:
    """Bound McNemar's exact p from two printed hit rates.

    Parameters
    ----------
    first, second : str
        In percent, as printed: the digits tell the rounding.
    queries : int
        On which both were measured, at least 1.

    Raises
    ------
    UsageError
        A text is no percentage, no count of hits rounds to it, or there are too many that do.
    """
    counts = hits_that_print(first, queries), hits_that_print(second, queries)
    if len(counts[0]) * len(counts[1]) > _MOST_PAIRS:
        raise UsageError(
            f"printed too coarsely: {len(counts[0]):,} and {len(counts[1]):,} hits are possible",
            expected="more digits, or fewer queries",
        )
    hits = np.array(counts[0])[:, None], np.array(counts[1])[None, :]
    ahead = hits[0] - hits[1]
    nested = np.maximum(ahead, 0), np.maximum(-ahead, 0)
    wins = np.minimum(hits[0], queries - hits[1])
    crossed = wins, wins - ahead
    least, most = mcnemar(*nested), mcnemar(*crossed)
    low, high = (
        np.unravel_index(least.argmin(), least.shape),
        np.unravel_index(most.argmax(), most.shape),
    )
    return Bounds(
        queries,
        counts,
        (int(nested[0][low]), int(nested[1][low]), float(least[low])),
        (int(crossed[0][high]), int(crossed[1][high]), float(most[high])),
    )


def hits_that_print(text: str, queries: int) -> range:
    """Return the numbers of hits that round to a printed percentage, halves either way.

    Raises
    ------
    UsageError
        It is no percentage, or none does.
    """
    number = parse_number(text) if text[:1].isdigit() else None
    if number is None or number.value > 100:
        raise UsageError(
            f"{text[:40]!r} is no printed percentage",
            expected=f"a number from 0 to 100 with at most {MOST_DECIMALS} decimals, such as 96.21",
        )
    counts = possible_counts(number, queries)
    if not counts:
        raise UsageError(
            f"no number of hits among {counted(queries, 'query')} is {text} %: the nearest are "
            f"{count_text(number, queries, digits=4)}",
            fix=_fix(number),
        )
    return counts


def _fix(number: Rounded) -> str:
    if 0 < number.value <= 1 and number.decimals > 1:
        percent = decimal_text(100 * number.value, number.decimals - 2)
        return f"{number.text} looks like a share from 0 to 1: give percent, {percent}"
    return "check --queries; a mean over scenes is no share of queries, so take one scene"


def hit_rate_interval(hits: int, queries: int) -> Floats:
    """Return Clopper and Pearson's exact 95 % interval of a hit rate, (2,), as shares.

    References
    ----------
    C. Clopper and E. Pearson, The use of confidence or fiducial limits illustrated in the case of
    the binomial, Biometrika 26 (1934).
    """
    from scipy.special import betaincinv

    tail = (1 - 0.95) / 2
    low = 0.0 if hits == 0 else float(betaincinv(hits, queries - hits + 1, tail))
    high = 1.0 if hits == queries else float(betaincinv(hits + 1, queries - hits, 1 - tail))
    return np.array([low, high])


def bounds_table(first: str, second: str, bounds: Bounds) -> Table:
    """Lay out what two printed hit rates can mean, with a verdict.

    Parameters
    ----------
    first, second : str
        As printed.
    bounds : Bounds
        From `printed_bounds`.
    """
    cases = (
        ("hits overlap the most", bounds.least),
        ("hits overlap the least", bounds.most),
    )
    columns = (
        Column("If"),
        Column(f"Only {first} hits"),
        Column(f"Only {second} hits"),
        Column("p, McNemar", decimals=4),
    )
    rows = tuple(
        Row((Cell(name), Cell(one), Cell(other), Cell(p, least=LEAST_P)))
        for name, (one, other, p) in cases
    )
    title = f"{first} % against {second} % on {counted(bounds.queries, 'query')}"
    rates = [
        _rate(text, counts, bounds.queries)
        for text, counts in zip((first, second), bounds.counts, strict=True)
    ]
    return Table(title, columns, rows, (bounds_verdict(first, second, bounds), *rates))


def _rate(text: str, counts: range, queries: int) -> str:
    limits = hit_rate_interval(counts[0], queries)[0], hit_rate_interval(counts[-1], queries)[1]
    hits = f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
    low, high = (share_to_percent(float(limit)) for limit in limits)
    return (
        f"{text} % is {hits} of {queries}; on its own between {low:.2f} and {high:.2f} % "
        "(95 %, Clopper and Pearson)"
    )


def bounds_verdict(first: str, second: str, bounds: Bounds) -> str:
    """Say in one sentence what two printed hit rates show."""
    least, most = bounds.least[2], bounds.most[2]
    ahead, behind = (first, second) if float(first) > float(second) else (second, first)
    if most <= LEVEL:
        at_most = "at most " * (most >= LEAST_P) + p_text(most)
        return f"{ahead} % is better than {behind} %, whichever the queries are: p {at_most}."
    if least > LEVEL:
        return (
            f"{ahead} % and {behind} % cannot be told apart, whichever the queries are: "
            f"p at least {p_text(least)}."
        )
    return (
        f"Whether {ahead} % is better than {behind} % depends on the queries: p lies between "
        f"{p_text(least)} and {p_text(most)}; compare the results themselves."
    )
