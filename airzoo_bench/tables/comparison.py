"""Comparisons: the verdict of a pair, a table of all pairs, the queries that differ most."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import groupby

import numpy as np

from airzoo_bench.core.errors import agreeing, counted, plural
from airzoo_bench.results.comparable import first_names
from airzoo_bench.results.comparison import FLOOR_MARK, Comparison, Pair, make_sample
from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.statistics.samples import ResamplingConfig, difference
from airzoo_bench.statistics.significance import LEVEL
from airzoo_bench.tables.breakdown import condition_names, condition_title, number_texts
from airzoo_bench.tables.intervals import (
    brackets_note,
    notes_by_reason,
    resampled,
    score_cell,
    score_title,
)
from airzoo_bench.tables.method_table import UNITS, as_shown
from airzoo_bench.tables.model import Cell, Column, Row, Table, share_to_percent, show_number

__all__ = [
    "LEAST_P",
    "comparison_table",
    "differences_table",
    "disagreement",
    "sentence",
    "verdict",
]

LEAST_P = 1e-4
"""A p-value below is shown as less than it."""

_OF_DIFFERENCE = {"share": "points", "m": "m", "deg": "deg"}
_SENTENCES = 4
_NAMES = 6
_VERDICTS = ("better", "worse", "unclear", "equal")
_TITLES = ("Score", "Method", "Verdict", "Value", "Ref.", "Difference")
_TITLES_OF_ONE = ("Score", "Against", "Verdict", "Value", "Other", "Difference")
_COMPARED = {"unclear": "unclear against", "equal": "equal to"}


def verdict(pair: Pair) -> str:
    """Say what a pair shows in a word, at a level of 5 % after Holm's correction."""
    if pair.wins == pair.losses == 0:
        return "equal"
    if not pair.test.patterns or pair.p_floor > LEVEL:
        return "too few"
    if not pair.difference or pair.p_holm > LEVEL:
        return "unclear"
    return "better" if pair.is_better else "worse"


def sentence(pair: Pair, resampling: ResamplingConfig) -> str:
    """Say what a pair shows, with its numbers, at a level of 5 % after Holm's correction."""
    word, on = verdict(pair), f"on {pair.score.title}"
    if word == "equal":
        infinite = ", and both infinite" * (pair.difference is None)
        return f"{pair.method} and {pair.reference} are equal {on} everywhere{infinite}."
    ahead, behind = (pair.method, pair.reference)[:: 1 if pair.is_better else -1]
    evidence = _evidence(pair, resampling)
    if word in ("better", "worse"):
        return f"{ahead} is better than {behind} {on} by {_amount(pair)}{evidence}."
    both = f"{pair.method} and {pair.reference}"
    untold = f"{both} cannot be told apart {on}"
    if word == "too few":
        untold = f"Too few to tell {both} apart {on}"
    if pair.difference is None:
        return f"{untold}: both are infinite."
    standing = f"{ahead} is ahead by {_amount(pair)}"
    if pair.difference == 0:
        standing = "both have the same value"
    return f"{untold}: {standing}{evidence}."


def _amount(pair: Pair) -> str:
    value = abs(pair.difference or 0.0)
    if math.isinf(value):
        return "an infinite amount"
    return f"{show_number(as_shown(pair.score, value), 2)} {_OF_DIFFERENCE[pair.score.unit]}"


def _evidence(pair: Pair, resampling: ResamplingConfig) -> str:
    """Return the interval of the better one's lead, p, and any disagreement between them."""
    low, high = pair.interval.low, pair.interval.high
    if low is None or high is None:
        text = " (no interval)"
    else:
        sign = -1 if (pair.difference or 0.0) < 0 else 1
        limits = sorted([sign * low + 0.0, sign * high + 0.0])
        first, last = (show_number(as_shown(pair.score, limit), 2) for limit in limits)
        level = share_to_percent(resampling.confidence)
        text = f" ({level:g} % interval {first} to {last})"
    p_values = {"p": pair.test.p_value}
    if pair.p_holm != pair.test.p_value:
        p_values["after Holm"] = pair.p_holm
    if pair.p_mcnemar is not None:
        p_values["McNemar"] = pair.p_mcnemar
    for name, p in p_values.items():
        text += f", {name} " + (f"< {LEAST_P}" if p < LEAST_P else f"= {p:.4f}")
    doubt = disagreement(pair)
    return text + (f"; but {doubt}" if doubt else "")


def disagreement(pair: Pair) -> str:
    """Say where the interval of a difference and the verdict point different ways; else empty."""
    low, high = pair.interval.low, pair.interval.high
    if low is None or high is None:
        return ""
    holds_0, word = low <= 0 <= high, verdict(pair)
    if word in ("better", "worse") and holds_0:
        return "the interval holds 0"
    if word != "unclear" or holds_0:
        return ""
    if pair.test.p_value <= LEVEL:
        return (
            "the interval excludes 0, as p does before Holm's correction: "
            "intervals are not corrected for the number of methods"
        )
    return "the interval excludes 0: interval and test answer different questions"


