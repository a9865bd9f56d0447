"""Rendering a list of frames into a folder, over processes, going on where an earlier run ended.

The folder holds ``images/``, ``depth/``, ``frames.csv`` and a COLMAP model in ``colmap/``.

Photos are JPEG of quality 92 without chroma subsampling: what drones store, a fifth of the bytes
of PNG, which could not compress the sensor's noise, and some 20 times as fast to write. Depth is
TIFF of 32-bit floats, compressed without loss. A photo carries a mark of its inputs.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import pandas as pd
from PIL import Image

from airzoo_bench.core.files import atomic_write, check_output_folder, fingerprint
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.datasets.mini.noise import seed_of
from airzoo_bench.datasets.mini.renderer import RENDERER_VERSION, Renderer
from airzoo_bench.datasets.mini.weather import conditions
from airzoo_bench.datasets.mini.world import CRS, load_world, stored_region, world_key
from airzoo_bench.engines.engine import HERE, Engine
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.crs import enu_axes, geodetic_to_ecef, grid_convergence_deg, to_lonlat
from airzoo_bench.geometry.poses import Poses, matrix_to_quaternion, rotations_to_angles

IMAGE_SUFFIX = ".jpg"
PLACE_COLUMNS = ("longitude", "latitude", "altitude", "roll", "pitch", "yaw")
ECEF_COLUMNS = ("ecef_x", "ecef_y", "ecef_z", "ecef_qw", "ecef_qx", "ecef_qy", "ecef_qz")
_DIGITS = (12, 12, 6, 12, 12, 12, 6, 6, 6, 15, 15, 15, 15)  # of these columns


@dataclass(frozen=True, eq=False)
class FrameList:
    """N frames to render; an unknown weather or time of day is refused."""

    names: tuple[str, ...]  # each once; they become names of files
    camera: Cameras  # one for all
    poses: Poses  # N, in `world.CRS`
    weather: tuple[str, ...]  # see `weather.conditions`
    time_of_day: tuple[str, ...]
    seed: int = 0  # of the noise, together with each frame's name
    sequence: tuple[str, ...] = ()  # the flight that each is of

    def __post_init__(self) -> None:
        for pair in sorted(set(zip(self.weather, self.time_of_day, strict=True))):
            conditions(*pair)

    @property
    def pinhole(self) -> tuple[float, ...]:
        """Width, height, focal lengths and principal point of the camera."""
        size = int(self.camera.width[0]), int(self.camera.height[0])
        return (*size, *self.camera.focal[0].tolist(), *self.camera.principal_point[0].tolist())


def frames_csv(frames: FrameList) -> str:
    """Return the table of frames, a row each."""
    poses = frames.poses
    lonlat = to_lonlat(CRS, poses.centres[:, :2])
    place = np.column_stack([lonlat, poses.centres[:, 2]])
    convergence = grid_convergence_deg(CRS, lonlat)
    angles = rotations_to_angles(poses.rotation, convergence_deg=convergence)[:, ::-1]
    # Rotations from ECEF to the grid, then to the camera.
    turn = np.radians(convergence)
    zero, one = np.zeros_like(turn), np.ones_like(turn)
    rows = ((np.cos(turn), -np.sin(turn), zero), (np.sin(turn), np.cos(turn), zero))
    grid_from_enu = np.moveaxis(np.array([*rows, (zero, zero, one)]), -1, 0)
    rotations: Floats = poses.rotation @ grid_from_enu @ np.swapaxes(enu_axes(lonlat), -1, -2)
    quaternion = matrix_to_quaternion(rotations)
    numbers = np.column_stack([place, angles, geodetic_to_ecef(place), quaternion])
    table = pd.DataFrame(
        {"name": frames.names, "weather": frames.weather, "time_of_day": frames.time_of_day}
    )
    columns = zip((*PLACE_COLUMNS, *ECEF_COLUMNS), _DIGITS, numbers.T, strict=True)
    for name, digits, values in columns:
        # Adding 0 makes a negative zero positive.
        rounded = (np.round(values, digits) + 0.0).tolist()
        table[name] = [f"{value:.{digits}f}" for value in rounded]
    table[["width", "height", "fx", "fy", "cx", "cy"]] = frames.pinhole
    return table.to_csv(index=False, lineterminator="\n")


def colmap_texts(frames: FrameList, offset: Floats) -> dict[str, str]:
    """Return the files of a COLMAP text model by name: the camera and the poses, and no points."""
    local = Poses(rotation=frames.poses.rotation, centres=frames.poses.centres - offset)
    numbers = np.column_stack([matrix_to_quaternion(local.rotation), local.translation])
    images = ""
    for row, name in enumerate(frames.names):
        pose = " ".join(f"{value:.15g}" for value in numbers[row])
        images += f"{row + 1} {pose} 1 {name}{IMAGE_SUFFIX}\n\n"
    shown = offset.tolist()
    world = f"# world: {CRS} less {' '.join(f'{value:g}' for value in shown)} (x y z, metres)\n"
    heads = "# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then an empty line\n"
    camera = f"1 PINHOLE {' '.join(map(repr, frames.pinhole))}\n"
    return {
        "cameras.txt": f"# CAMERA_ID MODEL WIDTH HEIGHT PARAMS\n{camera}",
        "images.txt": heads + world + images,
        "points3D.txt": f"# no points\n{world}",
        "offset.json": json.dumps({"crs": CRS, "offset": shown}, indent=2) + "\n",
    }


def render_frames(
    frames: FrameList,
    world: Path,
    folder: Path,
    *,
    engine: Engine = HERE,
    progress: Progress = silent,
) -> int:
    """Render frames of a stored world into a folder, except those that are there already.

    Returns
    -------
    int
        How many were rendered.
    """
    check_output_folder(folder, ("frames.csv",))
    key, (region, _) = world_key(world), stored_region(world)
    tables = colmap_texts(frames, np.array([region.west, region.south, 0.0]))
    tables = {f"colmap/{name}": text for name, text in tables.items()}
    tables["frames.csv"] = frames_csv(frames)
    marks = _marks(frames, key)
    found = [_read_mark(*frame_paths(folder, name)) for name in frames.names]
    todo = [row for row, mark in enumerate(marks) if found[row] != mark]
    for name in tables if todo else ():  # they would describe photos about to be replaced
        (folder / name).unlink(missing_ok=True)
    done = engine.map(
        _render_frame,
        todo,
        shared=(frames, marks, world, key, folder),
        stage="rendering",
        name=lambda row: f"frame {frames.names[row]}",
    )
    for _ in progress(done, "rendering", len(todo)):
        pass
    _renderer.cache_clear()
    for name, text in tables.items():
        with atomic_write(folder / name, "w") as stream:
            stream.write(text)
    return len(todo)


def _marks(frames: FrameList, key: str) -> list[str]:
    """Return the fingerprint of each frame's inputs."""
    marks = []
    for row, name in enumerate(frames.names):
        given = [frames.weather[row], frames.time_of_day[row]]
        pose = [frames.poses.rotation[row].tolist(), frames.poses.centres[row].tolist()]
        parts = [key, frames.pinhole, pose, given, seed_of(frames.seed, name)]
        marks.append(fingerprint([RENDERER_VERSION, *parts]))
    return marks


