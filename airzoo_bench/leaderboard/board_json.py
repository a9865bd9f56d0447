"""board.json, all that a board shows: tables with rows, scenes, conditions, ranks and history."""

from __future__ import annotations

import hashlib
import math
import re
import unicodedata
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.core.registry import load_track
from airzoo_bench.core.version import __version__
from airzoo_bench.datasets.about import about_file, about_of
from airzoo_bench.leaderboard.board import Board
from airzoo_bench.leaderboard.entries import Entry
from airzoo_bench.leaderboard.measured import OVERALL, RESAMPLING, Measured, Number
from airzoo_bench.leaderboard.ranking import Ranked, rank
from airzoo_bench.leaderboard.reported import Findings, read_findings, reported_rows
from airzoo_bench.protocol.lookup import load_protocol, protocol_files
from airzoo_bench.protocol.model import Protocol
from airzoo_bench.results.result import ScoreColumn, score_columns
from airzoo_bench.statistics.intervals import Interval
from airzoo_bench.tables.intervals import intervals_made, resampled
from airzoo_bench.tables.method_table import as_shown
from airzoo_bench.tables.model import show_number
from airzoo_bench.tables.published import (
    published_benchmarks,
    published_sources,
    read_source_file,
    shipped_fingerprints,
)

__all__ = ["SCHEMA", "Json", "alike", "headline_first", "make_board", "plain_json"]

SCHEMA = 2
"""The version of board.json; a field that goes, or means something else, makes it a new one."""

Json = dict[str, Any]

_UNITS = {"share": "points", "m": "m", "deg": "deg"}
_NOT_PLAIN = re.compile(r"[^a-z0-9]+")
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


@dataclass(frozen=True)
class _Sources:
    """All that tables are made of beside their entries."""

    board: Board | None
    protocols: Mapping[str, Protocol]
    findings: Findings
    cache: Path

    def benchmark_title(self, name: str) -> str:
        """Return the title that the board gives a benchmark, or the one of its protocols."""
        titles = {one.name: one.title for one in self.board.benchmarks} if self.board else {}
        of_protocols = (p for p in self.protocols.values() if p.benchmark == name)
        shipped = next((p.title.partition(",")[0] for p in of_protocols), name)
        return titles.get(name, shipped)


def make_board(entries: Sequence[Entry], board: Board | None, data: Path, cache: Path) -> Json:
    """Put entries and published numbers into tables, and the tables into a board."""
    shown = [entry for entry in entries if entry.measured is not None]
    sources = _Sources(board, _protocols(shown, board, data), read_findings(), cache)
    groups: dict[tuple[Any, ...], list[Entry]] = {}
    for entry in sorted(shown, key=lambda one: (one.method, one.number, _measured(one).kept)):
        groups.setdefault(_measured(entry).measures, []).append(entry)
    current = {measures[0]: measures for measures in sorted(groups, key=lambda m: _age(m, groups))}
    ids = {measures: _table_id(measures, current) for measures in groups}
    tables = []
    for measures, members in sorted(groups.items(), key=lambda pair: ids[pair[0]]):
        newest = _measured(groups[current[measures[0]]][0])
        head = _head_of_entries(_measured(members[0]), newest, ids, sources)
        tables.append(_table(head, members, entries, ids, sources))
    for name, protocol in sources.protocols.items():
        if name not in current:
            head = _head_of_protocol(protocol, sources)
            tables.append(_table(head, [], entries, ids, sources))
    return _board(tables, sources)


def _measured(entry: Entry) -> Measured:
    assert entry.measured is not None
    return entry.measured


def _protocols(entries: Iterable[Entry], board: Board | None, data: Path) -> dict[str, Protocol]:
    """Return the protocols that the board is of, and those of its results that are known here."""
    files = protocol_files(data)
    used = {_measured(entry).protocol for entry in entries}
    if board is None:
        known = {name: load_protocol(path) for name, path in files.items()}
        printed = {
            track: set(published_benchmarks(track)) for track in {p.track for p in known.values()}
        }
        return {n: p for n, p in known.items() if n in used or p.benchmark in printed[p.track]}
    for name in board.protocols:
        if name not in files:
            raise SubmissionError(
                f"unknown protocol {name}",
                where="leaderboard.toml",
                fix="name the folder of prepared benchmarks by --data",
            )
    return {n: load_protocol(p) for n, p in files.items() if n in used or n in board.protocols}


