"""Rendering a list of frames into a folder, over processes, going on where an earlier run ended.

The folder holds ``images/``, ``depth/``, ``frames.csv`` and a COLMAP model in ``colmap/``.

Photos are JPEG of quality 92 without chroma subsampling: what drones store, a fifth of the bytes
of PNG, which could not compress the sensor's noise, and some 20 times as fast to write. Depth is
TIFF of 32-bit floats, compressed without loss. Both carry a mark of their inputs.
"""

from __future__ import annotations

import io
import json
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from PIL import Image

from airzoo_bench.core.files import atomic_write, check_output_folder, fingerprint
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.datasets.mini.noise import seed_of
from airzoo_bench.datasets.mini.renderer import RENDERER_VERSION, Renderer
from airzoo_bench.datasets.mini.weather import conditions
from airzoo_bench.datasets.mini.world import CRS, load_world, world_key, world_region
from airzoo_bench.engines.engine import HERE, Engine
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.crs import enu_axes, geodetic_to_ecef, grid_convergence_deg, to_lonlat
from airzoo_bench.geometry.poses import Poses, matrix_to_quaternion, rotations_to_angles

IMAGE_SUFFIX = ".jpg"
PLACE_COLUMNS = ("longitude", "latitude", "altitude", "roll", "pitch", "yaw")
ECEF_COLUMNS = ("ecef_x", "ecef_y", "ecef_z", "ecef_qw", "ecef_qx", "ecef_qy", "ecef_qz")
_DIGITS = (12, 12, 6, 12, 12, 12, 6, 6, 6, 15, 15, 15, 15)  # of these columns
_LENS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
_END_OF_JPEG = b"\xff\xd9"
_DESCRIPTION_TAG = 270
_PREDICTOR_TAG, _FLOATING_POINT = 317, 3


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

    def __len__(self) -> int:
        return len(self.names)

    @property
    def lens(self) -> list[float]:
        """Parameters of the camera, as the columns of frames.csv name them."""
        camera = self.camera
        parts = (camera.focal, camera.principal_point, camera.distortion)
        return [number for part in parts for number in part[0].tolist()]


def frames_csv(frames: FrameList) -> str:
    """Return the table of frames, a row each."""
    poses = frames.poses
    lonlat = to_lonlat(CRS, poses.centres[:, :2])
    place = np.column_stack([lonlat, poses.centres[:, 2]])
    convergence = grid_convergence_deg(CRS, lonlat)
    angles = rotations_to_angles(poses.rotation, convergence_deg=convergence)[:, ::-1]
    quaternion = matrix_to_quaternion(_ecef_rotations(poses, lonlat, convergence))
    numbers = np.column_stack([place, angles, geodetic_to_ecef(place), quaternion])
    table = pd.DataFrame(
        {"name": frames.names, "weather": frames.weather, "time_of_day": frames.time_of_day}
    )
    columns = zip((*PLACE_COLUMNS, *ECEF_COLUMNS), _DIGITS, numbers.T, strict=True)
    for name, digits, values in columns:
        # Adding 0 makes a negative zero positive.
        rounded = (np.round(values, digits) + 0.0).tolist()
        table[name] = [f"{value:.{digits}f}" for value in rounded]
    table["width"], table["height"] = int(frames.camera.width[0]), int(frames.camera.height[0])
    for name, number in zip(_LENS, frames.lens, strict=True):
        table[name] = number
    return table.to_csv(index=False, lineterminator="\n")


def _ecef_rotations(poses: Poses, lonlat: Floats, convergence_deg: Floats) -> Floats:
    """Return rotations (N, 3, 3) from ECEF to the camera."""
    turn = np.radians(convergence_deg)
    zero, one = np.zeros_like(turn), np.ones_like(turn)
    rows = ((np.cos(turn), -np.sin(turn), zero), (np.sin(turn), np.cos(turn), zero))
    grid_from_enu: Floats = np.moveaxis(np.array([*rows, (zero, zero, one)]), -1, 0)
    rotations: Floats = poses.rotation @ grid_from_enu @ np.swapaxes(enu_axes(lonlat), -1, -2)
    return rotations


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
    return {
        "cameras.txt": f"# CAMERA_ID MODEL WIDTH HEIGHT PARAMS\n1 {_camera_line(frames)}\n",
        "images.txt": heads + world + images,
        "points3D.txt": f"# no points\n{world}",
        "offset.json": json.dumps({"crs": CRS, "offset": shown}, indent=2) + "\n",
    }


