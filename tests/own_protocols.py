"""Protocols of own photos."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from airzoo_bench.datasets.truths import BenchmarkProtocols
from airzoo_bench.matching.settings import MatchingProtocol
from airzoo_bench.protocol.model import load_protocol, protocol_for, shipped_protocols
from airzoo_bench.reconstruction.settings import ReconstructionProtocol
from airzoo_bench.retrieval.settings import RetrievalProtocol

if TYPE_CHECKING:
    pass


def photo_protocols(
    name: str, tile_sizes_px: tuple[int, ...], ground_truth: dict[str, Any] | None = None
) -> BenchmarkProtocols:
    """Return the protocols that `prepare photos` would start from, for a benchmark of that name."""
    shipped = shipped_protocols()
    tracks = ("retrieval", "matching", "reconstruction")
    retrieval, matching, reconstruction = (load_protocol(shipped[f"photos-{t}"]) for t in tracks)
    assert isinstance(retrieval, RetrievalProtocol)
    assert isinstance(matching, MatchingProtocol)
    assert isinstance(reconstruction, ReconstructionProtocol)
    changes = {"gallery": {"tile_sizes_px": tile_sizes_px}, "ground_truth": ground_truth or {}}
    return BenchmarkProtocols(
        (
            protocol_for(retrieval, name, changes),
            protocol_for(matching, name, {}),
            protocol_for(reconstruction, name, {}),
        )
    )
