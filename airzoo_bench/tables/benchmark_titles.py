"""What benchmarks are called above their columns."""

from __future__ import annotations

from collections.abc import Sequence

from airzoo_bench.protocol.lookup import load_protocol, shipped_protocols
from airzoo_bench.tables.method_table import MethodTable

__all__ = ["benchmark_titles"]


def benchmark_titles(boards: Sequence[MethodTable]) -> list[str]:
    """Return a head for each board: the benchmark's title, and what more tells them apart.

    That is the track, such as in ``AirZoo-Mini, matching``, or else the protocol's name. The title
    is that of a shipped protocol; a benchmark that has none goes by its name.
    """
    titles = _shipped_titles()
    benchmarks = [titles.get(board.benchmark, board.benchmark) for board in boards]
    tracks = [f"{name}, {b.track}" for name, b in zip(benchmarks, boards, strict=True)]
    heads = []
    for benchmark, track, board in zip(benchmarks, tracks, boards, strict=True):
        alone = benchmarks.count(benchmark) == 1
        heads.append(benchmark if alone else track if tracks.count(track) == 1 else board.title)
    return heads


def _shipped_titles() -> dict[str, str]:
    # A protocol's title is the benchmark's, and behind a comma what is measured.
    protocols = [load_protocol(path) for path in shipped_protocols().values()]
    return {protocol.benchmark: protocol.title.partition(",")[0] for protocol in protocols}
