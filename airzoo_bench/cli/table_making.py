"""Builds the table that a request asks for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from airzoo_bench.cli.common import scores_of
from airzoo_bench.cli.table_marks import in_digits, marked
from airzoo_bench.cli.table_request import Layout, TableRequest
from airzoo_bench.core.errors import UsageError
from airzoo_bench.results.comparable import check_score, find_scene, named_scores
from airzoo_bench.results.files import result_paths
from airzoo_bench.results.result import Result, ScoreColumn, read_result
from airzoo_bench.tables.marks import rename
from airzoo_bench.tables.method_table import (
    OVERALL,
    MethodTable,
    method_table,
    with_floors,
    with_published,
)

if TYPE_CHECKING:
    from airzoo_bench.tables.model import Table

__all__ = ["make_table"]


def make_table(request: TableRequest) -> Table:
    """Read the results that a request names and lay them out.

    Raises
    ------
    UsageError
        Options do not fit together, or name what is not there.
    ResultError
        A result cannot be read, or results cannot stand in one table.
    """
    # What is published needs no results, and where a protocol is named they are refused unread.
    paths = () if request.protocol is not None else result_paths(request.results)
    results = tuple(read_result(path) for path in paths)
    return _TableMaker(request, request.checked_layout(results), paths, results).table()


@dataclass(frozen=True)
class _TableMaker:
    """A request, its layout, and the files and results that were read for it."""

    request: TableRequest
    layout: Layout
    paths: tuple[Path, ...]
    results: tuple[Result, ...]

    def table(self) -> Table:
        """Lay the results out and mark them."""
        return (
            self._alone()
            if self.layout is Layout.RESULT
            else marked(self._laid_out(), self.request, self.results)
        )

    def _alone(self) -> Table:
        from airzoo_bench.tables.layouts import scenes_table

        (table,) = self._tables()
        (entry,) = table.rows
        made = scenes_table(
            self.results[0],
            scores=table.scores,
            uncertainties=entry.uncertainties,
            floors=self.request.floors,
        )
        # The table has the result's own notes, and whose they are goes without saying.
        without = self._without_interval(made)
        notes, about = (*table.notes, *without), (*table.about_intervals, *without)
        made = replace(
            made, notes=(*notes, *made.notes, *self._floors_hint()), legend=(*about, *made.legend)
        )
        return rename(in_digits(made, self.request), self.request.renamed)

    def _floors_hint(self) -> list[str]:
        names = ", ".join(self.results[0].references)
        return (
            [f"not shown: {names}; --floors adds it"] if names and not self.request.floors else []
        )

    def _without_interval(self, made: Table) -> list[str]:
        """Say why pooled values and floors have no interval."""
        from airzoo_bench.tables.layouts import POOLED

        if not self.request.intervals:
            return []
        names = [row.cells[0].value for row in made.rows]
        floors = ", ".join(self.results[0].references) if self.request.floors else ""
        pooled = f"no interval for {POOLED}: intervals are of scenes and of the average over scenes"
        return [pooled] * (POOLED in names) + _of_floors(floors)

    def _laid_out(self) -> Table:
        from airzoo_bench.tables.layouts import benchmarks_layout, methods_layout, scenes_layout

        asked, tables = self.request, self._tables()
        if self.layout is Layout.BENCHMARKS:
            kept = [table for table in tables if table.scores]
            made = benchmarks_layout(kept)
            return replace(made, notes=(*self._left_out(tables), *made.notes))
        if self.layout is Layout.METHODS:
            return methods_layout(tables[0], asked.scene)
        return scenes_layout(tables[0], average=asked.average, queries=asked.queries)

    def _tables(self) -> list[MethodTable]:
        """Return a table of methods for each protocol, with the scores to show, if it has any."""
        wanted = self.request.scores
        if self.request.protocol is not None:
            return [self._published_alone(self.request.protocol)]
        parts = _by_protocol(self.results)
        tables = [
            method_table(
                [self.results[place] for place in places],
                paths=[self.paths[place] for place in places],
                every_score=self.request.every_score or bool(wanted),
            )
            for places in parts
        ]
        for name in wanted:
            check_score(name, [score for table in tables for score in table.scores], "--score")
        chosen = [replace(table, scores=_chosen(table.scores, wanted)) for table in tables]
        return [
            self._filled(table, places) if table.scores else table
            for table, places in zip(chosen, parts, strict=True)
        ]

    def _left_out(self, tables: Sequence[MethodTable]) -> list[str]:
        titles = [table.title for table in tables if not table.scores]
        wanted = " or ".join(self.request.scores)
        return [f"left out, having no {wanted}: {', '.join(titles)}"] if titles else []

    def _filled(self, table: MethodTable, places: Sequence[int]) -> MethodTable:
        if self.request.intervals:
            table = self._with_intervals(table, places)
        if self.request.published:
            table = self._with_published(table, self.results[places[0]])
        if self.request.floors and self.layout is not Layout.RESULT:
            table = with_floors(table, [self.results[place] for place in places])
            if self.request.intervals:
                floors = ", ".join(entry.method for entry in table.rows if entry.floor)
                table = table.noted(*_of_floors(floors), legend=True)
        return table

    def _with_intervals(self, table: MethodTable, places: Sequence[int]) -> MethodTable:
        from airzoo_bench.results.records import Scored, read_records
        from airzoo_bench.statistics.samples import ResamplingConfig
        from airzoo_bench.tables.intervals import with_intervals

        methods = [
            Scored(entry.method, self.results[place], read_records(self.paths[place]))
            for entry, place in zip(table.rows, places, strict=True)
        ]
        made = with_intervals(table, methods, ResamplingConfig(), self._shown(table))
        return replace(made, about_intervals=made.notes[len(table.notes) :])

    def _shown(self, table: MethodTable) -> list[str]:
        """Return the scenes that the table shows, with the key of the average."""
        if self.layout in (Layout.RESULT, Layout.SCENES):
            return [*table.scenes, *[OVERALL] * self.request.average]
        scene = self.request.scene
        return [OVERALL if scene is None else find_scene(table.scenes, scene)]

    def _published_alone(self, name: str) -> MethodTable:
        """Return a table of methods with what is published on a protocol."""
        from airzoo_bench.tables.published import published_benchmarks

        wanted = self.request.scores
        protocol, columns = scores_of(name)
        every_score = self.request.every_score or bool(wanted)
        scores = [column for column in columns if every_score or column.headline]
        for score in wanted:
            check_score(score, scores, "--score")
        table = MethodTable(
            f"{protocol.name} v{protocol.version}",
            protocol.benchmark,
            protocol.track,
            _chosen(scores, wanted),
            {scene.id: scene.title for scene in protocol.scenes},
            {},
            (),
        )
        table = self._next_to_published(table)
        if not table.rows:
            raise UsageError(
                f"nothing is published on {table.benchmark} ({table.track})",
                where=f"--protocol {name}",
                expected="a protocol of a benchmark of a paper's tables: "
                + ", ".join(published_benchmarks(table.track)),
                fix="see `airzoo-bench protocols`",
            )
        printed = {key for e in table.rows for part in e.values.values() for key in part}
        if wanted:
            return table
        return replace(table, scores=tuple(s for s in table.scores if s.key in printed))

    def _with_published(self, table: MethodTable, result: Result) -> MethodTable:
        from airzoo_bench.tables.published import published_tables, shipped_fingerprints

        published = published_tables(table.benchmark, table.track)
        shipped = shipped_fingerprints(table.benchmark, table.track)
        if published and result.protocol.fingerprint not in shipped:
            note = (
                f"{table.title} is not the shipped protocol: reported numbers may measure "
                "something else"
            )
            table = table.noted(note, legend=True)
        return self._next_to_published(table)

    def _next_to_published(self, table: MethodTable) -> MethodTable:
        from airzoo_bench.tables.published import published_benchmarks, published_tables

        asked = self.request
        by_scene = self.layout is Layout.SCENES or asked.scene is not None
        published = published_tables(table.benchmark, table.track)
        average = asked.average and asked.scene is None
        elsewhere = published_benchmarks(table.track, by_scene=by_scene)
        return with_published(
            table, published, by_scene=by_scene, average=average, elsewhere=elsewhere
        )


def _of_floors(names: str) -> list[str]:
    return [f"no interval for {names}: intervals are of methods"] if names else []


def _by_protocol(results: Sequence[Result]) -> list[list[int]]:
    """Group the indices of results by the name of their protocol."""
    found: dict[str, list[int]] = {}
    for place, result in enumerate(results):
        found.setdefault(result.protocol.name, []).append(place)
    return list(found.values())


def _chosen(scores: Sequence[ScoreColumn], wanted: Sequence[str]) -> tuple[ScoreColumn, ...]:
    """Return the scores named by key or title, in that order; all if none is named."""
    if not wanted:
        return tuple(scores)
    by_name = named_scores(scores)
    return tuple(dict.fromkeys(by_name[name] for name in wanted if name in by_name))
