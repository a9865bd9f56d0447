"""UAVScenes as it is downloaded, made of the made world."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from airzoo_bench.geometry.poses import Poses
from tests.datasets.published.reconstruction_world import (
    MATRIX,
    local_points,
    local_poses,
    write_cloud,
    write_photo,
)

Change = Callable[[list[dict[str, Any]]], object]


def stamp(number: int) -> str:
    seconds, rest = divmod(641_204_937 + number * 100_000_000, 10**9)
    return f"{1_658_137_057 + seconds}.{rest:09d}"


def to_world(poses: Poses) -> np.ndarray:
    """Camera-to-world matrices (N, 4, 4), by inverting world-to-camera ones."""
    matrices = np.tile(np.eye(4), (len(poses), 1, 1))
    matrices[:, :3, :3], matrices[:, :3, 3] = poses.rotation, poses.translation
    return np.linalg.inv(matrices)


def samples() -> list[dict[str, Any]]:
    """Entries of every image of interval 1: five of each that interval 5 has."""
    entries = []
    for number, matrix in enumerate(to_world(local_poses())):
        for between in range(5):
            moved = matrix.copy()
            moved[0, 3] += 0.3 * between
            entry = {
                "OriginalImageName": f"{stamp(number * 5 + between)}.jpg",
                "SortedImageID": number * 5 + between,
                "T4x4": moved.tolist(),
                "P3x3": MATRIX.tolist(),
            }
            entries.append(entry)
    return entries


def make_run(
    root: Path,
    run: str = "AMtown01",
    *,
    ending: str = ".jpg",
    change: Change | None = None,
) -> Path:
    """Write a run's photos of interval 5 and its poses; returns its folder."""
    home = root / "interval5_CAM_LIDAR" / f"interval5_{run}"
    for number in range(len(local_poses())):
        write_photo(home / "interval5_CAM" / f"{stamp(number * 5)}{ending}")
    entries = samples()
    if change is not None:
        change(entries)
    (home / "sampleinfos_interpolated.json").write_text(json.dumps(entries))
    return home


def make_place(
    root: Path,
    place: str = "AMtown",
    scene: str = "yard",
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Path:
    """Write the cloud of a place."""
    cloud = root / "terra_3dmap_pointcloud_mesh" / place / "cloud_merged.ply"
    return write_cloud(cloud, np.add(local_points(scene), shift))
