"""Shares as counts: of how many queries each scene is, and which shares are no whole number."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtrc

from airzoo_bench.audit.findings import Finding, Grade, Outcome
from airzoo_bench.audit.values import Family, Span, Value, decimal_text
from airzoo_bench.core.errors import ResultError, UsageError, counted, first_of
from airzoo_bench.core.validation import nearest
from airzoo_bench.tables.published import Rounded, grouped

Key = tuple[str, str, str]
"""What has one number of queries (benchmark, track and scene), or one definition of a score."""

_SURE = 0.99  # so sure must a number of queries be that was not given
_LARGEST = 100_000  # from 10^(decimals + 2) on every percentage is a count
# How often a printed share is no count at all. That rare, a misprint does not speak for half a
# total only because the other counts happen to be even.
_MISPRINT = 1e-3
_RARE = 1e-4  # so rarely may so many values be whole numbers by chance
_MOST_MISFITS = 0.1
_FEWEST = 3  # from so many values on one may be a misprint


class Queries(NamedTuple):
    """How many queries a scene has, given by the user or the file, or else concluded."""

    number: int
    is_given: bool


def key_of(value: Value) -> Key:
    """Return what has one number of queries."""
    return *value.group, value.scene


def score_of(value: Value) -> Key:
    """Return what has one definition."""
    return *value.group, value.metric


def parse_counts(texts: Iterable[str]) -> dict[str, int]:
    """Read ``scene=n,...`` texts."""
    counts: dict[str, int] = {}
    for part in (part.strip() for text in texts for part in text.split(",")):
        match = re.fullmatch(r"(.*\S)\s*=\s*0*([1-9][0-9]{0,8})", part)
        if not match or match[1] in counts:
            raise UsageError(
                f"{part[:80]!r} is no scene and number of queries, or a scene is there twice",
                where="--counts",
                expected="such as 'City=161,Rural=190', or 'AirZoo-Real/City=161' where several "
                "benchmarks have a scene of that name",
            )
        counts[match[1]] = int(match[2])
    return counts


def shares_of_scenes(values: Sequence[Value], *families: Family) -> list[Value]:
    """Return shares of some kinds, without averages over scenes that are printed as well."""
    shares = [value for value in values if value.score.family in families]
    with_scenes = {(value.group, value.metric) for value in shares if not value.is_summary}
    return [v for v in shares if not (v.is_summary and (v.group, v.metric) in with_scenes)]


def resolve_queries(
    values: Sequence[Value],
    counts: Mapping[str, int],
    doubtful: Collection[tuple[str, ...]],
    precise: Collection[Key] = (),
) -> tuple[dict[Key, Queries], list[str]]:
    """Return the known number of queries of each scene, and how the printed shares agree with it.

    Nothing is concluded from rows that are doubtful; `precise` are scores of mean precision.
    """
    groups = grouped(values, key_of)
    known = {scene for _, _, scene in groups} | {f"{b}/{scene}" for b, _, scene in groups if b}
    for name in counts:
        if name not in known:
            raise UsageError(
                f"no scene {name!r}{nearest(name, sorted(known))}",
                where="--counts",
                expected=first_of(sorted(known), shown=20),
            )
    shares = shares_of_scenes(values, Family.HITS, Family.AVERAGE_PRECISION)
    counted_ones = [v for v in shares if v.score.family is Family.HITS or score_of(v) in precise]
    of_scenes = grouped(counted_ones, key_of)
    queries: dict[Key, Queries] = {}
    conclusions: list[str] = []
    for key, cells in groups.items():
        given = _stated_count(cells, counts)
        own = [cell for cell in of_scenes.get(key, ()) if cell.row not in doubtful]
        implied, text = _implied_count(own)
        if given is not None:
            queries[key] = Queries(given, is_given=True)
            text += f"; given is {given}" if text and given != implied else ""
        elif implied:
            queries[key] = Queries(implied, is_given=False)
        conclusions += [f"counts of {', '.join(filter(None, key))}: {text}"] if text else []
    return queries, conclusions


def _stated_count(cells: Sequence[Value], counts: Mapping[str, int]) -> int | None:
    first = cells[0]
    stated = {cell.queries: f"line {cell.line}" for cell in cells if cell.queries is not None}
    # The name with its benchmark is the more exact one.
    names = [n for n in (f"{first.benchmark}/{first.scene}", first.scene) if n in counts]
    stated |= {counts[name]: "--counts" for name in names[:1]}
    if len(stated) > 1:
        shown = ", ".join(f"{n} ({where})" for n, where in stated.items())
        raise ResultError(
            f"different numbers of queries for {first.place}: {shown}",
            expected="one number a scene",
        )
    return next(iter(stated), None)


def _implied_count(shares: Sequence[Value]) -> tuple[int, str]:
    """Weigh all totals by Bayes' rule: out of how many queries several printed shares are counts.

    A value that fits is one of as many as there are counts, one that does not is a misprint, and
    larger totals are less likely beforehand, in proportion. Either all values were rounded, or the
    digits of all were cut off. Returns the total, or 0 where it is not sure, and a sentence.
    """
    printed = {
        (int(one.number.value * scale), one.full * scale, one.score.cutoff or 1)
        for one in shares
        for scale in [10**one.number.decimals]
        if 0 < one.number.value < one.full
    }
    if not printed:
        return 0, ""
    totals = np.arange(1, min(_LARGEST, max(full for _, full, _ in printed)) + 1, dtype=np.int64)
    surprises = {
        kind: -np.log(_chance(totals * kind[1], kind[0])) for kind in {one[1:] for one in printed}
    }
    fits, merit = np.zeros((2, len(totals)), np.int64), np.tile(-np.log(totals), (2, 1))
    for value, full, places in printed:
        counted_of = totals * places
        # In half digits, from where to where counts are printed so: 2 x 10^11 x 10^7 at most.
        for row, (low, high) in enumerate([(-1, 1), (0, 2)]):
            lowest = -((-(2 * value + low) * counted_of) // (2 * full))
            fit = lowest * 2 * full <= (2 * value + high) * counted_of - row  # cut ones are below
            fits[row] += fit
            merit[row] += np.where(fit, surprises[full, places], math.log(_MISPRINT))
    row, best = (int(place) for place in np.unravel_index(np.argmax(merit), merit.shape))
    top = float(merit[row, best])
    rivals = float(np.exp(merit - top).max(axis=0).sum()) + math.exp(-max(top, -700.0))
    text = f"n = {totals[best]} fits {fits[row, best]} of {len(printed)} different values"
    text += ", with digits cut off" * row
    return (int(totals[best]), text) if 1 / rivals >= _SURE else (0, "")


def _chance(totals: NDArray[np.int64], full: int) -> NDArray[np.float64]:
    """Return the share of all printed values that are counts of each total."""
    halves = np.gcd(totals, 2 * full) - np.gcd(totals, full)
    return np.asarray(np.minimum(1.0, (totals + halves) / full))


@dataclass(frozen=True)
class _Share:
    """A printed share of a known number of queries, or of K places of each of them."""

    cell: Value
    queries: Queries
    places: int = 1

    @property
    def total(self) -> int:
        return self.queries.number * self.places

    @property
    def exact(self) -> Fraction:
        """How many the printed digits are."""
        return self.cell.number.value * self.total / self.cell.full

    @property
    def near(self) -> list[int]:
        """The whole numbers next to it."""
        ends = (math.floor(self.exact), math.ceil(self.exact))
        return sorted({min(max(count, 0), self.total) for count in ends})

    @property
    def off(self) -> Fraction:
        """How far the next whole number is, in last digits."""
        digit = 2 * self.cell.number.half * self.total / self.cell.full
        return min(abs(count - self.exact) for count in self.near) / digit


def check_counts(
    values: Sequence[Value], queries: Mapping[Key, Queries], conclusions: Sequence[str]
) -> Outcome:
    """Find shares of queries that are no whole number of queries."""
    hits = shares_of_scenes(values, Family.HITS)
    known = [_Share(cell, queries[key_of(cell)]) for cell in hits if key_of(cell) in queries]
    unknown = [cell for cell in hits if key_of(cell) not in queries]
    left = "" if hits else "no share of queries, such as R@1, is printed"
    if unknown:
        scenes = first_of(dict.fromkeys(cell.place for cell in unknown))
        left = (
            f"{counted(len(unknown), 'share')} in {scenes}, whose number of queries is not known "
        )
        left += "and the values do not tell: give it by --counts"
    what = f"shares of queries in {counted(len({key_of(one.cell) for one in known}), 'scene')}"
    return _outcome("counts", f"{what}, whether each is a whole number", left, known, conclusions)


def _outcome(
    check: str, what: str, left: str, shares: Sequence[_Share], conclusions: Sequence[str]
) -> Outcome:
    found = tuple(_no_count(check, one) for one in shares if one.off > Fraction(1, 2))
    cells = tuple(share.cell for share in shares)
    return Outcome(check, len(shares), what, left, found, tuple(conclusions), cells)


def define_precision(
    values: Sequence[Value], queries: Mapping[Key, Queries], doubtful: Collection[tuple[str, ...]]
) -> tuple[set[Key], Outcome]:
    """Tell which average precisions are mean precision, and find those that are no whole number.

    Mean precision at K is a whole number of positives out of K for each query. A score is that by
    its name, or where more values are whole numbers than would be by chance.
    """
    precise: set[Key] = set()
    shares: list[_Share] = []
    conclusions, left = [], 0
    precisions = [v for v in values if v.score.family is Family.AVERAGE_PRECISION]
    for name, cells in grouped(precisions, score_of).items():
        own = [
            _Share(cell, queries[key_of(cell)], cell.score.cutoff)
            for cell in cells
            if key_of(cell) in queries and not cell.is_summary
        ]
        variant, text = cells[0].score.variant, "it cannot be told which"
        if variant == "precision" or (variant is None and _is_precision(own, doubtful)):
            precise.add(name)
            shares += own
            fits = sum(share.off <= Fraction(1, 2) for share in own)
            text = f"mean precision, {'as named' if variant else 'concluded'}: "
            text += f"{fits} of {len(own)} values in scenes are whole numbers of positives"
        else:
            left += sum(not cell.is_summary for cell in cells)
            text = f"that of {variant}" if variant else text
        conclusions.append(f"AP of {', '.join(filter(None, name))}: the definition is {text}")
    none = "" if shares else "no average precision such as AP@5 of a scene with known queries"
    left_out = f"{left} that are not known to be mean precision" if left else none
    what = "mean precisions, whether each is a whole number of positives"
    return precise, _outcome("AP counts", what, left_out, shares, conclusions)


def _is_precision(shares: Sequence[_Share], doubtful: Collection[tuple[str, ...]]) -> bool:
    """Whether more values are whole numbers of positives than by chance."""
    own = [share for share in shares if share.cell.row not in doubtful]
    misfits = sum(share.off > Fraction(1, 2) for share in own)
    # One misprint of several values must not hide what all others are.
    if misfits > max(len(own) >= _FEWEST, int(len(own) * _MOST_MISFITS)):
        return False
    chances = []
    for share in own:
        number = share.cell.number
        chance = _chance(np.array(share.total), share.cell.full * 10**number.decimals)
        chances.append(float(chance) if number.value else 1.0)
    fits = len(own) - misfits
    return bool(fits and bdtrc(fits - 1, len(own), sum(chances) / len(own)) < _RARE)


def _no_count(check: str, share: _Share) -> Finding:
    cell, total, n = share.cell, share.total, share.queries.number
    unit = " %" if cell.full == 100 else ""
    of, things = counted(n, "query"), "queries"
    if share.places > 1:
        of, things = f"{share.places} x {n} = {total} places of mean precision", "positives"
    digits = cell.number.decimals
    near = ", ".join(
        f"{count}/{total} = {decimal_text(Fraction(count * cell.full, total), digits)}"
        for count in share.near
    )
    exact = decimal_text(share.exact, 2)
    why = f"{cell.number.text}{unit} of {of} is {exact} {things}, no whole number: {near}"
    # A definition that nobody has stated is as much in doubt as a number of queries.
    is_sure = share.queries.is_given and (share.places == 1 or bool(cell.score.variant))
    if not share.queries.is_given:
        why += f" (n = {n} is what the other values of the scene imply)"
    if share.off < 1:
        return Finding(Grade.ROUNDING, check, cell, why + ": off by the last digit")
    return Finding(Grade.IMPOSSIBLE if is_sure else Grade.INCONSISTENT, check, cell, why)


def counted_share(number: Rounded, total: int, full: int) -> Span:
    """Return where the true share lies in printed units, narrowed to counts where any fits."""
    low, high = ((number.value + sign * number.half) * Fraction(total, full) for sign in (-1, 1))
    counts = range(max(0, math.ceil(low)), min(total, math.floor(high)) + 1)
    if not counts:
        return Span(number.value, number.value).widened(number.half)
    return Span(Fraction(counts[0] * full, total), Fraction(counts[-1] * full, total))
