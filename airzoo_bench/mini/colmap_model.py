"""A COLMAP text model of frames: cameras and poses, and no points.

Its world is `world.CRS` less the region's south-west corner: with easting and northing in millions
of metres, t = -R C would lose digits, and most programs that read such models work in single
precision. The offset stands in the files' comments and in ``offset.json``.
"""

from __future__ import annotations

import json

import numpy as np

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.quaternions import matrix_to_quaternion
from airzoo_bench.mini.frame_files import IMAGE_SUFFIX
from airzoo_bench.mini.frame_list import FrameList
from airzoo_bench.mini.world import CRS

__all__ = ["colmap_texts"]


def colmap_texts(frames: FrameList, offset: Floats) -> dict[str, str]:
    """Return the files of a model by name.

    Parameters
    ----------
    frames : FrameList
    offset : (3,) array
        What is taken off positions in `world.CRS`.

    Returns
    -------
    dict of str to str
        ``cameras.txt``, ``images.txt``, ``points3D.txt``, ``offset.json``.
    """
    shown = [float(value) for value in offset]
    world = f"# world: {CRS} less {' '.join(f'{value:g}' for value in shown)} (x y z, metres)\n"
    cameras, index = _cameras(frames)
    return {
        "cameras.txt": f"# CAMERA_ID MODEL WIDTH HEIGHT PARAMS\n{cameras}",
        "images.txt": "# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then an empty line\n"
        + world
        + _images(frames, offset, index),
        "points3D.txt": f"# no points\n{world}",
        "offset.json": json.dumps({"crs": CRS, "offset": shown}, indent=2) + "\n",
    }


def _cameras(frames: FrameList) -> tuple[str, list[int]]:
    """Lines of the different cameras, and which of them took each frame."""
    numbers: dict[str, int] = {}
    taken = [
        numbers.setdefault(_camera_line(frames.cameras.take(n)), len(numbers) + 1)
        for n in range(len(frames.cameras))
    ]
    text = "".join(f"{number} {line}\n" for line, number in numbers.items())
    return text, taken * len(frames) if len(taken) == 1 else taken


def _camera_line(camera: Cameras) -> str:
    k1, k2, p1, p2, k3 = camera.distortion[0].tolist()
    pinhole = [*camera.focal[0].tolist(), *camera.principal_point[0].tolist()]
    if k3 != 0.0:
        model, params = "FULL_OPENCV", [*pinhole, k1, k2, p1, p2, k3, 0.0, 0.0, 0.0]
    elif any((k1, k2, p1, p2)):
        model, params = "OPENCV", [*pinhole, k1, k2, p1, p2]
    else:
        model, params = "PINHOLE", pinhole
    numbers = " ".join(repr(value) for value in params)
    return f"{model} {camera.width[0]} {camera.height[0]} {numbers}"


def _images(frames: FrameList, offset: Floats, camera: list[int]) -> str:
    local = Poses(rotation=frames.poses.rotation, centres=frames.poses.centres - offset)
    numbers = np.column_stack([matrix_to_quaternion(local.rotation), local.translation])
    lines = []
    for row, name in enumerate(frames.names):
        pose = " ".join(f"{value:.15g}" for value in numbers[row])
        lines.append(f"{row + 1} {pose} {camera[row]} {name}{IMAGE_SUFFIX}\n\n")
    return "".join(lines)
