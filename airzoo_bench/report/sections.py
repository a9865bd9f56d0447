"""The sections of a report: results that measure the same on the same queries."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from airzoo_bench.breakdown import MEASURED, condition_names
from airzoo_bench.errors import UsageError
from airzoo_bench.records import Scored, read_records
from airzoo_bench.result import Result, ScoreColumn, read_result
from airzoo_bench.statistics.compatibility import check_comparable, choose_scores
from airzoo_bench.workers import spread

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Section", "read_sections"]

_KEPT = frozenset(("scene", "query", "first_hit_rank", "first_tile", "failed"))
_LARGE_BYTES = 16 << 20


@dataclass(frozen=True, eq=False)
class Section:
    """Methods that can stand in one table.

    Attributes
    ----------
    methods : list of Scored
        Of one protocol, truth and set of queries, with records in the same order, of the columns
        that a report shows.
    """

    methods: list[Scored]

    @property
    def first(self) -> Result:
        """The result that tells of protocol and truth."""
        return self.methods[0].result

    @property
    def track(self) -> str:
        """Which track."""
        return self.first.track

    @property
    def by_query(self) -> bool:
        """Whether records are of queries, not of scenes."""
        return self.track != "reconstruction"

    @property
    def headline(self) -> list[ScoreColumn]:
        """The paper's scores that all methods have; the first ranks queries."""
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
        """The scores that are shown of each query: those of the paper, and errors."""
        return [score for score in self.scores if _is_shown(score)]

    @property
    def conditions(self) -> list[str]:
        """Columns by which queries differ."""
        return condition_names(self.methods[0])


def _is_shown(score: ScoreColumn) -> bool:
    return score.headline or score.unit != "share"


def read_sections(paths: Sequence[Path], jobs: int = 1) -> list[Section]:
    """Read results with their records, and put those together that measure the same.

    Parameters
    ----------
    paths : sequence of Path
    jobs : int
        Processes that read large records.

    Returns
    -------
    list of Section
        In the order in which their first results stand.

    Raises
    ------
    UsageError
        A file is named twice.
    ResultError
        See `airzoo_bench.records.read_records`; or results of one protocol and truth are on
        different queries.
    """
    for path, times in Counter(path.resolve() for path in paths).items():
        if times > 1:
            raise UsageError("named twice", where=path, mend="name each result once")
    results = [read_result(path) for path in paths]
    files = [path.with_name("records.csv") for path in paths]
    size = sum(file.stat().st_size for file in files if file.is_file())
    workers = min(jobs, len(paths)) if size > _LARGE_BYTES else 1
    records = spread(_shown_records, paths, workers)
    groups: dict[tuple[str, str, str], list[Scored]] = {}
    for name, result, rows in zip(_names(paths, results), results, records, strict=True):
        key = (result.track, result.protocol.fingerprint, result.truth.fingerprint)
        groups.setdefault(key, []).append(Scored(name, result, rows))
    for methods in groups.values():
        check_comparable(methods)
    return [Section(methods) for methods in groups.values()]


def _names(paths: Sequence[Path], results: Sequence[Result]) -> list[str]:
    """Return the methods' names, with the file's where several have the same."""
    keys = [(r.protocol.fingerprint, r.truth.fingerprint, r.predictions.method) for r in results]
    times = Counter(keys)
    return [
        key[-1] if times[key] == 1 else f"{key[-1]} ({path})"
        for key, path in zip(keys, paths, strict=True)
    ]


def _shown_records(path: Path) -> pd.DataFrame:
    """Read records and leave out what a report does not show, to move and hold less."""
    result = read_result(path)
    records = read_records(path, result)
    scores = {column.key: column for column in result.columns}
    kept = [
        name
        for name in records.columns
        if name in _KEPT
        or (name in scores and _is_shown(scores[name]))
        or (name not in scores and name not in MEASURED)
    ]
    return records[kept]
