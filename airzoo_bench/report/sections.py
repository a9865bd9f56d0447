"""The sections of a report: results that measure the same on the same queries."""

from __future__ import annotations

from collections.abc import Container, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from airzoo_bench.core.registry import TRACKS
from airzoo_bench.results.comparable import apart_in, check_same_queries, choose_scores
from airzoo_bench.results.files import method_names, records_path, result_paths
from airzoo_bench.results.records import Scored, column_names, read_records
from airzoo_bench.results.result import Result, ScoreColumn, read_result
from airzoo_bench.retrieval.scoring import RANKED_TILE
from airzoo_bench.tables.breakdown import condition_names, condition_title, is_condition

if TYPE_CHECKING:
    import pandas as pd


_KEPT = frozenset(("scene", "query", "first_hit_rank", "ranked", "failed"))
_MOST_RANKS = 5
_MOST_TILES = 2_000_000  # of all methods and queries: about 4 MB of the page


@dataclass(eq=False)
class Section:
    """Methods of one protocol, truth and set of queries, with records in the same order."""

    methods: list[Scored]
    folders: list[Path] = field(default_factory=list)  # of the runs
    ranks: int = _MOST_RANKS  # first tiles of each list that are shown

    @property
    def first(self) -> Result:
        """The first result: protocol and truth are the same in all."""
        return self.methods[0].result

    @property
    def track(self) -> str:
        """Which track."""
        return self.first.track

    @property
    def by_query(self) -> bool:
        """Whether each record is a query, not a scene."""
        return self.first.unit == "query"

    @cached_property
    def headline(self) -> list[ScoreColumn]:
        """The headline scores that all methods have; the first one ranks queries."""
        return choose_scores(self.methods, [])

    @cached_property
    def scores(self) -> list[ScoreColumn]:
        """Every score that all methods have."""
        return choose_scores(self.methods, [], every=True)

    @cached_property
    def query_scores(self) -> list[ScoreColumn]:
        """The scores shown for each query: headline scores and errors."""
        return [score for score in self.scores if _is_shown(score)]

    @cached_property
    def conditions(self) -> list[str]:
        """Columns of conditions, such as weather, that are the same for all methods."""
        names = condition_names(self.methods[0])
        return [name for name in names if apart_in(self.methods, name) is None]

    @property
    def notes(self) -> list[str]:
        """Notes on conditions and tiles that are left out."""
        notes = [
            f"no scores by {condition_title(name)}: the results have other values of it"
            for name in condition_names(self.methods[0])
            if name not in self.conditions
        ]
        if self.track == "retrieval" and self.ranks < _MOST_RANKS:
            kept = f"only the first {self.ranks} of {_MOST_RANKS} retrieved tiles of each query"
            notes.append(f"{kept} can be shown: there are too many queries and methods")
        return notes

    def rows_of(self, scene: str) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
        """Return the rows of a scene's records."""
        return np.flatnonzero((self.methods[0].records["scene"] == scene).to_numpy(bool))


def tile_columns(columns: Container[str]) -> list[str]:
    """Return the columns of the first tiles of each list, best first."""
    names = [f"{RANKED_TILE}{rank}" for rank in range(1, _MOST_RANKS + 1)]
    return [name for name in names if name in columns]


def _is_shown(score: ScoreColumn) -> bool:
    return score.headline or score.unit != "share"


def read_sections(paths: Sequence[Path]) -> list[Section]:
    """Read results with their records, and group those that measure the same."""
    paths = result_paths(paths)
    results = [read_result(path) for path in paths]
    names = method_names(paths, results)
    groups: dict[tuple[str, str, str], list[int]] = {}
    for number, result in enumerate(results):
        key = (result.track, result.protocol.fingerprint, result.truth.fingerprint)
        groups.setdefault(key, []).append(number)
    sections = []
    for members in groups.values():
        first = results[members[0]]
        lists = len(members) * sum(counts["queries"] for counts in first.counts.values())
        ranks = min(_MOST_RANKS, _MOST_TILES // max(lists, 1))
        methods = [
            Scored(names[n], results[n], _read_shown_columns(paths[n], results[n], ranks))
            for n in members
        ]
        check_same_queries(methods)
        score = choose_scores(methods, [])[0]
        sign = -1 if score.higher_is_better else 1
        order = sorted(
            range(len(methods)), key=lambda n: sign * methods[n].result.overall[score.key]
        )
        folders = [paths[members[n]].parent for n in order]
        sections.append(Section([methods[n] for n in order], folders, ranks))
    benchmarks = list(dict.fromkeys(section.first.truth.benchmark for section in sections))
    tracks = list(TRACKS.names())
    return sorted(
        sections,
        key=lambda one: (
            benchmarks.index(one.first.truth.benchmark),
            tracks.index(one.track) if one.track in tracks else len(tracks),
        ),
    )


def _read_shown_columns(path: Path, result: Result, ranks: int) -> pd.DataFrame:
    """Read of the records what a report shows, to take less time and hold less."""
    heads = column_names(records_path(path)) if records_path(path).is_file() else []
    scores = {column.key: column for column in result.columns}
    tiles = tile_columns(heads)[:ranks]
    kept = [
        name
        for name in heads
        if name in _KEPT
        or name in tiles
        or (_is_shown(scores[name]) if name in scores else is_condition(name, result.track))
    ]
    return read_records(path, result, kept)
