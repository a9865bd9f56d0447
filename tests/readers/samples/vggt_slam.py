"""``poses.txt`` and ``poses_logs`` as VGGT-SLAM's map.py writes them, two submaps of a scene."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from tests.readers.samples.true_views import TrueViews, true_views
from tests.reconstruction.world import World


def frame_id(name: str) -> float:
    found = re.search(r"\d+(?:\.\d+)?", name)
    assert found is not None
    return float(found.group())


def write_scene(place: Path, views: TrueViews, photos: Sequence[str], dense: bool = True) -> Path:
    """Write a scene; `photos` are the names that VGGT-SLAM was given."""
    (place / "poses_logs").mkdir(parents=True)
    lines = []
    half = len(photos) // 2
    xyzw = Rotation.from_matrix(views.c2w[:, :3, :3]).as_quat()
    for row in (*range(half + 1), *range(half, len(photos))):
        number = frame_id(photos[row])
        values = np.array([number, *views.c2w[row, :3, 3], *xyzw[row]])
        if row == half and len(lines) == half:
            values[1:4] += 5.0  # a frame that two submaps share: the first one's is another
        lines.append(" ".join(f"{value:.8f}" for value in values) + "\n")
        mask = views.depth[row] > 0
        points = np.where(mask[..., None], views.points[row], 99.0)
        np.savez(place / "poses_logs" / f"{number}.npz", pointcloud=points, mask=mask)
    (place / "poses.txt").write_text("".join(lines))
    if not dense:
        for one in (place / "poses_logs").iterdir():
            one.unlink()
        (place / "poses_logs").rmdir()
    return place


def bare(views: TrueViews) -> list[str]:
    return [f"{row:06d}.jpg" for row in range(len(views.names))]


def write(folder: Path, world: World) -> Path:
    """Write scenes whose photos were renamed to bare numbers, and ``names.txt`` beside them."""
    names = []
    for scene in ("yard", "lot"):
        views = true_views(world, scene)
        write_scene(folder / scene, views, bare(views))
        names += [f"{scene}/{name}" for name in views.names]
    folder.with_name(f"{folder.name}-names.txt").write_text("\n".join(names))
    return folder
