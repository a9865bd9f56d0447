"""Rendering a list of frames into a folder, over processes, going on where an earlier run ended.

The folder holds ``images/``, ``depth/``, ``frames.csv`` and a COLMAP model in ``colmap/``.

Photos are JPEG of quality 92 without chroma subsampling: what drones store, a fifth of the bytes
of PNG, which could not compress the sensor's noise, and some 20 times as fast to write. Depth is
TIFF of 32-bit floats, compressed without loss. Both carry what they were made from.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from airzoo_bench.core.files import atomic_write, check_output_folder, fingerprint
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.datasets.mini.noise import seed_of
from airzoo_bench.datasets.mini.rendering.renderer import (
    RENDERER_VERSION,
    Frame,
    Renderer,
    check_size,
)
from airzoo_bench.datasets.mini.rendering.weather import conditions
from airzoo_bench.datasets.mini.world.model import CRS, World
from airzoo_bench.engines.engine import HERE, Engine
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.crs import enu_axes, geodetic_to_ecef, grid_convergence_deg, to_lonlat
from airzoo_bench.geometry.poses import Poses, matrix_to_quaternion, rotations_to_angles

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
        An unknown weather or time of day, or photos that would not fit memory.
    """

    names: tuple[str, ...]  # each once; they become names of files
    camera: Cameras  # one for all
    poses: Poses  # N, in `model.CRS`
    weather: tuple[str, ...]  # see `weather.conditions`
    time_of_day: tuple[str, ...]
    seed: int = 0  # of the noise, together with each frame's name

    def __post_init__(self) -> None:
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


_END_OF_JPEG = b"\xff\xd9"
_DESCRIPTION_TAG = 270
_PREDICTOR_TAG = 317
_FLOATING_POINT = 3


class RenderCounts(NamedTuple):
    """How many frames were rendered, and how many were there already."""

    rendered: int
    kept: int


def render_frames(
    frames: FrameList,
    load: Callable[[], World],
    folder: Path,
    *,
    engine: Engine = HERE,
    progress: Progress = silent,
) -> RenderCounts:
    """Render frames into a folder; those that are there and made from the same are kept."""
    check_output_folder(folder, ("frames.csv",))
    world = load()
    source = _Source(world_key(world), load if engine.distributed else lambda: world)
    model = colmap_texts(frames, np.array([world.region.west, world.region.south, 0.0]))
    tables = {f"colmap/{name}": text for name, text in model.items()}
    tables["frames.csv"] = frames_csv(frames)
    _remove_stale(folder, tables)
    todo = [job for job in _jobs(frames, source.key) if not _is_done(folder, job)]
    if engine.distributed:
        del world  # each process has its own
    try:
        done = engine.map(
            _render_job,
            todo,
            shared=(source, folder),
            stage="rendering",
            name=lambda job: f"frame {job.name}",
        )
        for _ in progress(done, "rendering", len(todo)):
            pass
    finally:
        _renderer.cache_clear()
    for name, text in tables.items():
        with atomic_write(folder / name, "w") as stream:
            stream.write(text)
    return RenderCounts(rendered=len(todo), kept=len(frames) - len(todo))


def world_key(world: World) -> str:
    """Return the SHA-256 of all that a world's photos depend on."""
    digest = hashlib.sha256(repr((world.region, world.seed)).encode())
    arrays = [*vars(world.mesh).values(), *vars(world.buildings).values(), world.tree_colours]
    arrays += [world.ground_albedo, world.top_albedo, world.water, world.dsm]
    for array in arrays:
        digest.update(repr((array.dtype.str, array.shape)).encode())
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()


@dataclass(frozen=True)
class _Source:
    """How a process comes by a world; equal where the world is."""

    key: str
    load: Callable[[], World] = field(compare=False)


class _Job(NamedTuple):
    """A frame to be rendered, with the fingerprint of its inputs."""

    name: str
    view: tuple[Cameras, Poses, str, str, int]  # what `Renderer.render` takes
    made_from: str


def _jobs(frames: FrameList, world: str) -> list[_Job]:
    camera, poses = frames.camera, frames.poses
    lens = (camera.width, camera.height, camera.focal, camera.principal_point, camera.distortion)
    jobs = []
    for number, name in enumerate(frames.names):
        seed = seed_of(frames.seed, name)
        given = frames.weather[number], frames.time_of_day[number]
        made_from = {
            "renderer": RENDERER_VERSION,
            "world": world,
            "camera": [part.tolist() for part in lens],
            "pose": [poses.rotation[[number]].tolist(), poses.centres[[number]].tolist()],
            "conditions": list(given),
            "seed": seed,
        }
        view = (camera, poses.take(number), *given, seed)
        jobs.append(_Job(name, view, fingerprint(made_from)))
    return jobs


def _is_done(folder: Path, job: _Job) -> bool:
    """Return whether both files are there, whole, and made from the same as now."""
    return all(_mark(path) == job.made_from for path in frame_paths(folder, job.name))


def _render_job(shared: tuple[_Source, Path], job: _Job) -> None:
    source, folder = shared
    _write_frame(folder, job.name, _renderer(source).render(*job.view), job.made_from)


@lru_cache(maxsize=1)
def _renderer(source: _Source) -> Renderer:
    return Renderer(source.load())


def _remove_stale(folder: Path, tables: dict[str, str]) -> None:
    """Take away tables of other frames, which would describe photos about to be replaced."""
    for name, text in tables.items():
        path = folder / name
        if path.is_file() and path.read_bytes() != text.encode():
            path.unlink()


def frame_paths(folder: Path, name: str) -> tuple[Path, Path]:
    """Return where a frame's photo and depth stand."""
    return folder / "images" / f"{name}{IMAGE_SUFFIX}", folder / "depth" / f"{name}.tif"


def _write_frame(folder: Path, name: str, frame: Frame, mark: str) -> None:
    """Write a frame's files, each whole or not at all, and a mark of its inputs."""
    image, depth = frame_paths(folder, name)
    with atomic_write(depth) as stream:
        tags = {_PREDICTOR_TAG: _FLOATING_POINT, _DESCRIPTION_TAG: mark}
        picture = Image.fromarray(frame.depth)
        picture.save(stream, format="TIFF", compression="tiff_adobe_deflate", tiffinfo=tags)
    with atomic_write(image) as stream:
        picture = Image.fromarray(frame.rgb)
        picture.save(stream, format="JPEG", quality=92, subsampling=0, comment=mark)


def _mark(path: Path) -> str | None:
    """Return what a photo or depth was made from; None where it is missing or damaged."""
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


def read_depth(path: Path) -> NDArray[np.float32]:
    """Read a frame's depth, (H, W) metres along the optical axis, 0 where there is no surface."""
    with Image.open(path) as image:
        return np.asarray(image, np.float32)
