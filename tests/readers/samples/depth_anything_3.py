"""What Depth Anything 3 leaves: mini_npz and npz, a streaming run, a model with rigs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from tests.readers.samples.network_models import write_model, write_rigs
from tests.readers.samples.true_views import TrueViews, true_views
from tests.reconstruction.world import World

SCENES = ("yard", "lot")


def fields(views: TrueViews, digits: int = 8) -> dict[str, Any]:
    return {
        "depth": np.round(views.depth.astype("f4"), digits),
        "conf": np.round(np.full(views.depth.shape, 1.25, "f4"), 2),
        "extrinsics": views.w2c[:, :3].astype("f4"),
        "intrinsics": views.intrinsics.astype("f4"),
    }


def write_results(path: Path, **given: Any) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(path, **given)
    return path


def write(folder: Path, world: World, kind: str = "mini_npz") -> Path:
    for scene in SCENES:
        views = true_views(world, scene)
        given = fields(views, 8 if kind == "mini_npz" else 6)
        if kind == "npz":
            given["image"] = np.zeros((*views.depth.shape, 3), np.uint8)
        write_results(folder / scene / "exports" / kind / "results.npz", **given)
    return folder


def write_streaming_scene(place: Path, views: TrueViews) -> Path:
    (place / "results_output").mkdir(parents=True)
    (place / "pcd").mkdir()
    poses = (" ".join(str(x) for x in pose.flatten()) for pose in views.c2w)
    (place / "camera_poses.txt").write_text("".join(f"{line}\n" for line in poses))
    lenses = (f"{K[0, 0]} {K[1, 1]} {K[0, 2]} {K[1, 2]}\n" for K in views.intrinsics)
    (place / "intrinsic.txt").write_text("".join(lenses))
    for row, depth in enumerate(views.depth.astype("f4")):
        np.savez_compressed(
            place / "results_output" / f"frame_{row}.npz",
            image=np.zeros((*depth.shape, 3), np.uint8),
            depth=depth,
            conf=np.ones_like(depth),
            intrinsics=views.intrinsics[row].astype("f4"),
        )
    return place


def write_streaming(folder: Path, world: World) -> Path:
    for scene in SCENES:
        write_streaming_scene(folder / scene, true_views(world, scene))
    return folder


def write_models(folder: Path, world: World) -> Path:
    for scene in SCENES:
        views = true_views(world, scene)
        write_model(folder / scene, views)
        write_rigs(folder / scene, len(views.names))
    return folder
