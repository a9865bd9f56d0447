"""Comparisons as tables: the numbers of every pair, what they show, and what they cannot."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import groupby

from airzoo_bench.core.errors import agreeing, counted, plural
from airzoo_bench.results.comparable import first_names
from airzoo_bench.results.comparison import Comparison, Pair
from airzoo_bench.results.floors import FLOOR_MARK
from airzoo_bench.statistics.significance import LEVEL
from airzoo_bench.tables.model import Cell, Column, Row, Table
from airzoo_bench.tables.verdicts import LEAST_P, disagreement, sentence, verdict
from airzoo_bench.tables.wording import (
    brackets_note,
    notes_by_reason,
    resampled,
    score_cell,
    score_title,
)

__all__ = ["comparison_table"]

_SENTENCES = 4
_NAMES = 6
_VERDICTS = ("better", "worse", "unclear", "equal")

_TITLES = ("Score", "Method", "Verdict", "Value", "Ref.", "Difference")
_TITLES_OF_ONE = ("Score", "Against", "Verdict", "Value", "Other", "Difference")
_TESTS = ("Paired", "Holm", "McNemar")
_COMPARED = {"unclear": "unclear against", "equal": "equal to"}


def comparison_table(comparison: Comparison) -> Table:
    """Lay out a comparison: a row a score and method, for each score the best method first."""
    pairs = [
        pair
        for _, part in groupby(comparison.pairs, key=lambda pair: pair.score.key)
        for pair in _best_first(list(part), comparison)
    ]
    columns = _columns(comparison)
    return Table(
        _title(comparison),
        columns,
        tuple(_row(pair, comparison) for pair in pairs),
        (
            *_findings(pairs, comparison),
            *_disagreements(pairs, comparison),
            *_undecidable(pairs, comparison),
            *_notes(pairs, comparison, "no interval; ", lambda pair: pair.interval.reason),
            *comparison.notes,
            *_methods(comparison),
        ),
        leading=2,
        # What belongs to a pair stands in one line, wherever a width does not forbid it.
        groups_per_block=len(columns),
        fixed=True,
    )


def _columns(comparison: Comparison) -> tuple[Column, ...]:
    unit = plural(comparison.unit).capitalize()
    return (
        *map(Column, _TITLES_OF_ONE if comparison.of_one else _TITLES),
        *(Column(title, decimals=4, group="p") for title in _TESTS),
        *(Column(title, group=unit) for title in ("Win", "Tie", "Loss")),
    )


def _best_first(pairs: list[Pair], comparison: Comparison) -> list[Pair]:
    sign = -1 if pairs[0].score.higher_is_better else 1

    def value(pair: Pair) -> float:
        return sign * (pair.reference_value if comparison.of_one else pair.value)

    return sorted(pairs, key=value)


def _title(comparison: Comparison) -> str:
    number = counted(comparison.units, comparison.unit)
    where = "all scenes, " if comparison.unit == "query" else ""
    if comparison.scene is not None:
        where = f"scene {comparison.scene}, "
    if not comparison.of_one:
        return f"Against {comparison.reference}, {where}{number}"
    others = {comparison.other(pair) for pair in comparison.pairs}
    against = others.pop() if len(others) == 1 else "each other method"
    return f"{comparison.reference} against {against}, {where}{number}"


def _row(pair: Pair, comparison: Comparison) -> Row:
    score, other = pair.score, comparison.other(pair)
    tested = (pair.test.p_value, pair.p_holm, pair.p_mcnemar)
    return Row(
        (
            Cell(score_title(score)),
            Cell(other, mark=FLOOR_MARK * (other in comparison.no_better)),
            Cell(verdict(pair)),
            score_cell(score, pair.value),
            score_cell(score, pair.reference_value),
            score_cell(score, pair.difference, pair.interval),
            *(Cell(p, least=LEAST_P) for p in tested),
            *(Cell(number) for number in (pair.wins, pair.ties, pair.losses)),
        )
    )


def _has_sentences(pairs: Sequence[Pair]) -> bool:
    """Whether there are two methods, and few scores: then a sentence for each has room."""
    return len(pairs) == len({pair.score.key for pair in pairs}) <= _SENTENCES


def _findings(pairs: Sequence[Pair], comparison: Comparison) -> list[str]:
    """Say what was found, as far as it can be decided."""
    scores = list(dict.fromkeys(pair.score for pair in pairs))
    decidable = [pair for pair in pairs if verdict(pair) != "too few"]
    if _has_sentences(pairs):
        return [sentence(pair, comparison.resampling) for pair in decidable]
    if len(pairs) == len(scores):
        parts = _by_verdict(decidable, [pair.score.title for pair in decidable])
        said = "; ".join(f"{word} on {names}" for word, names in parts)
        return [f"{pairs[0].method} against {pairs[0].reference}: {said}"] if said else []
    by_finding: dict[str, list[str]] = {}
    for score in scores:
        part = [pair for pair in decidable if pair.score == score]
        parts = _by_verdict(part, [comparison.other(pair) for pair in part])
        said = "; ".join(_finding(word, names, comparison) for word, names in parts)
        by_finding.setdefault(said, []).append(score.title)
    of = f"of {comparison.reference}" if comparison.of_one else f"against {comparison.reference}"
    return [
        f"{first_names(titles, _NAMES)} {of}: {said}" for said, titles in by_finding.items() if said
    ]


def _finding(word: str, names: str, comparison: Comparison) -> str:
    if comparison.of_one:
        return f"{_COMPARED.get(word, f'{word} than')} {names}"
    return f"{names} {word}"


def _by_verdict(pairs: Sequence[Pair], names: Sequence[str]) -> list[tuple[str, str]]:
    """Return each verdict that occurs, and the names of the pairs that have it."""
    found: dict[str, list[str]] = {}
    for pair, name in zip(pairs, names, strict=True):
        found.setdefault(verdict(pair), []).append(name)
    return [(word, first_names(found[word], _NAMES)) for word in _VERDICTS if word in found]


def _notes(
    pairs: Sequence[Pair], comparison: Comparison, prefix: str, why: Callable[[Pair], str]
) -> list[str]:
    """Say why of the pairs for which there is a reason, those that share one together."""
    reasons = [(why(pair), pair.score, comparison.other(pair)) for pair in pairs]
    return notes_by_reason(reasons, prefix, "against" if comparison.of_one else "of")


def _disagreements(pairs: Sequence[Pair], comparison: Comparison) -> list[str]:
    """Say where verdict and interval point different ways, unless sentences do."""

    def why(pair: Pair) -> str:
        doubt = disagreement(pair)
        return f"{verdict(pair)}, but {doubt}" if doubt else ""

    return [] if _has_sentences(pairs) else _notes(pairs, comparison, "", why)


def _undecidable(pairs: Sequence[Pair], comparison: Comparison) -> list[str]:
    """Say where too few units differ for any test."""

    def why(pair: Pair) -> str:
        if verdict(pair) != "too few":
            return ""
        if not pair.test.patterns:
            return f"{pair.interval.reason}, and medians are tested by theirs"
        count = pair.wins + pair.losses
        differ = f"only {counted(count, comparison.unit)} {agreeing(count, 'differs', 'differ')}"
        return f"{differ}, so p {agreeing(count, 'is', 'cannot be below')} {pair.p_floor:g}"

    return _notes(pairs, comparison, "too few to tell; ", why)


def _methods(comparison: Comparison) -> list[str]:
    pairs, resampling = comparison.pairs, comparison.resampling
    drawn = resampled(comparison.unit)
    intervals = [pair.interval for pair in pairs]
    return [
        *brackets_note(intervals, resampling, drawn, "intervals of the difference"),
        f"p: {_tests(comparison)}; {_correction(comparison)}"
        + ("; McNemar exact, for hits" if any(p.p_mcnemar is not None for p in pairs) else ""),
        *_too_coarse(comparison),
    ]


def _tests(comparison: Comparison) -> str:
    kinds = {pair.test.kind for pair in comparison.pairs}
    resampling, said = comparison.resampling, []
    if "permutation" in kinds:
        said.append(f"paired permutation, two-sided, {_patterns(comparison)}")
    if "student" in kinds:
        said.append("Student's t over scenes, paired, two-sided")
    if "bootstrap" in kinds:
        of_medians = f"{'of medians ' * bool(said)}paired bootstrap, two-sided"
        said.append(f"{of_medians}, {resampling.resamples} resamples, seed {resampling.seed}")
    return "; ".join(said)


def _patterns(comparison: Comparison) -> str:
    exact = {pair.test.exact for pair in comparison.pairs if pair.test.kind == "permutation"}
    some = f"{comparison.resampling.resamples} random patterns, seed {comparison.resampling.seed}"
    tried = {True: "all patterns", False: some}
    return tried[exact.pop()] if len(exact) == 1 else f"all patterns or {some}"


def _correction(comparison: Comparison) -> str:
    methods = len({comparison.other(pair) for pair in comparison.pairs}) + 1
    if comparison.family < methods:
        return "corrected by Holm for the number of methods, not of scores"
    return (
        f"corrected by Holm for all {comparison.family} pairs of methods, since the "
        f"{'method' if comparison.of_one else 'reference'} was chosen for being the best, "
        "not for the number of scores"
    )


def _too_coarse(comparison: Comparison) -> list[str]:
    """Say where random patterns are too few for any p to be a finding after Holm."""
    if all(pair.test.exact for pair in comparison.pairs):
        return []
    sides = 2 if any(pair.test.kind == "bootstrap" for pair in comparison.pairs) else 1
    least = sides * comparison.family / (comparison.resampling.resamples + 1)
    if least <= LEVEL:
        return []
    return [
        f"p of random patterns, Holm, cannot be below {min(least, 1.0):.4f}: name a reference, or "
        "fewer methods"
    ]
