"""What a reader of the numbers of any track must know."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from airzoo_bench.core.errors import ProtocolError
from airzoo_bench.protocol.lookup import load_protocol, protocol_files
from airzoo_bench.protocol.model import Protocol
from airzoo_bench.results.comparable import other_settings

__all__ = ["counts_apart", "namesake_notes"]


def namesake_notes(used: Protocol, data: Path) -> list[str]:
    """Say so where a protocol goes by the name of another one, which readers would take it for."""
    path = protocol_files(data).get(used.name)
    try:
        known = None if path is None else load_protocol(path)
    except ProtocolError:  # what nobody can use is no namesake
        known = None
    if known is None or known.fingerprint == used.fingerprint:
        return []
    why = other_settings(known.settings(), used.settings())
    return [f"the protocol is not the {used.name} that all have: {why}"]


def counts_apart(protocol: Protocol, counts: Mapping[str, Mapping[str, int]]) -> list[str]:
    """Say where a scene has not as many queries as in the paper."""
    return [
        f"scene {scene.title} has {counts[scene.id]['queries']:,} queries here, "
        f"{scene.queries:,} in the paper"
        for scene in protocol.scenes
        if scene.queries not in (None, counts[scene.id].get("queries", scene.queries))
    ]
