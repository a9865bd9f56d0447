"""What a score's printed name says of it: its family, its thresholds, which way is better."""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import StrEnum
from fractions import Fraction

__all__ = [
    "Family",
    "Score",
    "at_most",
    "read_score",
    "recall_of_cloud",
]

Threshold = tuple[Fraction, str]


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


_SHARES = (
    Family.HITS,
    Family.AVERAGE_PRECISION,
    Family.PRECISION,
    Family.RECALL,
    Family.F1,
)
_LOWER = (Family.ACCURACY, Family.COMPLETENESS, Family.CHAMFER, Family.MEDIAN, Family.ERROR)

# What is within a distance is within a larger one.
_GROWING = (Family.HITS, Family.PRECISION, Family.RECALL, Family.F1, Family.CURVE)

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
_HITS = re.compile(
    r"((?:pose |translation |rotation )?"
    r"(?:r|rec|recall|acc|accuracy|success|sr|hit|hits|hit ?rate))? ?@ ?(.+)"
)
_BELOW = re.compile(r"(d|distance|error) ?< ?([0-9].*)")
_NEGATIVE = re.compile(r"[@<]\s*[-\u2212]")
# Shares of queries with a hit among the first K, where no unit makes K a distance.
_RANKED = ("r", "rec", "recall", "hit", "hits", "hit rate", "hitrate")
# Of point clouds: within a distance; without a unit it may be of the first so many.
_CLOUD = re.compile(
    r"(f|f1|f ?score|f1 ?score|p|prec|precision) ?[@<] ?"
    r"([0-9]{1,9}(?:\.[0-9]{1,9})?) ?(cm|mm|km|m)?"
)
_AP = re.compile(r"(ap|p|precision) ?@ ?([0-9]{1,4})(?:/(min|trec|hits|precision))?")
# Thresholds of a distance and an angle, each with its unit, are a share's without any name.
_BARE = re.compile(
    r"\(? ?(<? ?[0-9]{1,9}(?:\.[0-9]{1,9})? ?(?:cm|mm|km|m) ?[,/] ?"
    r"<? ?[0-9]{1,9}(?:\.[0-9]{1,9})? ?(?:deg|°)) ?\)?"
)
# Areas under, or means of, recalls up to a threshold, and shares of pairs or pixels within one.
_CURVE = re.compile(
    r"((?:pose )?m?auc|maa|mma|rra|rta|pck) ?@ ?([0-9]{1,9}(?:\.[0-9]{1,9})?) ?(deg|°|px|m)?"
)
_HIGHER = re.compile(
    r"(ap(?!@)|map|mrr|ndcg|auc[0-9]*|iou|miou|cameras placed|psnr|ssim|sdm|pdm|ma)\b.*"
)
_DISTANCE = re.compile(r"dis ?@ ?[0-9]{1,4}\b.*")
_PARTS = re.compile(r" ?[,/] ?|(?<=[a-z°]) (?=[0-9])")
_PART = re.compile(r"<?([0-9]{1,9}(?:\.[0-9]{1,9})?) ?(cm|mm|km|m|deg|°|px|%)?")


@dataclass(frozen=True)
class Score:
    """A score, by its printed name.

    Attributes
    ----------
    name : str
        As printed.
    thresholds : tuple of (Fraction, str)
        Of a share of queries, such as 3, or 5 m and 1 deg: value and unit.
    stem : str
        What stands before the ``@``: only scores of one stem are ordered by their thresholds.
    cutoff : int
        K of average precision at K; 0 otherwise.
    variant : str or None
        Which average precision, where the name says so.
    higher_is_better : bool or None
        None where it is not known.
    """

    name: str
    family: Family
    thresholds: tuple[Threshold, ...] = ()
    stem: str = ""
    cutoff: int = 0
    variant: str | None = None
    higher_is_better: bool | None = None

    @property
    def is_share(self) -> bool:
        """Whether it is a share of something, printed in percent or from 0 to 1."""
        return self.family in _SHARES


