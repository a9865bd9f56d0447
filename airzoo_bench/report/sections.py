"""The sections of a report: results that measure the same, and what their runs left to draw."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.files import atomic_write, write_npz
from airzoo_bench.core.registry import TRACKS
from airzoo_bench.formats.npz import NpzFile
from airzoo_bench.results.comparable import check_same_queries, choose_scores, same_in_all
from airzoo_bench.results.records import Method, read_records
from airzoo_bench.results.result import Result, ScoreColumn, method_names, read_result, result_paths
from airzoo_bench.tables.breakdown import condition_names

Arrays = dict[str, NDArray[Any]]
_KEPT = {"matching": "matches.npz", "reconstruction": "clouds.npz"}
_LIMIT_BYTES = 1 << 30


@dataclass(eq=False)
class Section:
    """Methods of one protocol, truth and set of queries, with records in the same order."""

    methods: list[Method]
    folders: list[Path] = field(default_factory=list)  # of the runs

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

    @property
    def names(self) -> list[str]:
        """The names of the methods."""
        return [method.name for method in self.methods]

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
        return [score for score in self.scores if score.headline or score.unit != "share"]

    @cached_property
    def conditions(self) -> list[str]:
        """Columns of conditions, such as weather, that are the same for all methods."""
        names = condition_names(self.methods[0]) if self.by_query else []
        return [name for name in names if same_in_all(self.methods, name)]

    def rows_of(self, scene: str) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
        """Return the rows of a scene's records."""
        return np.flatnonzero((self.methods[0].records["scene"] == scene).to_numpy(bool))


def read_sections(paths: Sequence[Path]) -> list[Section]:
    """Read results with their records, and group those that measure the same, the best first."""
    paths = result_paths(paths)
    results = [read_result(path) for path in paths]
    groups: dict[tuple[str, str, str], list[tuple[Path, Method]]] = {}
    for path, name, result in zip(paths, method_names(paths, results), results, strict=True):
        key = (result.track, result.protocol.fingerprint, result.truth.fingerprint)
        scored = Method(name, result, read_records(path, result))
        groups.setdefault(key, []).append((path.parent, scored))
    sections = []
    for members in groups.values():
        methods = [method for _, method in members]
        check_same_queries(methods)
        score = choose_scores(methods, [])[0]
        sign = -1 if score.higher_is_better else 1
        members.sort(key=lambda member: sign * member[1].result.overall[score.key])
        sections.append(Section([m for _, m in members], [folder for folder, _ in members]))
    benchmarks = list(dict.fromkeys(section.first.truth.benchmark for section in sections))
    tracks = [*TRACKS.names(), *(section.track for section in sections)]
    return sorted(
        sections,
        key=lambda one: (benchmarks.index(one.first.truth.benchmark), tracks.index(one.track)),
    )


def keep(out: Path, track: str, arrays: Mapping[str, NDArray[Any]]) -> Path:
    """Write arrays into a run's folder; return the folder of its figures."""
    folder = out / "figures"
    folder.mkdir(parents=True, exist_ok=True)
    with atomic_write(folder / _KEPT[track]) as stream:
        write_npz(stream, dict(arrays), compress=True)
    return folder


def read_kept(section: Section, number: int) -> Arrays | None:
    """Read what a method's run has left; None where it has not."""
    if section.track not in _KEPT or not section.folders:
        return None
    path = section.folders[number] / "figures" / _KEPT[section.track]
    return _read(path, path.stat().st_mtime_ns) if path.is_file() else None


@lru_cache(maxsize=16)
def _read(path: Path, written: int) -> Arrays:
    del written  # a file that was written anew is read anew
    file = NpzFile(path, _LIMIT_BYTES)
    return {name: file.read(name) for name in file.names()}


def need_kept(section: Section) -> Arrays:
    """Read what the first method's run has left, or say how to have it."""
    found = read_kept(section, 0)
    if found is None:
        raise UsageError(
            "this run has left nothing to draw",
            where=section.folders[0],
            fix=f"score again with `eval {section.track} ... --out DIR --figures`",
        )
    return found
