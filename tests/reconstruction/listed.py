"""What is read of a prediction of scenes."""

from __future__ import annotations

from pathlib import Path

from airzoo_bench.evaluation.track import ScenePredictions
from airzoo_bench.reconstruction.reading import open_reconstruction

ROOM = 1 << 24


def listed(path: Path, room: int = ROOM) -> ScenePredictions:
    return open_reconstruction(path, unpacked_limit_bytes=room)
