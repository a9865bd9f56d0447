"""Printed values as exact intervals, and their scores, known by the printed names."""

from __future__ import annotations

import re
from dataclasses import dataclass, fields, replace
from decimal import ROUND_HALF_UP, Decimal, localcontext
from enum import StrEnum
from fractions import Fraction
from functools import cache

from airzoo_bench.core.errors import ResultError, first_of
from airzoo_bench.tables.published import PrintedValue, Published


class Family(StrEnum):
    """Kinds of scores that arithmetic knows something of."""

    HITS = "share of queries"
    AVERAGE_PRECISION = "average precision at K"
    PRECISION = "precision"
    RECALL = "recall"
    F1 = "F1"
    DISTANCE = "distance"
    MEDIAN = "median error"
    ERROR = "error"
    CURVE = "share or area within a threshold"
    OTHER = "other"


_SHARES = (Family.HITS, Family.AVERAGE_PRECISION, Family.PRECISION, Family.RECALL, Family.F1)
LOWER = (Family.DISTANCE, Family.MEDIAN, Family.ERROR)

# By the whole name, in lower case, without arrows, with one space for any run of space, - and _.
_NAMES = (
    (r"m?f ?1?|f ?1? ?score", Family.F1),
    (r"p|prec\.?|precision", Family.PRECISION),
    (r"r|rec\.?|recall", Family.RECALL),
    (r"(acc|comp)\.?|(accuracy|completeness)( distance)?", Family.DISTANCE),
    (r"(accuracy|completeness), median", Family.ERROR),
    (r"cd|chamfer( distance)?", Family.ERROR),
    (r"(.* )?med(ian|\.)?( .*)?", Family.MEDIAN),
    (r"(.* )?(error|distance|ate|rpe|rmse|mae|rre|rte|te|re|mte|mre)(,? .*)?", Family.ERROR),
    (r"horizontal|vertical|rotation|translation", Family.ERROR),
)
_VALUE, _LENGTH = r"([0-9]{1,9}(?:\.[0-9]{1,9})?)", r"(cm|mm|km|m)"
_RANKED = r"(r|rec|recall|hit|hits|hit ?rate)"
_POSE = r"((?:pose |translation |rotation )?(?:r|rec|recall|acc|accuracy|success|sr))?"
_PATTERNS = {
    # Average precision; precision at K is mean precision by its very name.
    "ap": re.compile(r"(ap|p|precision) ?@ ?([1-9][0-9]{0,3})(?:/(min|trec|hits|precision))?"),
    # Of point clouds within a distance; without a unit it may be of the first so many.
    "cloud": re.compile(
        rf"(f|f1|f ?score|f1 ?score|p|prec|precision) ?[@<] ?({_VALUE} ?{_LENGTH}?)"
    ),
    # Areas under, or means of, recalls up to a threshold, and shares of pairs or pixels within one.
    "curve": re.compile(rf"((?:pose )?m?auc|maa|mma|rra|rta|pck) ?@ ?({_VALUE} ?(?:deg|°|px|m)?)"),
    # Shares of queries with a hit among the first K, or within thresholds; a pair needs no name.
    "ranked": re.compile(rf"{_RANKED} ?@ ?([1-9][0-9]{{0,8}})"),
    "within": re.compile(rf"{_POSE} ?(?:@|(?<!.)(?=\(?<?[0-9.]+ ?{_LENGTH} ?[,/]))(?P<limits>.+)"),
    "below": re.compile(r"(d|distance|error) ?<(?P<limits>.+)"),
}
_HIGHER = re.compile(
    r"(ap(?!@)|map|mrr|ndcg|auc[0-9]*|iou|miou|cameras placed|psnr|ssim|sdm|pdm|ma)\b.*"
)
_DISTANCE = re.compile(r"dis ?@ ?[0-9]{1,4}\b.*")
_PARTS = re.compile(r" ?[,/] ?|(?<=[a-z°]) (?=[0-9])")
_PART = re.compile(rf"<? ?{_VALUE} ?(cm|mm|km|m|deg|°|px|%)?")
_FULL = {"": 100, "%": 100, "percent": 100, "share": 1, "1": 1}
_LENGTHS = ("mm", "cm", "m", "km")


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


@cache
def read_score(name: str) -> Score:
    """Understand a score's printed name; the family of unknown names is `OTHER`."""
    plain = " ".join(re.sub(r"[_\-\s↑↓]+", " ", name.casefold()).split())
    matches = {kind: pattern.fullmatch(plain) for kind, pattern in _PATTERNS.items()}
    if re.search(r"[@<]\s*[-\u2212]", name):  # no threshold is below 0
        return Score(name, Family.OTHER, higher_is_better=None)
    if found := matches["ap"]:
        variant = found[3] or (None if found[1] == "ap" else "precision")
        return Score(name, Family.AVERAGE_PRECISION, cutoff=int(found[2]), variant=variant)
    if found := matches["cloud"]:
        family = Family.F1 if found[1].startswith("f") else Family.PRECISION
        return Score(name, family, _thresholds(found[2]))
    if found := matches["curve"] or matches["ranked"]:
        family = Family.CURVE if matches["curve"] else Family.HITS
        return Score(name, family, _thresholds(found[2]), found[1])
    if found := matches["within"] or matches["below"]:
        thresholds = _thresholds(found["limits"])
        if thresholds and all(value for value, _ in thresholds):
            return Score(name, Family.HITS, thresholds, found[1] or "")
    for pattern, family in _NAMES:
        if re.fullmatch(pattern, plain):
            return Score(name, family, higher_is_better=family not in LOWER)
    better = True if _HIGHER.fullmatch(plain) else False if _DISTANCE.fullmatch(plain) else None
    return Score(name, Family.OTHER, higher_is_better=better)


