"""What average precisions say of their own definition: bounds that hold, and whole numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from fractions import Fraction

from airzoo_bench.audit.average_precision import VARIANTS
from airzoo_bench.audit.queries import Key, Queries, RowKey, key_of, row_of
from airzoo_bench.tables.printed.cells import PrintedValue
from airzoo_bench.tables.printed.counts import chance_of_fit, possible_counts
from airzoo_bench.tables.printed.numbers import Interval

__all__ = ["NAMES", "Bounded", "Definition", "Evidence", "evidence_of", "has_known_queries"]

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
        """Whether the recalls beside it do not allow it by a definition."""
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
    wholeness : _Wholeness
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
                f"of {self.bounded} values, so many lie within what the recalls beside them allow "
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
