"""Shares as counts: of how many queries each scene is, and which shares are no whole number."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from fractions import Fraction
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtrc

from airzoo_bench.audit.values import (
    Finding,
    Grade,
    Key,
    Outcome,
    Span,
    Value,
    decimal_text,
    group_by,
)
from airzoo_bench.core.errors import UsageError, counted, first_of
from airzoo_bench.core.validation import nearest

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


def parse_counts(texts: Iterable[str]) -> dict[str, int]:
    """Read ``scene=n,...`` texts."""
    counts: dict[str, int] = {}
    for part in (part.strip() for text in texts for part in text.split(",")):
        match = re.fullmatch(r"(.*\S)\s*=\s*0*([1-9][0-9]{0,8})", part)
        if not match:
            raise UsageError(
                f"{part[:80]!r} is no scene and number of queries",
                where="--counts",
                expected="such as City=161,Rural=190, or AirZoo-Real/City=161",
            )
        counts[match[1]] = int(match[2])
    return counts


def resolve_queries(
    values: Sequence[Value],
    counts: Mapping[str, int],
    doubtful: Collection[tuple[str, ...]],
    precise: Collection[Key] = (),
) -> tuple[dict[Key, Queries], list[str]]:
    """Return the known number of queries of each scene, and how the printed shares agree with it.

    Nothing is concluded from rows that are doubtful; `precise` are scores of mean precision.
    """
    groups = group_by(values, lambda value: value.scene_key)
    known = {scene for _, _, scene in groups} | {f"{b}/{scene}" for b, _, scene in groups if b}
    for name in counts:
        if name not in known:
            raise UsageError(
                f"no scene {name!r}{nearest(name, sorted(known))}",
                where="--counts",
                expected=first_of(sorted(known), shown=20),
            )
    shares = [v for v in values if v.score.kind == "hits" or v.score_key in precise]
    of_scenes = group_by(drop_averages(shares), lambda value: value.scene_key)
    queries: dict[Key, Queries] = {}
    conclusions: list[str] = []
    for key, cells in groups.items():
        # The name with its benchmark is the more exact one.
        stated = (counts.get(f"{key[0]}/{key[2]}"), counts.get(key[2]), *(v.cell.n for v in cells))
        given = next((number for number in stated if number), None)
        own = [value for value in of_scenes.get(key, ()) if value.row not in doubtful]
        implied, text = _implied_count(own)
        if given or implied:
            queries[key] = Queries(given or implied, is_given=given is not None)
        if text and given and given != implied:
            text += f"; given is {given}"
        conclusions += [f"counts of {', '.join(filter(None, key))}: {text}"] if text else []
    return queries, conclusions


def drop_averages(shares: Sequence[Value]) -> list[Value]:
    """Leave out averages over scenes that are printed as well."""
    with_scenes = {value.score_key for value in shares if not value.cell.is_summary}
    return [v for v in shares if not (v.cell.is_summary and v.score_key in with_scenes)]


def _implied_count(shares: Sequence[Value]) -> tuple[int, str]:
    """Weigh all totals by Bayes' rule: out of how many queries several printed shares are counts.

    A value that fits is one of as many as there are counts, one that does not is a misprint, and
    larger totals are less likely beforehand, in proportion. Either all values were rounded, or the
    digits of all were cut off. Returns the total, or 0 where it is not sure, and a sentence.
    """
    printed = {
        (int(one.number * scale), one.full * scale, one.score.places)
        for one in shares
        for scale in [10**one.decimals]
        if 0 < one.number < one.full
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


def _find_count(value: Value, queries: Queries) -> tuple[int, Fraction, list[int], Fraction]:
    """Return out of how many, how many exactly, the whole numbers near, and digits to the next."""
    total = queries.number * value.score.places
    exact = value.number * total / value.full
    ends = (math.floor(exact), math.ceil(exact))
    near = sorted({min(max(count, 0), total) for count in ends})
    digit = 2 * value.half * total / value.full
    return total, exact, near, min(abs(count - exact) for count in near) / digit


def check_counts(values: Sequence[Value], queries: Mapping[Key, Queries]) -> Outcome:
    """Find shares that are no whole number of queries, or of positives among K places of each."""
    shares = [value for value in values if value.scene_key in queries]
    found = (_judge_share(value, queries[value.scene_key]) for value in shares)
    return Outcome("counts", len(shares), [*filter(None, found)])


def _judge_share(value: Value, queries: Queries) -> Finding | None:
    total, exact, near, off = _find_count(value, queries)
    if off <= Fraction(1, 2):
        return None
    n, places = queries.number, value.score.places
    of, things = counted(n, "query"), "queries"
    if places > 1:
        of, things = f"{places} x {n} = {total} places of mean precision", "positives"
    fractions = ", ".join(
        f"{count}/{total} = {decimal_text(Fraction(count * value.full, total), value.decimals)}"
        for count in near
    )
    why = f"{value.cell.value}{' %' * (value.full == 100)} of {of} is {decimal_text(exact, 2)} "
    why += f"{things}, no whole number: {fractions}"
    if not queries.is_given:
        why += f" (n = {n} is what the other values of the scene imply)"
    # A definition that nobody has stated is as much in doubt as a number of queries.
    is_sure = queries.is_given and (places == 1 or bool(value.score.variant))
    grade = Grade.IMPOSSIBLE if is_sure else Grade.INCONSISTENT
    if off < 1:
        grade, why = Grade.ROUNDING, why + ": off by the last digit"
    return Finding(grade, "counts", value.cell, why)


def define_precision(
    values: Sequence[Value], queries: Mapping[Key, Queries], doubtful: Collection[tuple[str, ...]]
) -> tuple[set[Key], list[str]]:
    """Tell which average precisions are mean precision, a whole number of positives of K places.

    A score is that by its name, or where more values are whole numbers than would be by chance.
    """
    precise: set[Key] = set()
    conclusions = []
    precisions = [value for value in values if value.score.kind == "ap"]
    for name, cells in group_by(precisions, lambda value: value.score_key).items():
        own = [v for v in cells if v.scene_key in queries and not v.cell.is_summary]
        offs = {v: _find_count(v, queries[v.scene_key])[-1] for v in own}
        variant, text = cells[0].score.variant, "it cannot be told which"
        sure = {v: queries[v.scene_key].number for v in own if v.row not in doubtful}
        misfits = sum(offs[v] > Fraction(1, 2) for v in sure)
        if variant == "precision" or (not variant and _is_precision(sure, misfits)):
            precise.add(name)
            fits = sum(off <= Fraction(1, 2) for off in offs.values())
            text = f"mean precision, {'as named' if variant else 'concluded'}: "
            text += f"{fits} of {len(own)} values in scenes are whole numbers of positives"
        elif variant:
            text = f"that of {variant}"
        conclusions.append(f"AP of {', '.join(filter(None, name))}: the definition is {text}")
    return precise, conclusions


def _is_precision(numbers: Mapping[Value, int], misfits: int) -> bool:
    """Whether more values, with their numbers of queries, are whole numbers than by chance."""
    # One misprint of several values must not hide what all others are.
    if misfits > max(len(numbers) >= _FEWEST, int(len(numbers) * _MOST_MISFITS)):
        return False
    chances = [
        float(_chance(np.array(n * v.score.places), v.full * 10**v.decimals)) if v.number else 1.0
        for v, n in numbers.items()
    ]
    fits = len(numbers) - misfits
    return bool(fits and bdtrc(fits - 1, len(numbers), sum(chances) / len(numbers)) < _RARE)


def narrow_span(value: Value, queries: Queries | None) -> Span:
    """Return where the true number lies: at a count, where one is printed so."""
    if queries is None:
        return value.span
    total = queries.number * value.score.places
    low, high = (end * total / value.full for end in value.span)
    counts = range(max(0, math.ceil(low)), min(total, math.floor(high)) + 1)
    if not counts:
        return value.span
    return Span(Fraction(counts[0] * value.full, total), Fraction(counts[-1] * value.full, total))
