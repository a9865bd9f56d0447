"""The made world of the reconstruction tests in a local frame, and predictions that are scored."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from airzoo_bench.evaluation.evaluate import evaluate
from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.formats.clouds.ply import write_ply
from airzoo_bench.geometry.poses import Poses
from tests.geometry.support import looking_down
from tests.reconstruction.world import (
    MAP_SIZE,
    ORIGIN,
    Array,
    matrix_of_maps,
    save,
    true_points,
)

FRAME = np.array((-120.0, 35.0, -80.0))  # where the world's corner lies in the local frame
MATRIX = matrix_of_maps()


def local_poses() -> Poses:
    """Six cameras 70 m above the ground, whose photos overlap by half."""
    rows = np.arange(6)
    rotation = np.concatenate([looking_down(4 + 2 * n, 65 * n - 40) for n in rows])
    east, north = 18 + 12 * (rows % 3) + rows, 24 + 12 * (rows // 3) + 0.7 * rows
    centres = np.stack([east, north, 70 + 2.0 * rows], axis=1) + FRAME
    return Poses(rotation=rotation, centres=centres)


def local_points(scene: str = "yard") -> Array:
    return true_points(scene) - ORIGIN + FRAME


def write_photo(path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.new("RGB", MAP_SIZE, (90, 120, 80)).save(path, format="JPEG")


def write_cloud(path: Path, points: Array) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_ply(path, Cloud(points))
    return path


def score(
    data: Path,
    protocol: str,
    scene: str,
    points: Array,
    names: Sequence[str],
    poses: Poses,
) -> dict[str, Any]:
    """Predict one scene's cloud and cameras, and return its record."""
    folder = data / "prediction"
    write_ply(folder / f"{scene}.ply", Cloud(np.asarray(points, np.float64)))
    extrinsics = np.concatenate([poses.rotation, poses.translation[..., None]], axis=2)
    save(
        folder / f"{scene}.cameras.npz",
        {"image_names": np.array(list(names)), "extrinsics": extrinsics},
    )
    (folder / "protocol.txt").write_text(protocol + "\n")
    scored = evaluate(folder, track="reconstruction", data=data).scored
    record: dict[str, Any] = scored[scene].records.to_dict("records")[0]
    return record
