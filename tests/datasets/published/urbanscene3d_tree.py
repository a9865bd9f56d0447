"""UrbanScene3D with poses of Mega-NeRF or COLMAP, made of the made world."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses, matrix_to_quaternion
from tests.datasets.published.reconstruction_world import (
    MATRIX,
    local_poses,
    write_photo,
)
from tests.formats.torch_support import Tensor, save
from tests.reconstruction.world import MAP_SIZE

# From the frame of the poses to that of the scan: a turn about all axes, a scale and a shift.
_ANGLE = np.radians((20.0, -35.0, 50.0))
SCALE, SHIFT = 2.5, np.array((310.0, -40.0, 12.0))


def _turn() -> np.ndarray:
    turn = np.eye(3)
    for axis, angle in enumerate(_ANGLE):
        about = np.eye(3)
        a, b = (axis + 1) % 3, (axis + 2) % 3
        about[[a, a, b, b], [a, b, a, b]] = (
            *(np.cos(angle), -np.sin(angle)),
            *(np.sin(angle), np.cos(angle)),
        )
        turn = about @ turn
    return turn


TURN = _turn()


def model_poses() -> Poses:
    """The true poses in a frame of their own, as structure from motion finds them."""
    poses = local_poses()
    centres = (poses.centres - SHIFT) @ TURN / SCALE
    return Poses(rotation=poses.rotation @ TURN, centres=centres)


def write_transform(path: Path) -> Path:
    """Write the matrix as CloudCompare prints it."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = SCALE * TURN, SHIFT
    lines = [" ".join(f"{value:.12f}" for value in row) for row in matrix]
    path.write_text("\n".join(lines) + "\n")
    return path


def photo(number: int) -> str:
    """The name of a photo in Mega-NeRF's layout: every third is held out."""
    return f"{'val' if number % 3 == 0 else 'train'}/rgbs/{number:06d}.jpg"


def make_mega_nerf(
    home: Path, poses: Poses, *, cameras: Cameras | None = None, double: bool = False
) -> None:
    """Write what Mega-NeRF's own converter writes, by the steps of its code."""
    to_drb = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])
    kind = "<f8" if double else "<f4"
    rotations = [to_drb @ r.T @ np.linalg.inv(to_drb) for r in poses.rotation]
    positions = poses.centres @ to_drb.T
    origin = (positions.max(axis=0) + positions.min(axis=0)) / 2
    factor = float(np.sqrt(((positions - origin) ** 2).sum(axis=1)).max())
    lenses = cameras or Cameras.from_matrices(np.tile(MATRIX, (len(poses), 1, 1)), *MAP_SIZE)
    for number, (turn, place) in enumerate(zip(rotations, positions, strict=True)):
        camera = np.column_stack([turn, (place - origin) / factor])
        c2w = np.column_stack([camera[:, 1], -camera[:, 0], camera[:, 2], camera[:, 3]])
        write_photo(home / photo(number))
        content: dict[str, Any] = {
            "H": int(lenses.height[number]),
            "W": int(lenses.width[number]),
            "c2w": Tensor(c2w, kind),
            "intrinsics": Tensor([*lenses.focal[number], *lenses.principal_point[number]], kind),
            "distortion": Tensor([0.1, 0.0, 0.0, 0.0], kind),
        }
        part = photo(number).split("/")[0]
        save(home / part / "metadata" / f"{number:06d}.pt", content)
    stated = {"origin_drb": Tensor(origin, kind), "pose_scale_factor": factor}
    save(home / "coordinates.pt", stated)


def make_colmap(home: Path, poses: Poses) -> None:
    """Write photos and a COLMAP text model."""
    model = home / "sparse" / "0"
    model.mkdir(parents=True)
    fx, fy, cx, cy = MATRIX[0, 0], MATRIX[1, 1], MATRIX[0, 2], MATRIX[1, 2]
    camera = f"1 PINHOLE {MAP_SIZE[0]} {MAP_SIZE[1]} {fx} {fy} {cx} {cy}\n"
    (model / "cameras.txt").write_text(camera)
    (model / "points3D.txt").write_text("")
    lines = []
    rows = zip(matrix_to_quaternion(poses.rotation), poses.translation, strict=True)
    for number, (quaternion, shift) in enumerate(rows):
        numbers = " ".join(f"{value:.15g}" for value in (*quaternion, *shift))
        lines.append(f"{number + 1} {numbers} 1 a/DJI_{number:04d}.JPG\n\n")
        write_photo(home / "images" / "a" / f"DJI_{number:04d}.JPG")
    (model / "images.txt").write_text("".join(lines))
