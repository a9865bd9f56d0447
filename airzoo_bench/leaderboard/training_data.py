"""Whether a method may have been trained on what it is scored by."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from airzoo_bench.benchmark.folder import benchmark_folders
from airzoo_bench.core.errors import BenchmarkError, counted
from airzoo_bench.core.registry import DATASETS
from airzoo_bench.core.validation import nearest
from airzoo_bench.leaderboard.submission import Submission
from airzoo_bench.protocol.lookup import load_protocol, shipped_protocols

__all__ = ["training_warnings"]

_MAX_RANGE_M = 2000.0  # as `check-split` has it


def training_warnings(submission: Submission, benchmark: str, data: Path) -> Iterator[str]:
    """Warn of training data that are, or may hold, what the benchmark is of."""
    known = _known_ids(data) if submission.training_data else []
    for name in submission.training_data:
        if _same(name, benchmark):
            yield (
                f"the training data {name!r} are, or are of one dataset with, the benchmark "
                f"{benchmark}: say in `summary` which part of it was trained on"
            )
        elif name not in known:
            meant = nearest(name, known)
            if meant:
                yield f"training data {name!r} are no dataset that is known here{meant}"
        if name != benchmark and {name, benchmark} <= {*benchmark_folders(data)}:
            yield from _overlap(name, benchmark, data)


def _known_ids(data: Path) -> list[str]:
    of_protocols = (load_protocol(path).benchmark for path in shipped_protocols().values())
    return [*dict.fromkeys([*DATASETS.names(), *of_protocols, *benchmark_folders(data)])]


def _same(one: str, other: str) -> bool:
    """Whether two ids are alike, or one is that of a part of the other, such as gta-uav-cross."""
    first, second = sorted((one.casefold().replace("_", "-"), other.casefold().replace("_", "-")))
    return second == first or second.startswith(f"{first}-")


def _overlap(name: str, benchmark: str, data: Path) -> Iterator[str]:
    """Compare the ground that both see, as ``airzoo-bench check-split`` does."""
    from airzoo_bench.datasets.geometry_checks.splits import compare_splits, read_footprints

    try:
        train, test = (read_footprints(data / one, _MAX_RANGE_M) for one in (name, benchmark))
    except BenchmarkError as error:
        yield f"training data {name!r} were not compared with the benchmark: {error.what}"
        return
    found = compare_splits(train, test)
    if not found.pairs.empty:
        yield (
            f"training data {name!r} see the ground of {counted(found.tainted, 'test photo')} of "
            f"{len(test.ids):,}: `airzoo-bench check-split {name} {benchmark}` lists them"
        )
