"""Results compared query by query: what the command ``compare`` prints, and the numbers in it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from airzoo_bench.api.arrays import listed, text_of
from airzoo_bench.api.results import Tabular
from airzoo_bench.core.errors import ArgumentError, first_of
from airzoo_bench.results import comparison
from airzoo_bench.results.comparable import (
    check_same_queries,
    choose_scores,
    find_scene,
    score_keys,
)
from airzoo_bench.results.comparison import Pair, score_intervals
from airzoo_bench.results.files import result_paths, results_here
from airzoo_bench.results.records import Scored, checked_records, read_scored
from airzoo_bench.results.result import ScoreColumn, read_result
from airzoo_bench.statistics.intervals import Interval
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.tables.comparison import comparison_table, verdict
from airzoo_bench.tables.intervals import intervals_table
from airzoo_bench.tables.model import Table

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Comparison", "Request", "compare"]

Given = str | Path | Scored


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Tabular):
    """What a comparison found.

    Attributes
    ----------
    table : Table
        What ``airzoo-bench compare`` prints, and this object shows.
    frame : DataFrame
        The numbers; see `compare`.
    """

    table: Table
    frame: pd.DataFrame

    def _laid_out(self) -> Table:
        return self.table


@dataclass(frozen=True)
class Request:
    """Methods that can be compared, by which scores and on which scene."""

    methods: list[Scored]
    scores: list[ScoreColumn]
    scene: str | None

    @classmethod
    def of(
        cls,
        results: Sequence[Given],
        scores: Sequence[str] = (),
        *,
        every: bool = False,
        scene: str | None = None,
        every_column: bool = False,
    ) -> Request:
        """Read the results that are files, and refuse what cannot be compared."""
        methods = _read(results, scores, every=every, every_column=every_column)
        check_same_queries(methods)
        chosen = choose_scores(methods, scores, every=every)
        titles = methods[0].result.truth.scene_titles
        return cls(methods, chosen, None if scene is None else find_scene(titles, scene))


def compare(
    results: Given | Iterable[Given],
    scores: Sequence[str] = (),
    *,
    every: bool = False,
    reference: str | None = None,
    method: str | None = None,
    scene: str | None = None,
) -> Comparison:
    """Compare results query by query: differences, intervals, tests, a verdict in words.

    Parameters
    ----------
    results : path, Result, or several of them
        Of one protocol and one truth. Of one result, its intervals are taken.
    scores : sequence of str
        Keys or titles; the headline ones where left out.
    every : bool
        Every score instead.
    reference : str, optional
        The method that all others are compared with, or "best"; the first where left out.
    method : str, optional
        Instead of a reference: differences, verdicts and wins are this method's.
    scene : str, optional
        This scene only, by id or title.

    Returns
    -------
    Comparison
        Its `frame` has a row a score and method: ``score``, ``method``, ``reference``, ``value``,
        ``reference_value``, ``difference``, its ``low`` and ``high``, ``p``, ``p_holm``,
        ``p_mcnemar``, ``wins``, ``ties``, ``losses`` and ``verdict``. Of one result it has a row a
        scene and score: ``scene`` (None for the average), ``score``, ``value``, ``low``,
        ``high``, ``interval`` and ``reason``. Shares are 0 to 1.

    Raises
    ------
    UserError
        Results cannot be read or compared; there is no such score, method or scene.

    References
    ----------
    docs/statistics.md says how each number is made.

    Examples
    --------
    >>> compare([])
    Traceback (most recent call last):
    ...
    airzoo_bench.core.errors.ArgumentError: results: holds nothing to compare
      expected: results, or paths of result.json
    """
    plan = ResamplingConfig()
    given = [results] if isinstance(results, Given) else listed("results", results)
    _check(given, every=every, scores=scores, reference=reference, method=method)
    names = [text_of("scores", score) or "" for score in listed("scores", scores)]
    asked = Request.of(given, names, every=every, scene=text_of("scene", scene))
    if len(asked.methods) == 1:
        return _intervals(asked, plan)
    found = comparison.compare(
        asked.methods,
        asked.scores,
        reference=text_of("reference", reference),
        method=text_of("method", method),
        scene=asked.scene,
        resampling=plan,
    )
    return Comparison(comparison_table(found), _frame([_pair(pair) for pair in found.pairs]))


def _check(
    results: Sequence[object],
    *,
    every: bool,
    scores: Sequence[str],
    reference: str | None,
    method: str | None,
) -> None:
    strange = [type(result).__name__ for result in results if not isinstance(result, Given)]
    if strange or not results:
        raise ArgumentError(
            f"holds {first_of(strange)}" if strange else "holds nothing to compare",
            where="results",
            expected="results, or paths of result.json",
        )
    if isinstance(scores, str):
        raise ArgumentError(f"is {scores!r}", where="scores", expected=f"a list: [{scores!r}]")
    if every and scores:
        raise ArgumentError("exclude each other", where="every, scores", expected="one of them")
    if len(results) == 1 and (reference or method):
        raise ArgumentError(
            "needs two results", where="reference or method", expected="several results"
        )


def _read(
    results: Sequence[Given], scores: Sequence[str], *, every: bool, every_column: bool
) -> list[Scored]:
    read: list[Scored] = []
    paths = results_here([result for result in results if not isinstance(result, Scored)])
    if paths:
        first = read_result(result_paths(paths)[0])
        read = read_scored(paths, None if every_column else score_keys(first, scores, every=every))
    files = iter(read)
    methods = [_rechecked(one) if isinstance(one, Scored) else next(files) for one in results]
    names = [method.name for method in methods]
    twice = [name for name in dict.fromkeys(names) if names.count(name) > 1]
    if twice:
        raise ArgumentError(
            f"several are called {first_of(twice)}",
            where="results",
            expected="methods of different names",
            fix="load_result(path, name=...)",
        )
    return methods


def _rechecked(one: Scored) -> Scored:
    """Check records against their result: those in memory may have changed since they were read."""
    return replace(one, records=checked_records(one.records, one.result, f"records of {one.name}"))


def _intervals(asked: Request, plan: ResamplingConfig) -> Comparison:
    (method,), scores, scene = asked.methods, asked.scores, asked.scene
    found = score_intervals(method, scores, plan, scene)
    table, result = intervals_table(method, scores, found, plan, scene), method.result
    parts: list[tuple[str | None, dict[str, float], list[Interval]]] = [
        (name, result.scenes[name], part) for name, part in found.groups.items()
    ]
    if scene is None:
        parts.append((None, result.overall, found.overall))
    return Comparison(
        table,
        _frame(
            [
                {
                    "scene": name,
                    "score": score.key,
                    "value": values[score.key],
                    "low": span.low,
                    "high": span.high,
                    "interval": span.method,
                    "reason": span.reason,
                }
                for name, values, spans in parts
                for score, span in zip(scores, spans, strict=True)
            ]
        ),
    )


def _pair(pair: Pair) -> dict[str, Any]:
    return {
        "score": pair.score.key,
        "method": pair.method,
        "reference": pair.reference,
        "value": pair.value,
        "reference_value": pair.reference_value,
        "difference": pair.difference,
        "low": pair.interval.low,
        "high": pair.interval.high,
        "p": pair.test.p_value,
        "p_holm": pair.p_holm,
        "p_mcnemar": pair.p_mcnemar,
        "wins": pair.wins,
        "ties": pair.ties,
        "losses": pair.losses,
        "verdict": verdict(pair),
    }


def _frame(rows: list[dict[str, Any]]) -> pd.DataFrame:
    import pandas as pd

    return pd.DataFrame(rows)
