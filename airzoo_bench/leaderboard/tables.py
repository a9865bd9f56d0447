"""The tables of a board: entries of one protocol and truth ranked, papers' numbers and floors."""

from __future__ import annotations

import base64
import json
import re
import zlib
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from airzoo_bench.core.files import atomic_write, fingerprint, write_npz
from airzoo_bench.core.registry import load_track
from airzoo_bench.core.version import __version__
from airzoo_bench.datasets.about import about_file, load_about
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.leaderboard import answers as kept
from airzoo_bench.leaderboard.answers import Answer, Entry, Row, Score
from airzoo_bench.protocol.model import find_protocol
from airzoo_bench.results.comparison import is_share
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.statistics import significance
from airzoo_bench.statistics.samples import ResamplingConfig, Sample
from airzoo_bench.tables import published
from airzoo_bench.tables.layouts import MethodRow, MethodTable, with_published
from airzoo_bench.tables.published import OVERALL

_OLD = "scored by another protocol or truth, earlier"


def empty_table(protocol_name: str, data: Path, benchmark_title: str) -> dict[str, Any]:
    """Return a table of board.json before there are submissions, with the keys of every table."""
    protocol = find_protocol(protocol_name, data)
    name, track = protocol.benchmark, protocol.track
    scenes = ((s.id, s.title, s.queries) for s in protocol.scenes)
    papers = map(published.read_source_file, published.published_sources().values())
    return kept.make_head(name, track, protocol, scenes).model_dump(mode="json") | {
        "id": protocol.name,
        "title": protocol.title,
        "summary": " ".join(protocol.summary.split()),
        "benchmark_title": benchmark_title,
        "scores": [column.model_dump() for column in load_track(track).scores(protocol)],
        **{"conditions": [], "rows": [], "pairs": {}, "about_intervals": "", "notes": []},
        "data": (load_about(name).page or None) if about_file(name).is_file() else None,
        "paper": next((one.url for one in papers if name in one.benchmarks.values()), None),
    }


def make_table(empty: Mapping[str, Any], entries: Sequence[Entry], cache: Path) -> dict[str, Any]:
    """Rank the entries of a protocol; add numbers of papers, floors and failed submissions.

    Ranked are those of the newest protocol and truth, in the order of their folders.
    """
    at = empty["benchmark"], empty["track"]
    mine = [e for e in entries if e.place[:2] == at and e.protocol in ("", empty["id"])]
    scored = [(entry, entry.answer) for entry in mine if entry.answer is not None]
    newest = _basis(max((answer for _, answer in scored), key=_age)) if scored else ()
    ranked = [(entry, answer) for entry, answer in scored if _basis(answer) == newest]
    members, answers = [entry for entry, _ in ranked], [answer for _, answer in ranked]
    places = {entry.place for entry in members}
    first = answers[0] if answers else None
    found = dict(empty) | (first.head.model_dump(mode="json") if first else {})
    begun = [ScoreColumn(**column) for column in empty["scores"]]
    columns = _columns([one.columns for one in answers] or [begun])
    pairs = {c.key: _rank(members, answers, c, cache) for c in columns if c.headline and members}
    reported = [] if found["sealed"] else _reported(found, columns)
    if not members:
        printed = {key for row in reported for key in row.scores}
        columns = [column for column in columns if column.headline or column.key in printed]
    shown = [*(entry.row for entry in members), *reported]
    known = {key for row in shown for key in row.scores}
    lead = next((column for column in columns if column.key in known), columns[0])
    floors = {row.method: row for answer in reversed(answers) for row in answer.floors}
    unscored: dict[str, Any] = {"kind": "failed", "scores": {}, "scenes": {}, "conditions": {}}
    failed = [
        e.row.model_copy(update=unscored | {"history": (), "reason": e.row.reason or _OLD})
        for e in mine
        if e.place not in places
    ]
    rows = [*sorted(shown, key=lambda row: _order(lead, row)), *floors.values(), *failed]
    found["scores"] = [column.model_dump() for column in columns]
    found["rows"] = [json.loads(row.model_dump_json()) for row in _with_ids(rows)]
    found["pairs"] = {key: one for key, one in pairs.items() if one}
    if first:
        versions, conditions = (one.version for one in answers), first.model_dump()["conditions"]
        found |= {"conditions": conditions, "about_intervals": first.about_intervals}
        found["notes"] = ["Scored by airzoo-bench " + ", ".join(sorted({*versions}))]
    return found


def _basis(answer: Answer) -> tuple[Any, ...]:
    return answer.head.protocol_fingerprint, answer.head.truth, answer.head.sealed


def _age(answer: Answer) -> tuple[Any, ...]:
    head = answer.head
    return head.protocol_version, head.benchmark_version or 0, answer.scored, head.truth


def _columns(every: Sequence[Sequence[ScoreColumn]]) -> list[ScoreColumn]:
    """Return the scores that any result has, the headline ones that all have first."""
    columns = {column.key: column for one in every for column in one}
    headline = set.intersection(*({c.key for c in one if c.headline} for one in every))
    marked = [c.model_copy(update={"headline": c.key in headline}) for c in columns.values()]
    return sorted(marked, key=lambda column: not column.headline)


# --- rows ---


