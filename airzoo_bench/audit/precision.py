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

from scipy.special import bdtrc

from airzoo_bench.audit.counts import (
    Key,
    Queries,
    Share,
    chance_of_fit,
    decimal_text,
    judge_shares,
    key_of,
)
from airzoo_bench.audit.findings import Conclusion, Finding, Grade, Outcome
from airzoo_bench.tables.printed import Family, Span
from airzoo_bench.tables.published import PrintedValue, Published, grouped

__all__ = ["Definition", "check_average_precision", "define_average_precision"]

_NAMES = {
    "precision": "mean precision",
    "min": "sum of precisions at hits / min(R, K)",
    "trec": "sum of precisions at hits / R",
    "hits": "sum of precisions at hits / hits",
}
_LARGEST_CUTOFF = 12  # all patterns of hits are gone through: 2^K
_SURE = 1e-4  # so rarely may so many values be whole numbers by chance
_MOST_MISFITS = Fraction(1, 10)
_FEWEST = 3  # from so many values on one tells what the others are
_NONE = "no average precision such as AP@5 is printed in a scene"


@dataclass(frozen=True)
class Definition:
    """Which average precision a score is, or None where it cannot be told."""

    variant: str | None
    is_given: bool


@dataclass(frozen=True)
class _Bounded:
    """A value with the bounds of each definition, as shares; none where there are no recalls."""

    cell: PrintedValue
    bounds: dict[str, Span]
    recalls: tuple[PrintedValue, ...]

    def outside(self, variant: str) -> bool:
        """Whether the recalls of its row do not allow it by a definition."""
        return variant in self.bounds and not self.cell.share.meets(self.bounds[variant])


@cache
def first_hit_bounds(variant: str, cutoff: int, after: int, upto: int) -> Span:
    """Bound a query's average precision by where its first positive stands."""
    values = []
    for pattern in itertools.product((False, True), repeat=cutoff):
        ranks = [rank for rank, hit in enumerate(pattern, 1) if hit]
        if not ranks or not after < ranks[0] <= upto:
            continue
        # R, the number of positives, is at least the hits and may be without end.
        precisions = sum((Fraction(n, rank) for n, rank in enumerate(ranks, 1)), Fraction(0))
        most = precisions / len(ranks)
        least = {"hits": most, "min": precisions / cutoff, "trec": Fraction(0)}
        values += (
            [Fraction(len(ranks), cutoff)] if variant == "precision" else [least[variant], most]
        )
    return Span(min(values), max(values))


def _bounded(cell: PrintedValue, row: Sequence[PrintedValue]) -> _Bounded:
    """Bound a value by the recalls of its row, if one is at the same K."""
    cutoff = cell.score.cutoff
    found = {
        int(threshold): other
        for other in row
        if other.score.family is Family.HITS and len(other.score.thresholds) == 1
        for threshold, unit in other.score.thresholds
        if unit == "" and threshold.denominator == 1 and 0 < threshold <= cutoff
    }
    if cutoff not in found or cutoff > _LARGEST_CUTOFF:
        return _Bounded(cell, {}, ())
    ranks = sorted(found)
    recalls, nothing = [found[k] for k in ranks], Span(Fraction(0), Fraction(0))
    bounds = {}
    for variant in _NAMES:
        parts = [
            first_hit_bounds(variant, cutoff, after, upto)
            for after, upto in zip([0, *ranks], ranks, strict=False)
        ]
        low = high = Fraction(0)
        for recall, this, following in zip(recalls, parts, [*parts[1:], nothing], strict=True):
            low += recall.share.times(this.low - following.low).low
            high += recall.share.times(this.high - following.high).high
        bounds[variant] = Span(low, high)
    return _Bounded(cell, bounds, tuple(recalls))


def _groups(published: Published) -> dict[Key, list[_Bounded]]:
    rows = published.by(lambda cell: cell.row)
    cells = [c for c in published.cells if c.score.family is Family.AVERAGE_PRECISION]
    groups = grouped(cells, lambda cell: (*cell.group, cell.score.name))
    return {name: [_bounded(c, rows[c.row]) for c in group] for name, group in groups.items()}


def _share(cell: PrintedValue, queries: Mapping[Key, Queries], *, is_given: bool) -> Share | None:
    """Return a value of one scene, whose number of queries is known, as a share of their places."""
    known = queries.get(key_of(cell))
    if cell.is_summary or known is None:
        return None
    return Share(cell, known, cell.score.cutoff, known.is_given and is_given)


def define_average_precision(
    published: Published,
    queries: Mapping[Key, Queries],
    variant: str | None,
    doubtful: AbstractSet[tuple[str, ...]],
) -> dict[Key, Definition]:
    """Tell which average precision the values of each benchmark, track and score are."""
    definitions = {}
    for name, group in _groups(published).items():
        told = group[0].cell.score.variant or variant
        own = [value for value in group if value.cell.row not in doubtful]
        definitions[name] = Definition(told or _evidence(own, queries)[0], told is not None)
    return definitions