def comparison_table(comparison: Comparison) -> Table:
    """Lay out a comparison: a row a score and method, for each score the best method first."""
    pairs = []
    for _, part in groupby(comparison.pairs, key=lambda pair: pair.score.key):
        of_score = list(part)
        sign = -1 if of_score[0].score.higher_is_better else 1
        side = "reference_value" if comparison.of_one else "value"
        pairs += sorted(of_score, key=lambda pair: sign * getattr(pair, side))
    columns = (
        *map(Column, _TITLES_OF_ONE if comparison.of_one else _TITLES),
        *(Column(title, decimals=4, group="p") for title in ("Paired", "Holm", "McNemar")),
        *(
            Column(title, group=plural(comparison.unit).capitalize())
            for title in ("Win", "Tie", "Loss")
        ),
    )
    return Table(
        _title(comparison),
        columns,
        tuple(_row(pair, comparison) for pair in pairs),
        (
            *_findings(pairs, comparison),
            *_notes(pairs, comparison),
            *comparison.notes,
            *_how(comparison),
        ),
        leading=2,
        # What belongs to a pair stands in one line, wherever a width does not forbid it.
        groups_per_block=len(columns),
        fixed=True,
    )


def _title(comparison: Comparison) -> str:
    where = "all scenes, " if comparison.unit == "query" else ""
    if comparison.scene is not None:
        where = f"scene {comparison.scene}, "
    where += counted(comparison.units, comparison.unit)
    if not comparison.of_one:
        return f"Against {comparison.reference}, {where}"
    others = {comparison.other(pair) for pair in comparison.pairs}
    against = others.pop() if len(others) == 1 else "each other method"
    return f"{comparison.reference} against {against}, {where}"


