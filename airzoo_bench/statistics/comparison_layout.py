"""Comparisons as tables: the numbers of every pair, what they show, and what they cannot."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby

from airzoo_bench.comparable import first_names
from airzoo_bench.statistics.comparison import Comparison, Pair
from airzoo_bench.statistics.verdicts import LEAST_P, is_decidable, sentence, verdict
from airzoo_bench.statistics.wording import (
    brackets_note,
    by_reason,
    counted,
    score_cell,
    score_title,
)
from airzoo_bench.tables.model import Cell, Column, Row, Table

__all__ = ["comparison_table"]

_SENTENCES = 4
_NAMES = 6
_VERDICTS = ("better", "worse", "unclear", "equal")

_COLUMNS = (
    Column("Score"),
    Column("Method"),
    Column("Verdict"),
    Column("Value"),
    Column("Ref."),
    Column("Difference"),
    *(Column(title, decimals=4, group="p") for title in ("Paired", "Holm", "McNemar")),
)


def comparison_table(comparison: Comparison) -> Table:
    """Lay out a comparison: a row a score and method, for each score the best method first.

    Below stand what the pairs show in words: of two methods and at most four scores a sentence
    for each score, otherwise a line that sums up; then what cannot be decided, and why.
    """
    pairs = [
        pair
        for _, part in groupby(comparison.pairs, key=lambda pair: pair.score.key)
        for pair in _best_first(list(part))
    ]
    unit = {"query": "Queries", "scene": "Scenes"}[comparison.unit]
    tallies = (Column(title, group=unit) for title in ("Win", "Tie", "Loss"))
    return Table(
        _title(comparison),
        (*_COLUMNS, *tallies),
        tuple(_row(pair) for pair in pairs),
        (
            *_findings(pairs, comparison),
            *_undecidable(pairs, comparison.unit),
            *_without_interval(pairs),
            *comparison.notes,
            *_methods(comparison),
        ),
        leading=2,
    )


def _best_first(pairs: list[Pair]) -> list[Pair]:
    sign = -1 if pairs[0].score.higher_is_better else 1
    return sorted(pairs, key=lambda pair: sign * pair.value)


def _title(comparison: Comparison) -> str:
    number = counted(comparison.units, comparison.unit)
    where = "all scenes, " if comparison.unit == "query" else ""
    if comparison.scene is not None:
        where = f"scene {comparison.scene}, "
    return f"Against {comparison.reference}, {where}{number}"


def _row(pair: Pair) -> Row:
    score = pair.score
    tested = (pair.test.p_value, pair.p_holm, pair.p_mcnemar)
    return Row(
        (
            Cell(score_title(score)),
            Cell(pair.method),
            Cell(verdict(pair)),
            score_cell(score, pair.value),
            score_cell(score, pair.reference_value),
            score_cell(score, pair.difference, pair.interval),
            *(Cell(p, least=LEAST_P) for p in tested),
            *(Cell(number) for number in (pair.wins, pair.ties, pair.losses)),
        )
    )


def _findings(pairs: Sequence[Pair], comparison: Comparison) -> list[str]:
    """Say what was found, as far as it can be decided."""
    scores = list(dict.fromkeys(pair.score for pair in pairs))
    decidable = [pair for pair in pairs if is_decidable(pair)]
    if len(pairs) == len(scores) <= _SENTENCES:
        return [sentence(pair, comparison.plan) for pair in decidable]
    against = f"against {comparison.reference}"
    if len(pairs) == len(scores):
        parts = _by_verdict(decidable, [pair.score.title for pair in decidable])
        said = "; ".join(f"{word} on {names}" for word, names in parts)
        return [f"{pairs[0].method} {against}: {said}"] if said else []
    by_finding: dict[str, list[str]] = {}
    for score in scores:
        part = [pair for pair in decidable if pair.score == score]
        parts = _by_verdict(part, [pair.method for pair in part])
        said = "; ".join(f"{names} {word}" for word, names in parts)
        by_finding.setdefault(said, []).append(score.title)
    return [
        f"{first_names(titles, _NAMES)} {against}: {said}"
        for said, titles in by_finding.items()
        if said
    ]


def _by_verdict(pairs: Sequence[Pair], names: Sequence[str]) -> list[tuple[str, str]]:
    """Return each verdict that occurs, and the names of the pairs that have it."""
    found: dict[str, list[str]] = {}
    for pair, name in zip(pairs, names, strict=True):
        found.setdefault(verdict(pair), []).append(name)
    return [(word, first_names(found[word], _NAMES)) for word in _VERDICTS if word in found]


def _undecidable(pairs: Sequence[Pair], unit: str) -> Iterator[str]:
    """Say where too few units differ for any test."""

    def why(pair: Pair) -> str:
        if is_decidable(pair):
            return ""
        count = pair.wins + pair.losses
        differ = f"only {counted(count, unit)} {'differs' if count == 1 else 'differ'}"
        return f"{differ}, so p {'is' if count == 1 else 'cannot be below'} {pair.p_floor:g}"

    found = by_reason(((why(pair), pair.score, pair.method) for pair in pairs), "of")
    for reason, names in found.items():
        if reason:
            yield f"{names}: too few to tell; {reason}"


def _without_interval(pairs: Sequence[Pair]) -> Iterator[str]:
    found = by_reason(((pair.interval.reason, pair.score, pair.method) for pair in pairs), "of")
    for reason, names in found.items():
        if reason:
            yield f"{names}: no interval; {reason}"


def _methods(comparison: Comparison) -> list[str]:
    plan = comparison.plan
    unit = {"query": "queries within scenes", "scene": "scenes"}[comparison.unit]
    intervals = [pair.interval for pair in comparison.pairs]
    exact = {pair.test.exact for pair in comparison.pairs}
    some = f"{plan.resamples} random patterns, seed {plan.seed}"
    tried = {True: "all patterns", False: some}
    patterns = tried[exact.pop()] if len(exact) == 1 else f"all patterns or {some}"
    hits = any(pair.p_mcnemar is not None for pair in comparison.pairs)
    return [
        *brackets_note(intervals, plan, unit, "intervals of the difference"),
        f"p: paired permutation, two-sided, {patterns}; Holm over methods, not over scores"
        + ("; McNemar exact, for hits" if hits else ""),
    ]
