"""``predictions.npz`` as VGGT's demo_gradio.py writes it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tests.readers.samples.true_views import TrueViews, true_views
from tests.reconstruction.world import World


def fields(views: TrueViews) -> dict[str, Any]:
    count, height, width = views.depth.shape
    trust = np.full(views.depth.shape, 7.0, "f4")
    xyzw = views.quaternions()[:, [1, 2, 3, 0]]
    focal = views.intrinsics[:, (1, 0), (1, 0)]
    fov = 2 * np.arctan(np.array((height, width)) / 2 / focal)
    return {
        "pose_enc": np.concatenate([views.w2c[:, :3, 3], xyzw, fov], axis=1).astype("f4"),
        "pose_enc_list": np.array(None, dtype=object),  # pickled, as the demo leaves it
        "depth": views.depth[..., None].astype("f4"),
        "depth_conf": trust,
        "world_points": views.points.astype("f4"),
        "world_points_conf": trust,
        "images": np.zeros((count, 3, height, width), "f4"),
        "extrinsic": views.w2c[:, :3].astype("f4"),
        "intrinsic": views.intrinsics.astype("f4"),
        "world_points_from_depth": views.points,
    }


def write_scene(place: Path, views: TrueViews, **changes: Any) -> Path:
    place.mkdir(parents=True)
    given = fields(views) | changes
    np.savez(place / "predictions.npz", **{k: v for k, v in given.items() if v is not None})
    (place / "images").mkdir()
    for name in views.names:
        (place / "images" / name).touch()
    (place / "glbscene_50_All.glb").write_bytes(b"glTF")
    return place


def write(folder: Path, world: World, **changes: Any) -> Path:
    for scene in ("yard", "lot"):
        write_scene(folder / scene, true_views(world, scene), **changes)
    return folder
