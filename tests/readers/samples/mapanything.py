"""``predictions.npz`` as MapAnything's gradio app writes it, and what its demo_colmap.py leaves."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tests.readers.samples.network_models import write_model, write_points_ply
from tests.readers.samples.true_views import TrueViews, true_views
from tests.reconstruction.world import World

PROCESSED = (518, 392)


def fields(views: TrueViews) -> dict[str, Any]:
    seen = views.depth > 0
    # Where the mask is False the method leaves depths of its own, which it takes for none.
    depth = np.where(seen, views.depth, 3.0)
    return {
        "extrinsic": views.c2w.astype("f4"),
        "intrinsic": views.intrinsics.astype("f4"),
        "world_points": views.points.astype("f4"),
        "conf": np.full(views.depth.shape, 1.5, "f4"),
        "depth": depth[..., None].astype("f4"),
        "images": np.zeros((*views.depth.shape, 3), "f4"),
        "final_mask": seen,
    }


def write_scene(place: Path, views: TrueViews, **changes: Any) -> Path:
    place.mkdir(parents=True)
    given = fields(views) | changes
    np.savez(place / "predictions.npz", **{k: v for k, v in given.items() if v is not None})
    touch_images(place / "images", views)
    return place


def touch_images(folder: Path, views: TrueViews) -> None:
    folder.mkdir()
    for name in views.names:
        (folder / name).touch()


def write(folder: Path, world: World, **changes: Any) -> Path:
    for scene in ("yard", "lot"):
        write_scene(folder / scene, true_views(world, scene), **changes)
    return folder


def write_models(folder: Path, world: World) -> Path:
    for scene in ("yard", "lot"):
        views = true_views(world, scene)
        write_points_ply(write_model(folder / scene / "sparse", views, PROCESSED), views)
        touch_images(folder / scene / "images", views)
    return folder