def _render_frame(shared: tuple[FrameList, list[str], Path, str, Path], row: int) -> None:
    """Write a frame's files, each whole or not at all, with the mark of its inputs."""
    frames, marks, world, key, folder = shared
    name, given = frames.names[row], (frames.weather[row], frames.time_of_day[row])
    seed = seed_of(frames.seed, name)
    frame = _renderer(world, key).render(frames.camera, frames.poses.take(row), *given, seed)
    image, depth = frame_paths(folder, name)
    photo, distances = Image.fromarray(frame.rgb), Image.fromarray(frame.depth)
    with atomic_write(depth) as stream:
        kind, predictor = "tiff_adobe_deflate", {317: 3}  # of floating point
        distances.save(stream, format="TIFF", compression=kind, tiffinfo=predictor)
    with atomic_write(image) as stream:  # after its depth, so that it says that both are there
        photo.save(stream, format="JPEG", quality=92, subsampling=0, comment=marks[row])


@lru_cache(maxsize=1)
def _renderer(world: Path, key: str) -> Renderer:
    del key  # tells worlds apart
    return Renderer(load_world(world))


def frame_paths(folder: Path, name: str) -> tuple[Path, Path]:
    """Return the places of a frame's photo and depth."""
    return folder / "images" / f"{name}{IMAGE_SUFFIX}", folder / "depth" / f"{name}.tif"


def _read_mark(image: Path, depth: Path) -> str | None:
    """Return the mark of a photo; None where it or its depth is missing or damaged."""
    try:
        with Image.open(image) as picture:
            mark: bytes = picture.info.get("comment", b"")
    except OSError:
        return None
    return mark.decode("ascii", "replace") if depth.is_file() else None


def read_depth(path: Path) -> Floats:
    """Read a frame's depth, (H, W) metres along the optical axis, 0 where there is no surface."""
    with Image.open(path) as image:
        return np.asarray(image, np.float64)
