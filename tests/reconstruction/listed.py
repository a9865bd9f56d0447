"""What is read of a prediction of scenes."""

from __future__ import annotations

from pathlib import Path

from airzoo_bench.reconstruction.predictions import ReconstructionPredictions, open_reconstruction

ROOM = 1 << 24


def listed(path: Path, room: int = ROOM) -> ReconstructionPredictions:
    return open_reconstruction(path, unpacked_limit_bytes=room)
