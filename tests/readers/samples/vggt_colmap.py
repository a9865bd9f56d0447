"""The folder of a scene as VGGT's demo_colmap.py leaves it."""

from __future__ import annotations

from pathlib import Path

from tests.readers.samples.network_models import write_model, write_points_ply
from tests.readers.samples.true_views import true_views
from tests.reconstruction.world import World


def write(folder: Path, world: World) -> Path:
    for scene in ("yard", "lot"):
        views = true_views(world, scene)
        write_points_ply(write_model(folder / scene / "sparse", views), views)
    return folder
