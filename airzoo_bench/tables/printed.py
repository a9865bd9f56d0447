"""Printed numbers as exact intervals, and what the printed names of scores say of them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import StrEnum
from fractions import Fraction
from functools import cached_property

__all__ = ["Family", "Rounded", "Score", "Span", "parse_number", "read_score"]

_NUMBER = re.compile(r"[+-]?[0-9]{1,9}(\.[0-9]{1,9})?")
_MINUS = str.maketrans({"−": "-", "–": "-"})


@dataclass(frozen=True)
class Span:
    """A closed interval of exact numbers."""

    low: Fraction
    high: Fraction

    def meets(self, other: Span) -> bool:
        """Whether a number lies in both."""
        return self.low <= other.high and other.low <= self.high

    def times(self, factor: Fraction) -> Span:
        """Return the interval times a number, which may be negative."""
        ends = (self.low * factor, self.high * factor)
        return Span(min(ends), max(ends))

    def widened(self, by: Fraction) -> Span:
        """Return the interval with so much more at either end."""
        return Span(self.low - by, self.high + by)


@dataclass(frozen=True)
class Rounded:
    """A number as printed, trailing zeros included: its exact value, digits behind the point."""

    text: str
    value: Fraction
    decimals: int

    @property
    def half(self) -> Fraction:
        """Half a step of the last digit."""
        return Fraction(1, 2 * 10**self.decimals)

    @cached_property
    def span(self) -> Span:
        """Where the true number lies; closed, so that halves may have gone up, down or to even."""
        return Span(self.value - self.half, self.value + self.half)


def parse_number(text: str) -> Rounded | None:
    """Read a printed number; None for what is none."""
    plain = text.strip().replace("--", "-").translate(_MINUS)
    if not _NUMBER.fullmatch(plain):
        return None
    return Rounded(plain, Fraction(plain), len(plain.partition(".")[2]))


class Family(StrEnum):
    """Kinds of scores that arithmetic knows something of."""

    HITS = "share of queries"
    AVERAGE_PRECISION = "average precision at K"
    PRECISION = "precision"
    RECALL = "recall"
    F1 = "F1"
    ACCURACY = "accuracy"
    COMPLETENESS = "completeness"
    CHAMFER = "Chamfer distance"
    MEDIAN = "median error"
    ERROR = "error"
    CURVE = "share or area within a threshold"
    OTHER = "other"


_SHARES = (Family.HITS, Family.AVERAGE_PRECISION, Family.PRECISION, Family.RECALL, Family.F1)
_LOWER = (Family.ACCURACY, Family.COMPLETENESS, Family.CHAMFER, Family.MEDIAN, Family.ERROR)

# By the whole name, in lower case, without arrows, with one space for any run of space, - and _.
_NAMES = (
    (r"(m?f ?1?|f1|f ?score|f1 ?score)", Family.F1),
    (r"(p|prec\.?|precision)", Family.PRECISION),
    (r"(r|rec\.?|recall)", Family.RECALL),
    (r"(acc\.?|accuracy|accuracy distance)", Family.ACCURACY),
    (r"(comp\.?|completeness|completeness distance)", Family.COMPLETENESS),
    (r"(accuracy|completeness), median", Family.ERROR),
    (r"(cd|chamfer|chamfer distance)", Family.CHAMFER),
    (r"(.* )?med(ian|\.)?( .*)?", Family.MEDIAN),
    (r"(.* )?(error|distance|ate|rpe|rmse|mae|rre|rte|te|re|mte|mre)(,? .*)?", Family.ERROR),
    (r"(horizontal|vertical|rotation|translation)", Family.ERROR),
)
_VALUE = r"([0-9]{1,9}(?:\.[0-9]{1,9})?)"
_LENGTH = r"(cm|mm|km|m)"
_RANKED = r"(r|rec|recall|hit|hits|hit ?rate)"
_POSE = r"((?:pose |translation |rotation )?(?:r|rec|recall|acc|accuracy|success|sr))?"
_PATTERNS = {
    # Average precision; precision at K is mean precision by its very name.
    "ap": re.compile(r"(ap|p|precision) ?@ ?([1-9][0-9]{0,3})(?:/(min|trec|hits|precision))?"),
    # Of point clouds within a distance; without a unit it may be of the first so many.
    "cloud": re.compile(rf"(f|f1|f ?score|f1 ?score|p|prec|precision) ?[@<] ?{_VALUE} ?{_LENGTH}?"),
    # Areas under, or means of, recalls up to a threshold, and shares of pairs or pixels within one.
    "curve": re.compile(rf"((?:pose )?m?auc|maa|mma|rra|rta|pck) ?@ ?{_VALUE} ?(deg|°|px|m)?"),
    # Shares of queries with a hit among the first K, or within thresholds; a pair needs no name.
    "ranked": re.compile(rf"{_RANKED} ?@ ?([1-9][0-9]{{0,8}})"),
    "within": re.compile(rf"{_POSE} ?(?:@|(?<!.)(?=\(?<?[0-9.]+ ?{_LENGTH} ?[,/]))(.+)"),
    "below": re.compile(r"(d|distance|error) ?<(.+)"),
}
_HIGHER = re.compile(
    r"(ap(?!@)|map|mrr|ndcg|auc[0-9]*|iou|miou|cameras placed|psnr|ssim|sdm|pdm|ma)\b.*"
)
_DISTANCE = re.compile(r"dis ?@ ?[0-9]{1,4}\b.*")
_PARTS = re.compile(r" ?[,/] ?|(?<=[a-z°]) (?=[0-9])")
_PART = re.compile(rf"<? ?{_VALUE} ?(cm|mm|km|m|deg|°|px|%)?")


@dataclass(frozen=True)
class Score:
    """A score, by its printed name.

    Thresholds have a value and a unit, such as 5 m and 1 deg; only scores with one `stem` before
    the ``@`` are ordered by them. `cutoff` and `variant` are of average precision at K.
    `higher_is_better` is None where it is not known.
    """

    name: str
    family: Family
    thresholds: tuple[tuple[Fraction, str], ...] = ()
    stem: str = ""
    cutoff: int = 0
    variant: str | None = None
    higher_is_better: bool | None = True

    @property
    def is_share(self) -> bool:
        """Whether it is a share of something, printed in percent or from 0 to 1."""
        return self.family in _SHARES


def read_score(name: str) -> Score:
    """Understand a score's printed name; unknown names are of the family `OTHER`."""
    plain = " ".join(re.sub(r"[_\-\s↑↓]+", " ", name.casefold()).split())
    matches = {kind: pattern.fullmatch(plain) for kind, pattern in _PATTERNS.items()}
    if re.search(r"[@<]\s*[-\u2212]", name):  # no threshold is below 0
        return Score(name, Family.OTHER, higher_is_better=None)
    if found := matches["ap"]:
        variant = found[3] or (None if found[1] == "ap" else "precision")
        return Score(name, Family.AVERAGE_PRECISION, cutoff=int(found[2]), variant=variant)
    if found := matches["cloud"]:
        family = Family.F1 if found[1].startswith("f") else Family.PRECISION
        return Score(name, family, _thresholds(found[2] + (found[3] or "")))
    if found := matches["curve"]:
        return Score(name, Family.CURVE, _thresholds(found[2] + (found[3] or "")), found[1])
    if found := matches["ranked"]:
        return Score(name, Family.HITS, _thresholds(found[2]), found[1])
    if found := matches["within"] or matches["below"]:
        thresholds = _thresholds(found[found.lastindex or 0])
        if thresholds and all(value for value, _ in thresholds):
            return Score(name, Family.HITS, thresholds, found[1] or "")
    for pattern, family in _NAMES:
        if re.fullmatch(pattern, plain):
            return Score(name, family, higher_is_better=family not in _LOWER)
    better = True if _HIGHER.fullmatch(plain) else False if _DISTANCE.fullmatch(plain) else None
    return Score(name, Family.OTHER, higher_is_better=better)


def _thresholds(text: str) -> tuple[tuple[Fraction, str], ...]:
    """Read thresholds such as ``5m, 1°``; none where some part is no number with its unit."""
    parts = [_PART.fullmatch(part.strip()) for part in _PARTS.split(text.strip("() "))]
    known = [(Fraction(p[1]), (p[2] or "").replace("°", "deg")) for p in parts if p]
    return tuple(known) if len(known) == len(parts) else ()