def _age(
    measures: tuple[Any, ...], groups: Mapping[tuple[Any, ...], list[Entry]]
) -> tuple[Any, ...]:
    """Order what is measured by its protocol and truth, the newest last."""
    members = groups[measures]
    dates = max(entry.scored or "" for entry in members)
    version = _measured(members[0]).benchmark_version or 0
    return measures[1], version, dates, len(members), repr(measures)


def _table_id(measures: tuple[Any, ...], current: Mapping[str, tuple[Any, ...]]) -> str:
    name: str = measures[0]
    mark = hashlib.sha256(repr(measures).encode()).hexdigest()[:8]
    return name if current[name] == measures else f"{name}-{mark}"


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


# --- tables ---


def _head_of_entries(
    first: Measured, newest: Measured, ids: Mapping[tuple[Any, ...], str], sources: _Sources
) -> Json:
    """Return what a table of results is of."""
    protocol = sources.protocols.get(first.protocol)
    apart = _apart(first, newest)
    return {
        "id": ids[first.measures],
        "title": first.protocol if protocol is None else protocol.title,
        "summary": "" if protocol is None else " ".join(protocol.summary.split()),
        "benchmark": first.benchmark,
        "benchmark_title": sources.benchmark_title(first.benchmark),
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


def _head_of_protocol(protocol: Protocol, sources: _Sources) -> Json:
    """Return what a table without any result is of."""
    return {
        "id": protocol.name,
        "title": protocol.title,
        "summary": " ".join(protocol.summary.split()),
        "benchmark": protocol.benchmark,
        "benchmark_title": sources.benchmark_title(protocol.benchmark),
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
        "scenes": [{"id": s.id, "title": s.title, "queries": s.queries} for s in protocol.scenes],
    }


def _table(
    head: Json,
    members: Sequence[Entry],
    entries: Sequence[Entry],
    ids: Mapping[tuple[Any, ...], str],
    sources: _Sources,
) -> Json:
    """Rank the entries of a table, and put beside them what is published and what has failed."""
    members, odd = alike(members)
    measured = [_measured(entry) for entry in members]
    columns = headline_first(measured) or _protocol_columns(sources.protocols[head["protocol"]])
    ranked = {c.key: rank(measured, c, sources.cache) for c in columns if c.headline and measured}
    rows = [_row(entry, n, ranked, ids) for n, entry in enumerate(members)]
    conditions = measured[0].conditions if measured else []
    for row, one in zip(rows, measured, strict=True):
        row["conditions"] = _condition_values(conditions, one)
    reported, notes = _reported(head, columns, sources)
    if not measured:
        printed = {key for row in reported for part in row["numbers"].values() for key in part}
        columns = [column for column in columns if column.headline or column.key in printed]
    rows += reported
    known = {key for row in rows for key in row["numbers"].get(OVERALL, {})}
    lead = next((column for column in columns if column.key in known), columns[0])
    rows.sort(key=lambda row: _order(lead, row))
    faults = [*odd, *(_faults(entries, head) if head["current"] else ())]
    rows, ranked_ids = _with_ids([*rows, *_floors(measured), *faults], columns)
    return head | {
        "scores": [column.model_dump() for column in columns],
        "conditions": [
            {key: one[key] for key in ("by", "title", "labels", "counts")} for one in conditions
        ],
        "rows": rows,
        "pairs": {
            key: {"ids": ranked_ids} | one.pairs
            for key, one in ranked.items()
            if one.pairs is not None
        },
        "about_ranks": (_RANKS + (_UNPAIRED if head["sealed"] else _PAIRED)) if measured else "",
        "about_intervals": _about_intervals(measured),
        "notes": [*notes, *_version_notes(measured)],
        "data": _data_page(head["benchmark"]),
        "paper": _paper(head["benchmark"]),
    }


def alike(entries: Sequence[Entry]) -> tuple[list[Entry], list[Json]]:
    """Return the entries that measure the same as most, and a row that says why of each other."""
    times = Counter(_measured(entry).queries for entry in entries)
    known: dict[str, Json] = {}
    found, odd = [], []
    for entry in entries:
        measured = _measured(entry)
        given = {
            c["key"]: {k: v for k, v in c.items() if k != "headline"} for c in measured.columns
        }
        other = [key for key, column in given.items() if known.get(key, column) != column]
        if measured.queries != times.most_common(1)[0][0]:
            odd.append(_failed(entry, "scored on other queries than most methods of this table"))
        elif other:
            odd.append(_failed(entry, f"means another thing by the score {other[0]}"))
        else:
            known |= given
            found.append(entry)
    return found, odd


def headline_first(measured: Sequence[Measured]) -> list[ScoreColumn]:
    """Return the scores that any result has, the headline ones that all have first."""
    columns = {column.key: column for one in measured for column in one.score_columns}
    of_all = [{c.key for c in one.score_columns if c.headline} for one in measured]
    headline = set.intersection(*of_all) if of_all else set()
    marked = [c.model_copy(update={"headline": c.key in headline}) for c in columns.values()]
    return sorted(marked, key=lambda column: not column.headline)


def _protocol_columns(protocol: Protocol) -> list[ScoreColumn]:
    columns = score_columns(load_track(protocol.track).scores(protocol))
    return sorted(columns, key=lambda column: not column.headline)


def _reported(
    head: Json, columns: Sequence[ScoreColumn], sources: _Sources
) -> tuple[list[Json], list[str]]:
    """Return the rows of published methods, none beside a sealed truth, and notes on them."""
    if head["sealed"]:
        return [], []
    benchmark, track = head["benchmark"], head["track"]
    titles = {scene["id"]: scene["title"] for scene in head["scenes"]}
    rows, notes = reported_rows(benchmark, track, columns, titles, sources.findings)
    shipped = shipped_fingerprints(benchmark, track)
    if rows and head["protocol_fingerprint"] not in shipped:
        notes.append("not the shipped protocol: reported numbers may measure something else")
    return rows, notes


def _order(lead: ScoreColumn, row: Json) -> tuple[bool, float, str]:
    number = row["numbers"].get(OVERALL, {}).get(lead.key)
    if number is None:
        return True, 0.0, row["method"]
    return False, -number[0] if lead.higher_is_better else number[0], row["method"]


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


def _row(
    entry: Entry, number: int, ranked: Mapping[str, Ranked], ids: Mapping[tuple[Any, ...], str]
) -> Json:
    """Return the row of an entry that was scored here; `number` is its place in `ranked`."""
    measured = _measured(entry)
    notes = [*measured.notes, *([entry.reason] if entry.reason else [])]
    return _stated(entry) | {
        "kind": "sealed" if measured.sealed else "re-scored",
        "rescored": entry.scored,
        "notes": notes,
        "place": number,
        "numbers": measured.scores,
        "ranks": {
            key: {"rank": one.ranges[number].tolist(), "near_best": bool(one.near_best[number])}
            for key, one in ranked.items()
        },
        "history": _history(entry, ids),
    }


def _stated(entry: Entry) -> Json:
    """Return what the authors of a submission say of it."""
    name = _slug(entry.method) if entry.place is None else entry.place.folder
    found: Json = {"id": name, "method": entry.method, "version": entry.number or None}
    if entry.submission is None:
        return found
    given = entry.submission.model_dump(mode="json")
    given |= given["pipeline"] | (given["cost"] or {})
    given |= {key: given[key] or "" for key in ("summary", "bibtex")}
    return found | {key: given[key] for key in _STATED if key in given}


def _failed(entry: Entry, reason: str) -> Json:
    return _stated(entry) | {"kind": "failed", "reason": reason}


def _faults(entries: Sequence[Entry], head: Json) -> list[Json]:
    """Return a row for each submission to a table that has no numbers."""
    table = (head["benchmark"], head["track"])
    return [
        _failed(entry, entry.reason)
        for entry in entries
        if entry.measured is None
        and entry.place is not None
        and entry.place.table == table
        and (entry.submission is None or entry.submission.protocol == head["protocol"])
    ]


def _floors(measured: Sequence[Measured]) -> list[Json]:
    """Return what scores without a method, of each name the first that a result states."""
    found: dict[str, Any] = {}
    for one in measured:
        for name, reference in one.references.items():
            found.setdefault(name, reference)
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


def _with_ids(rows: Sequence[Json], columns: Sequence[ScoreColumn]) -> tuple[list[Json], list[str]]:
    """Return whole rows, and the names of the ranked ones in the order in which they were ranked.

    The names, which stand in paths, differ also where case does not count.
    """
    keys, times, found = [column.key for column in columns], Counter[str](), []
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
            key: _score(number) | ranks.get(key, {"rank": None, "near_best": False})
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


def _score(number: Number) -> Json:
    value, low, high, error = number
    return {"value": value, "low": low, "high": high, "standard_error": error}


def _slug(name: str) -> str:
    letters = unicodedata.normalize("NFKD", name).encode("ascii", "ignore").decode().lower()
    return _NOT_PLAIN.sub("-", letters).strip("-")[:_LONGEST].strip("-") or "method"


def _condition_values(conditions: Sequence[Json], measured: Measured) -> Json:
    """Return a method's scores by condition, where its queries lie in the same groups."""
    own = {one["by"]: one for one in measured.conditions}
    return {
        one["by"]: own[one["by"]]["values"]
        for one in conditions
        if all(own.get(one["by"], {}).get(key) == one[key] for key in ("labels", "members"))
    }


def _history(entry: Entry, ids: Mapping[tuple[Any, ...], str]) -> list[Json]:
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
                "date": None if one.submission is None else one.submission.date.isoformat(),
                "rescored": one.scored,
                "made_with": measured.made_with,
                "table": ids.get(measured.measures, ""),
                "scores": {key: number[0] for key, number in measured.scores[OVERALL].items()},
                "changes": "" if before is None else _changes(measured, _measured(before)),
                "files": f"runs/{one.place.path.partition('/')[2]}/{one.number}",  # type: ignore[union-attr]
            }
        )
    return found


