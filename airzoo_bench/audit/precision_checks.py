"""Which average precision a table holds, and whether its values can be that."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

from airzoo_bench.audit.average_precision import (
    LARGEST_CUTOFF,
    VARIANTS,
    bounds_of,
    recalls_for,
)
from airzoo_bench.audit.count_checks import Share, judge_shares
from airzoo_bench.audit.findings import Conclusion, Finding, Grade, Outcome
from airzoo_bench.audit.queries import Key, Queries, key_of
from airzoo_bench.printed.counts import chance_of_fit, possible_counts
from airzoo_bench.printed.numbers import Interval, decimal_text
from airzoo_bench.printed.scores import Family
from airzoo_bench.printed.table import Printed, Published, grouped

__all__ = ["Definition", "check_average_precision", "define_average_precision"]

_BOUNDS = "AP bounds"
_WHOLE = "AP counts"
_NAMES = {
    "precision": "mean precision",
    "min": "sum of precisions at hits / min(R, K)",
    "trec": "sum of precisions at hits / R",
    "hits": "sum of precisions at hits / hits",
}
# So rarely may so many values be whole numbers by chance.
_SURE = 1e-5
_BOUNDED = "average precisions, whether the recalls beside them allow them"
_COUNTED = "mean precisions, whether each is a whole number of positives"
_NONE = "no average precision such as AP@5 is printed in a scene"
_MOST_MISFITS = Fraction(1, 10)


@dataclass(frozen=True)
class _Bounded:
    """A value with the bounds of each definition, as shares; none where there are no recalls."""

    cell: Printed
    bounds: dict[str, Interval]

    def outside(self, variant: str) -> bool:
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


def define_average_precision(
    published: Published, queries: Mapping[Key, Queries], variant: str | None
) -> dict[Key, Definition]:
    """Tell which average precision the values of each benchmark, track and score are.

    Parameters
    ----------
    published : Published
    queries : mapping
        From `resolve_queries`, without any use of average precision.
    variant : str or None
        One of `VARIANTS`, which a score's own name overrules; None to conclude it from the values.
    """
    definitions: dict[Key, Definition] = {}
    for name, group in _groups(published).items():
        told = group[0].cell.score.variant or variant
        evidence = _evidence(group, queries)
        definitions[name] = Definition(told or evidence.concluded, told is not None)
    return definitions


def check_average_precision(
    published: Published, queries: Mapping[Key, Queries], definitions: Mapping[Key, Definition]
) -> tuple[Outcome, Outcome]:
    """Find average precisions that cannot be what they are, by the recalls or by their counts.

    Parameters
    ----------
    published : Published
    queries : mapping
        From `resolve_queries`.
    definitions : mapping
        From `define_average_precision`.
    """
    bounds: list[Finding] = []
    conclusions: list[Conclusion] = []
    shares: list[Share] = []
    groups = _groups(published)
    for name, group in groups.items():
        definition = definitions[name]
        bounds.extend(_outside(group, definition))
        text = _evidence(group, queries).text(definition)
        conclusions.append(Conclusion("AP", ", ".join(filter(None, name)), text))
        if definition.variant == "precision":
            shares += [_share(v.cell, queries, definition) for v in group if _known(v, queries)]
    values = [value for group in groups.values() for value in group]
    bounded = sum(bool(value.bounds) for value in values)
    left = [_no_bounds_text(len(values), bounded), _not_whole_text(values, shares)]
    whole, cut = judge_shares(_WHOLE, shares)
    return (
        Outcome(_BOUNDS, bounded, _BOUNDED, left[0], tuple(bounds), tuple(conclusions)),
        Outcome(_WHOLE, len(shares), _COUNTED, left[1], tuple(whole), tuple(cut)),
    )


def _no_bounds_text(values: int, bounded: int) -> str:
    if not values:
        return _NONE
    left = values - bounded
    return f"{left} without a recall at the same K beside them" if left else ""


def _not_whole_text(values: Sequence[_Bounded], shares: Sequence[Share]) -> str:
    scenes = sum(not value.cell.is_summary for value in values)
    if not scenes:
        return _NONE
    left = scenes - len(shares)
    return f"{left} that are not mean precision, or of queries of unknown number" if left else ""


def _known(value: _Bounded, queries: Mapping[Key, Queries]) -> bool:
    return not value.cell.is_summary and key_of(value.cell) in queries


def _share(cell: Printed, queries: Mapping[Key, Queries], definition: Definition) -> Share:
    known = queries[key_of(cell)]
    return Share(cell, known, cell.score.cutoff, known.is_given and definition.is_given)


def _groups(published: Published) -> dict[Key, list[_Bounded]]:
    rows = published.by(lambda cell: (cell.table, *key_of(cell), cell.method))
    cells = [c for c in published.cells if c.score.family is Family.AVERAGE_PRECISION]
    groups = grouped(cells, lambda cell: (*cell.group, cell.score.name))
    return {
        name: [_bounded(c, rows[(c.table, *key_of(c), c.method)]) for c in group]
        for name, group in groups.items()
    }


def _bounded(cell: Printed, row: list[Printed]) -> _Bounded:
    recalls = recalls_for(cell, row)
    if recalls is None or cell.score.cutoff > LARGEST_CUTOFF:
        return _Bounded(cell, {})
    return _Bounded(cell, {name: bounds_of(name, cell.score.cutoff, recalls) for name in VARIANTS})


def _is_whole(cell: Printed, queries: Mapping[Key, Queries]) -> bool:
    total = queries[key_of(cell)].number * cell.score.cutoff
    return bool(possible_counts(cell.number, total, cell.full))


@dataclass(frozen=True)
class _Evidence:
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

    @property
    def concluded(self) -> str | None:
        least = (1 - _MOST_MISFITS) * self.bounded
        left = [name for name in VARIANTS if self.bounded and self.inside[name] >= least]
        if self.wholeness.is_sure and self.inside["precision"] >= least:
            return "precision"
        return left[0] if len(left) == 1 else None

    def text(self, definition: Definition) -> str:
        """Say what the definition is, and why."""
        name = definition.variant
        how = "given" if definition.is_given else "concluded"
        parts = [f"the definition is {_NAMES[name]} ({how})" if name else "it cannot be told which"]
        if self.wholeness.values:
            parts.append(self.wholeness.text)
        if self.bounded:
            inside = ", ".join(f"{name} {self.inside[name]}" for name in VARIANTS)
            parts.append(
                f"of {self.bounded} values, so many lie within what the recalls beside them allow "
                f"by each definition: {inside}"
            )
        return "; ".join(parts)


def _evidence(group: Sequence[_Bounded], queries: Mapping[Key, Queries]) -> _Evidence:
    with_bounds = [value for value in group if value.bounds]
    inside = {name: sum(not v.outside(name) for v in with_bounds) for name in VARIANTS}
    whole = [value.cell for value in group if _known(value, queries)]
    return _Evidence(len(with_bounds), inside, _wholeness(whole, queries))


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


def _wholeness(cells: Sequence[Printed], queries: Mapping[Key, Queries]) -> _Wholeness:
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
    few_misfits = len(cells) - fits <= _MOST_MISFITS * len(cells)
    luck = float(bdtrc(fits - 1, len(cells), sum(chances) / len(cells))) if fits else 1.0
    return _Wholeness(len(cells), fits, sum(chances), few_misfits and luck < _SURE)


def _outside(bounded: Sequence[_Bounded], definition: Definition) -> list[Finding]:
    findings = []
    kind = definition.variant or "precision"
    for value in bounded:
        by_all = bool(value.bounds) and all(value.outside(name) for name in VARIANTS)
        if by_all or (definition.variant and value.outside(kind)):
            sure = by_all or definition.is_given
            grade = Grade.IMPOSSIBLE if sure else Grade.INCONSISTENT
            why = _bounds_text(value, kind, by_all)
            if value.is_near(kind):
                grade, why = Grade.ROUNDING, f"{why}: off by the last digit"
            findings.append(Finding(grade, _BOUNDS, value.cell, why))
    return findings


def _bounds_text(value: _Bounded, kind: str, by_all: bool) -> str:
    cell = value.cell
    bounds = value.bounds[kind].times(Fraction(cell.full))
    low, high = (decimal_text(end, cell.number.decimals) for end in (bounds.low, bounds.high))
    why = f"the recalls beside it allow {_NAMES[kind]} of {low} to {high}"
    if kind == "precision":
        why += " (from one positive for each query that has any, to all behind its first)"
    every = ", and no other definition allows it" if by_all else ""
    return f"{why}; printed is {cell.number.text}{every}"
