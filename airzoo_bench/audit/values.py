"""Printed values as exact intervals, their scores by the printed names, and findings on them."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from decimal import ROUND_HALF_UP, Decimal, localcontext
from enum import StrEnum
from fractions import Fraction
from functools import cache
from typing import NamedTuple, TypeVar

from airzoo_bench.tables.published import PrintedValue

S = TypeVar("S")
T = TypeVar("T")

Key = tuple[str, str, str]
"""What has one number of queries (benchmark, track and scene), or one definition of a score."""

_N, _L = r"[0-9]{1,9}(?:\.[0-9]{1,9})?", r"(?:cm|mm|km|m)"
_RATE = r"(?:pose |translation |rotation )?(?:r|rec|recall|acc|accuracy|success|sr)"
# By the whole name, in lower case, without arrows, with one space for any run of space, - and _:
# shares of queries, average precisions at K (precision at K is mean precision by its very name),
# shares of points, all else; whether more is better.
_NAMES: tuple[tuple[str, bool, str], ...] = (
    ("ap", True, r"(?P<stem>ap|p|precision) ?@ ?(?P<limits>[1-9][0-9]{0,3})(/(?P<variant>\w+))?"),
    ("cloud", True, rf"(?P<stem>f1?( ?score)?|p|prec|precision) ?[@<] ?(?P<limits>{_N} ?{_L}?)"),
    ("other", True, rf"(?P<stem>(pose )?m?auc|maa|mma|rra|rta|pck) ?@ ?(?P<limits>{_N}.*)"),
    ("hits", True, r"(?P<stem>r|rec|recall|hits?|hit ?rate) ?@ ?(?P<limits>[1-9][0-9]{0,8})"),
    ("hits", True, rf"(?P<stem>{_RATE})? ?@(?P<limits>.+)"),
    ("hits", True, rf"(?P<limits>\(?<?{_N} ?{_L} ?[,/].+)"),
    ("hits", True, r"(?P<stem>d|distance|error) ?<(?P<limits>.+)"),
    ("cloud", True, r"m?f ?1?|f ?1? ?score|p|prec\.?|precision|r|rec\.?|recall"),
    ("other", False, r"cd|chamfer( distance)?|(.* )?med(ian|\.)?( .*)?"),
    ("other", False, r"(.* )?(error|distance|ate|rpe|rmse|mae|rre|rte|te|re|mte|mre)(,? .*)?"),
    ("other", False, r"horizontal|vertical|rotation|translation|dis ?@ ?[0-9]{1,4}\b.*"),
    ("other", True, r"(ap(?!@)|map|mrr|ndcg|auc[0-9]*|m?iou|psnr|ssim|sdm|pdm|ma)\b.*"),
)
_PARTS = re.compile(r" ?[,/] ?|(?<=[a-z°]) (?=[0-9])")
_PART = re.compile(rf"<? ?({_N}) ?({_L}|deg|°|px|%)?")


class Score(NamedTuple):
    """A score, by its printed name.

    Thresholds have a value and a unit, such as 5 m and 1 deg; only scores with one `stem` before
    the ``@`` are ordered by them. A variant names the definition of an average precision. `better`
    says whether more is better, None where that is not known.
    """

    kind: str = "other"
    better: bool | None = None
    thresholds: tuple[tuple[Fraction, str], ...] = ()
    stem: str = ""
    variant: str = ""

    @property
    def places(self) -> int:
        """How many places of each query a whole number of positives is out of."""
        return int(self.thresholds[0][0]) if self.kind == "ap" else 1


@cache
def read_score(name: str) -> Score:
    """Understand a score's printed name."""
    plain = " ".join(re.sub(r"[_\-\s↑↓]+", " ", name.casefold()).split())
    for kind, better, pattern in _NAMES:
        if (found := re.fullmatch(pattern, plain)) is None:
            continue
        parts = found.groupdict()
        stem, variant = parts.get("stem") or "", parts.get("variant") or ""
        thresholds = _thresholds(parts["limits"]) if parts.get("limits") else ()
        if parts.get("limits") and (not thresholds or not all(value for value, _ in thresholds)):
            continue
        if kind == "ap" and stem != "ap":
            variant = variant or "precision"
        return Score(kind, better, thresholds, stem, variant)
    return Score()


