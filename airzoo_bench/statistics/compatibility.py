"""Whether results may be compared, and if not, why."""

from __future__ import annotations

from collections.abc import Sequence

from airzoo_bench.core.errors import ResultError, first_of
from airzoo_bench.core.plurals import counted
from airzoo_bench.results import comparable
from airzoo_bench.results.comparable import check_score, named_scores
from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import Result, ScoreColumn

__all__ = ["check_comparable", "choose_scores", "score_keys"]


def check_comparable(methods: Sequence[Scored]) -> None:
    """Refuse results whose numbers do not measure the same on the same queries.

    Parameters
    ----------
    methods : sequence of Scored
        Results with their records, at least one.

    Raises
    ------
    ResultError
        Protocol, truth or queries of one differ from those of the first; it says in what.
    """
    comparable.check_comparable([m.name for m in methods], [m.result for m in methods])
    for other in methods[1:]:
        _check_queries(methods[0], other)


def _check_queries(first: Scored, other: Scored) -> None:
    if first.records["query"].equals(other.records["query"]):
        return
    one, two = set(first.records["query"]), set(other.records["query"])
    if one == two:
        return
    lonely = first_of(sorted(one ^ two), len(one | two))
    shared = f"only {counted(len(one & two), 'query')}" if one & two else "no query"
    raise ResultError(
        f"{first.name} and {other.name} have {shared} in common; not in both: {lonely}",
        expected="results on the same queries",
        fix="score all predictions again with the same benchmark folder",
    )


def choose_scores(
    methods: Sequence[Scored], wanted: Sequence[str], *, every: bool = False
) -> list[ScoreColumn]:
    """Find scores by key or title; where none is wanted, the headline ones that all have.

    Parameters
    ----------
    methods : sequence of Scored
        Results of one protocol.
    wanted : sequence of str
        Keys or titles, in the order of the answer.
    every : bool
        Where none is wanted, take every score that all have.

    Returns
    -------
    list of ScoreColumn
        Of the first result, each once.

    Raises
    ------
    ResultError
        The results have no score in common.
    UsageError
        They have no such score in common.
    """
    shared = [
        column
        for column in methods[0].result.columns
        if all(column in other.result.columns for other in methods[1:])
    ]
    if not wanted:
        found = [column for column in shared if every or column.headline]
        if not found:
            raise ResultError(
                "the results have no score in common",
                expected="results of one track, with the same scores",
                fix="score all predictions again with the same version and protocol",
            )
        return found
    some = named_scores(column for method in methods for column in method.result.columns)
    for name in wanted:
        lacking = "leave out the results that lack it: not all have it" * (name in some)
        check_score(name, shared, "--score", lacking)
    by_name = named_scores(shared)
    return list({by_name[name].key: by_name[name] for name in wanted}.values())


def score_keys(result: Result, wanted: Sequence[str], *, every: bool = False) -> set[str]:
    """Return the keys of the scores that `choose_scores` can choose, before records are read.

    Parameters
    ----------
    result : Result
        Any of the results of a protocol.
    wanted : sequence of str
        Keys or titles; none means the headline scores.
    every : bool
        Instead of the headline scores, all of them.

    Returns
    -------
    set of str
        The columns of records that are needed.
    """
    return {
        column.key
        for column in result.columns
        if every or {column.key, column.title} & set(wanted) or (not wanted and column.headline)
    }
