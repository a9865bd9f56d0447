"""The tables of a board: entries of one protocol and truth ranked, papers' numbers and floors."""

from __future__ import annotations

import base64
import hashlib
import re
import unicodedata
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.registry import load_track
from airzoo_bench.core.version import __version__
from airzoo_bench.datasets.about import about_file, about_of
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.leaderboard.measured import (
    Entry,
    Head,
    Measured,
    Row,
    Scene,
    Score,
    Table,
    Version,
    load_arrays,
    store_arrays,
)
from airzoo_bench.protocol.model import Protocol, load_protocol, shipped_protocols
from airzoo_bench.results.comparison import is_share
from airzoo_bench.results.result import ScoreColumn, score_columns
from airzoo_bench.statistics.samples import ResamplingConfig, Sample
from airzoo_bench.statistics.significance import (
    LEVEL,
    compare_all,
    correct_pairs,
    rank_ranges,
    resamples_for,
    told_apart,
    unpaired_p_values,
)
from airzoo_bench.tables.published import (
    OVERALL,
    published_sources,
    published_values,
    read_source_file,
)

_LONGEST = 40


class Ranks(NamedTuple):
    """One score of methods, in the order of their folders, the `ids`.

    `ranges` are rank ranges (V, 2), `apart` which two differ after the correction for all pairs
    (V, V), `near_best` which cannot be told from the best by a test of these two alone (V,);
    `pairs` is for board.json, and empty of a sealed table.
    """

    ids: tuple[str, ...]
    ranges: NDArray[np.int64]
    apart: Bools
    near_best: Bools
    pairs: dict[str, str]


def make_table(
    protocol: Protocol, benchmark_title: str, entries: Sequence[Entry], cache: Path
) -> tuple[Table, dict[str, Ranks]]:
    """Rank the entries of a protocol; add numbers of papers, floors and failed submissions.

    The ranks are returned by score too.
    """
    members, rows = _members(entries)
    measured = [_measured(entry) for entry in members]
    head = measured[0].head if members else _head_of(protocol)
    columns = _columns(measured, protocol)
    ranks = {c.key: _rank(members, c, cache) for c in columns if c.headline and members}
    scored = [_scored_row(entry, n, ranks, measured[0]) for n, entry in enumerate(members)]
    reported = [] if head.sealed else _reported(head, columns)
    if not measured:
        printed = {key for row in reported for key in row.scores}
        columns = [column for column in columns if column.headline or column.key in printed]
    known = {key for row in (*scored, *reported) for key in row.scores}
    lead = next((column for column in columns if column.key in known), columns[0])
    floors = {row.method: row for one in reversed(measured) for row in one.floors}
    shown = sorted((*scored, *reported), key=lambda row: _order(lead, row))
    notes = [f"scored by airzoo-bench {', '.join(sorted({one.made_with for one in measured}))}"]
    shipped = shipped_protocols().get(head.protocol)
    known_as = "" if shipped is None else load_protocol(shipped).fingerprint
    if reported and head.protocol_fingerprint != known_as:
        notes.append("not the shipped protocol: reported numbers may measure something else")
    table = Table(
        **dict(head),
        id=protocol.name,
        title=protocol.title,
        summary=" ".join(protocol.summary.split()),
        benchmark_title=benchmark_title,
        scores=tuple(columns),
        conditions=measured[0].conditions if measured else (),
        rows=_with_ids([*shown, *floors.values(), *rows]),
        pairs={key: {"ids": one.ids} | one.pairs for key, one in ranks.items() if one.pairs},
        about_intervals=measured[0].about_intervals if measured else "",
        notes=tuple(notes if measured else notes[1:]),
        data=about_of(head.benchmark).page or None
        if about_file(head.benchmark).is_file()
        else None,
        paper=_paper(head.benchmark),
    )
    return table, ranks


def _measured(entry: Entry) -> Measured:
    assert entry.measured is not None
    return entry.measured


def _members(entries: Sequence[Entry]) -> tuple[list[Entry], list[Row]]:
    """Return the entries of the newest protocol and truth, and a row for every other one.

    Members are in an order that stays when others come or go.
    """

    def basis(entry: Entry) -> tuple[Any, ...]:
        head = _measured(entry).head
        return head.protocol_fingerprint, head.truth, head.sealed

    def age(entry: Entry) -> tuple[Any, ...]:
        head = _measured(entry).head
        version = head.benchmark_version or 0
        return head.protocol_version, version, entry.scored, times[basis(entry)], head.truth

    shown = [entry for entry in entries if entry.measured is not None]
    times = Counter(map(basis, shown))
    newest = basis(max(shown, key=age)) if shown else ()
    members = [entry for entry in shown if basis(entry) == newest]
    members.sort(key=lambda entry: (_measured(entry).key, entry.place))
    old = "scored by another protocol or truth, earlier"
    others = [entry for entry in entries if entry not in members]
    return members, [
        _stated_row(one, "failed", old if one.measured else one.reason) for one in others
    ]