def _row(pair: Pair, comparison: Comparison) -> Row:
    score, other = pair.score, comparison.other(pair)
    return Row(
        (
            Cell(score_title(score)),
            Cell(other, mark=FLOOR_MARK * (other in comparison.no_better)),
            Cell(verdict(pair)),
            score_cell(score, pair.value),
            score_cell(score, pair.reference_value),
            score_cell(score, pair.difference, pair.interval),
            *(Cell(p, least=LEAST_P) for p in (pair.test.p_value, pair.p_holm, pair.p_mcnemar)),
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
        parts = _by_verdict(decidable, lambda pair: pair.score.title)
        said = "; ".join(f"{word} on {names}" for word, names in parts)
        return [f"{pairs[0].method} against {pairs[0].reference}: {said}"] if said else []
    by_finding: dict[str, list[str]] = {}
    for score in scores:
        parts = _by_verdict([p for p in decidable if p.score == score], comparison.other)
        said = "; ".join(
            f"{_COMPARED.get(word, f'{word} than')} {names}"
            if comparison.of_one
            else f"{names} {word}"
            for word, names in parts
        )
        by_finding.setdefault(said, []).append(score.title)
    of = f"of {comparison.reference}" if comparison.of_one else f"against {comparison.reference}"
    return [
        f"{first_names(titles, _NAMES)} {of}: {said}" for said, titles in by_finding.items() if said
    ]


def _by_verdict(pairs: Sequence[Pair], name: Callable[[Pair], str]) -> list[tuple[str, str]]:
    """Return each verdict that occurs, and the names of the pairs that have it."""
    found: dict[str, list[str]] = {}
    for pair in pairs:
        found.setdefault(verdict(pair), []).append(name(pair))
    return [(word, first_names(found[word], _NAMES)) for word in _VERDICTS if word in found]


def _notes(pairs: Sequence[Pair], comparison: Comparison) -> list[str]:
    """Say where verdict and interval differ, too few units do, or there is no interval."""

    def noted(prefix: str, why: Callable[[Pair], str]) -> list[str]:
        reasons = [(why(pair), pair.score, comparison.other(pair)) for pair in pairs]
        return notes_by_reason(reasons, prefix, "against" if comparison.of_one else "of")

    def doubt(pair: Pair) -> str:
        found = disagreement(pair)
        return f"{verdict(pair)}, but {found}" if found else ""

    def too_few(pair: Pair) -> str:
        if verdict(pair) != "too few":
            return ""
        if not pair.test.patterns:
            return f"{pair.interval.reason}, and medians are tested by theirs"
        count = pair.wins + pair.losses
        differ = f"only {counted(count, comparison.unit)} {agreeing(count, 'differs', 'differ')}"
        return f"{differ}, so p {agreeing(count, 'is', 'cannot be below')} {pair.p_floor:g}"

    return [
        *([] if _has_sentences(pairs) else noted("", doubt)),
        *noted("too few to tell; ", too_few),
        *noted("no interval; ", lambda pair: pair.interval.reason),
    ]


def _how(comparison: Comparison) -> list[str]:
    """Say how intervals and tests were made, and what p was corrected for."""
    pairs, resampling = comparison.pairs, comparison.resampling
    kinds = {pair.test.kind for pair in pairs}
    tests = []
    if "permutation" in kinds:
        exact = {pair.test.exact for pair in pairs if pair.test.kind == "permutation"}
        random = f"{resampling.resamples} random patterns, seed {resampling.seed}"
        tried = " or ".join(["all patterns"] * (True in exact) + [random] * (False in exact))
        tests.append(f"paired permutation, two-sided, {tried}")
    if "student" in kinds:
        tests.append("Student's t over scenes, paired, two-sided")
    if "bootstrap" in kinds:
        of_medians = f"{'of medians ' * bool(tests)}paired bootstrap, two-sided"
        tests.append(f"{of_medians}, {resampling.resamples} resamples, seed {resampling.seed}")
    if comparison.family <= len({comparison.other(pair) for pair in pairs}):
        correction = "corrected by Holm for the number of methods, not of scores"
    else:
        correction = (
            f"corrected by Holm for all {comparison.family} pairs of methods, since the "
            f"{'method' if comparison.of_one else 'reference'} was chosen for being the best, "
            "not for the number of scores"
        )
    hits = any(pair.p_mcnemar is not None for pair in pairs)
    made = [pair.interval for pair in pairs]
    notes = brackets_note(
        made, resampling, resampled(comparison.unit), "intervals of the difference"
    )
    notes.append(f"p: {'; '.join([*tests, correction, *['McNemar exact, for hits'] * hits])}")
    # Random patterns may be too few for any p to be a finding after Holm.
    least = (2 if "bootstrap" in kinds else 1) * comparison.family / (resampling.resamples + 1)
    if least > LEVEL and not all(pair.test.exact for pair in pairs):
        notes.append(
            f"p of random patterns, Holm, cannot be below {min(least, 1.0):.4f}: name a reference, "
            "or fewer methods"
        )
    return notes


def differences_table(
    methods: Sequence[Scored],
    scores: Sequence[ScoreColumn],
    count: int,
    scene: str | None = None,
    *,
    base: int = 0,
) -> Table:
    """List the queries on which methods differ most by the first score."""
    sample, score, two = make_sample(methods, scores, scene), scores[0], len(methods) == 2
    by_score = np.concatenate(sample.values, axis=1).reshape(len(scores), len(methods), -1)
    spread = difference(by_score.max(axis=1), by_score.min(axis=1))
    # The rows of the records in the order of the sample's units.
    of_row = methods[0].records["scene"].to_numpy(str)
    scenes = [name for name in methods[0].result.scenes if scene in (None, name)]
    rows = np.flatnonzero(np.isin(of_row, scenes))
    if sample.unit == "query":
        rows = np.concatenate([np.flatnonzero(of_row == name) for name in scenes])
    ids = methods[0].records["query"].to_numpy(str)[rows]
    found = int((spread[0] > 0).sum())
    chosen = np.lexsort([ids, *(-spread[::-1])])[: min(count, found)]
    values = by_score[0][:, chosen]
    titles = [Column(m.name, UNITS[score.unit], score.higher_is_better) for m in methods]
    if two:
        titles.append(Column("Difference", UNITS[score.unit]))
        numbers = [*values, difference(values[1 - base], values[base])]
    else:
        titles.insert(0, Column("Best to worst", UNITS[score.unit]))
        numbers = [difference(values.max(0), values.min(0)), *values]
    columns = [(Column(sample.unit.capitalize()), [Cell(name) for name in ids[chosen].tolist()])]
    columns += [
        (title, [score_cell(score, number) for number in row.tolist()])
        for title, row in zip(titles, numbers, strict=True)
    ]
    differ = agreeing(found, "differs", "differ")
    notes = [f"{found} of {counted(len(ids), sample.unit)} {differ} on {score.title}"]
    if two:
        columns += [
            (Column(condition_title(name)), _condition_cells(methods[0], name, rows[chosen]))
            for name in condition_names(methods[0])
        ]
        notes.append(f"difference: {methods[1 - base].name} minus {methods[base].name}")
    return Table(
        f"Where the methods differ most on {score.title}",
        tuple(column for column, _ in columns),
        tuple(Row(cells) for cells in zip(*(cells for _, cells in columns), strict=True)),
        tuple(notes),
        leading=1,
    )


def _condition_cells(method: Scored, name: str, rows: np.ndarray) -> list[Cell]:
    column = method.records[name].iloc[rows]
    known = column[column.notna()].tolist()
    texts = number_texts(known) if column.dtype.kind in "iuf" else list(map(str, known))
    named = dict(zip(known, texts, strict=True))
    return [Cell(named.get(value)) for value in column.tolist()]