def _thresholds(text: str) -> tuple[tuple[Fraction, str], ...]:
    """Read thresholds such as ``5m, 1°``; none where some part is no number with its unit."""
    parts = [_PART.fullmatch(part.strip()) for part in _PARTS.split(text.strip("() "))]
    known = [(Fraction(p[1]), (p[2] or "").replace("°", "deg")) for p in parts if p]
    return tuple(known) if len(known) == len(parts) else ()


class Span(NamedTuple):
    """A closed interval of exact numbers."""

    low: Fraction
    high: Fraction

    def meets(self, other: Span) -> bool:
        """Whether a number lies in both."""
        return self.low <= other.high and other.low <= self.high

    def widen(self, by: Fraction) -> Span:
        """Return the interval with so much more at either end."""
        return Span(self.low - by, self.high + by)


@dataclass(frozen=True, eq=False)
class Value:
    """A printed number, exact, with its score; a share of all is printed as `full`, 100 or 1.

    `half` is half a step of its last digit. Keys are those of its row, of its column, of what has
    one number of queries (`scene_key`) and of what has one definition (`score_key`).
    """

    cell: PrintedValue
    score: Score
    full: int
    number: Fraction
    decimals: int
    half: Fraction
    row: tuple[str, ...]
    column: tuple[str, ...]
    scene_key: Key
    score_key: Key

    @property
    def span(self) -> Span:
        """Where the true number lies; closed, so that halves may have gone up, down or to even."""
        return Span(self.number, self.number).widen(self.half)


def count_decimals(number: Decimal) -> int:
    """Return how many digits are printed behind the point."""
    return -int(number.as_tuple().exponent)


def read_values(cells: Sequence[PrintedValue]) -> list[Value]:
    """Know the score of each printed number, and whether shares are percent.

    They are from 0 to 1 where the unit says so, or where none is printed and all are at most 1.
    """
    scored = [(cell, read_score(cell.metric)) for cell in cells]
    shares = [cell for cell, score in scored if score.kind != "other"]
    small = all(cell.value <= 1 for cell in shares) and not any(cell.unit for cell in shares)
    # What has an F1 or precision at the same threshold is of points, not of queries.
    clouds = {
        (cell.table, cell.benchmark, cell.track, score.thresholds)
        for cell, score in scored
        if score.kind == "cloud" and score.thresholds
    }
    values = []
    for cell, score in scored:
        key = (cell.table, cell.benchmark, cell.track, score.thresholds)
        if score.kind in ("hits", "ap") and score.variant in ("", "precision") and key in clouds:
            score = score._replace(kind="cloud")
        full = 1 if cell.is_share or small or score.kind == "other" else 100
        decimals, group = count_decimals(cell.value), (cell.benchmark, cell.track)
        scene_key, score_key = (*group, cell.scene), (*group, cell.metric)
        row, column = ((cell.table, *scene_key, name) for name in (cell.method, cell.metric))
        number, half = Fraction(cell.value), Fraction(1, 2 * 10**decimals)
        values.append(
            Value(cell, score, full, number, decimals, half, row, column, scene_key, score_key)
        )
    return values


def decimal_text(number: Fraction, decimals: int) -> str:
    """Write an exact number with `decimals` decimals, halves away from zero."""
    half = Decimal(1).scaleb(-decimals)
    with localcontext(prec=60):
        exact = Decimal(number.numerator) / Decimal(number.denominator)
        return f"{exact.quantize(half, ROUND_HALF_UP):zf}"


def group_by(items: Iterable[S], key: Callable[[S], T]) -> dict[T, list[S]]:
    """Group items, in their order."""
    groups: dict[T, list[S]] = {}
    for item in items:
        groups.setdefault(key(item), []).append(item)
    return groups


class Grade(StrEnum):
    """How sure it is that a printed number is wrong.

    `IMPOSSIBLE` follows from its row and what was given, `INCONSISTENT` is a contradiction to other
    numbers or to what they imply, and `ROUNDING` may come from digits cut off or rounded twice.
    """

    IMPOSSIBLE = "impossible"
    INCONSISTENT = "inconsistent"
    ROUNDING = "rounding"


class Finding(NamedTuple):
    """A finding: a cell, the check that failed, and its arithmetic in words."""

    grade: Grade
    check: str
    cell: PrintedValue
    why: str


class Outcome(NamedTuple):
    """The outcome of one check: how many values it compared, and its findings."""

    check: str
    tested: int
    findings: list[Finding]
