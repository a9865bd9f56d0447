"""Comparisons, intervals and bounds as tables."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from airzoo_bench.records import Scored
from airzoo_bench.result import ScoreColumn
from airzoo_bench.statistics.comparison import Comparison, Pair, make_sample
from airzoo_bench.statistics.intervals import Bootstrap, Interval
from airzoo_bench.statistics.printed import Bounds, hit_rate_interval
from airzoo_bench.statistics.samples import Plan, gap
from airzoo_bench.statistics.verdicts import as_shown, bounds_verdict, verdict
from airzoo_bench.tables.model import Cell, Column, Row, Table, share_to_percent

__all__ = [
    "bounds_table",
    "comparison_table",
    "differences_table",
    "intervals_table",
]

_UNITS = {"share": "%", "m": "m", "deg": "deg"}
_PLURAL = {"query": "queries", "scene": "scenes"}


def comparison_table(comparison: Comparison) -> Table:
    """Lay out a comparison: a row a score and method, verdicts below.

    Of two methods there is a verdict for every score, of more for the first score only.
    """
    pairs, plan = comparison.pairs, comparison.plan
    percent = f"{share_to_percent(plan.confidence):g} %"
    columns = (
        Column("Score"),
        Column("Method"),
        Column("Value"),
        Column("Reference"),
        Column("Difference"),
        Column(f"{percent} from"),
        Column("to"),
        Column("p", decimals=4),
        Column("p, Holm", decimals=4),
        Column("p, McNemar", decimals=4),
        *(Column(title) for title in ("Wins", "Ties", "Losses")),
    )
    single = len({pair.method for pair in pairs}) == 1
    said = [pair for pair in pairs if single or pair.score == pairs[0].score]
    where = "all scenes" if comparison.scene is None else f"scene {comparison.scene}"
    number = f"{comparison.units} {_PLURAL[comparison.unit]}"
    return Table(
        f"Against {comparison.reference}, {where}, {number}",
        columns,
        tuple(_comparison_row(pair) for pair in pairs),
        (
            *(verdict(pair, plan) for pair in said),
            *_without_interval(pairs),
            *comparison.notes,
            _method(comparison),
        ),
    )


def _comparison_row(pair: Pair) -> Row:
    score = pair.score
    return Row(
        (
            Cell(f"{score.title} [{_UNITS[score.unit]}]"),
            Cell(pair.method),
            _cell(score, pair.value),
            _cell(score, pair.reference_value),
            _cell(score, pair.difference),
            _cell(score, pair.interval.low),
            _cell(score, pair.interval.high),
            Cell(pair.test.p_value),
            Cell(pair.p_holm),
            Cell(pair.p_mcnemar),
            Cell(pair.wins),
            Cell(pair.ties),
            Cell(pair.losses),
        )
    )


def _cell(score: ScoreColumn, value: float | None) -> Cell:
    return Cell(None if value is None else as_shown(score, value))


def _without_interval(pairs: Sequence[Pair]) -> list[str]:
    return [
        f"{pair.method}, {pair.score.title}: no interval; {pair.interval.reason}"
        for pair in pairs
        if pair.interval.reason
    ]


def _method(comparison: Comparison) -> str:
    plan, unit = comparison.plan, _PLURAL[comparison.unit]
    within = " within scenes" if comparison.unit == "query" else ""
    used = sorted({pair.interval.method for pair in comparison.pairs} - {""})
    named = " and ".join({"bca": "BCa", "percentile": "percentile"}[name] for name in used)
    exact = all(pair.test.exact for pair in comparison.pairs)
    tried = "all patterns" if exact else f"{plan.resamples} random patterns where not all"
    intervals = f"intervals: {named or 'none'}, {plan.resamples} resamples of {unit}{within}; "
    return (
        f"{intervals}p: paired permutation, two-sided, {tried}; Holm over methods; seed {plan.seed}"
    )


def differences_table(
    methods: Sequence[Scored], scores: Sequence[ScoreColumn], count: int, scene: str | None = None
) -> Table:
    """List the queries on which methods differ most by the first score.

    Equal differences are ordered by the other scores, then by id.

    Parameters
    ----------
    methods : sequence of Scored
        On the same queries.
    scores : sequence of ScoreColumn
    count : int
        How many queries; those without a difference are left out.
    scene : str, optional
    """
    sample = make_sample(methods, scores, scene)
    values = np.concatenate(sample.values, axis=1)
    by_score = values.reshape(len(scores), len(methods), -1)
    spread = gap(by_score.max(axis=1), by_score.min(axis=1))
    of_unit = methods[0].records["scene"].to_numpy(str)
    names = methods[0].records["query"].to_numpy(str)
    scenes = [name for name in methods[0].result.scenes if scene in (None, name)]
    ids = (
        np.concatenate([names[of_unit == name] for name in scenes])
        if sample.unit == "query"
        else names[np.isin(of_unit, scenes)]
    )
    order = np.lexsort([ids, *(-spread[::-1])])
    chosen = [row for row in order[:count].tolist() if spread[0, row] > 0]
    score = scores[0]
    rows = tuple(
        Row((Cell(str(ids[row])), *(_cell(score, float(v)) for v in by_score[0][:, row])))
        for row in chosen
    )
    heads = tuple(Column(m.name, _UNITS[score.unit], score.higher_is_better) for m in methods)
    found = int((spread[0] > 0).sum())
    note = f"{found} of {len(ids)} {_PLURAL[sample.unit]} differ on {score.title}"
    title = f"Where the methods differ most on {score.title}"
    return Table(title, (Column(sample.unit.capitalize()), *heads), rows, (note,))


def intervals_table(
    method: Scored, scores: Sequence[ScoreColumn], found: Bootstrap, plan: Plan
) -> Table:
    """Lay out the intervals of one method: a row a scene and score, then the average."""
    result = method.result
    columns = (
        *(Column(title) for title in ("Scene", "Score", "Value")),
        Column(f"{share_to_percent(plan.confidence):g} % from"),
        *(Column(title) for title in ("to", "Interval")),
    )
    rows = [
        _interval_row(result.truth.scene_titles[scene], score, result.scenes[scene], interval)
        for scene, intervals in found.groups.items()
        for score, interval in zip(scores, intervals, strict=True)
    ]
    rows += [
        _interval_row("Average", score, result.overall, interval, summary=True)
        for score, interval in zip(scores, found.overall, strict=True)
    ]
    unit = "queries within scenes" if found.groups else "scenes"
    note = f"{plan.resamples} resamples of {unit}, seed {plan.seed}"
    title = f"{method.name} on {result.protocol.name} v{result.protocol.version}"
    return Table(title, columns, tuple(rows), (*result.notes, note))


def _interval_row(
    title: str,
    score: ScoreColumn,
    values: dict[str, float],
    interval: Interval,
    *,
    summary: bool = False,
) -> Row:
    cells = (
        Cell(title),
        Cell(f"{score.title} [{_UNITS[score.unit]}]"),
        _cell(score, values[score.key]),
        _cell(score, interval.low),
        _cell(score, interval.high),
        Cell(interval.method or f"none: {interval.reason}"),
    )
    return Row(cells, summary)


def bounds_table(first: str, second: str, bounds: Bounds) -> Table:
    """Lay out what two printed hit rates can mean, with a verdict.

    Parameters
    ----------
    first, second : str
        As printed.
    bounds : Bounds
        From `printed_bounds`.
    """
    cases = (
        ("hits overlap the most", bounds.least),
        ("hits overlap the least", bounds.most),
    )
    columns = (
        Column("If"),
        Column(f"Only {first} hits"),
        Column(f"Only {second} hits"),
        Column("p, McNemar", decimals=4),
    )
    rows = tuple(Row((Cell(name), *map(Cell, values))) for name, values in cases)
    title = f"{first} % against {second} % on {bounds.queries} queries"
    rates = [
        _rate(text, counts, bounds.queries)
        for text, counts in zip((first, second), bounds.counts, strict=True)
    ]
    return Table(title, columns, rows, (bounds_verdict(first, second, bounds), *rates))


def _rate(text: str, counts: range, queries: int) -> str:
    limits = hit_rate_interval(counts[0], queries)[0], hit_rate_interval(counts[-1], queries)[1]
    hits = f"{counts[0]}" if len(counts) == 1 else f"{counts[0]} to {counts[-1]}"
    low, high = (share_to_percent(float(limit)) for limit in limits)
    return (
        f"{text} % is {hits} of {queries}; on its own between {low:.2f} and {high:.2f} % "
        "(95 %, Clopper and Pearson)"
    )
