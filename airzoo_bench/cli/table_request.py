"""What a call of ``airzoo-bench table`` asks for, and the table that answers it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

from airzoo_bench.errors import UsageError
from airzoo_bench.validation import nearest

if TYPE_CHECKING:
    from airzoo_bench.result import Result, ScoreColumn
    from airzoo_bench.statistics.intervals import Interval
    from airzoo_bench.tables.entries import Board
    from airzoo_bench.tables.model import Table, Uncertainty

__all__ = ["Layout", "TableRequest"]


class Layout(StrEnum):
    """How results are laid out."""

    RESULT = "result"
    METHODS = "methods"
    SCENES = "scenes"
    BENCHMARKS = "benchmarks"


@dataclass(frozen=True)
class TableRequest:
    """The options of the command that change what a table says; see there."""

    results: tuple[Path, ...]
    layout: Layout | None = None
    scene: str | None = None
    every_score: bool = False
    scores: tuple[str, ...] = ()
    published: bool = False
    mark_published: bool = False
    second: bool = False
    baselines: tuple[str, ...] = ()
    highlighted: tuple[str, ...] = ()
    citations: tuple[str, ...] = ()
    intervals: bool = False
    queries: bool = False
    average: bool = True
    per_block: int | None = None

    def answer(self) -> Table:
        """Read the results and lay them out.

        Raises
        ------
        UsageError
            Options do not fit together, or name what is not there.
        ResultError
            A result cannot be read, or results cannot stand in one table.
        """
        from airzoo_bench.result import read_result
        from airzoo_bench.tables.build import scenes_table

        self._check()
        results = [read_result(path) for path in self.results]
        if self._layout is Layout.RESULT:
            return scenes_table(results[0], every_score=self.every_score)
        return self._marked(self._laid_out(results))

    @property
    def _layout(self) -> Layout:
        if self.layout is not None:
            return self.layout
        # One result has nothing to be compared with, unless a row of methods is asked for.
        return Layout.METHODS if len(self.results) > 1 or self._of_methods else Layout.RESULT

    @property
    def _of_methods(self) -> list[str]:
        given = {
            "--scene": self.scene,
            "--score": self.scores,
            "--published": self.published,
            "--second": self.second,
            "--baseline": self.baselines,
            "--highlight": self.highlighted,
            "--cite": self.citations,
            "--intervals": self.intervals,
        }
        return [name for name, value in given.items() if value]

    def _check(self) -> None:
        layout = self._layout
        if layout is Layout.RESULT and (len(self.results) > 1 or self._of_methods):
            odd = " and ".join(self._of_methods) or f"{len(self.results)} results"
            raise UsageError(
                f"layout result shows one result as it is, and takes no {odd}",
                mend="choose --layout methods or scenes",
            )
        wrong = {
            "--scene": bool(self.scene) and layout is not Layout.METHODS,
            "--queries": self.queries and layout is not Layout.SCENES,
            "--no-average": not self.average and layout is not Layout.SCENES,
            "--per-block": bool(self.per_block) and layout in (Layout.METHODS, Layout.RESULT),
            "--mark-published": self.mark_published and not self.published,
        }
        for name, is_wrong in wrong.items():
            if is_wrong:
                needs = "--published" if name == "--mark-published" else "another layout"
                raise UsageError(f"{name} does not go with layout {layout}: it needs {needs}")

    def _laid_out(self, results: list[Result]) -> Table:
        from airzoo_bench.tables.layouts import benchmarks_layout, methods_layout, scenes_layout

        if self._layout is Layout.BENCHMARKS:
            boards = [self._board(members) for members in _by_protocol(results)]
            return benchmarks_layout(boards, per_block=self.per_block or 4)
        board = self._board(list(enumerate(results)))
        if self._layout is Layout.METHODS:
            return methods_layout(board, self.scene)
        return scenes_layout(
            board, average=self.average, queries=self.queries, per_block=self.per_block or 2
        )

    def _board(self, numbered: list[tuple[int, Result]]) -> Board:
        from airzoo_bench.tables.entries import board_of

        results = [result for _, result in numbered]
        board = board_of(results, every_score=self.every_score or bool(self.scores))
        board = replace(board, scores=_chosen(board.scores, self.scores))
        if self.intervals:
            board = _with_intervals(board, [self.results[number] for number, _ in numbered])
        return self._with_published(board, results[0]) if self.published else board

    def _with_published(self, board: Board, result: Result) -> Board:
        from airzoo_bench.published import published_tables, shipped_fingerprints
        from airzoo_bench.tables.entries import with_published

        by_scene = self._layout is Layout.SCENES or self.scene is not None
        tables = published_tables(board.benchmark, board.track)
        if tables and result.protocol.fingerprint not in shipped_fingerprints(
            board.benchmark, board.track
        ):
            note = (
                f"{board.title} is not the shipped protocol: reported numbers may measure "
                "something else"
            )
            board = replace(board, notes=(*board.notes, note))
        return with_published(board, tables, by_scene=by_scene)

    def _marked(self, made: Table) -> Table:
        from airzoo_bench.published import published_sources, read_source_file
        from airzoo_bench.tables.citations import add_citations
        from airzoo_bench.tables.marks import add_gains, highlight, parse_baselines
        from airzoo_bench.tables.model import mark_best

        made = mark_best(made, second=self.second, reported=self.mark_published)
        made = replace(made, notes=(*self._rule_of_marks(made), *made.notes))
        made = highlight(made, self.highlighted)
        made = add_gains(made, parse_baselines(made, self.baselines))
        if not self.citations:
            return made
        sources = {
            name: read_source_file(path).citations for name, path in published_sources().items()
        }
        return add_citations(made, self.citations, sources)

    def _rule_of_marks(self, made: Table) -> list[str]:
        if not any(row.reported for row in made.rows):
            return []
        who = "all rows" if self.mark_published else "the rows that were scored here"
        return [f"the best of each score is that of {who}"]


def _by_protocol(results: list[Result]) -> list[list[tuple[int, Result]]]:
    found: dict[str, list[tuple[int, Result]]] = {}
    for number, result in enumerate(results):
        found.setdefault(result.protocol.name, []).append((number, result))
    return list(found.values())


def _chosen(scores: Sequence[ScoreColumn], wanted: Sequence[str]) -> tuple[ScoreColumn, ...]:
    """Return the scores that are named by key or title, in that order; all where none is."""
    if not wanted:
        return tuple(scores)
    by_name = {score.key: score for score in scores} | {score.title: score for score in scores}
    for name in wanted:
        if name not in by_name:
            raise UsageError(
                f"there is no score {name[:80]!r}{nearest(name[:80], list(by_name))}",
                where="--score",
                expected="one of " + ", ".join(score.title for score in scores),
            )
    return tuple(dict.fromkeys(by_name[name] for name in wanted))


def _with_intervals(board: Board, paths: Sequence[Path]) -> Board:
    from airzoo_bench.records import read_scored
    from airzoo_bench.statistics.comparison import score_intervals
    from airzoo_bench.statistics.samples import Plan
    from airzoo_bench.tables.entries import OVERALL

    plan = Plan()
    entries = []
    for entry, method in zip(board.entries, read_scored(paths), strict=True):
        held = {column.key for column in method.result.columns}
        scores = [score for score in board.scores if score.key in held]
        found = score_intervals(method, scores, plan)
        parts = {OVERALL: found.overall} | found.groups
        spans = {scene: _spans(scores, intervals) for scene, intervals in parts.items()}
        entries.append(replace(entry, uncertainties=spans))
    note = f"in square brackets: 95 % intervals, {plan.resamples} resamples, seed {plan.seed}"
    return replace(board, entries=tuple(entries), notes=(note, *board.notes))


def _spans(scores: Sequence[ScoreColumn], intervals: Sequence[Interval]) -> dict[str, Uncertainty]:
    from airzoo_bench.tables.entries import as_shown
    from airzoo_bench.tables.model import Between

    return {
        score.key: Between(as_shown(score, interval.low), as_shown(score, interval.high))
        for score, interval in zip(scores, intervals, strict=True)
        if interval.low is not None and interval.high is not None
    }