def _evidence(
    group: Sequence[_Bounded], queries: Mapping[Key, Queries]
) -> tuple[str | None, list[str], str]:
    """Conclude a definition; say why, and which value hides it if it is the only one."""
    bounded = [value for value in group if value.bounds]
    inside = {name: sum(not value.outside(name) for value in bounded) for name in _NAMES}
    shares = [s for value in group if (s := _share(value.cell, queries, is_given=True))]
    fits = sum(share.fits for share in shares)
    # No positives at all are a whole number by any definition.
    by_chance = sum(
        chance_of_fit(share.cell, share.total) if share.cell.number.value else 1.0
        for share in shares
    )
    luck = float(bdtrc(fits - 1, len(shares), by_chance / len(shares))) if fits else 1.0
    is_whole = bool(shares) and len(shares) - fits <= _tolerated(len(shares)) and luck < _SURE
    # One misprint of several values must not hide what all others are.
    least = len(bounded) - _tolerated(len(bounded))
    left = [name for name in _NAMES if inside[name] >= least]
    concluded = left[0] if len(left) == 1 and len(bounded) >= _FEWEST else None
    if is_whole and "precision" in left:
        concluded = "precision"
    reasons = []
    if shares:
        reasons.append(
            f"{fits} of {len(shares)} values in scenes are whole numbers of positives, as "
            f"mean precision must be, and by chance {by_chance:.1f} would be"
        )
    if bounded:
        reasons.append(
            f"of {len(bounded)} values, so many lie within what the recalls next to them allow "
            "by each definition: " + ", ".join(f"{one} {inside[one]}" for one in _NAMES)
        )
    odd = {id(value.cell): value.cell for value in bounded if value.outside("precision")}
    odd |= {id(share.cell): share.cell for share in shares if not share.fits}
    if len(bounded) < _FEWEST or len(odd) != 1:
        return concluded, reasons, ""
    [misfit] = odd.values()
    where = f"{misfit.number.text} of {misfit.method} in {misfit.scene}"
    return concluded, reasons, f"mean precision fits all but one, {where}"


def _definition_text(definition: Definition, reasons: Sequence[str], misfit: str) -> str:
    if not definition.variant:
        return "; ".join(filter(None, ["it cannot be told which", *reasons, misfit]))
    how = "given" if definition.is_given else "concluded"
    return "; ".join([f"the definition is {_NAMES[definition.variant]} ({how})", *reasons])


def _tolerated(values: int) -> int:
    """Return how many of several values may be misprints."""
    return max(1 if values >= _FEWEST else 0, int(_MOST_MISFITS * values))


def check_average_precision(
    published: Published,
    queries: Mapping[Key, Queries],
    definitions: Mapping[Key, Definition],
    doubtful: AbstractSet[tuple[str, ...]],
) -> tuple[Outcome, Outcome]:
    """Find average precisions that cannot be what they are, by the recalls or by their counts."""
    groups = _groups(published)
    values = [value for group in groups.values() for value in group]
    bounded, outside, shares, conclusions = [], [], [], []
    for name, group in groups.items():
        definition = definitions[name]
        own = [value for value in group if value.cell.row not in doubtful]
        text = _definition_text(definition, *_evidence(own, queries)[1:])
        conclusions.append(Conclusion("AP", ", ".join(filter(None, name)), text))
        own = [value for value in own if value.bounds]
        bounded += own
        outside += [found for value in own if (found := _judge(value, definition))]
        if definition.variant == "precision":
            given = definition.is_given
            shares += [s for v in group if (s := _share(v.cell, queries, is_given=given))]
    left = len(values) - len(bounded)
    why = f"{left} without a recall at the same K, or with impossible ones, next to them"
    whole, cut = judge_shares("AP counts", shares)
    scenes = sum(not value.cell.is_summary for value in values)
    unknown = scenes - len(shares)
    no_count = f"{unknown} that are not mean precision, or of queries of unknown number"
    return (
        Outcome(
            "AP bounds",
            len(bounded),
            "average precisions, whether the recalls next to them allow them",
            _NONE if not values else why if left else "",
            tuple(outside),
            tuple(conclusions),
            tuple(cell for value in bounded for cell in (value.cell, *value.recalls)),
        ),
        Outcome(
            "AP counts",
            len(shares),
            "mean precisions, whether each is a whole number of positives",
            _NONE if not scenes else no_count if unknown else "",
            tuple(whole),
            tuple(cut),
            tuple(share.cell for share in shares),
        ),
    )


def _judge(value: _Bounded, definition: Definition) -> Finding | None:
    cell, kind = value.cell, definition.variant or "precision"
    by_all = all(value.outside(name) for name in _NAMES)
    if not by_all and not (definition.variant and value.outside(kind)):
        return None
    bounds = value.bounds[kind].times(Fraction(cell.full))
    low, high = (decimal_text(end, cell.number.decimals) for end in (bounds.low, bounds.high))
    why = f"the recalls next to it allow {_NAMES[kind]} of {low} to {high}"
    if kind == "precision":
        why += " (from one positive for each query that has any, to all behind its first)"
    why += f"; printed is {cell.number.text}" + ", and no other definition allows it" * by_all
    # Outside by no more than digits that were cut off instead of rounded.
    if cell.share.widened(2 * cell.number.half / cell.full).meets(value.bounds[kind]):
        return Finding(Grade.ROUNDING, "AP bounds", cell, f"{why}: off by the last digit")
    grade = Grade.IMPOSSIBLE if by_all or definition.is_given else Grade.INCONSISTENT
    return Finding(grade, "AP bounds", cell, why)
