"""The folder that CUT3R's demo.py writes, and ``pred_traj.txt`` of its evaluation of poses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from tests.readers.samples.true_views import TrueViews, true_views
from tests.reconstruction.world import World


def write_scene(place: Path, views: TrueViews) -> Path:
    for name in ("depth", "conf", "color", "camera"):
        (place / name).mkdir(parents=True)
    for row, depth in enumerate(views.depth):
        np.save(place / "depth" / f"{row:06d}.npy", depth.astype("f4"))
        np.save(place / "conf" / f"{row:06d}.npy", np.full(depth.shape, 7.0, "f4"))
        (place / "color" / f"{row:06d}.png").touch()
        np.savez(
            place / "camera" / f"{row:06d}.npz",
            pose=views.c2w[row].astype("f4"),
            intrinsics=views.intrinsics[row].astype("f4"),
        )
    return place


def write_trajectory(place: Path, views: TrueViews) -> Path:
    place.mkdir(parents=True)
    xyzw = Rotation.from_matrix(views.c2w[:, :3, :3]).as_quat()
    rows = np.concatenate([views.c2w[:, :3, 3], xyzw[:, [3, 0, 1, 2]]], axis=1)
    lines = [
        f"{float(row)} {' '.join(map(str, values))}\n" for row, values in enumerate(rows.tolist())
    ]
    (place / "pred_traj.txt").write_text("".join(lines))
    np.savetxt(place / "pred_focal.txt", views.intrinsics[:, 0, 0], fmt="%.6f")
    return place


def write(folder: Path, world: World) -> Path:
    for scene in ("yard", "lot"):
        write_scene(folder / scene, true_views(world, scene))
    return folder


def write_trajectories(folder: Path, world: World) -> Path:
    for scene in ("yard", "lot"):
        write_trajectory(folder / scene, true_views(world, scene))
    return folder
