"""Which average precision a table holds, and whether its values can be that."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet
from fractions import Fraction

from airzoo_bench.audit.average_precision import (
    LARGEST_CUTOFF,
    NAMES,
    VARIANTS,
    Bounded,
    Definition,
    bounds_of,
    evidence_of,
    has_known_queries,
    recalls_for,
)
from airzoo_bench.audit.count_checks import Share, judge_shares
from airzoo_bench.audit.findings import Conclusion, Finding, Grade, Outcome
from airzoo_bench.audit.queries import Key, Queries, RowKey, key_of
from airzoo_bench.tables.printed_numbers import decimal_text
from airzoo_bench.tables.printed_scores import Family
from airzoo_bench.tables.printed_values import PrintedValue, Published, grouped

__all__ = ["Definition", "check_average_precision", "define_average_precision"]

_BOUNDS = "AP bounds"
_WHOLE = "AP counts"
_BOUNDED = "average precisions, whether the recalls next to them allow them"
_COUNTED = "mean precisions, whether each is a whole number of positives"
_NONE = "no average precision such as AP@5 is printed in a scene"


def define_average_precision(
    published: Published,
    queries: Mapping[Key, Queries],
    variant: str | None,
    doubtful: AbstractSet[RowKey] = frozenset(),
) -> dict[Key, Definition]:
    """Tell which average precision the values of each benchmark, track and score are."""
    definitions: dict[Key, Definition] = {}
    for name, group in _groups(published).items():
        told = group[0].cell.score.variant or variant
        evidence = evidence_of(group, queries, doubtful)
        definitions[name] = Definition(told or evidence.concluded, told is not None)
    return definitions


def check_average_precision(
    published: Published,
    queries: Mapping[Key, Queries],
    definitions: Mapping[Key, Definition],
    doubtful: AbstractSet[RowKey] = frozenset(),
) -> tuple[Outcome, Outcome]:
    """Find average precisions that cannot be what they are, by the recalls or by their counts."""
    bounds: list[Finding] = []
    conclusions: list[Conclusion] = []
    shares: list[Share] = []
    groups = _groups(published)
    for name, group in groups.items():
        definition = definitions[name]
        bounds.extend(_outside([v for v in group if v.row not in doubtful], definition))
        text = evidence_of(group, queries, doubtful).text(definition)
        conclusions.append(Conclusion("AP", ", ".join(filter(None, name)), text))
        if definition.variant == "precision":
            shares += [
                _share(v.cell, queries, definition) for v in group if has_known_queries(v, queries)
            ]
    values = [value for group in groups.values() for value in group]
    with_bounds = [v for v in values if v.bounds and v.row not in doubtful]
    bounded = len(with_bounds)
    left = [_no_bounds_text(len(values), bounded), _not_whole_text(values, shares)]
    whole, cut = judge_shares(_WHOLE, shares)
    return (
        Outcome(
            *(_BOUNDS, bounded, _BOUNDED, left[0], tuple(bounds), tuple(conclusions)),
            cells=tuple(cell for v in with_bounds for cell in (v.cell, *v.recalls)),
        ),
        Outcome(
            *(_WHOLE, len(shares), _COUNTED, left[1], tuple(whole), tuple(cut)),
            cells=tuple(share.cell for share in shares),
        ),
    )


def _no_bounds_text(values: int, bounded: int) -> str:
    if not values:
        return _NONE
    left = values - bounded
    return (
        f"{left} without a recall at the same K, or with impossible ones, next to them"
        if left
        else ""
    )


def _not_whole_text(values: Sequence[Bounded], shares: Sequence[Share]) -> str:
    scenes = sum(not value.cell.is_summary for value in values)
    if not scenes:
        return _NONE
    left = scenes - len(shares)
    return f"{left} that are not mean precision, or of queries of unknown number" if left else ""


def _share(cell: PrintedValue, queries: Mapping[Key, Queries], definition: Definition) -> Share:
    known = queries[key_of(cell)]
    return Share(cell, known, cell.score.cutoff, known.is_given and definition.is_given)


def _groups(published: Published) -> dict[Key, list[Bounded]]:
    rows = published.by(lambda cell: (cell.table, *key_of(cell), cell.method))
    cells = [c for c in published.cells if c.score.family is Family.AVERAGE_PRECISION]
    groups = grouped(cells, lambda cell: (*cell.group, cell.score.name))
    return {
        name: [_bounded(c, rows[(c.table, *key_of(c), c.method)]) for c in group]
        for name, group in groups.items()
    }


def _bounded(cell: PrintedValue, row: list[PrintedValue]) -> Bounded:
    recalls = recalls_for(cell, row)
    if recalls is None or cell.score.cutoff > LARGEST_CUTOFF:
        return Bounded(cell, {})
    bounds = {name: bounds_of(name, cell.score.cutoff, recalls) for name in VARIANTS}
    return Bounded(cell, bounds, tuple(recalls))


def _outside(bounded: Sequence[Bounded], definition: Definition) -> list[Finding]:
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


def _bounds_text(value: Bounded, kind: str, by_all: bool) -> str:
    cell = value.cell
    bounds = value.bounds[kind].times(Fraction(cell.full))
    low, high = (decimal_text(end, cell.number.decimals) for end in (bounds.low, bounds.high))
    why = f"the recalls next to it allow {NAMES[kind]} of {low} to {high}"
    if kind == "precision":
        why += " (from one positive for each query that has any, to all behind its first)"
    every = ", and no other definition allows it" if by_all else ""
    return f"{why}; printed is {cell.number.text}{every}"
