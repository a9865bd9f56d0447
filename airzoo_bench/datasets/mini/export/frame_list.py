"""Which frames are rendered, and the tables that say where each was taken."""

from __future__ import annotations

import csv
import io
import json
import re
from collections import Counter
from dataclasses import dataclass

import numpy as np

from airzoo_bench.core.errors import UsageError, first_of
from airzoo_bench.core.validation import SAFE_NAME
from airzoo_bench.datasets.mini.rendering.renderer import check_size
from airzoo_bench.datasets.mini.rendering.weather import conditions
from airzoo_bench.datasets.mini.world.model import CRS
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.frames import enu_axes, geodetic_to_ecef, to_lonlat
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.rotations import matrix_to_quaternion, rotations_to_angles
from airzoo_bench.geometry.units import grid_convergence_deg

__all__ = [
    "ECEF_COLUMNS",
    "IMAGE_SUFFIX",
    "PLACE_COLUMNS",
    "FrameList",
    "colmap_texts",
    "frames_csv",
]

IMAGE_SUFFIX = ".jpg"
PLACE_COLUMNS = ("longitude", "latitude", "altitude", "roll", "pitch", "yaw")
ECEF_COLUMNS = ("ecef_x", "ecef_y", "ecef_z", "ecef_qw", "ecef_qx", "ecef_qy", "ecef_qz")
_LENS = ("width", "height", "fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")


@dataclass(frozen=True, eq=False)
class FrameList:
    """N frames to render.

    Raises
    ------
    UsageError
        Fields of other lengths, names that are there twice or cannot be names of files, an
        unknown weather or time of day, photos that would not fit memory.
    """

    names: tuple[str, ...]  # each once; they become names of files
    camera: Cameras  # one for all
    poses: Poses  # N, in `model.CRS`
    weather: tuple[str, ...]  # see `weather.conditions`
    time_of_day: tuple[str, ...]
    seed: int = 0  # of the noise, together with each frame's name

    def __post_init__(self) -> None:
        count = len(self.names)
        if {len(self.poses), len(self.weather), len(self.time_of_day)} != {count}:
            raise UsageError("lists of frames differ in length", expected=f"{count} of each")
        twice = [name for name, found in Counter(self.names).items() if found > 1]
        if twice:
            raise UsageError(f"names of frames are there twice: {first_of(twice)}")
        unsafe = [name for name in self.names if not re.fullmatch(SAFE_NAME, name)]
        if unsafe:
            raise UsageError(
                f"names of frames cannot be names of files: {first_of(unsafe, count)}",
                expected="letters, digits, dots, hyphens and underscores, at most 64",
            )
        for pair in sorted(set(zip(self.weather, self.time_of_day, strict=True))):
            conditions(*pair)
        check_size(self.camera)

    def __len__(self) -> int:
        return len(self.names)


def frames_csv(frames: FrameList) -> str:
    """Return the table of frames, a row each."""
    poses = frames.poses
    lonlat = to_lonlat(CRS, poses.centres[:, :2])
    place = np.column_stack([lonlat, poses.centres[:, 2]])
    convergence = grid_convergence_deg(CRS, lonlat)
    angles = rotations_to_angles(poses.rotation, convergence_deg=convergence)[:, ::-1]
    ecef = geodetic_to_ecef(place)
    quaternion = matrix_to_quaternion(_ecef_rotations(poses, lonlat, convergence))
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["name", "weather", "time_of_day", *PLACE_COLUMNS, *ECEF_COLUMNS, *_LENS])
    camera = frames.camera
    lens = [*camera.width.tolist(), *camera.height.tolist()]
    for part in (camera.focal, camera.principal_point, camera.distortion):
        lens += part[0].tolist()
    for row, name in enumerate(frames.names):
        numbers = _fixed(12, place[row, :2]) + _fixed(6, place[row, 2:]) + _fixed(12, angles[row])
        numbers += _fixed(6, ecef[row]) + _fixed(15, quaternion[row])
        writer.writerow([name, frames.weather[row], frames.time_of_day[row], *numbers, *lens])
    return text.getvalue()


def _ecef_rotations(poses: Poses, lonlat: Floats, convergence_deg: Floats) -> Floats:
    """Return rotations (N, 3, 3) from ECEF to the camera."""
    turn = np.radians(convergence_deg)
    zero, one = np.zeros_like(turn), np.ones_like(turn)
    rows = ((np.cos(turn), -np.sin(turn), zero), (np.sin(turn), np.cos(turn), zero))
    grid_from_enu: Floats = np.moveaxis(np.array([*rows, (zero, zero, one)]), -1, 0)
    rotations: Floats = poses.rotation @ grid_from_enu @ np.swapaxes(enu_axes(lonlat), -1, -2)
    return rotations


def _fixed(digits: int, values: Floats) -> list[str]:
    # Adding 0 makes a negative zero positive.
    return [f"{value:.{digits}f}" for value in (np.round(values, digits) + 0.0).tolist()]


def colmap_texts(frames: FrameList, offset: Floats) -> dict[str, str]:
    """Return the files of a COLMAP text model by name: the camera and the poses, and no points."""
    local = Poses(rotation=frames.poses.rotation, centres=frames.poses.centres - offset)
    numbers = np.column_stack([matrix_to_quaternion(local.rotation), local.translation])
    images = ""
    for row, name in enumerate(frames.names):
        pose = " ".join(f"{value:.15g}" for value in numbers[row])
        images += f"{row + 1} {pose} 1 {name}{IMAGE_SUFFIX}\n\n"
    shown = [float(value) for value in offset]
    world = f"# world: {CRS} less {' '.join(f'{value:g}' for value in shown)} (x y z, metres)\n"
    heads = "# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then an empty line\n"
    camera = f"# CAMERA_ID MODEL WIDTH HEIGHT PARAMS\n1 {_camera_line(frames.camera)}\n"
    return {
        "cameras.txt": camera,
        "images.txt": heads + world + images,
        "points3D.txt": f"# no points\n{world}",
        "offset.json": json.dumps({"crs": CRS, "offset": shown}, indent=2) + "\n",
    }


def _camera_line(camera: Cameras) -> str:
    k1, k2, p1, p2, k3 = camera.distortion[0].tolist()
    params = [*camera.focal[0].tolist(), *camera.principal_point[0].tolist()]
    model = "PINHOLE"
    if k3 != 0.0:
        model, params = "FULL_OPENCV", [*params, k1, k2, p1, p2, k3, 0.0, 0.0, 0.0]
    elif any((k1, k2, p1, p2)):
        model, params = "OPENCV", [*params, k1, k2, p1, p2]
    return f"{model} {camera.width[0]} {camera.height[0]} {' '.join(map(repr, params))}"
