"""Poses as texts of hloc, LTVL, TUM and KITTI, written from truth as those tools write them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from airzoo_bench.geometry.poses import matrix_to_quaternion
from tests.matching.world import World

READER = "hloc-poses"

IDENTITY = "1 0 0 0 0 0 0"


def write(folder: Path, world: World) -> Path:
    """Write ``localize_sfm``'s results: basenames, w2c, w x y z."""
    return write_lines(folder / "hloc_results.txt", list(hloc_lines(world).values()))


def hloc_lines(world: World) -> dict[str, str]:
    """Return a line a photo, as ``hloc.utils.io.write_poses`` makes them, by the photo's name."""
    poses = world.truth.poses
    quaternions = matrix_to_quaternion(poses.rotation)
    rows = zip(world.truth.queries["image"], quaternions, poses.translation, strict=True)
    return {name: " ".join([name, *map(repr, map(float, (*q, *t)))]) for name, q, t in rows}


def write_tum(folder: Path, world: World) -> Path:
    """Write centres and camera-to-world quaternions x y z w, and ``names.txt``."""
    poses = world.truth.poses
    w, x, y, z = matrix_to_quaternion(np.swapaxes(poses.rotation, 1, 2)).T
    values = np.column_stack([np.arange(len(w)), poses.centres, x, y, z, w])
    return _numbers(folder, world, "tum.txt", values)


def write_kitti(folder: Path, world: World) -> Path:
    """Write camera-to-world matrices row by row, and ``names.txt``."""
    poses = world.truth.poses
    matrices = np.concatenate(
        [np.swapaxes(poses.rotation, 1, 2), poses.centres[:, :, None]], axis=2
    )
    return _numbers(folder, world, "kitti.txt", matrices.reshape(-1, 12))


def _numbers(folder: Path, world: World, name: str, values: np.ndarray) -> Path:
    write_lines(folder / "names.txt", world.truth.queries["image"].tolist())
    rows = [" ".join(map(repr, map(float, row))) for row in values]
    return write_lines(folder / name, rows)


def write_lines(path: Path, lines: list[str]) -> Path:
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path