def _camera_line(frames: FrameList) -> str:
    *params, k3 = frames.lens
    model, params = ("OPENCV", params) if any(params[4:]) else ("PINHOLE", params[:4])
    if k3 != 0.0:
        model, params = "FULL_OPENCV", [*frames.lens, 0.0, 0.0, 0.0]
    camera = frames.camera
    return f"{model} {camera.width[0]} {camera.height[0]} {' '.join(map(repr, params))}"


class _Job(NamedTuple):
    """A frame to be rendered, with the fingerprint of its inputs."""

    name: str
    view: tuple[Cameras, Poses, str, str, int]  # arguments of `Renderer.render`
    mark: str


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
    key, region = world_key(world), world_region(world)
    tables = colmap_texts(frames, np.array([region.west, region.south, 0.0]))
    tables = {f"colmap/{name}": text for name, text in tables.items()}
    tables["frames.csv"] = frames_csv(frames)
    todo = [job for job in _jobs(frames, key) if not _is_done(folder, job)]
    for name in tables if todo else ():  # they would describe photos about to be replaced
        (folder / name).unlink(missing_ok=True)
    done = engine.map(
        _render_job,
        todo,
        shared=(world, key, folder),
        stage="rendering",
        name=lambda job: f"frame {job.name}",
    )
    for _ in progress(done, "rendering", len(todo)):
        pass
    _renderer.cache_clear()
    for name, text in tables.items():
        with atomic_write(folder / name, "w") as stream:
            stream.write(text)
    return len(todo)


def _jobs(frames: FrameList, key: str) -> list[_Job]:
    camera, poses = frames.camera, frames.poses
    size = [int(camera.width[0]), int(camera.height[0])]
    jobs = []
    for number, name in enumerate(frames.names):
        seed = seed_of(frames.seed, name)
        given = frames.weather[number], frames.time_of_day[number]
        pose = [poses.rotation[number].tolist(), poses.centres[number].tolist()]
        mark = fingerprint([RENDERER_VERSION, key, size, frames.lens, pose, list(given), seed])
        jobs.append(_Job(name, (camera, poses.take(number), *given, seed), mark))
    return jobs


def _is_done(folder: Path, job: _Job) -> bool:
    return all(_read_mark(path) == job.mark for path in frame_paths(folder, job.name))


def _render_job(shared: tuple[Path, str, Path], job: _Job) -> None:
    """Write a frame's files, each whole or not at all, with the mark of its inputs."""
    world, key, folder = shared
    frame = _renderer(world, key).render(*job.view)
    image, depth = frame_paths(folder, job.name)
    with atomic_write(depth) as stream:
        tags = {_PREDICTOR_TAG: _FLOATING_POINT, _DESCRIPTION_TAG: job.mark}
        picture = Image.fromarray(frame.depth)
        picture.save(stream, format="TIFF", compression="tiff_adobe_deflate", tiffinfo=tags)
    with atomic_write(image) as stream:
        picture = Image.fromarray(frame.rgb)
        picture.save(stream, format="JPEG", quality=92, subsampling=0, comment=job.mark)


@lru_cache(maxsize=1)
def _renderer(world: Path, key: str) -> Renderer:
    del key  # tells worlds apart
    return Renderer(load_world(world))


def frame_paths(folder: Path, name: str) -> tuple[Path, Path]:
    """Return the places of a frame's photo and depth."""
    return folder / "images" / f"{name}{IMAGE_SUFFIX}", folder / "depth" / f"{name}.tif"


def _read_mark(path: Path) -> str | None:
    """Return the mark of a photo or depth; None where it is missing or damaged."""
    try:
        content = path.read_bytes()
        with Image.open(io.BytesIO(content), formats=["JPEG", "TIFF"]) as picture:
            opened: Any = picture
            if picture.format == "TIFF":
                return str(opened.tag_v2.get(_DESCRIPTION_TAG))
            mark: bytes = picture.info.get("comment", b"")
    except (OSError, SyntaxError):
        return None
    return mark.decode("ascii", "replace") if content.endswith(_END_OF_JPEG) else None


def read_depth(path: Path) -> Floats:
    """Read a frame's depth, (H, W) metres along the optical axis, 0 where there is no surface."""
    with Image.open(path) as image:
        return np.asarray(image, np.float64)
