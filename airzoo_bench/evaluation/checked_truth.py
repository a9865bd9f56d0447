"""The truth of a scene whose conditions can stand beside what is scored."""

from __future__ import annotations

from fnmatch import fnmatchcase
from typing import Any

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.errors import BenchmarkError, agreeing
from airzoo_bench.core.registry import load_track
from airzoo_bench.protocol.model import Protocol

__all__ = ["read_checked_truth"]


def read_checked_truth(benchmark: Benchmark, protocol: Protocol, scene: str) -> Any:
    """Read the truth of a scene, and refuse conditions that have the name of another column."""
    track = load_track(protocol.track)
    truth = track.truth(benchmark, scene)
    conditions = getattr(truth, "conditions", None)  # of queries; other tracks have none
    if conditions is None:
        return truth
    taken = {*track.recorded, *(score.column for score in track.scores(protocol))}
    clashing = [
        str(name)
        for name in conditions.columns
        if any(fnmatchcase(str(name), pattern) for pattern in taken)
    ]
    if clashing:
        raise BenchmarkError(
            f"the {agreeing(len(clashing), 'condition', 'conditions')} {', '.join(clashing)} "
            f"{agreeing(len(clashing), 'is', 'are')} called as what the "
            f"{protocol.track} track records",
            where=benchmark.scene_folder(scene) / "queries.csv",
            expected="conditions of other names",
            fix="rename the columns, then `airzoo-bench manifest FOLDER --force`",
        )
    return truth
