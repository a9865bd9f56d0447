"""board.json, all that a board shows: tables with rows, scenes, conditions, ranks and history."""

from __future__ import annotations

import hashlib
import math
import re
import unicodedata
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from airzoo_bench.audit.audit import audit
from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.core.registry import load_track
from airzoo_bench.core.version import __version__
from airzoo_bench.datasets.about import about_file, about_of
from airzoo_bench.leaderboard.board import Board
from airzoo_bench.leaderboard.measured import OVERALL, RESAMPLING, Entry, Measured, Number
from airzoo_bench.leaderboard.ranking import Ranked, alike, headline_first, rank
from airzoo_bench.protocol.lookup import load_protocol, protocol_files
from airzoo_bench.protocol.model import Protocol
from airzoo_bench.results.result import ScoreColumn, score_columns
from airzoo_bench.statistics.intervals import Interval
from airzoo_bench.tables.intervals import intervals_made, resampled
from airzoo_bench.tables.method_table import MethodRow, MethodTable, as_shown, with_published
from airzoo_bench.tables.model import show_number
from airzoo_bench.tables.published import (
    published_benchmarks,
    published_sources,
    published_tables,
    read_published,
    read_source_file,
    shipped_fingerprints,
)

__all__ = ["SCHEMA", "Json", "make_board", "plain_json"]

SCHEMA = 2
"""The version of board.json; a field that goes, or means something else, makes it a new one."""

Json = dict[str, Any]

_UNITS = {"share": "points", "m": "m", "deg": "deg"}
_LONGEST = 40
_RANKS = (
    "Rank ranges: from 1 plus the methods that are significantly better to N minus those that are "
    "significantly worse, of the N methods that were scored here. "
)
_PAIRED = (
    "Paired tests of every two methods, Holm's correction for all pairs of a column, 5 %. "
    "≈ marks methods that a paired test with the best alone cannot tell from it at 5 %."
)
_UNPAIRED = (
    "The truth is sealed, so methods are compared by their rounded scores and standard errors, "
    "which are added as if no two methods erred alike: ranges are wider than paired tests would "
    "give. Holm's correction for all pairs of a column, 5 %. A method without a standard error is "
    "told from no other."
)
_SEALED = "95 % intervals: the rounded score and 1.96 rounded standard errors to each side."


def make_board(entries: Sequence[Entry], board: Board | None, data: Path, cache: Path) -> Json:
    """Put entries and published numbers into tables, and the tables into a board."""
    return _Builder(entries, board, data, cache).board_json()