def _reported(table: Mapping[str, Any], columns: Sequence[ScoreColumn]) -> list[Row]:
    """Return the methods that papers print numbers of; a number comes from the first that does."""
    titles, found = {one["id"]: one["title"] for one in table["scenes"]}, dict[str, MethodRow]()
    at = table["benchmark"], table["track"]
    empty, cells = MethodTable("", *at, tuple(columns), titles), published.published_values(*at)
    for scenes in ([OVERALL], [*titles, OVERALL]):  # a row by scene replaces that of averages
        found |= {row.method: row for row in with_published(empty, cells, scenes).rows}
    factors, rows = {column.key: 100 if column.unit == "share" else 1 for column in columns}, []
    for name, row in found.items():
        values = {
            scene: {key: value / factors[key] for key, value in part.items()}
            for scene, part in row.values.items()
        }
        overall = values.pop(OVERALL, {})
        facts: Any = {"kind": "reported", "method": name, "source": row.reported}
        rows.append(kept.make_row(overall, values, **facts))
    return rows


def _order(lead: ScoreColumn, row: Row) -> tuple[bool, float, str, str]:
    value = row.scores.get(lead.key, Score()).value
    signed = 0.0 if value is None else -value if lead.higher_is_better else value
    return value is None, signed, row.method, row.id


def _with_ids(rows: Sequence[Row]) -> tuple[Row, ...]:
    """Give each row without a folder a name for its page, which no folder can have."""
    found = dict[str, Row]()
    for row in rows:
        name = row.id or f"{row.kind}~{re.sub(r'[^a-z0-9]+', '-', row.method.lower()).strip('-')}"
        name = name if name not in found else f"{name}~{len(found)}"
        found[name] = row.model_copy(update={"id": name})
    return tuple(found.values())


# --- ranks ---


def _rank(
    members: list[Entry], answers: Sequence[Answer], column: ScoreColumn, cache: Path
) -> dict[str, Any]:
    """Write ranks by a headline score into the rows, and return the pairs of board.json."""
    scores = [one.row.scores.get(column.key, Score(value=np.inf)) for one in members]
    values = np.array([score.value for score in scores], np.float64)
    limits: list[Floats] = []
    if answers[0].head.sealed:
        errors = np.array([score.standard_error for score in scores], np.float64)
        p_values = significance.unpaired_p_values(values, errors)
    else:
        ids = [one.place.folder for one in members]
        *limits, p_values = _compare_pairs(ids, answers, column, cache)
    corrected = significance.correct_pairs(p_values)
    best = int(np.argmax(values if column.higher_is_better else -values))
    near = ((p_values[best] > significance.LEVEL) | (values == values[best])) & np.isfinite(values)
    ranges = significance.rank_ranges(values, corrected, higher_is_better=column.higher_is_better)
    for n, (one, rank, is_near) in enumerate(zip(members, ranges.tolist(), near, strict=True)):
        update = {"rank": tuple(rank), "near_best": bool(is_near) and len(members) > 1}
        score = one.row.scores.get(column.key, Score()).model_copy(update=update)
        row = one.row.model_copy(update={"scores": one.row.scores | {column.key: score}})
        members[n] = one.model_copy(update={"row": row})
    if not limits or len(members) < 2:
        return {}
    upper, found = np.triu_indices(len(members), 1), (*limits, p_values, corrected)
    packed = {
        name: kept.pack(matrix[upper] + 0.0, "<f4")  # no -0.0
        for name, matrix in zip(("low", "high", "p", "p_holm"), found, strict=True)
    }
    return {"ids": [one.place.folder for one in members]} | packed


def _sample_of(answers: Sequence[Answer], column: ScoreColumn) -> Sample:
    """Put one headline score of many methods into a sample, as `make_sample` would."""
    first, rows = answers[0], []
    for one in answers:
        headline = [c.key for c in one.columns if c.headline]
        packed = np.frombuffer(zlib.decompress(base64.b64decode(one.values)), "<f8")
        rows.append(packed.reshape(len(headline), -1)[headline.index(column.key)])
    ends = np.cumsum([0, *(units for _, units in first.groups)]).tolist()
    by_median = first.head.unit == "query" and column.average == "median"
    return Sample(
        first.head.unit,
        tuple(name for name, _ in first.groups),
        tuple(np.stack([row[start:end] for row in rows]) for start, end in pairwise(ends)),
        np.full(len(rows), by_median),
        np.full(len(rows), is_share(column)),
    )


def _compare_pairs(
    ids: Sequence[str], answers: Sequence[Answer], column: ScoreColumn, cache: Path
) -> Floats:
    """Return low, high and p of every two methods (3, V, V), and store them for the next build."""
    resampling = ResamplingConfig()
    mark = fingerprint([*_basis(answers[0]), column.key, resampling.resamples, __version__])
    path, then, matrices = cache / f"pairs-{mark}.npz", list[str](), np.zeros((3, 0, 0))
    names = [fingerprint([one, answer.values]) for one, answer in zip(ids, answers, strict=True)]
    if path.is_file():
        with np.load(path, allow_pickle=False) as stored:
            then, matrices = stored["names"].tolist(), stored["pairs"]
    known = [n for n, name in enumerate(names) if name in then]
    old = [then.index(names[n]) for n in known]
    wanted: Bools = np.ones((len(names),) * 2, np.bool_)
    wanted[np.ix_(known, known)] = False
    found = np.ones((3, *wanted.shape))
    if np.triu(wanted, 1).any():
        found = significance.compare_all(_sample_of(answers, column), resampling, wanted)
    for matrix, before in zip(found, matrices, strict=True):
        matrix[np.ix_(known, known)] = before[np.ix_(old, old)]
    with atomic_write(path) as stream:
        write_npz(stream, {"names": np.array(names), "pairs": found})
    return found
