"""VGGT's files: read right, whatever branch they hold, and refused where they contradict."""

from __future__ import annotations

from pathlib import Path

from tests.readers.recon_support import check_perfect, scored, world
from tests.readers.samples import vggt
from tests.reconstruction.world import World

__all__ = ["world"]


def test_exact_depth_is_perfect(world: World, tmp_path: Path) -> None:
    found = scored(world, vggt.write(tmp_path / "out", world))
    print(found.result.overall, found.result.notes, found.given.reader)
    check_perfect(found)