def _thresholds(text: str) -> tuple[tuple[Fraction, str], ...]:
    """Read thresholds such as ``5m, 1°``; none where some part is no number with its unit."""
    parts = [_PART.fullmatch(part.strip()) for part in _PARTS.split(text.strip("() "))]
    known = [(Fraction(p[1]), (p[2] or "").replace("°", "deg")) for p in parts if p]
    return tuple(known) if len(known) == len(parts) else ()


@dataclass(frozen=True)
class Span:
    """A closed interval of exact numbers."""

    low: Fraction
    high: Fraction

    def meets(self, other: Span) -> bool:
        """Whether a number lies in both."""
        return self.low <= other.high and other.low <= self.high

    def widened(self, by: Fraction) -> Span:
        """Return the interval with so much more at either end."""
        return Span(self.low - by, self.high + by)


@dataclass(frozen=True, eq=False)
class Value(PrintedValue):
    """A printed number with its score; a share of all is printed as `full`, 100 or 1."""

    score: Score
    full: int

    @property
    def is_pooled(self) -> bool:
        """Whether it says of itself that it is over all queries, whatever their scene."""
        return self.scene.casefold() == "pooled"

    @property
    def span(self) -> Span:
        """Where the true number lies; closed, so that halves may have gone up, down or to even."""
        return Span(self.number.value, self.number.value).widened(self.number.half)

    @property
    def share(self) -> Span:
        """Where the true number lies, as a share from 0 to 1."""
        return Span(self.span.low / self.full, self.span.high / self.full)


def read_values(published: Published) -> list[Value]:
    """Know the score of each printed number; refuse a unit that leaves open what it is."""
    values = []
    for cell in published.cells:
        score, unit = read_score(cell.metric), cell.unit.casefold()
        if score.is_share and unit not in _FULL:
            raise ResultError(
                f"unit is {cell.unit[:80]!r}",
                where=f"{published.path}, line {cell.line}, column 'unit'",
                expected="% or share",
            )
        known = {field.name: getattr(cell, field.name) for field in fields(cell)}
        values.append(Value(**known, score=score, full=_FULL[unit] if score.is_share else 1))
    shares = [value for value in values if value.score.is_share and not value.unit]
    # Nothing at all is 0 by either.
    printed = [value.number.value for value in shares if value.number.value]
    if printed and all(0 < value <= 1 for value in printed):
        names = first_of(dict.fromkeys(value.metric for value in shares))
        raise ResultError(
            f"all shares are at most 1: percent, or from 0 to 1? {names}",
            where=published.path,
            expected="a column 'unit' that says % or share",
        )
    return _settled(values)


def _settled(values: list[Value]) -> list[Value]:
    """Decide by the whole file whether recall means clouds, and accuracy a distance."""

    def place(value: Value, score: Score) -> tuple[object, ...]:
        return value.table, *value.group, score.thresholds

    clouds = [v for v in values if v.score.family in (Family.F1, Family.PRECISION)]
    of_clouds = {place(value, value.score) for value in clouds if value.score.thresholds}
    settled = []
    for value in values:
        score, cloud = value.score, _cloud_score(value.score)
        if cloud and place(value, cloud) in of_clouds:
            score = cloud
        elif score.family is Family.DISTANCE and value.unit not in _LENGTHS:
            # In percent more is better; without a unit it may be anything.
            better = True if value.unit.casefold() in ("%", "percent") else None
            score = replace(score, family=Family.OTHER, higher_is_better=better)
        settled.append(replace(value, score=score))
    return settled


def _cloud_score(score: Score) -> Score | None:
    """Return recall or precision at K as a point cloud's within K; None for other scores."""
    if score.family is Family.AVERAGE_PRECISION and score.variant == "precision":
        return Score(score.name, Family.PRECISION, ((Fraction(score.cutoff), ""),))
    recall = Score(score.name, Family.RECALL, score.thresholds)
    return recall if score.family is Family.HITS else None


def decimal_text(number: Fraction, decimals: int) -> str:
    """Write an exact number with `decimals` decimals, halves away from zero."""
    half = Decimal(1).scaleb(-decimals)
    with localcontext(prec=60):
        exact = Decimal(number.numerator) / Decimal(number.denominator)
        return f"{exact.quantize(half, ROUND_HALF_UP):zf}"
