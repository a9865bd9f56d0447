"""Comparisons: the verdict of a pair, a table of all pairs, the queries that differ most."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

import numpy as np

from airzoo_bench.core.errors import agreeing, counted, plural
from airzoo_bench.results.comparison import FLOOR_MARK, MethodComparison, Pair
from airzoo_bench.results.records import Method
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.statistics.samples import difference
from airzoo_bench.statistics.significance import LEVEL
from airzoo_bench.tables.intervals import brackets_note, resampled, score_cell, score_title
from airzoo_bench.tables.method_table import UNITS, share_notes
from airzoo_bench.tables.model import Cell, Column, Row, Table

LEAST_P = 1e-4
"""A p-value below is shown as less than it."""


def verdict(pair: Pair) -> str:
    """Say what a pair shows in a word, at a level of 5 % after Holm's correction."""
    if pair.wins == pair.losses == 0:
        return "equal"
    if not pair.test.patterns or pair.p_floor > LEVEL:
        return "too few"
    if not pair.difference or pair.p_holm > LEVEL:
        return "unclear"
    return "better" if pair.is_better else "worse"


def comparison_table(comparison: MethodComparison) -> Table:
    """Lay out a comparison: a row a score and method, for each score the best method first."""
    pairs: list[Pair] = []
    for _, part in groupby(comparison.pairs, key=lambda pair: pair.score.key):
        of_score = list(part)
        sign = -1 if of_score[0].score.higher_is_better else 1
        pairs += sorted(of_score, key=lambda pair: sign * pair.value)
    columns = (
        *map(Column, ("Score", "Method", "Verdict", "Value", "Ref.", "Difference")),
        *(Column(title, decimals=4, group="p") for title in ("Paired", "Holm", "McNemar")),
        *(
            Column(title, group=plural(comparison.unit).capitalize())
            for title in ("Win", "Tie", "Loss")
        ),
    )
    where = "all scenes" if comparison.scene is None else f"scene {comparison.scene}"
    return Table(
        f"{comparison.reference} against others, {where}, "
        f"{counted(comparison.units, comparison.unit)}",
        columns,
        tuple(_row(pair, comparison) for pair in pairs),
        (*_notes(pairs, comparison), *comparison.notes, *_explain_tests(comparison)),
        leading=2,
    )


def _row(pair: Pair, comparison: MethodComparison) -> Row:
    score, other = pair.score, pair.method
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


def _notes(pairs: Sequence[Pair], comparison: MethodComparison) -> list[str]:
    """Say where there are too few units or no interval."""
    reasons = []
    for pair in pairs:
        name = f"{pair.score.title}, {pair.method}"
        if verdict(pair) == "too few":
            differ = f"{counted(pair.wins + pair.losses, comparison.unit)} with a difference"
            reasons.append((name, f"too few to tell; {differ}, so p is at least {pair.p_floor:g}"))
        if pair.interval.reason:
            reasons.append((name, f"no interval; {pair.interval.reason}"))
    return share_notes(reasons)


def _explain_tests(comparison: MethodComparison) -> list[str]:
    """Say how intervals and tests were made, and for how many comparisons p was corrected."""
    pairs, plan, family = comparison.pairs, comparison.resampling, comparison.family
    kinds = {pair.test.kind for pair in pairs}
    drawn = f"{plan.resamples} resamples, seed {plan.seed}"
    tests = {
        "permutation": f"paired permutation (all patterns, or {drawn})",
        "student": "Student's t over scenes, paired",
        "bootstrap": f"paired bootstrap ({drawn})",
    }
    used = " or ".join(name for kind, name in tests.items() if kind in kinds)
    about = "intervals of the difference" + ", not corrected by Holm" * (family > 1)
    note = (
        f"p: {used}, two-sided; corrected by Holm for {counted(family, 'pair')} of methods, "
        "not for the number of scores"
    )
    note += "; McNemar exact, for hits" * any(pair.p_mcnemar is not None for pair in pairs)
    made = [pair.interval for pair in pairs]
    return [*brackets_note(made, plan, resampled(comparison.unit), about), note]


def differences_table(
    methods: Sequence[Method], scores: Sequence[ScoreColumn], count: int
) -> Table:
    """List the queries on which two methods differ most by the first score, the second minus it."""
    score, records = scores[0], [method.records for method in methods]
    values = np.array([frame[score.key].to_numpy(np.float64) for frame in records])
    spread = difference(values.max(axis=0), values.min(axis=0))
    ids = records[0]["query"].to_numpy(str)
    found = int((spread > 0).sum())
    chosen = np.lexsort([ids, -spread])[: min(count, found)]
    numbers = [*values[:, chosen], difference(values[1], values[0])[chosen]]
    cells = [list(map(Cell, ids[chosen].tolist()))]
    cells += [[score_cell(score, number) for number in row.tolist()] for row in numbers]
    unit = UNITS[score.unit]
    return Table(
        f"Where the methods differ most on {score.title}",
        (
            Column(methods[0].result.unit.capitalize()),
            *(Column(method.name, unit, score.higher_is_better) for method in methods),
            Column("Difference", unit),
        ),
        tuple(map(Row, zip(*cells, strict=True))),
        (
            f"{found} of {counted(len(ids), methods[0].result.unit)} "
            f"{agreeing(found, 'differs', 'differ')} on {score.title}",
            f"difference: {methods[1].name} minus {methods[0].name}",
        ),
        leading=1,
    )