def _head_of(protocol: Protocol) -> Head:
    return Head(
        benchmark=protocol.benchmark,
        track=protocol.track,
        protocol=protocol.name,
        protocol_version=protocol.version,
        protocol_fingerprint=protocol.fingerprint,
        scenes=tuple(Scene(id=s.id, title=s.title, queries=s.queries) for s in protocol.scenes),
    )


def _columns(measured: Sequence[Measured], protocol: Protocol) -> list[ScoreColumn]:
    """Return the scores that any result has, the headline ones that all have first."""
    every = [one.columns for one in measured]
    if not every:
        every = [score_columns(load_track(protocol.track).scores(protocol))]
    columns = {column.key: column for one in every for column in one}
    headline = set.intersection(*({c.key for c in one if c.headline} for one in every))
    marked = [c.model_copy(update={"headline": c.key in headline}) for c in columns.values()]
    return sorted(marked, key=lambda column: not column.headline)


# --- rows ---


def _stated_row(entry: Entry, kind: Any, reason: str = "") -> Row:
    """Return a row with the statements of a submission's authors."""
    row = Row(id=entry.place.folder, kind=kind, method=entry.method, reason=reason)
    given = entry.submission
    if given is None:
        return row
    said = {name: getattr(given, name) for name in Row.model_fields if hasattr(given, name)}
    said |= {"date": given.date.isoformat(), "summary": given.summary or ""}
    said |= {"bibtex": given.bibtex or "", **dict(given.pipeline)}
    return row.model_copy(update=said)


def _scored_row(entry: Entry, number: int, ranks: Mapping[str, Ranks], first: Measured) -> Row:
    """Return the row of an entry that was scored here; `number` is its place in the ranks."""
    one = _measured(entry)
    scores = dict(one.row.scores)
    for key in scores.keys() & ranks.keys():
        rank = tuple(ranks[key].ranges[number].tolist())
        near = bool(ranks[key].near_best[number])
        scores[key] = scores[key].model_copy(update={"rank": rank, "near_best": near})
    history = (
        Version(
            number=version.number,
            date=version.scored,
            scores={key: score.value for key, score in _measured(version).row.scores.items()},
            files=f"{version.place.runs}/{version.number}",
        )
        for version in (entry, *entry.older)
    )
    return _stated_row(entry, one.row.kind).model_copy(
        update={
            "rescored": entry.scored,
            "version": entry.number,
            "notes": (*one.row.notes, *filter(None, [entry.reason])),
            "scores": scores,
            "scenes": one.row.scenes,
            "conditions": {
                given.by: one.row.conditions[given.by]
                for given in first.conditions
                if given in one.conditions
            },
            "history": tuple(history),
        }
    )


def _reported(head: Head, columns: Sequence[ScoreColumn]) -> list[Row]:
    """Return the methods that papers print numbers of; a number comes from the first that does."""
    shares = {column.key: column.unit == "share" for column in columns}
    scenes = {scene.title: scene.id for scene in head.scenes} | {OVERALL: OVERALL}
    numbers: dict[str, dict[str | None, dict[str, float]]] = {}
    sources: dict[str, dict[str, None]] = {}
    printed = published_values(head.benchmark, head.track)
    scenic = {cell.table for cell in printed if cell.scene != OVERALL}
    for cell in sorted(printed, key=lambda cell: cell.table not in scenic):
        found = numbers.setdefault(cell.method, {}).setdefault(scenes.get(cell.scene), {})
        key, value = cell.metric, float(cell.value)
        if cell.scene in scenes and key in shares and key not in found:
            found[key] = value / 100 if shares[key] else value
            sources.setdefault(cell.method, {})[cell.table] = None
    return [
        Row(
            kind="reported",
            method=method,
            source="; ".join(sources[method]),
            scores={key: Score(value=v) for key, v in numbers[method].get(OVERALL, {}).items()},
            scenes={
                scene: {key: (value, None, None) for key, value in part.items()}
                for scene, part in numbers[method].items()
                if scene
            },
        )
        for method in sources
    ]


def _order(lead: ScoreColumn, row: Row) -> tuple[bool, float, str, str]:
    value = row.scores.get(lead.key, Score()).value
    signed = 0.0 if value is None else -value if lead.higher_is_better else value
    return value is None, signed, row.method, row.id


