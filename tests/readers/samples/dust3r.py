"""What the lines of docs/recipes/reconstruction.md save of a scene of DUSt3R or MASt3R."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tests.readers.samples.true_views import TrueViews, true_views
from tests.reconstruction.world import World


def fields(views: TrueViews) -> dict[str, Any]:
    points = np.where(views.depth[..., None] > 0, views.points, np.nan)
    return {
        "pts3d": points.astype("f4"),
        "poses": views.c2w.astype("f4"),
        "focals": views.intrinsics[:, :1, 0].astype("f4"),
        "conf": np.full(views.depth.shape, 7.0, "f4"),
        "names": np.array(views.names),
    }


def write(folder: Path, world: World, **changes: Any) -> Path:
    for scene in ("yard", "lot"):
        given = fields(true_views(world, scene)) | changes
        given = {name: value for name, value in given.items() if value is not None}
        (folder / scene).mkdir(parents=True)
        np.savez(folder / scene / "scene.npz", **given)
    return folder
