"""Marks a table that is laid out: order, digits, best values, gains, citations, names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from airzoo_bench.cli.common import scores_of
from airzoo_bench.cli.table_request import TableRequest
from airzoo_bench.results.comparable import check_score, named_scores
from airzoo_bench.results.result import Result, ScoreColumn
from airzoo_bench.tables.layouts import AVERAGE
from airzoo_bench.tables.marks import BY_NAME, rename, sort_rows, with_decimals

if TYPE_CHECKING:
    from airzoo_bench.tables.model import Table

__all__ = ["in_digits", "marked"]


def marked(made: Table, asked: TableRequest, results: Sequence[Result]) -> Table:
    """Sort a table, mark its best values, and add gains and citations."""
    from airzoo_bench.tables.marks import add_gains, highlight, mark_best, parse_baselines

    made = in_digits(_sorted(made, asked, results), asked)
    made = mark_best(made, second=asked.second)
    rule = _rule_of_marks(made)
    made = replace(made, notes=(*rule, *made.notes), legend=(*rule, *made.legend))
    made = highlight(made, asked.highlighted)
    baselines = parse_baselines(made, asked.baselines)
    made = _cited(made, asked.citations) if asked.citations else made
    # Options go by the names of results, and all that is said by those of the table.
    return rename(add_gains(made, baselines), asked.renamed)


def in_digits(made: Table, asked: TableRequest) -> Table:
    """Show values with the digits that were asked for, if any were."""
    return made if asked.decimals is None else with_decimals(made, asked.decimals)


def _sorted(made: Table, asked: TableRequest, results: Sequence[Result]) -> Table:
    wanted = asked.sort
    if wanted is None:
        return made
    if wanted != BY_NAME:
        shown = {column.title for column in made.columns}
        columns = _known_scores(asked, results)
        scores = [score for score in columns.values() if score.title in shown]
        hidden = wanted in named_scores(columns.values())
        check_score(wanted, scores, "--sort", f"add --score {wanted!r} to show it" * hidden)
        wanted = named_scores(scores)[wanted].title
    return sort_rows(made, wanted, AVERAGE)


def _known_scores(asked: TableRequest, results: Sequence[Result]) -> dict[str, ScoreColumn]:
    """Return all scores that there are, shown or not, by key."""
    if asked.protocol is None:
        columns = [score for result in results for score in result.columns]
    else:
        columns = scores_of(asked.protocol)[1]
    return {score.key: score for score in columns}


def _cited(made: Table, citations: Sequence[str]) -> Table:
    from airzoo_bench.tables.marks import add_citations
    from airzoo_bench.tables.published import published_sources, read_source_file

    sources = {name: read_source_file(path).citations for name, path in published_sources().items()}
    return add_citations(made, citations, sources)


def _rule_of_marks(made: Table) -> list[str]:
    # Among reported rows alone there is nothing to tell apart.
    if len({bool(row.reported) for row in made.rows if not row.floor}) < 2:
        return []
    return ["the best of each score is that of the rows that were scored here"]
