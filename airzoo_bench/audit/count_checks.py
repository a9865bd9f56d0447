"""Shares of queries, and mean precisions, that are no whole number."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from airzoo_bench.audit.findings import Conclusion, Finding, Grade, Outcome
from airzoo_bench.audit.queries import Key, Queries, is_average, key_of
from airzoo_bench.core.errors import agreeing, counted
from airzoo_bench.tables.printed_numbers import (
    count_text,
    decimal_text,
    is_cut,
    is_near,
    possible_counts,
)
from airzoo_bench.tables.printed_scores import Family
from airzoo_bench.tables.printed_values import PrintedValue, Published, grouped

__all__ = ["Share", "check_counts", "judge_shares"]

_CHECK = "counts"
# Of one scene, so that its digits were cut off for certain.
_FEWEST_CUTS = 3
_NONE = "no share of queries, such as R@1, is printed"


@dataclass(frozen=True)
class Share:
    """A printed share of a known number of queries.

    Attributes
    ----------
    places : int
        For each query: 1, or K for mean precision at K.
    is_sure : bool
        Whether the number of queries, and what the share is of, were given.
    """

    cell: PrintedValue
    queries: Queries
    places: int
    is_sure: bool

    @property
    def total(self) -> int:
        """Queries, or places of all queries."""
        return self.queries.number * self.places

    @property
    def fits(self) -> bool:
        """Whether a whole number rounds to it."""
        return bool(possible_counts(self.cell.number, self.total, self.cell.full))

    @property
    def is_cut(self) -> bool:
        """Whether it is a whole number whose further digits were cut off."""
        return is_cut(self.cell.number, self.total, self.cell.full)


def check_counts(published: Published, queries: Mapping[Key, Queries]) -> Outcome:
    """Find shares of queries that are no whole number of queries."""
    averaged = is_average(published)
    hits = [cell for cell in published.cells if cell.score.family is Family.HITS]
    of_scenes = [cell for cell in hits if not averaged(cell)]
    known = [cell for cell in of_scenes if key_of(cell) in queries]
    shares = [Share(c, queries[key_of(c)], 1, queries[key_of(c)].is_given) for c in known]
    findings, conclusions = judge_shares(_CHECK, shares)
    scenes = {key_of(cell) for cell in known}
    number = counted(len(scenes), "scene")
    what = f"shares of queries in {number}, whether each is a whole number of queries"
    unknown = [cell for cell in of_scenes if key_of(cell) not in queries]
    left = _left(len(hits) - len(of_scenes), unknown) if hits else _NONE
    said = tuple(conclusions)
    return Outcome(_CHECK, len(shares), what, left, tuple(findings), said, tuple(known))


def _left(averages: int, unknown: Sequence[PrintedValue]) -> str:
    parts = []
    if averages:
        are = agreeing(averages, "which is", "which are")
        parts.append(f"{counted(averages, 'average')} over scenes, {are} no share of queries")
    if unknown:
        scenes = dict.fromkeys(cell.place for cell in unknown)
        names = ", ".join(list(scenes)[:3]) + (" ..." if len(scenes) > 3 else "")
        parts.append(
            f"{counted(len(unknown), 'share')} in {names}, whose number "
            "of queries is not known and the values do not tell: give it by --counts"
        )
    return "; ".join(parts)


def judge_shares(check: str, shares: Sequence[Share]) -> tuple[list[Finding], list[Conclusion]]:
    """Find shares that are no count, table by table."""
    findings: list[Finding] = []
    conclusions: list[Conclusion] = []
    for table, own in grouped(shares, lambda share: share.cell.table).items():
        wrong = [share for share in own if not share.fits]
        all_cut = bool(wrong) and all(share.is_cut for share in own)
        cut = all_cut or _shows_cuts(wrong, own)
        if cut:
            told = f"so all {len(own)} shares are counts" if all_cut else "as one scene shows"
            text = f"digits are cut off, not rounded: {told}"
            conclusions.append(Conclusion(check, table, text))
        findings.extend(_no_count(check, share, cut=cut) for share in wrong)
    return findings, conclusions


def _shows_cuts(wrong: Sequence[Share], own: Sequence[Share]) -> bool:
    """Whether some scene shows that a table cuts: other concluded numbers of queries are in doubt.

    All shares of that scene are counts whose digits were cut off, and several of them no others.
    """
    if any(share.queries.is_given and not share.is_cut for share in wrong):
        return False
    scenes = Counter(key_of(share.cell) for share in wrong if share.is_cut)
    shown = {scene for scene, number in scenes.items() if number >= _FEWEST_CUTS}
    for share in own:
        if not share.is_cut:
            shown.discard(key_of(share.cell))
    return bool(shown)


def _no_count(check: str, share: Share, *, cut: bool) -> Finding:
    cell, number, total = share.cell, share.cell.number, share.total
    unit = " %" if cell.full == 100 else ""
    exact = decimal_text(number.value * total / cell.full, 2)
    n = share.queries.number
    of, things = (
        (counted(n, "query"), "queries")
        if share.places == 1
        else (f"{share.places} x {n} = {total} places of mean precision", "positives")
    )
    why = (
        f"{number.text}{unit} of {of} is {exact} {things}, no whole number: "
        f"{count_text(number, total, cell.full)}"
    )
    if not share.queries.is_given:
        why += f" (n = {n} is what the other values of the scene imply)"
    near = is_near(number, total, cell.full)
    if near:
        way = "cut off, not rounded" if share.is_cut else "as if rounded up, or twice"
        why += f": off by the last digit, {way}"
    grade = Grade.IMPOSSIBLE if share.is_sure else Grade.INCONSISTENT
    return Finding(Grade.ROUNDING if near or cut else grade, check, cell, why)