def plain_json(value: Any) -> Any:
    """Return what JSON holds: infinite numbers as text, as result.json has them."""
    if isinstance(value, float):
        if math.isfinite(value):
            return value
        return None if math.isnan(value) else "Infinity" if value > 0 else "-Infinity"
    if isinstance(value, Mapping):
        return {key: plain_json(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [plain_json(part) for part in value]
    return value


class _Builder:
    """The entries, in groups that measure the same, and all else that tables are made of."""

    def __init__(
        self, entries: Sequence[Entry], board: Board | None, data: Path, cache: Path
    ) -> None:
        self.entries, self.board, self.cache = entries, board, cache
        self.groups: dict[tuple[Any, ...], list[Entry]] = {}
        shown = [(entry, entry.measured) for entry in entries if entry.measured is not None]
        for entry, one in sorted(
            shown, key=lambda pair: (pair[0].method, pair[0].number, pair[1].key)
        ):
            self.groups.setdefault(one.measures, []).append(entry)
        # The newest of a protocol, which is the last, has the protocol's name.
        self.current = {measures[0]: measures for measures in sorted(self.groups, key=self._age)}
        self.ids = {
            measures: measures[0]
            if self.current[measures[0]] == measures
            else f"{measures[0]}-{hashlib.sha256(repr(measures).encode()).hexdigest()[:8]}"
            for measures in self.groups
        }
        self.protocols = self._find_protocols({one.protocol for _, one in shown}, data)

    def _age(self, measures: tuple[Any, ...]) -> tuple[Any, ...]:
        """Order groups by protocol and truth, the newest last."""
        members = self.groups[measures]
        dates = max(entry.scored or "" for entry in members)
        version = _measured(members[0]).benchmark_version or 0
        return measures[1], version, dates, len(members), repr(measures)

    def _find_protocols(self, used: set[str], data: Path) -> dict[str, Protocol]:
        """Return the protocols that the board is of, and those of its results."""
        files = protocol_files(data)
        if self.board is None:
            known = {name: load_protocol(path) for name, path in files.items()}
            printed = {p.track: {*published_benchmarks(p.track)} for p in known.values()}
            return {n: p for n, p in known.items() if n in used or p.benchmark in printed[p.track]}
        if missing := [name for name in self.board.protocols if name not in files]:
            raise SubmissionError(
                f"unknown protocol {missing[0]}",
                where="leaderboard.toml",
                fix="put the prepared benchmark into $AIRZOO_BENCH_DATA",
            )
        used |= {*self.board.protocols}
        return {name: load_protocol(path) for name, path in files.items() if name in used}

    def board_json(self) -> Json:
        """Return the whole board, tables in the order of leaderboard.toml."""
        tables = [
            self._table(self._head_of_entries(measures), members)
            for measures, members in sorted(self.groups.items(), key=lambda g: self.ids[g[0]])
        ]
        tables += [
            self._table(self._head_of_protocol(protocol), [])
            for name, protocol in self.protocols.items()
            if name not in self.current
        ]
        board = self.board
        order = {name: n for n, name in enumerate(board.protocols if board else ())}
        tables.sort(
            key=lambda t: (
                order.get(t["protocol"], len(order)),
                t["protocol"],
                not t["current"],
                t["id"],
            )
        )
        names = [one.name for one in board.benchmarks] if board else []
        names = list(dict.fromkeys([*names, *sorted(table["benchmark"] for table in tables)]))
        dates = [row["rescored"] for table in tables for row in table["rows"] if row["rescored"]]
        home = board and board.repository_url
        return {
            "schema": SCHEMA,
            "title": board.title if board else "Leaderboard",
            "url": board and board.url,
            "repository": board and board.repository,
            "repository_url": home,
            "data_url": home and f"{home}/tree/leaderboard-data",
            "updated": max(dates, default=None),
            "made_with": __version__,
            "benchmarks": [
                {
                    "name": name,
                    "title": self._benchmark_title(name),
                    "tables": [table["id"] for table in tables if table["benchmark"] == name],
                }
                for name in names
            ],
            "tables": {table["id"]: table for table in tables},
        }

    def _benchmark_title(self, name: str) -> str:
        """Return the title that the board gives a benchmark, or the one of its protocols."""
        stated = (
            (one.title for one in self.board.benchmarks if one.name == name) if self.board else ()
        )
        shipped = (
            p.title.partition(",")[0] for p in self.protocols.values() if p.benchmark == name
        )
        return next(iter([*stated, *shipped]), name)

    # --- tables ---

    def _head_of_entries(self, measures: tuple[Any, ...]) -> Json:
        """Return the facts of a table of results."""
        first = _measured(self.groups[measures][0])
        newest = _measured(self.groups[self.current[measures[0]]][0])
        protocol, apart = self.protocols.get(first.protocol), _apart(first, newest)
        return {
            "id": self.ids[measures],
            "title": protocol.title if protocol else first.protocol,
            "summary": " ".join(protocol.summary.split()) if protocol else "",
            "benchmark": first.benchmark,
            "benchmark_title": self._benchmark_title(first.benchmark),
            "benchmark_version": first.benchmark_version,
            "track": first.track,
            "protocol": first.protocol,
            "protocol_version": first.protocol_version,
            "protocol_fingerprint": first.protocol_fingerprint,
            "truth": first.truth,
            "sealed": first.sealed,
            "current": not apart,
            "apart": apart,
            "unit": first.unit,
            "scenes": first.scenes,
        }

    def _head_of_protocol(self, protocol: Protocol) -> Json:
        """Return the facts of a table without any result."""
        return {
            "id": protocol.name,
            "title": protocol.title,
            "summary": " ".join(protocol.summary.split()),
            "benchmark": protocol.benchmark,
            "benchmark_title": self._benchmark_title(protocol.benchmark),
            "benchmark_version": None,
            "track": protocol.track,
            "protocol": protocol.name,
            "protocol_version": protocol.version,
            "protocol_fingerprint": protocol.fingerprint,
            "truth": "",
            "sealed": False,
            "current": True,
            "apart": "",
            "unit": "query",
            "scenes": [
                {"id": s.id, "title": s.title, "queries": s.queries} for s in protocol.scenes
            ],
        }

    def _table(self, head: Json, members: Sequence[Entry]) -> Json:
        """Rank the entries of a table; put published methods and failed submissions beside them."""
        members, odd = alike(members)
        measured = [_measured(entry) for entry in members]
        columns = headline_first(measured) or self._columns_of_protocol(head["protocol"])
        ranked = {c.key: rank(measured, c, self.cache) for c in columns if c.headline and measured}
        conditions = measured[0].conditions if measured else []
        rows = [
            _row_of_entry(entry, n, ranked)
            | {"history": self._history(entry), "conditions": _condition_values(conditions, one)}
            for n, (entry, one) in enumerate(zip(members, measured, strict=True))
        ]
        reported, notes = self._reported(head, columns)
        if not measured:
            printed = {key for row in reported for part in row["numbers"].values() for key in part}
            columns = [column for column in columns if column.headline or column.key in printed]
        rows += reported
        known = {key for row in rows for key in row["numbers"].get(OVERALL, {})}
        lead = next((column for column in columns if column.key in known), columns[0])
        rows.sort(key=lambda row: _order(lead, row))
        rows += _floors(measured)
        rows += [_stated(entry) | {"kind": "failed", "reason": why} for entry, why in odd]
        rows += self._faults(head) if head["current"] else []
        rows, ids = _with_ids(rows, [column.key for column in columns])
        about = _RANKS + (_UNPAIRED if head["sealed"] else _PAIRED)
        versions = sorted({one.made_with for one in measured})
        return head | {
            "scores": [column.model_dump() for column in columns],
            "conditions": [
                {key: one[key] for key in ("by", "title", "labels", "counts")} for one in conditions
            ],
            "rows": rows,
            "pairs": {key: {"ids": ids} | one.pairs for key, one in ranked.items() if one.pairs},
            "about_ranks": about if measured else "",
            "about_intervals": _about_intervals(measured),
            "notes": [
                *notes,
                *([f"scored by airzoo-bench {', '.join(versions)}"] if versions else []),
            ],
            "data": _data_page(head["benchmark"]),
            "paper": _paper(head["benchmark"]),
        }

    def _columns_of_protocol(self, name: str) -> list[ScoreColumn]:
        protocol = self.protocols[name]
        columns = score_columns(load_track(protocol.track).scores(protocol))
        return sorted(columns, key=lambda column: not column.headline)

    def _faults(self, head: Json) -> Iterator[Json]:
        """Yield a row for each submission to a table that has no numbers."""
        for entry in self.entries:
            place, stated = entry.place, entry.submission
            is_here = place is not None and place[:2] == (head["benchmark"], head["track"])
            is_for_it = stated is None or stated.protocol == head["protocol"]
            if entry.measured is None and is_here and is_for_it:
                yield _stated(entry) | {"kind": "failed", "reason": entry.reason}

    def _history(self, entry: Entry) -> list[Json]:
        """Return the versions of a submission, the newest first, and what changed."""
        if entry.place is None:
            return []
        versions = [entry, *entry.older]
        found = []
        for one, before in zip(versions, [*versions[1:], None], strict=True):
            measured = _measured(one)
            found.append(
                {
                    "number": one.number,
                    "method": one.method,
                    "date": one.submission.date.isoformat() if one.submission else None,
                    "rescored": one.scored,
                    "made_with": measured.made_with,
                    "table": self.ids.get(measured.measures, ""),
                    "scores": {key: n[0] for key, n in measured.scores[OVERALL].items()},
                    "changes": _changes(measured, _measured(before)) if before else "",
                    "files": f"{entry.place.runs}/{one.number}",
                }
            )
        return found

    # --- published methods ---

    def _reported(self, head: Json, columns: Sequence[ScoreColumn]) -> tuple[list[Json], list[str]]:
        """Return the rows of published methods, none beside a sealed truth, and notes on them."""
        benchmark, track = head["benchmark"], head["track"]
        tables = [] if head["sealed"] else published_tables(benchmark, track)
        if not tables:
            return [], []
        scenes = {scene["id"]: scene["title"] for scene in head["scenes"]}
        empty = MethodTable("", benchmark, track, tuple(columns), scenes)
        scenic = any(table.has_scenes for table in tables)
        made = with_published(empty, tables, by_scene=scenic)
        rows = {row.method: row for row in made.rows}
        if scenic:
            for row in with_published(empty, tables, by_scene=False).rows:
                rows.setdefault(row.method, row)
        ids = {title: scene for scene, title in scenes.items()} | {OVERALL: OVERALL}
        found = [
            {
                "kind": "reported",
                "method": row.method,
                "source": row.reported,
                "numbers": _printed_numbers(columns, row),
                "findings": [
                    finding | {"scene": ids[finding["scene"]]}
                    for finding in _find_doubts().get((benchmark, track, row.method), ())
                    if finding["scene"] in ids
                ],
            }
            for row in rows.values()
            if row.values
        ]
        notes = list(made.notes)
        if found and head["protocol_fingerprint"] not in shipped_fingerprints(benchmark, track):
            notes.append("not the shipped protocol: reported numbers may measure something else")
        return found, notes


@cache
def _find_doubts() -> dict[tuple[str, str, str], list[Json]]:
    """Audit the sources that travel with the package; by benchmark, track and method."""
    found: dict[tuple[str, str, str], list[Json]] = {}
    for path in published_sources().values():
        source = read_source_file(path)
        for one in audit(read_published(path.with_name(source.data))).findings:
            cell = one.cell
            key = (source.benchmarks.get(cell.benchmark, ""), cell.track, cell.method)
            found.setdefault(key, []).append(
                {
                    "scene": OVERALL if cell.is_summary else cell.scene,
                    "score": source.scores.get(cell.track, {}).get(cell.score.name, ""),
                    "grade": one.grade.value,
                    "check": one.check,
                    "printed": cell.number.text,
                    "why": one.why,
                    "source": ", ".join(filter(None, (source.name, cell.table))),
                }
            )
    return found


def _measured(entry: Entry) -> Measured:
    assert entry.measured is not None
    return entry.measured


def _apart(own: Measured, newest: Measured) -> str:
    """Say why a table is not comparable with the current one of its protocol."""
    if own.measures == newest.measures:
        return ""
    if own.protocol_version != newest.protocol_version:
        return f"an earlier protocol: {own.protocol} v{own.protocol_version}"
    if own.protocol_fingerprint != newest.protocol_fingerprint:
        return f"another protocol of this name: {own.protocol_fingerprint[:12]}"
    if own.benchmark_version != newest.benchmark_version:
        return f"an earlier truth: {own.benchmark} v{own.benchmark_version}"
    return f"another truth of {own.benchmark}: {own.truth[:12]}"


def _order(lead: ScoreColumn, row: Json) -> tuple[bool, float, str]:
    number = row["numbers"].get(OVERALL, {}).get(lead.key)
    if number is None:
        return True, 0.0, row["method"]
    return False, -number[0] if lead.higher_is_better else number[0], row["method"]


def _about_intervals(measured: Sequence[Measured]) -> str:
    if not measured or measured[0].sealed:
        return _SEALED if measured else ""
    kinds = sorted({kind for one in measured for kind in one.interval_kinds})
    every = [Interval(0.0, 0.0, kind) for kind in kinds]
    made = intervals_made(every, RESAMPLING, resampled(measured[0].unit))
    return f"{made}." if made else "No intervals: too few queries or scenes."


def _data_page(benchmark: str) -> str | None:
    """Return the page of a published benchmark's data."""
    return about_of(benchmark).page or None if about_file(benchmark).is_file() else None


def _paper(benchmark: str) -> str | None:
    """Return the page of the paper whose numbers on a benchmark travel with the package."""
    sources = map(read_source_file, published_sources().values())
    return next((one.url for one in sources if benchmark in one.benchmarks.values()), None)


# --- rows ---

_STATED = (
    *("team", "authors", "summary", "date", "paper", "code", "weights", "licence"),
    *("training_data", "stages", "uses", "hardware", "seconds_per_query", "bibtex"),
)
"""What a row takes of submission.toml."""

_FIELDS: Json = {
    **dict.fromkeys(("id", "kind", "method", "team", "summary", "source", "reason", "bibtex"), ""),
    **dict.fromkeys(("date", "rescored", "version", "paper", "code", "weights", "licence")),
    **dict.fromkeys(("training_data", "stages", "hardware", "seconds_per_query")),
    **{key: [] for key in ("authors", "uses", "notes", "findings", "history")},
    **{key: {} for key in ("scores", "scenes", "conditions")},
}
"""The fields of a row; which of them say something depends on its kind."""


def _stated(entry: Entry) -> Json:
    """Return the statements of a submission's authors."""
    name = entry.place.folder if entry.place else _slug(entry.method)
    found: Json = {"id": name, "method": entry.method, "version": entry.number or None}
    if entry.submission is None:
        return found
    given = entry.submission.model_dump(mode="json")
    given |= given["pipeline"] | (given["cost"] or {})
    given |= {key: given[key] or "" for key in ("summary", "bibtex")}
    return found | {key: given[key] for key in _STATED if key in given}


def _row_of_entry(entry: Entry, number: int, ranked: Mapping[str, Ranked]) -> Json:
    """Return the row of an entry that was scored here; `number` is its place in `ranked`."""
    measured = _measured(entry)
    return _stated(entry) | {
        "kind": "sealed" if measured.sealed else "re-scored",
        "rescored": entry.scored,
        "notes": [*measured.notes, *([entry.reason] if entry.reason else [])],
        "place": number,
        "numbers": measured.scores,
        "ranks": {
            key: {"rank": one.ranges[number].tolist(), "near_best": bool(one.near_best[number])}
            for key, one in ranked.items()
        },
    }


def _floors(measured: Sequence[Measured]) -> list[Json]:
    """Return scores without a method, of each name the first that a result states."""
    found: dict[str, Any] = {}
    for one in measured:
        found |= {name: part for name, part in one.references.items() if name not in found}
    return [
        {
            "kind": "floor",
            "method": name,
            "source": part["meaning"],
            "numbers": {
                scene: {key: (value, None, None, None) for key, value in scores.items()}
                for scene, scores in ({OVERALL: part["overall"]} | part["scenes"]).items()
            },
        }
        for name, part in found.items()
    ]


def _printed_numbers(
    columns: Sequence[ScoreColumn], row: MethodRow
) -> dict[str, dict[str, Number]]:
    """Return printed numbers as a result has them: tables have shares in percent."""
    shares = {column.key for column in columns if column.unit == "share"}
    return {
        scene: {
            key: (value / 100 if key in shares else value, None, None, None)
            for key, value in part.items()
        }
        for scene, part in row.values.items()
    }


def _with_ids(rows: Sequence[Json], keys: Sequence[str]) -> tuple[list[Json], list[str]]:
    """Return whole rows, and the names of the ranked ones in the order in which they were ranked.

    The names, which stand in paths, differ also where case does not count.
    """
    times, found = Counter[str](), []
    ranked: dict[int, str] = {}
    for given in rows:
        row = _FIELDS | given
        numbers, ranks = row.pop("numbers", {}), row.pop("ranks", {})
        name = row["id"] or f"{row['kind']}-{_slug(row['method'])}"
        times[name.casefold()] += 1
        again = times[name.casefold()]
        row["id"] = name if again == 1 else f"{name}-{again}"
        place = row.pop("place", None)
        if place is not None:
            ranked[place] = row["id"]
        row["scores"] = {
            key: dict(zip(("value", "low", "high", "standard_error"), number, strict=True))
            | ranks.get(key, {"rank": None, "near_best": False})
            for key, number in numbers.get(OVERALL, {}).items()
            if key in keys
        }
        row["scenes"] = {
            scene: {key: list(number[:3]) for key, number in part.items() if key in keys}
            for scene, part in numbers.items()
            if scene != OVERALL
        }
        found.append(row)
    return found, [name for _, name in sorted(ranked.items())]


def _slug(name: str) -> str:
    letters = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode().lower()
    return re.sub(r"[^a-z0-9]+", "-", letters).strip("-")[:_LONGEST].strip("-") or "method"


def _condition_values(conditions: Sequence[Json], measured: Measured) -> Json:
    """Return a method's scores by condition, where its queries lie in the same groups."""
    own = {one["by"]: one for one in measured.conditions}
    return {
        one["by"]: own[one["by"]]["values"]
        for one in conditions
        if all(own.get(one["by"], {}).get(key) == one[key] for key in ("labels", "members"))
    }


def _changes(new: Measured, old: Measured) -> str:
    if new.measures != old.measures:
        return "the version before was measured with another protocol or truth"
    said = []
    for column in new.score_columns:
        pair = [one.scores[OVERALL].get(column.key) for one in (new, old)]
        now, before = (
            as_shown(column, one[0]) if one and one[0] is not None else None for one in pair
        )
        if column.headline and now is not None and before is not None and now != before:
            said.append(f"{column.title} {show_number(now - before, 2, '+')} {_UNITS[column.unit]}")
    return ", ".join(said) or "the same scores"