def _changes(new: Measured, old: Measured) -> str:
    if new.measures != old.measures:
        return "the version before was measured with another protocol or truth"
    said = []
    for column in new.score_columns:
        pair = [one.scores[OVERALL].get(column.key) for one in (new, old)]
        now, before = (None if one is None else as_shown(column, one[0]) for one in pair)
        if column.headline and now is not None and before is not None and now != before:
            said.append(f"{column.title} {show_number(now - before, 2, '+')} {_UNITS[column.unit]}")
    return ", ".join(said) or "the same scores"


# --- words and the whole ---


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


def _version_notes(measured: Sequence[Measured]) -> list[str]:
    versions = sorted({one.made_with for one in measured})
    return [f"scored by airzoo-bench {', '.join(versions)}"] if versions else []


def _board(tables: Sequence[Json], sources: _Sources) -> Json:
    board = sources.board
    stated = [] if board is None else board.protocols
    order = {name: number for number, name in enumerate(stated)}
    ordered = sorted(
        tables,
        key=lambda t: (
            order.get(t["protocol"], len(order)),
            t["protocol"],
            not t["current"],
            t["id"],
        ),
    )
    names = [] if board is None else [one.name for one in board.benchmarks]
    names = list(dict.fromkeys([*names, *sorted(table["benchmark"] for table in tables)]))
    dates = [row["rescored"] for table in tables for row in table["rows"] if row["rescored"]]
    return {
        "schema": SCHEMA,
        "title": "Leaderboard" if board is None else board.title,
        "url": board and board.url,
        "repository": board and board.repository,
        "repository_url": board and board.repository_url,
        "data_url": board and board.data_url,
        "updated": max(dates, default=None),
        "made_with": __version__,
        "benchmarks": [
            {
                "name": name,
                "title": sources.benchmark_title(name),
                "tables": [table["id"] for table in ordered if table["benchmark"] == name],
            }
            for name in names
        ],
        "tables": {table["id"]: table for table in ordered},
    }


def plain_json(value: Any) -> Any:
    """Return what JSON holds: infinite numbers as text, as result.json has them."""
    if isinstance(value, float):
        if math.isnan(value):
            return None
        return ("Infinity" if value > 0 else "-Infinity") if math.isinf(value) else value
    if isinstance(value, Mapping):
        return {key: plain_json(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [plain_json(part) for part in value]
    return value
