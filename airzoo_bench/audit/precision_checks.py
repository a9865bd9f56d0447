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
from airzoo_bench.audit.counts import chance_of_fit, count_text, possible_counts
from airzoo_bench.audit.findings import Conclusion, Finding, Grade
from airzoo_bench.audit.published import Printed, Published, grouped
from airzoo_bench.audit.queries import Key, Queries, key_of
from airzoo_bench.audit.rounding import Interval, decimal_text
from airzoo_bench.audit.scores import Family

__all__ = ["Definition", "check_average_precision", "define_average_precision"]

_BOUNDS = "AP bounds"
_WHOLE = "AP counts"
_NAMES = {
    "precision": "mean precision",
    "min": "sum of precisions at hits / min(R, K)",
    "trec": "sum of precisions at hits / R",
    "hits": "sum of precisions at hits / hits",
}
_SURE = 1e-3
_MOST_MISFITS = Fraction(1, 10)


@dataclass(frozen=True)
class _Bounded:
    """A value with the bounds of each definition, as shares; none where there are no recalls."""

    cell: Printed
    bounds: dict[str, Interval]

    def outside(self, variant: str) -> bool:
        return variant in self.bounds and not self.cell.share.meets(self.bounds[variant])


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
) -> tuple[dict[Key, Definition], list[Conclusion]]:
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
    conclusions: list[Conclusion] = []
    for name, group in _groups(published).items():
        whole = [value.cell for value in group if _is_counted(value.cell, queries)]
        concluded, text = _conclude(group, whole, queries)
        told = group[0].cell.score.variant or variant
        definitions[name] = Definition(told or concluded, told is not None)
        conclusions.append(Conclusion("AP", ", ".join(filter(None, name)), text))
    return definitions, conclusions


def check_average_precision(
    published: Published, queries: Mapping[Key, Queries], definitions: Mapping[Key, Definition]
) -> list[Finding]:
    """Find average precisions that cannot be what they are, by the recalls or by their counts.

    Parameters
    ----------
    published : Published
    queries : mapping
        From `resolve_queries`.
    definitions : mapping
        From `define_average_precision`.
    """
    findings = []
    for name, group in _groups(published).items():
        definition = definitions[name]
        findings.extend(_outside(group, definition))
        if definition.variant == "precision":
            whole = [value.cell for value in group if _is_counted(value.cell, queries)]
            findings.extend(_not_whole(whole, queries, is_told=definition.is_given))
    return findings


def _groups(published: Published) -> dict[Key, list[_Bounded]]:
    rows = published.by(lambda cell: (cell.table, *key_of(cell), cell.method))
    cells = [c for c in published.cells if c.score.family is Family.AVERAGE_PRECISION]
    groups = grouped(cells, lambda cell: (*cell.group, cell.score.name))
    return {
        name: [_bounded(c, rows[(c.table, *key_of(c), c.method)]) for c in group]
        for name, group in groups.items()
    }


def _is_counted(cell: Printed, queries: Mapping[Key, Queries]) -> bool:
    return not cell.is_summary and key_of(cell) in queries


def _bounded(cell: Printed, row: list[Printed]) -> _Bounded:
    recalls = recalls_for(cell, row)
    if recalls is None or cell.score.cutoff > LARGEST_CUTOFF:
        return _Bounded(cell, {})
    return _Bounded(cell, {name: bounds_of(name, cell.score.cutoff, recalls) for name in VARIANTS})


def _is_whole(cell: Printed, queries: Mapping[Key, Queries]) -> bool:
    total = queries[key_of(cell)].number * cell.score.cutoff
    return bool(possible_counts(cell.number, total, cell.full))


def _conclude(
    bounded: Sequence[_Bounded], whole: Sequence[Printed], queries: Mapping[Key, Queries]
) -> tuple[str | None, str]:
    """Return the definition that the values are, if that can be told, and the evidence."""
    with_bounds = [b for b in bounded if b.bounds]
    out = {name: sum(b.outside(name) for b in with_bounds) for name in VARIANTS}
    wholeness = _wholeness(whole, queries)
    allowed = _MOST_MISFITS * len(with_bounds)
    left = [name for name in VARIANTS if with_bounds and out[name] <= allowed]
    if wholeness.is_sure and out["precision"] <= allowed:
        chosen: str | None = "precision"
    else:
        chosen = left[0] if len(left) == 1 else None
    evidence = [f"the definition is {_NAMES[chosen]}" if chosen else "the definition is not told"]
    if wholeness.values:
        evidence.append(wholeness.text)
    if with_bounds:
        inside = ", ".join(f"{name} {len(with_bounds) - out[name]}" for name in VARIANTS)
        evidence.append(f"of {len(with_bounds)} values within the bounds by recalls: {inside}")
    return chosen, "; ".join(evidence)


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
            f"those of mean precision; {self.by_chance:.1f} would be by chance"
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
            findings.append(Finding(grade, _BOUNDS, value.cell, _bounds_text(value, kind, by_all)))
    return findings


def _bounds_text(value: _Bounded, kind: str, by_all: bool) -> str:
    cell = value.cell
    bounds = value.bounds[kind].times(Fraction(cell.full))
    low, high = (decimal_text(end, cell.number.decimals) for end in (bounds.low, bounds.high))
    rule = f"{_NAMES[kind]} lies between {low} and {high} by the recalls of the row"
    if kind == "precision":
        rule += " (one positive a query that has any; all behind its first)"
    every = "; it is outside the bounds of every other definition too" if by_all else ""
    return f"{cell.number.text}, but {rule}{every}"


def _not_whole(
    cells: Sequence[Printed], queries: Mapping[Key, Queries], *, is_told: bool
) -> list[Finding]:
    findings = []
    for cell in cells:
        known = queries[key_of(cell)]
        if _is_whole(cell, queries):
            continue
        near = count_text(cell.number, known.number * cell.score.cutoff, cell.full)
        unit = " %" if cell.full == 100 else ""
        origin = "" if known.is_given else ", which the other values imply"
        why = (
            f"{cell.number.text}{unit} of {cell.score.cutoff} places x {known.number} queries"
            f"{origin}, as mean precision: {near}"
        )
        sure = is_told and known.is_given
        grade = Grade.IMPOSSIBLE if sure else Grade.INCONSISTENT
        findings.append(Finding(grade, _WHOLE, cell, why))
    return findings
