"""Average precision at K, by its four definitions: bounds from recalls, whole numbers of hits.

A query whose first positive stands at rank r has an average precision between bounds that depend on
r alone. Recalls tell how many queries have their first positive in which ranks, so they bound the
mean. Mean precision, moreover, is a whole number of positives out of K for each query.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from fractions import Fraction
from functools import cache

from airzoo_bench.audit.queries import Key, Queries, RowKey, key_of, row_of
from airzoo_bench.tables.printed_numbers import Interval, chance_of_fit, possible_counts
from airzoo_bench.tables.printed_scores import Family
from airzoo_bench.tables.printed_values import PrintedValue

__all__ = [
    "NAMES",
    "VARIANTS",
    "Bounded",
    "Definition",
    "Evidence",
    "bounds_of",
    "brackets",
    "evidence_of",
    "first_hit_bounds",
    "has_known_queries",
    "recalls_for",
]

VARIANTS = ("precision", "min", "trec", "hits")
# All patterns of hits are gone through: 2^K.
LARGEST_CUTOFF = 12
NAMES = {
    "precision": "mean precision",
    "min": "sum of precisions at hits / min(R, K)",
    "trec": "sum of precisions at hits / R",
    "hits": "sum of precisions at hits / hits",
}
# So rarely may so many values be whole numbers by chance.
_SURE = 1e-4
_MOST_MISFITS = Fraction(1, 10)
# From so many values on one tells what the others are.
_FEWEST = 3


@cache
def first_hit_bounds(variant: str, cutoff: int, after: int, upto: int) -> Interval:
    """Bound a query's average precision by where its first positive stands."""
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
    """Bound the mean average precision, as a share, by recalls at several K up to the cutoff."""
    parts = [first_hit_bounds(variant, cutoff, *bracket) for bracket in brackets(recalls)]
    low = high = Fraction(0)
    for recall, this, following in zip(
        recalls, parts, [*parts[1:], Interval(Fraction(0), Fraction(0))], strict=True
    ):
        low += recall.share.times(this.low - following.low).low
        high += recall.share.times(this.high - following.high).high
    return Interval(low, high)


@dataclass(frozen=True)
class Bounded:
    """A value with the bounds of each definition, as shares; none where there are no recalls."""

    cell: PrintedValue
    bounds: dict[str, Interval]
    recalls: tuple[PrintedValue, ...] = ()

    @property
    def row(self) -> RowKey:
        """The row that it stands in."""
        return row_of(self.cell)

    def outside(self, variant: str) -> bool:
        """Whether the recalls of its row do not allow it by a definition."""
        return variant in self.bounds and not self.cell.share.meets(self.bounds[variant])

    def is_near(self, variant: str) -> bool:
        """Whether it is outside by no more than digits that were cut off instead of rounded."""
        half = self.cell.number.half / self.cell.full
        return self.cell.share.widened(2 * half).meets(self.bounds[variant])


@dataclass(frozen=True)
class Definition:
    """Which average precision a score is.

    Attributes
    ----------
    variant : str or None
        One of `VARIANTS`; None where it cannot be told.
    is_given : bool
        By the user or the score's name; else it was concluded from the values.
    """

    variant: str | None
    is_given: bool


def has_known_queries(value: Bounded, queries: Mapping[Key, Queries]) -> bool:
    """Whether it is of one scene, whose number of queries is known."""
    return not value.cell.is_summary and key_of(value.cell) in queries


def _is_whole(cell: PrintedValue, queries: Mapping[Key, Queries]) -> bool:
    total = queries[key_of(cell)].number * cell.score.cutoff
    return bool(possible_counts(cell.number, total, cell.full))


@dataclass(frozen=True)
class Evidence:
    """What the values say of their definition.

    Attributes
    ----------
    inside : dict of str to int
        How many of `bounded` values lie within the bounds of each definition.
    """

    bounded: int
    inside: dict[str, int]
    wholeness: _Wholeness
    misfits: tuple[PrintedValue, ...]

    @property
    def concluded(self) -> str | None:
        """The definition that the values tell, None where they do not."""
        # One misprint of several values must not hide what all others are.
        least = self.bounded - _tolerated(self.bounded)
        left = [name for name in VARIANTS if self.inside[name] >= least]
        if self.wholeness.is_sure and self.inside["precision"] >= least:
            return "precision"
        return left[0] if len(left) == 1 and self.bounded >= _FEWEST else None

    def text(self, definition: Definition) -> str:
        """Say what the definition is, and why."""
        name = definition.variant
        how = "given" if definition.is_given else "concluded"
        parts = [f"the definition is {NAMES[name]} ({how})" if name else "it cannot be told which"]
        if self.wholeness.values:
            parts.append(self.wholeness.text)
        if self.bounded:
            inside = ", ".join(f"{name} {self.inside[name]}" for name in VARIANTS)
            parts.append(
                f"of {self.bounded} values, so many lie within what the recalls next to them allow "
                f"by each definition: {inside}"
            )
        if not name and self.bounded >= _FEWEST and len(self.misfits) == 1:
            odd = self.misfits[0]
            parts.append(
                f"mean precision fits all but one, {odd.number.text} of {odd.method} in {odd.scene}"
            )
        return "; ".join(parts)


def _tolerated(values: int) -> int:
    """How many of several values may be misprints."""
    return max(1 if values >= _FEWEST else 0, int(_MOST_MISFITS * values))


def evidence_of(
    printed: Sequence[Bounded], queries: Mapping[Key, Queries], doubtful: AbstractSet[RowKey]
) -> Evidence:
    """Gather what values say of their definition, those of doubtful rows left out."""
    group = [value for value in printed if value.row not in doubtful]
    with_bounds = [value for value in group if value.bounds]
    inside = {name: sum(not v.outside(name) for v in with_bounds) for name in VARIANTS}
    whole = [value.cell for value in group if has_known_queries(value, queries)]
    misfits = tuple(
        value.cell
        for value in group
        if (value.bounds and value.outside("precision"))
        or (has_known_queries(value, queries) and not _is_whole(value.cell, queries))
    )
    return Evidence(len(with_bounds), inside, _wholeness(whole, queries), misfits)


@dataclass(frozen=True)
class _Wholeness:
    """How many values are a whole number of positives in all places, and how many by chance."""

    values: int
    fits: int
    by_chance: float
    is_sure: bool

    @property
    def text(self) -> str:
        return (
            f"{self.fits} of {self.values} values in scenes are whole numbers of positives, as "
            f"mean precision must be, and by chance {self.by_chance:.1f} would be"
        )


def _wholeness(cells: Sequence[PrintedValue], queries: Mapping[Key, Queries]) -> _Wholeness:
    from scipy.special import bdtrc

    fits = sum(_is_whole(cell, queries) for cell in cells)
    # No positives at all are a whole number by any definition.
    chances = [
        chance_of_fit(c.number, queries[key_of(c)].number * c.score.cutoff, c.full)
        if c.number.value
        else 1.0
        for c in cells
    ]
    if not chances:
        return _Wholeness(0, 0, 0.0, False)
    few_misfits = len(cells) - fits <= _tolerated(len(cells))
    luck = float(bdtrc(fits - 1, len(cells), sum(chances) / len(cells))) if fits else 1.0
    return _Wholeness(len(cells), fits, sum(chances), few_misfits and luck < _SURE)
