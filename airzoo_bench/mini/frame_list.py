"""Which frames are to be rendered, and the tables that say where each was taken."""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np

from airzoo_bench.core.errors import UsageError, first_of
from airzoo_bench.core.settings import SAFE_NAME
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.attitude import grid_convergence_deg, rotations_to_angles
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.frames import Enu, geodetic_to_ecef, to_lonlat
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.quaternions import matrix_to_quaternion
from airzoo_bench.mini.render import check_size
from airzoo_bench.mini.weather import conditions
from airzoo_bench.mini.world import CRS

__all__ = ["FrameList", "ecef_rotations", "frames_csv"]

_PLACE = ("longitude", "latitude", "altitude", "roll", "pitch", "yaw")
_ECEF = ("ecef_x", "ecef_y", "ecef_z", "ecef_qw", "ecef_qx", "ecef_qy", "ecef_qz")
_LENS = ("width", "height", "fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")


@dataclass(frozen=True, eq=False)
class FrameList:
    """N frames to render.

    Attributes
    ----------
    names : tuple of N str
        Each once; they become names of files.
    cameras : Cameras
        One for all, or N.
    poses : Poses
        N, in `world.CRS`.
    weather, time_of_day : tuple of N str
        See `weather.conditions`.
    seed : int
        Of the noise, together with each frame's name.

    Raises
    ------
    UsageError
        Fields of other lengths, names that are there twice or cannot be names of files, an
        unknown weather or time of day, photos that would not fit memory.
    """

    names: tuple[str, ...]
    cameras: Cameras
    poses: Poses
    weather: tuple[str, ...]
    time_of_day: tuple[str, ...]
    seed: int = 0

    def __post_init__(self) -> None:
        count = len(self.names)
        lengths = {len(self.poses), len(self.weather), len(self.time_of_day)}
        if lengths != {count} or len(self.cameras) not in (1, count):
            raise UsageError("lists of frames differ in length", expected=f"{count} of each")
        _check_names(self.names)
        for weather, time in sorted(set(zip(self.weather, self.time_of_day, strict=True))):
            conditions(weather, time)
        for number in range(len(self.cameras)):
            check_size(self.cameras.take(number))

    def __len__(self) -> int:
        return len(self.names)

    def camera(self, number: int) -> Cameras:
        """Return the camera of a frame."""
        return self.cameras.take(number if len(self.cameras) > 1 else 0)


def frames_csv(frames: FrameList) -> str:
    """Return the table of frames, a row each.

    Position and gimbal angles in WGS84 as `geometry.attitude` has them, the position and the
    world-to-camera quaternion (w x y z) in ECEF, and the intrinsics (pixel centres at integer
    + 0.5). Degrees have 12 digits behind the point, metres 6: a chain of frames through this
    table closes to the micrometre.
    """
    poses = frames.poses
    lonlat = to_lonlat(CRS, poses.centres[:, :2])
    place = np.column_stack([lonlat, poses.centres[:, 2]])
    angles = rotations_to_angles(poses.rotation, convergence_deg=grid_convergence_deg(CRS, lonlat))[
        :, ::-1
    ]
    ecef = np.column_stack(
        [geodetic_to_ecef(place), matrix_to_quaternion(ecef_rotations(poses, lonlat))]
    )
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["name", "weather", "time_of_day", *_PLACE, *_ECEF, *_LENS])
    lens = [_lens_cells(frames.camera(n)) for n in range(len(frames))]
    for row, name in enumerate(frames.names):
        numbers = _fixed(12, place[row, :2]) + _fixed(6, place[row, 2:]) + _fixed(12, angles[row])
        numbers += _fixed(6, ecef[row, :3]) + _fixed(15, ecef[row, 3:])
        writer.writerow([name, frames.weather[row], frames.time_of_day[row], *numbers, *lens[row]])
    return text.getvalue()


def ecef_rotations(poses: Poses, lonlat: Floats) -> Floats:
    """Return rotations (N, 3, 3) from ECEF to the camera.

    The grid's axes stand for true directions at the camera: its north turned back by the
    convergence, its scale (1.0001 in the regions of AirZoo-Mini) left out.
    """
    turn = np.radians(grid_convergence_deg(CRS, lonlat))
    zero, one = np.zeros_like(turn), np.ones_like(turn)
    rows = ((np.cos(turn), -np.sin(turn), zero), (np.sin(turn), np.cos(turn), zero))
    grid_from_enu: Floats = np.moveaxis(np.array([*rows, (zero, zero, one)]), -1, 0)
    enu_from_ecef = np.array([Enu(lon, lat, 0.0).rotation.T for lon, lat in lonlat.tolist()])
    rotations: Floats = poses.rotation @ grid_from_enu @ enu_from_ecef.reshape(-1, 3, 3)
    return rotations


def _fixed(digits: int, values: Floats) -> list[str]:
    # Adding 0 makes a negative zero positive.
    return [f"{value:.{digits}f}" for value in (np.round(values, digits) + 0.0).tolist()]


def _lens_cells(camera: Cameras) -> list[Any]:
    lens = (camera.focal[0], camera.principal_point[0], camera.distortion[0])
    numbers = [float(number) for part in lens for number in part]
    return [int(camera.width[0]), int(camera.height[0]), *numbers]


def _check_names(names: tuple[str, ...]) -> None:
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise UsageError(f"names of frames are there twice: {first_of(twice)}")
    unsafe = [name for name in names if not re.fullmatch(SAFE_NAME, name)]
    if unsafe:
        raise UsageError(
            f"names of frames cannot be names of files: {first_of(unsafe, len(names))}",
            expected="letters, digits, dots, hyphens and underscores, at most 64",
        )
