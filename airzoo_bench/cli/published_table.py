"""The board of a protocol without results: what is published on it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from airzoo_bench.matching.scores import matching_scores
from airzoo_bench.matching.settings import MatchingProtocol
from airzoo_bench.protocol.lookup import find_protocol
from airzoo_bench.protocol.model import Protocol
from airzoo_bench.reconstruction.scores import reconstruction_scores
from airzoo_bench.reconstruction.settings import ReconstructionProtocol
from airzoo_bench.results.result import score_columns
from airzoo_bench.retrieval.scores import retrieval_scores
from airzoo_bench.retrieval.settings import RetrievalProtocol
from airzoo_bench.tables.method_table import MethodTable

if TYPE_CHECKING:
    from airzoo_bench.results.scores import Score

__all__ = ["empty_board", "published_benchmarks"]


def empty_board(name: str, data: Path, *, every_score: bool) -> MethodTable:
    """Return a board with the scores and scenes of a protocol, and no entry.

    Parameters
    ----------
    name : str
        Name or path of the protocol.
    data : Path
        Where benchmark folders are found, which may have protocols of their own.
    every_score : bool
        Take all scores instead of the headline ones.

    Raises
    ------
    ProtocolError
        There is no such protocol.
    """
    protocol = find_protocol(name, data)
    columns = score_columns(_scores(protocol))
    return MethodTable(
        f"{protocol.name} v{protocol.version}",
        protocol.benchmark,
        protocol.track,
        tuple(column for column in columns if every_score or column.headline),
        {scene.id: scene.title for scene in protocol.scenes},
        {},
        (),
    )


def published_benchmarks(track: str, *, by_scene: bool = False) -> list[str]:
    """Return the benchmarks on which something is published in a track, and by scene if asked."""
    from airzoo_bench.tables.published import published_sources, read_source

    tables = [table for path in published_sources().values() for table in read_source(path)]
    fitting = [t for t in tables if t.track == track and (t.has_scenes or not by_scene)]
    return list(dict.fromkeys(table.benchmark for table in fitting))


def _scores(protocol: Protocol) -> list[Score]:
    if isinstance(protocol, RetrievalProtocol):
        return retrieval_scores(protocol.scores)
    if isinstance(protocol, MatchingProtocol):
        return matching_scores(protocol.scores)
    assert isinstance(protocol, ReconstructionProtocol)
    return reconstruction_scores(protocol.scores, with_poses=False)
