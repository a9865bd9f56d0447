"""Intervals and tests as tables: one method by scene, pairs of methods, where two differ most."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import groupby
from operator import itemgetter

import numpy as np

from airzoo_bench.core.errors import counted, plural
from airzoo_bench.results.comparison import (
    FLOOR_MARK,
    MethodComparison,
    Pair,
    is_hit,
    score_intervals,
    why_untested,
)
from airzoo_bench.results.records import Method
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.statistics.intervals import Interval
from airzoo_bench.statistics.samples import ResamplingConfig, difference
from airzoo_bench.statistics.significance import LEVEL, p_floor
from airzoo_bench.tables.layouts import (
    MethodTable,
    limits_shown,
    method_table,
    scenes_table,
    score_cell,
    score_column,
    share_notes,
)
from airzoo_bench.tables.model import Cell, Column, Row, Table
from airzoo_bench.tables.published import OVERALL

HIT, MISS = "✓ hit", "✗ miss"
_NAMES = {"wilson": "Wilson", "mover": "MOVER", "student": "Student's t", "bca": "BCa"}


# --- intervals ---


def describe_intervals(
    intervals: Iterable[Interval],
    resampling: ResamplingConfig,
    unit: str,
    *,
    lead: str = "in square brackets: ",
    what: str = "intervals",
    within: str = "scenes",
) -> list[str]:
    """Say how intervals were made, by the kinds that there are; nothing where there are none."""
    made = [interval for interval in intervals if interval.method]
    kinds = {interval.method for interval in made}
    names = " or ".join(_NAMES.get(kind, kind) for kind in sorted(kinds, reverse=True))
    drawn = f"{plural(unit)} within {within}" if plural(unit) != within else within
    said = f"{lead}{100 * resampling.confidence:g} % {what}, {names} over {drawn}"
    if kinds & {"bca", "percentile"}:
        said += f", {resampling.resamples} resamples, seed {resampling.seed}"
    if any(one.method == "lognormal" and one.high == math.inf for one in made):
        said += "; inf: the upper limit is not known, it is above ten times the mean"
    return [said] if made else []


def with_intervals(
    table: MethodTable,
    methods: Sequence[Method],
    resampling: ResamplingConfig,
    shown: Sequence[str],
) -> MethodTable:
    """Put intervals next to the numbers of methods, and notes how they were made, or why not."""
    rows, seen, reasons = [], list[Interval](), list[tuple[str, str]]()
    titles = {**table.scenes, OVERALL: "the average"}
    for row, method in zip(table.rows, methods, strict=True):
        scores = [score for score in table.scores if score in method.result.columns]
        found = score_intervals(method, scores, resampling)
        parts, spans = {OVERALL: found.overall, **found.groups}, {}
        for scene, part in parts.items():
            spans[scene] = {c.key: limits_shown(c, i) for c, i in zip(scores, part, strict=True)}
        rows.append(replace(row, intervals=spans))
        for scene in shown:
            intervals = parts.get(scene, [Interval(reason="a scene has one record")])
            seen += intervals
            reasons += [(titles[scene], f"no interval: {i.reason}") for i in intervals if i.reason]
    made = describe_intervals(seen, resampling, methods[0].result.unit)
    notes = (*made, *share_notes(reasons), *table.notes)
    return replace(table, rows=tuple(rows), notes=notes)


def intervals_table(
    method: Method, scores: Sequence[ScoreColumn], resampling: ResamplingConfig
) -> Table:
    """Lay out one method by scene, with intervals."""
    methods = replace(method_table([method.result]), scores=tuple(scores))
    shown = [*methods.scenes, OVERALL]
    return scenes_table(method.result, methods=with_intervals(methods, [method], resampling, shown))


# --- pairs ---


def verdict(pair: Pair) -> str:
    """Say what a pair shows in a word, at a level of 5 % after Holm's correction."""
    if pair.wins == pair.losses == 0:
        return "equal"
    if pair.untested or why_untested(pair.test, "query", pair.wins + pair.losses):
        return "too few"
    if not pair.difference or pair.p_holm > LEVEL:
        return "unclear"
    return "better" if (pair.difference > 0) == pair.score.higher_is_better else "worse"


