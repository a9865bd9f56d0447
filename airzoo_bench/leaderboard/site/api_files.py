"""The files of a board's API, from methods that are measured and what is published."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.core.registry import load_track
from airzoo_bench.core.version import __version__
from airzoo_bench.leaderboard.board import Board
from airzoo_bench.leaderboard.site.api import (
    API,
    Benchmark,
    BoardIndex,
    MethodFile,
    TableFile,
    TableLink,
)
from airzoo_bench.leaderboard.site.downloads import bibtex
from airzoo_bench.leaderboard.site.entries import Entry
from airzoo_bench.leaderboard.site.history import versions
from airzoo_bench.leaderboard.site.measured import OVERALL, Measured
from airzoo_bench.leaderboard.site.reported import Reported, read_reported
from airzoo_bench.leaderboard.site.rows import Scored
from airzoo_bench.leaderboard.site.tables import About, Made, make_table, table_id
from airzoo_bench.protocol.lookup import load_protocol, protocol_files
from airzoo_bench.protocol.model import Protocol
from airzoo_bench.results.result import ScoreColumn, score_columns

__all__ = ["API_FOLDER", "MARK", "ApiFiles", "Given"]

API_FOLDER = "api/v1/"
MARK = f"{API_FOLDER}board.json"


@dataclass(frozen=True)
class Given:
    """What a board is built from.

    Attributes
    ----------
    runs, submissions : Path
        Folders, which need not be there.
    results : sequence of Path
        Plain results, as `table` takes them.
    data : Path
        Where prepared benchmarks may have protocols of their own.
    """

    runs: Path
    submissions: Path
    results: Sequence[Path]
    board: Board | None
    data: Path


@dataclass
class ApiFiles:
    """All files of the API, from methods with their earlier versions.

    Attributes
    ----------
    given : Given
    methods : list of (Scored, list of (Entry, Measured))
        Every shown method with its earlier versions, the newest first.
    cache : Path
    """

    given: Given
    methods: list[tuple[Scored, list[tuple[Entry, Measured]]]]
    cache: Path

    @cached_property
    def reported(self) -> Reported:
        """What is published, with the audit's findings."""
        return read_reported(self.cache)

    @cached_property
    def protocols(self) -> dict[str, Protocol]:
        """The protocols that the board is of, and those of its results that are known here."""
        files = protocol_files(self.given.data)
        load = cache(load_protocol)
        board = self.given.board
        wanted = [] if board is None else [p for b in board.benchmarks for p in b.protocols]
        if board is None:
            printed = {(table.benchmark, table.track) for table in self.reported.tables}
            known = {name: load(path) for name, path in files.items()}
            wanted = [n for n, p in known.items() if (p.benchmark, p.track) in printed]
        missing = [name for name in wanted if name not in files]
        if missing:
            raise SubmissionError(
                f"unknown protocol {missing[0]}",
                where="leaderboard.toml",
                fix="name the folder of prepared benchmarks by --data",
            )
        used = {scored.measured.protocol for scored, _ in self.methods}
        return {n: load(path) for n, path in files.items() if n in wanted or n in used}

    @cached_property
    def groups(self) -> dict[tuple[Any, ...], list[Scored]]:
        """The methods by what they measure."""
        found: dict[tuple[Any, ...], list[Scored]] = {}
        for scored, _ in self.methods:
            found.setdefault(scored.measured.measures, []).append(scored)
        return found

    @cached_property
    def current(self) -> dict[str, tuple[Any, ...]]:
        """What the ranked table of each protocol measures: the newest protocol and truth."""

        def newness(measures: tuple[Any, ...]) -> tuple[Any, ...]:
            methods = self.groups[measures]
            version = methods[0].measured.benchmark_version
            dates = max(one.entry.scored or "" for one in methods)
            return (measures[1], version, dates, len(methods), repr(measures))

        names = {measures[0] for measures in self.groups}
        return {name: max((m for m in self.groups if m[0] == name), key=newness) for name in names}

    @cached_property
    def ids(self) -> dict[tuple[Any, ...], str]:
        """The tables' ids by what they measure."""
        return {m: table_id(m[0], m, current=self.current[m[0]] == m) for m in self.groups}

    @cached_property
    def tables(self) -> list[Made]:
        """All tables: those with results, then those of published methods alone."""
        found = [
            make_table(self._about(measures), methods, self.reported)
            for measures, methods in sorted(self.groups.items(), key=lambda pair: self.ids[pair[0]])
        ]
        empty = [self._about_empty(p) for n, p in self.protocols.items() if n not in self.current]
        return [*found, *(make_table(about, [], self.reported) for about in empty)]

    def _about(self, measures: tuple[Any, ...]) -> About:
        first = self.groups[measures][0].measured
        protocol = self.protocols.get(first.protocol)
        return About(
            self.ids[measures],
            first.protocol if protocol is None else protocol.title,
            first.benchmark,
            self._benchmark_title(first.benchmark),
            first.track,
            first.protocol,
            first.protocol_version,
            first.protocol_fingerprint,
            self.current[first.protocol] == measures,
            self._apart(measures),
            (),
            protocol,
        )

    def _about_empty(self, protocol: Protocol) -> About:
        columns = score_columns(load_track(protocol.track).scores(protocol))
        return About(
            protocol.name,
            protocol.title,
            protocol.benchmark,
            self._benchmark_title(protocol.benchmark),
            protocol.track,
            protocol.name,
            protocol.version,
            protocol.fingerprint,
            True,
            "",
            self._printed_columns(protocol, columns),
            protocol,
        )

    def _printed_columns(
        self, protocol: Protocol, columns: Sequence[ScoreColumn]
    ) -> list[ScoreColumn]:
        """Keep those that are headline or printed somewhere."""
        titles = {scene.id: scene.title for scene in protocol.scenes}
        rows, _ = self.reported.rows(protocol.benchmark, protocol.track, columns, titles)
        printed = {key for row in rows for part in row.values.values() for key in part}
        return [column for column in columns if column.headline or column.key in printed]

    def _benchmark_title(self, name: str) -> str:
        board = self.given.board
        titles = {} if board is None else {one.name: one.title for one in board.benchmarks}
        shipped = [
            p.title.partition(",")[0] for p in self.protocols.values() if p.benchmark == name
        ]
        return titles.get(name, shipped[0] if shipped else name)

    def _apart(self, measures: tuple[Any, ...]) -> str:
        newest = self.current[measures[0]]
        if newest == measures:
            return ""
        own, other = (self.groups[m][0].measured for m in (measures, newest))
        if own.protocol_version != other.protocol_version:
            return f"an earlier protocol: {own.protocol} v{own.protocol_version}"
        if own.protocol_fingerprint != other.protocol_fingerprint:
            return f"another protocol of this name: {own.protocol_fingerprint[:12]}"
        if own.benchmark_version != other.benchmark_version:
            return f"an earlier truth: {own.benchmark} v{own.benchmark_version}"
        return f"another truth of {own.benchmark}: {own.truth[:12]}"

    @cached_property
    def files(self) -> dict[str, Any]:
        """Every file of the API by its path from the site's root."""
        found: dict[str, Any] = {}
        methods = {(self.ids[s.measured.measures], s.id): (s, old) for s, old in self.methods}
        for one in self.tables:
            base = f"{API_FOLDER}tables/{one.table.id}"
            found[f"{base}/table.json"] = one.table
            found |= one.files
            for row in one.table.rows:
                if row.kind != "floor":
                    pair = methods.get((one.table.id, row.id))
                    found[f"{base}/methods/{row.id}.json"] = MethodFile(
                        API,
                        one.table.id,
                        row,
                        {s: part for s, part in one.scenes[row.id].items() if s != OVERALL},
                        () if pair is None else tuple(versions(*pair, self.ids)),
                        bibtex(row, None if pair is None else pair[0].entry.submission, self.title),
                    )
        return {MARK: self._board(), **found}

    @property
    def title(self) -> str:
        """The board's title."""
        return "Leaderboard" if self.given.board is None else self.given.board.title

    def _board(self) -> BoardIndex:
        order = [] if self.given.board is None else [b.name for b in self.given.board.benchmarks]
        names = {one.table.benchmark: one.table.benchmark_title for one in self.tables}
        names = {n: names.get(n, self._benchmark_title(n)) for n in (*order, *sorted(names))}
        benchmarks = [
            Benchmark(name, title, tuple(map(self._link, self._in_order(name))))
            for name, title in names.items()
        ]
        dates = [link.updated for b in benchmarks for link in b.tables if link.updated]
        board = self.given.board
        return BoardIndex(
            API,
            self.title,
            *((None,) * 4 if board is None else board.addresses),
            max(dates, default=None),
            __version__,
            tuple(benchmarks),
        )

    def _in_order(self, benchmark: str) -> list[TableFile]:
        """Return a benchmark's tables in the order in which the board states their protocols."""
        board = self.given.board
        stated = [p for b in (board.benchmarks if board else ()) for p in b.protocols]
        own = [one.table for one in self.tables if one.table.benchmark == benchmark]
        names = dict.fromkeys([*stated, *sorted(table.protocol for table in own)])
        order = {name: number for number, name in enumerate(names)}
        return sorted(own, key=lambda t: (order[t.protocol], not t.current, t.id))

    def _link(self, table: TableFile) -> TableLink:
        dates = [row.rescored for row in table.rows if row.rescored]
        scored = sum(row.kind in ("re-scored", "sealed") for row in table.rows)
        return TableLink(
            table.id,
            table.title,
            table.track,
            table.protocol,
            table.protocol_version,
            table.sealed,
            table.current,
            table.apart,
            scored,
            sum(row.kind == "reported" for row in table.rows),
            max(dates, default=None),
        )