def _with_ids(rows: Sequence[Row]) -> tuple[Row, ...]:
    """Give each row a name for its page, which differs from the others' in more than case."""
    times, found = Counter(row.id.casefold() for row in rows if row.id), []
    for row in rows:
        name = row.id
        if not name:
            letters = unicodedata.normalize("NFKD", row.method).encode("ascii", "ignore").decode()
            slug = re.sub(r"[^a-z0-9]+", "-", letters.lower())[:_LONGEST].strip("-") or "method"
            name = f"{row.kind}-{slug}"
            times[name] += 1
            name = name if times[name] == 1 else f"{name}-{times[name]}"
        found.append(row.model_copy(update={"id": name}))
    return tuple(found)


def _paper(benchmark: str) -> str | None:
    """Return the page of the paper with published numbers on a benchmark."""
    sources = map(read_source_file, published_sources().values())
    return next((one.url for one in sources if benchmark in one.benchmarks.values()), None)


# --- ranks ---


def _rank(entries: Sequence[Entry], column: ScoreColumn, cache: Path) -> Ranks:
    """Rank methods of one protocol and truth by a headline score."""
    methods = [_measured(entry) for entry in entries]
    scores = [one.row.scores.get(column.key, Score(value=np.inf)) for one in methods]
    values = np.array([score.value for score in scores], np.float64)
    limits: list[Floats] = []
    if methods[0].head.sealed:
        errors = np.array([score.standard_error for score in scores], np.float64)
        p_values = unpaired_p_values(values, errors)
    else:
        *limits, p_values = _compare_pairs(entries, column, cache)
    corrected = correct_pairs(p_values)
    upper, pairs = np.triu_indices(len(methods), 1), {}
    if limits and len(methods) > 1:
        found = (*limits, p_values, corrected)
        for name, matrix in zip(("low", "high", "p", "p_holm"), found, strict=True):
            content = (matrix[upper] + 0.0).astype("<f4").tobytes()  # no -0.0
            pairs[name] = base64.b64encode(zlib.compress(content, 6)).decode()
    best = int(np.argmax(values if column.higher_is_better else -values))
    near = (p_values[best] > LEVEL) | (values == values[best])
    return Ranks(
        tuple(entry.place.folder for entry in entries),
        rank_ranges(values, corrected, higher_is_better=column.higher_is_better),
        told_apart(values, corrected),
        near & np.isfinite(values),
        pairs,
    )


def _sample_of(methods: Sequence[Measured], column: ScoreColumn) -> Sample:
    """Put one headline score of many methods into a sample, as `make_sample` would."""
    first, rows = methods[0], []
    for one in methods:
        headline = [c.key for c in one.columns if c.headline]
        rows.append(one.values[headline.index(column.key)])
    ends = np.cumsum([0, *(units for _, units in first.groups)]).tolist()
    by_median = first.head.unit == "query" and column.average == "median"
    return Sample(
        first.head.unit,
        tuple(name for name, _ in first.groups),
        tuple(np.stack([row[start:end] for row in rows]) for start, end in pairwise(ends)),
        np.full(len(rows), by_median),
        np.full(len(rows), is_share(column)),
    )


def _compare_pairs(entries: Sequence[Entry], column: ScoreColumn, cache: Path) -> Floats:
    """Return low, high and p of every two methods (3, V, V), and store them for the next build.

    Methods are in the order of their names here, so that no stored pair is the other way around.
    """
    methods = [_measured(entry) for entry in entries]
    names = [f"{_measured(entry).key} {entry.place.path}" for entry in entries]
    head, resampling = methods[0].head, ResamplingConfig(resamples_for(len(methods)))
    basis = (head.protocol, head.protocol_fingerprint, head.truth, column.key)
    mark = repr((*basis, resampling.resamples, __version__)).encode()
    path = cache / f"pairs-{hashlib.sha256(mark).hexdigest()}.npz"
    before = load_arrays(path) or {"names": np.array([]), "pairs": np.zeros((3, 0, 0))}
    places = {name: place for place, name in enumerate(before["names"].tolist())}
    known = [n for n, name in enumerate(names) if name in places]
    then = [places[names[n]] for n in known]
    wanted = np.ones((len(names),) * 2, np.bool_)
    wanted[np.ix_(known, known)] = False
    found = np.ones((3, *wanted.shape))
    if np.triu(wanted, 1).any():
        found = compare_all(_sample_of(methods, column), resampling, wanted)
    for matrix, stored in zip(found, before["pairs"], strict=True):
        matrix[np.ix_(known, known)] = stored[np.ix_(then, then)]
    store_arrays(path, {"names": np.array(names), "pairs": found})
    return found