def read_score(name: str) -> Score:
    """Understand a score's printed name; what is not understood is of the family `OTHER`."""
    plain = " ".join(re.sub(r"[_\-\s↑↓]+", " ", name.casefold()).split())
    score = (
        _average_precision(name, plain)
        or _of_cloud(name, plain)
        or _curve(name, plain)
        or _hits(name, plain)
        or _named(name, plain)
    )
    cannot_be = (
        _NEGATIVE.search(name)
        or any(not value for value, _ in score.thresholds)
        or (score.stem in _RANKED and _is_no_rank(score.thresholds))
    )
    return Score(name, Family.OTHER) if cannot_be else score


def _is_no_rank(thresholds: tuple[Threshold, ...]) -> bool:
    """Whether K of recall at K is no whole number, as in R@5.5."""
    return len(thresholds) == 1 and not thresholds[0][1] and thresholds[0][0].denominator > 1


def _of_cloud(name: str, plain: str) -> Score | None:
    found = _CLOUD.fullmatch(plain)
    if not found:
        return None
    family = Family.F1 if found[1].startswith("f") else Family.PRECISION
    return Score(name, family, ((Fraction(found[2]), found[3] or ""),), higher_is_better=True)


def _curve(name: str, plain: str) -> Score | None:
    found = _CURVE.fullmatch(plain)
    if not found:
        return None
    thresholds = ((Fraction(found[2]), (found[3] or "").replace("°", "deg")),)
    return Score(name, Family.CURVE, thresholds, found[1], higher_is_better=True)


def recall_of_cloud(score: Score) -> Score | None:
    """Return recall or precision at K as that of a point cloud within K; None for other scores."""
    if score.family is Family.AVERAGE_PRECISION and score.variant == "precision":
        threshold = ((Fraction(score.cutoff), ""),)
        return Score(score.name, Family.PRECISION, threshold, higher_is_better=True)
    if score.family is Family.HITS:
        return Score(score.name, Family.RECALL, score.thresholds, higher_is_better=True)
    return None


def _average_precision(name: str, plain: str) -> Score | None:
    found = _AP.fullmatch(plain)
    if not found or not int(found[2]):
        return None
    # Precision at K is mean precision by its very name.
    variant = found[3] or (None if found[1] == "ap" else "precision")
    family = Family.AVERAGE_PRECISION
    return Score(name, family, cutoff=int(found[2]), variant=variant, higher_is_better=True)


def _hits(name: str, plain: str) -> Score | None:
    found = _HITS.fullmatch(plain) or _BELOW.fullmatch(plain)
    bare = _BARE.fullmatch(plain)
    if not (found or bare):
        return None
    inside = bare[1] if bare else found[2] if found else ""
    parts = [_PART.fullmatch(part.strip()) for part in _PARTS.split(inside.strip("() "))]
    thresholds = [(Fraction(p[1]), (p[2] or "").replace("°", "deg")) for p in parts if p]
    if len(thresholds) < len(parts):
        return None
    stem = (found[1] or "") if found else ""
    return Score(name, Family.HITS, tuple(thresholds), stem, higher_is_better=True)


def _named(name: str, plain: str) -> Score:
    for pattern, family in _NAMES:
        if re.fullmatch(pattern, plain):
            return Score(name, family, higher_is_better=family not in _LOWER)
    better = True if _HIGHER.fullmatch(plain) else False if _DISTANCE.fullmatch(plain) else None
    return Score(name, Family.OTHER, higher_is_better=better)


def at_most(first: Score, second: Score) -> bool:
    """Whether all that counts for the first score counts for the second, by their thresholds."""
    comparable = (
        first.family is second.family
        and first.family in _GROWING
        and first.stem == second.stem
        and [unit for _, unit in first.thresholds] == [unit for _, unit in second.thresholds]
    )
    if not comparable or first.thresholds == second.thresholds:
        return False
    pairs = zip(first.thresholds, second.thresholds, strict=True)
    return all(one[0] <= two[0] for one, two in pairs)
