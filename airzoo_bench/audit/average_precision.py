"""Average precision at K, by its four definitions: bounds from recalls, whole numbers of hits.

A query whose first positive stands at rank r has an average precision between bounds that depend on
r alone. Recalls tell how many queries have their first positive in which ranks, so they bound the
mean. Mean precision, moreover, is a whole number of positives out of K for each query.
"""

from __future__ import annotations

import itertools
from fractions import Fraction
from functools import cache

from airzoo_bench.tables.printed.cells import PrintedValue
from airzoo_bench.tables.printed.numbers import Interval
from airzoo_bench.tables.printed.scores import Family

__all__ = ["VARIANTS", "bounds_of", "brackets", "first_hit_bounds", "recalls_for"]

VARIANTS = ("precision", "min", "trec", "hits")
# All patterns of hits are gone through: 2^K.
LARGEST_CUTOFF = 12


@cache
def first_hit_bounds(variant: str, cutoff: int, after: int, upto: int) -> Interval:
    """Bound a query's average precision by where its first positive stands.

    Parameters
    ----------
    variant : str
        One of `VARIANTS`: the sum of precisions at hits over min(R, K), R or the number of hits,
        where R is the number of positives; or hits over K.
    cutoff : int
        K, at most 12.
    after, upto : int
        The first positive stands behind the former rank and at the latter at the latest.
    """
    values = []
    for pattern in itertools.product((False, True), repeat=cutoff):
        ranks = [rank for rank, hit in enumerate(pattern, 1) if hit]
        if ranks and after < ranks[0] <= upto:
            values += _values(variant, cutoff, ranks)
    return Interval(min(values), max(values))


def _values(variant: str, cutoff: int, ranks: list[int]) -> list[Fraction]:
    """Return the least and the greatest value: R is at least the hits and may be without end."""
    precisions = sum((Fraction(n, rank) for n, rank in enumerate(ranks, 1)), Fraction(0))
    most = precisions / len(ranks)
    if variant == "precision":
        return [Fraction(len(ranks), cutoff)]
    if variant == "hits":
        return [most]
    return [precisions / cutoff if variant == "min" else Fraction(0), most]


def recalls_for(cell: PrintedValue, row: list[PrintedValue]) -> list[PrintedValue] | None:
    """Return the recalls of a row that say where first hits stand, by K; None without R@K."""
    found = {
        int(other.score.thresholds[0][0]): other
        for other in row
        if other.score.family is Family.HITS
        and len(other.score.thresholds) == 1
        and other.score.thresholds[0][1] == ""
        and other.score.thresholds[0][0].denominator == 1
        and 0 < other.score.thresholds[0][0] <= cell.score.cutoff
    }
    known = [found[k] for k in sorted(found)]
    return known if cell.score.cutoff in found else None


def brackets(recalls: list[PrintedValue]) -> list[tuple[int, int]]:
    """Return the ranks between which recalls count first hits, as (after, up to)."""
    cutoffs = [int(recall.score.thresholds[0][0]) for recall in recalls]
    return list(zip([0, *cutoffs], cutoffs, strict=False))


def bounds_of(variant: str, cutoff: int, recalls: list[PrintedValue]) -> Interval:
    """Bound the mean average precision, as a share, by recalls at several K up to the cutoff.

    With b_i the bound of the i-th bracket of ranks, the sum of b_i (R_i - R_(i-1)) is the sum of
    R_i (b_i - b_(i+1)), so that each recall's interval enters once.
    """
    parts = [first_hit_bounds(variant, cutoff, *bracket) for bracket in brackets(recalls)]
    low = high = Fraction(0)
    for recall, this, following in zip(
        recalls, parts, [*parts[1:], Interval(Fraction(0), Fraction(0))], strict=True
    ):
        low += recall.share.times(this.low - following.low).low
        high += recall.share.times(this.high - following.high).high
    return Interval(low, high)
