"""The sections of a report: results that measure the same on the same queries."""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from airzoo_bench.core.errors import ResultError
from airzoo_bench.core.registry import TRACKS
from airzoo_bench.engines.engine import Processes
from airzoo_bench.results.comparable import apart_in, check_same_queries, choose_scores
from airzoo_bench.results.files import method_names, records_path, result_paths
from airzoo_bench.results.records import Scored, column_names, read_records
from airzoo_bench.results.result import Result, ScoreColumn, read_result
from airzoo_bench.retrieval.scoring import RANKED_TILE
from airzoo_bench.tables.breakdown import condition_names, is_condition

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Section", "read_sections", "tile_columns"]

_Key = tuple[str, str, str]  # track, fingerprints of protocol and truth

_KEPT = frozenset(("scene", "query", "first_hit_rank", "ranked", "failed"))
_LARGE_BYTES = 16 << 20
_FIRST_TILE = "first_tile"  # of records from before there were the columns of `RANKED_TILE`
_MOST_RANKS = 5
_MOST_TILES = 2_000_000  # of all methods and queries: about 4 MB of the page


@dataclass(frozen=True, eq=False)
class Section:
    """Methods that can stand in one table.

    Attributes
    ----------
    methods : list of Scored
        Of one protocol, truth and set of queries, with records in the same order, of the columns
        that a report shows.
    ranks : int
        So many of the first tiles of each list are kept, where records tell of them.
    """

    methods: list[Scored]
    ranks: int = _MOST_RANKS

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
        """Whether records are of queries, not of scenes."""
        return self.first.unit == "query"

    @property
    def headline(self) -> list[ScoreColumn]:
        """The headline scores that all methods have; the first one ranks queries."""
        return choose_scores(self.methods, [])

    @property
    def scores(self) -> list[ScoreColumn]:
        """Every score that all methods have."""
        keys = [column.key for column in self.first.columns]
        shared = [{column.key for column in method.result.columns} for method in self.methods]
        return choose_scores(
            self.methods, [key for key in keys if all(key in known for known in shared)]
        )

    @property
    def query_scores(self) -> list[ScoreColumn]:
        """The scores shown for each query: headline scores and errors."""
        return [score for score in self.scores if _is_shown(score)]

    @property
    def conditions(self) -> list[str]:
        """Columns of conditions, such as weather, that are the same for all methods."""
        return [name for name in condition_names(self.methods[0]) if not self._is_apart(name)]

    @property
    def conditions_apart(self) -> list[str]:
        """Conditions whose groups differ between the methods."""
        return [name for name in condition_names(self.methods[0]) if self._is_apart(name)]

    def _is_apart(self, condition: str) -> bool:
        return apart_in(self.methods, condition) is not None

    @property
    def left_out(self) -> str:
        """A note if not all first tiles are shown, else empty."""
        if self.track != "retrieval" or self.ranks == _MOST_RANKS:
            return ""
        kept = (
            "no retrieved tiles are"
            if not self.ranks
            else (
                "only the first retrieved tile of each query is"
                if self.ranks == 1
                else f"only the first {self.ranks} retrieved tiles of each query are"
            )
        )
        return f"{kept} shown: there are too many queries and methods for {_MOST_RANKS}"


def tile_columns(columns: Container[str]) -> list[str]:
    """Return the columns of the first tiles of each list, best first."""
    names = [f"{RANKED_TILE}{rank}" for rank in range(1, _MOST_RANKS + 1)]
    found = [name for name in names if name in columns]
    return found or [name for name in (_FIRST_TILE,) if name in columns]


def _is_shown(score: ScoreColumn) -> bool:
    return score.headline or score.unit != "share"


def read_sections(paths: Sequence[Path], jobs: int = 1) -> list[Section]:
    """Read results with their records, and group those that measure the same."""
    paths = result_paths(paths)
    results = [read_result(path) for path in paths]
    files = [records_path(path) for path in paths]
    size = sum(file.stat().st_size for file in files if file.is_file())
    engine = Processes(jobs if size > _LARGE_BYTES else 1)
    ranks = _affordable_ranks(results)
    asked = [(path, ranks[_key(result)]) for path, result in zip(paths, results, strict=True)]
    records = engine.map(
        _shown_records, asked, shared=None, stage="results", name=lambda one: str(one[0])
    )
    groups: dict[_Key, list[Scored]] = {}
    for name, result, rows in zip(method_names(paths, results), results, records, strict=True):
        groups.setdefault(_key(result), []).append(Scored(name, result, rows))
    for methods in groups.values():
        check_same_queries(methods)
    return _in_order([Section(_best_first(methods), ranks[key]) for key, methods in groups.items()])


def _best_first(methods: list[Scored]) -> list[Scored]:
    score = choose_scores(methods, [])[0]
    sign = -1 if score.higher_is_better else 1
    return sorted(methods, key=lambda method: sign * method.result.overall[score.key])


def _in_order(sections: list[Section]) -> list[Section]:
    benchmarks = [section.first.truth.benchmark for section in sections]
    places = {name: place for place, name in enumerate(dict.fromkeys(benchmarks))}
    tracks = {name: place for place, name in enumerate(TRACKS.names())}
    return sorted(
        sections,
        key=lambda s: (places[s.first.truth.benchmark], tracks.get(s.track, len(tracks))),
    )


def _key(result: Result) -> _Key:
    return result.track, result.protocol.fingerprint, result.truth.fingerprint


def _affordable_ranks(results: Sequence[Result]) -> dict[_Key, int]:
    """Return how many ranks of tiles are kept: fewer if there are very many queries."""
    lists = Counter[_Key]()
    for result in results:
        lists[_key(result)] += sum(counts["queries"] for counts in result.counts.values())
    return {key: min(_MOST_RANKS, _MOST_TILES // max(count, 1)) for key, count in lists.items()}


def _shown_records(shared: None, asked: tuple[Path, int]) -> pd.DataFrame:
    """Read of the records what a report shows, to take less time and hold less."""
    del shared
    path, ranks = asked
    result = read_result(path)
    heads = _heads(records_path(path))
    scores = {column.key: column for column in result.columns}
    tiles = tile_columns(heads)[:ranks]
    kept = [
        name
        for name in heads
        if name in _KEPT
        or name in tiles
        or (name in scores and _is_shown(scores[name]))
        or (name not in scores and is_condition(name, result.track))
    ]
    return read_records(path, result, kept)


def _heads(file: Path) -> list[str]:
    """Return the columns of records; none where there is no such table, which is told later."""
    if not file.is_file():
        return []
    try:
        return column_names(file)
    except ResultError:
        return []