def comparison_table(comparison: MethodComparison) -> Table:
    """Lay out a comparison: a row a score and method, for each score the best method first."""
    keys, units = [pair.score.key for pair in comparison.pairs], plural(comparison.unit)
    pairs = sorted(
        comparison.pairs,
        key=lambda p: (keys.index(p.score.key), p.value * (-1 if p.score.higher_is_better else 1)),
    )
    columns = (
        *map(Column, ("Score", "Method", "Verdict", "Value", "Ref.", "Difference")),
        *(Column(title, decimals=4, group="p") for title in ("Paired", "Holm", "McNemar")),
        *(Column(title, group=units.capitalize()) for title in ("Win", "Tie", "Loss")),
    )
    rows = [
        (
            Cell(score_column(pair.score).heading),
            Cell(pair.method, mark=FLOOR_MARK * (pair.method in comparison.no_better)),
            Cell(verdict(pair)),
            score_cell(pair.score, pair.value),
            score_cell(pair.score, pair.reference_value),
            score_cell(pair.score, pair.difference, pair.interval),
            *(
                Cell(p, least=1e-4, hidden=bool(pair.untested))
                for p in (pair.test.p_value, pair.p_holm, pair.p_mcnemar)
            ),
            *map(Cell, (pair.wins, pair.ties, pair.losses)),
        )
        for pair in pairs
    ]
    where = "all scenes" if comparison.scene is None else f"scene {comparison.scene}"
    where += f", {counted(comparison.units, comparison.unit)}"
    base, compact = comparison.reference, list[Row]()
    table = Table(
        f"Others against {base} (the reference), {where}",
        columns,
        tuple(map(Row, rows)),
        (*_explain_gaps(pairs), *comparison.notes, *_explain_tests(comparison)),
        leading=2,
    )
    own = Cell(base, mark=FLOOR_MARK * (base in comparison.no_better))
    for score, (first, *others) in groupby(rows, key=itemgetter(0)):
        compact.append(Row((score, *[Cell("")] * 3), summary=bool(compact)))
        compact.append(Row((own, first[4], Cell(None), Cell(None))))
        compact += [Row(itemgetter(1, 3, 5, 7)(row)) for row in (first, *others)]
    heads = (*itemgetter(1, 3, 5)(columns), Column("p", decimals=4))
    return replace(table, narrow=replace(table, columns=heads, rows=tuple(compact), leading=1))


def _explain_gaps(pairs: Sequence[Pair]) -> list[str]:
    """Say where there are too few units or no interval, or where it and the verdict disagree."""
    reasons = []
    for pair in pairs:
        name, said = f"{pair.score.title} of {pair.method}", verdict(pair)
        limits = limits_shown(pair.score, pair.interval)
        if pair.untested:
            reasons.append((name, pair.untested))
        elif said == "too few":
            floor = f"p is at least {p_floor(pair.wins + pair.losses):g}"
            reasons.append((name, f"too few to tell: {pair.wins + pair.losses} differ, so {floor}"))
        elif limits and said != "equal" and (limits[0] * limits[1] > 0) == (said == "unclear"):
            reasons.append(
                (name, "interval and p disagree about 0; the verdict is by p after Holm")
            )
        if pair.interval.reason and not pair.untested:
            reasons.append((name, f"no interval; {pair.interval.reason}"))
    return share_notes(reasons, len(pairs))


def _explain_tests(comparison: MethodComparison) -> list[str]:
    """Say how intervals and tests were made, and for how many comparisons p was corrected."""
    pairs, plan, family = comparison.pairs, comparison.resampling, comparison.family
    kinds = sorted({pair.test.kind for pair in pairs})
    used = " or ".join(kinds).replace("student", "Student's t")
    drawn = f", {plan.resamples} resamples, seed {plan.seed}" * (kinds != ["student"])
    note = (
        f"p: paired {used}, two-sided{drawn}; corrected by Holm for {counted(family, 'pair')} of "
        "methods, not for the number of scores; McNemar exact, for hits"
    )
    about = "intervals of the difference" + ", not corrected by Holm" * (family > 1)
    made = [pair.interval for pair in pairs]
    notes = [note] if not all(pair.untested for pair in pairs) else []
    return [*describe_intervals(made, plan, comparison.unit, what=about), *notes]


def differences_table(methods: Sequence[Method], score: ScoreColumn, count: int) -> Table:
    """List the queries on which two methods differ most by a score, the second minus the first."""
    result, records = methods[0].result, [method.records for method in methods]
    values = np.array([frame[score.key].to_numpy(np.float64) for frame in records])
    spread = difference(values.max(axis=0), values.min(axis=0))
    ids = records[0]["query"].to_numpy(str)
    found = int((spread > 0).sum())
    chosen = np.lexsort([ids, -spread])[: min(count, found)]
    cells, notes = [list(map(Cell, ids[chosen].tolist()))], list[str]()
    heads = [Column(result.unit.capitalize()), *(Column(method.name) for method in methods)]
    if is_hit(result.track, score):
        cells += [[Cell(HIT if v == 1 else MISS) for v in row] for row in values[:, chosen]]
    else:
        numbers, shown = [*values, difference(values[1], values[0])], score_column(score)
        cells += [[score_cell(score, v) for v in row[chosen].tolist()] for row in numbers]
        heads[1:] = [replace(shown, title=method.name) for method in methods]
        heads.append(Column("Difference", shown.unit))
        notes.append(f"difference: {methods[1].name} minus {methods[0].name}")
    return Table(
        f"Where the methods differ most on {score.title}",
        tuple(heads),
        tuple(map(Row, zip(*cells, strict=True))),
        (f"{found} of {counted(len(ids), result.unit)} with a difference", *notes),
        leading=1,
    )
