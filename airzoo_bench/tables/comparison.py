"""Comparisons: the verdict of a pair, a table of all pairs, the queries that differ most."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import groupby

import numpy as np

from airzoo_bench.core.errors import agreeing, counted, plural
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

LEAST_P = 1e-4
"""A p-value below is shown as less than it."""

_OF_DIFFERENCE = {"share": "points", "m": "m", "deg": "deg"}
_SENTENCES = 4


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
    lead = f"{ahead} is ahead by {_amount(pair)}"
    return f"{untold}: {lead if pair.difference else 'both have the same value'}{evidence}."


def _amount(pair: Pair) -> str:
    value = abs(pair.difference or 0.0)
    if math.isinf(value):
        return "an infinite amount"
    return f"{show_number(as_shown(pair.score, value), 2)} {_OF_DIFFERENCE[pair.score.unit]}"


def _evidence(pair: Pair, resampling: ResamplingConfig) -> str:
    """Return the interval of the better one's lead, and p."""
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
    return text


def comparison_table(comparison: Comparison) -> Table:
    """Lay out a comparison: a row a score and method, for each score the best method first."""
    pairs: list[Pair] = []
    for _, part in groupby(comparison.pairs, key=lambda pair: pair.score.key):
        of_score = list(part)
        sign = -1 if of_score[0].score.higher_is_better else 1
        side = "reference_value" if comparison.of_one else "value"
        pairs += sorted(of_score, key=lambda pair: sign * getattr(pair, side))
    is_one = comparison.of_one
    columns = (
        *map(Column, ("Score", "Against" if is_one else "Method", "Verdict", "Value")),
        *map(Column, ("Other" if is_one else "Ref.", "Difference")),
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
        (*_notes(pairs, comparison), *comparison.notes, *_how(comparison)),
        leading=2,
        groups_per_block=None,  # since one line has everything about a pair
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


def _notes(pairs: Sequence[Pair], comparison: Comparison) -> list[str]:
    """Say a sentence about each of few pairs, and where there are too few units or no interval."""

    def noted(prefix: str, why: Callable[[Pair], str]) -> list[str]:
        reasons = [(why(pair), pair.score, comparison.other(pair)) for pair in pairs]
        return notes_by_reason(reasons, prefix, "against" if comparison.of_one else "of")

    def too_few(pair: Pair) -> str:
        if verdict(pair) != "too few":
            return ""
        if not pair.test.patterns:
            return f"{pair.interval.reason}, and medians are tested by theirs"
        count = pair.wins + pair.losses
        differ = f"only {counted(count, comparison.unit)} {agreeing(count, 'differs', 'differ')}"
        return f"{differ}, so p {agreeing(count, 'is', 'cannot be below')} {pair.p_floor:g}"

    notes = noted("too few to tell; ", too_few)
    # Of two methods by few scores, sentences have room.
    if len(pairs) == len({pair.score.key for pair in pairs}) <= _SENTENCES:
        told = [pair for pair in pairs if verdict(pair) != "too few"]
        notes = [*(sentence(pair, comparison.resampling) for pair in told), *notes]
    return notes + noted("no interval; ", lambda pair: pair.interval.reason)


def _how(comparison: Comparison) -> list[str]:
    """Say how intervals and tests were made, and for how many comparisons p was corrected."""
    pairs, plan, family = comparison.pairs, comparison.resampling, comparison.family
    kinds = {pair.test.kind for pair in pairs}
    tests = []
    if "permutation" in kinds:
        exact = {pair.test.exact for pair in pairs if pair.test.kind == "permutation"}
        random = f"{plan.resamples} random patterns, seed {plan.seed}"
        tried = " or ".join(["all patterns"] * (True in exact) + [random] * (False in exact))
        tests.append(f"paired permutation, two-sided, {tried}")
    if "student" in kinds:
        tests.append("Student's t over scenes, paired, two-sided")
    if "bootstrap" in kinds:
        of_medians = f"{'of medians ' * bool(tests)}paired bootstrap, two-sided"
        tests.append(f"{of_medians}, {plan.resamples} resamples, seed {plan.seed}")
    chosen = "method" if comparison.of_one else "reference"
    if family <= len({comparison.other(pair) for pair in pairs}):
        tests.append("corrected by Holm for the number of methods, not of scores")
    else:
        tests.append(
            f"corrected by Holm for all {family} pairs of methods, since the {chosen} was chosen "
            "for being the best, not for the number of scores"
        )
    if any(pair.p_mcnemar is not None for pair in pairs):
        tests.append("McNemar exact, for hits")
    made, drawn = [pair.interval for pair in pairs], resampled(comparison.unit)
    uncorrected = ", not corrected for the number of methods" * (family > 1)
    notes = brackets_note(made, plan, drawn, f"intervals of the difference{uncorrected}")
    return [*notes, f"p: {'; '.join(tests)}"]


def differences_table(
    methods: Sequence[Scored],
    scores: Sequence[ScoreColumn],
    count: int,
    scene: str | None = None,
    *,
    base: int = 0,
) -> Table:
    """List the queries on which two methods differ most by the first score."""
    sample, score, other = make_sample(methods, scores, scene), scores[0], 1 - base
    by_score = np.concatenate(sample.values, axis=1).reshape(len(scores), 2, -1)
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
    values, unit = by_score[0][:, chosen], UNITS[score.unit]
    numbers = [*values, difference(values[other], values[base])]
    cells = [list(map(Cell, ids[chosen].tolist()))]
    cells += [[score_cell(score, number) for number in row.tolist()] for row in numbers]
    conditions = condition_names(methods[0])
    cells += [_condition_cells(methods[0], name, rows[chosen]) for name in conditions]
    return Table(
        f"Where the methods differ most on {score.title}",
        (
            Column(sample.unit.capitalize()),
            *(Column(method.name, unit, score.higher_is_better) for method in methods),
            Column("Difference", unit),
            *(Column(condition_title(name)) for name in conditions),
        ),
        tuple(map(Row, zip(*cells, strict=True))),
        (
            f"{found} of {counted(len(ids), sample.unit)} {agreeing(found, 'differs', 'differ')} "
            f"on {score.title}",
            f"difference: {methods[other].name} minus {methods[base].name}",
        ),
        leading=1,
    )


def _condition_cells(method: Scored, name: str, rows: np.ndarray) -> list[Cell]:
    column = method.records[name].iloc[rows]
    known = column[column.notna()].tolist()
    texts = number_texts(known) if column.dtype.kind in "iuf" else list(map(str, known))
    named = dict(zip(known, texts, strict=True))
    return [Cell(named.get(value)) for value in column.tolist()]
