"""Rendering a list of frames into a folder, over processes, going on where an earlier run ended.

The folder holds ``images/``, ``depth/``, ``frames.csv`` and a COLMAP model in ``colmap/``. Photos
are JPEG of quality 92 without chroma subsampling, as drones store them, and carry a mark of their
inputs. Depth is TIFF of 32-bit floats, compressed without loss.
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
from airzoo_bench.datasets.mini.world import CRS, load_world, read_index
from airzoo_bench.engines.engine import HERE, Engine
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.crs import grid_convergence_deg, to_lonlat
from airzoo_bench.geometry.poses import Poses, matrix_to_quaternion, rotations_to_angles

IMAGE_SUFFIX = ".jpg"
PLACE_COLUMNS = ("longitude", "latitude", "altitude", "roll", "pitch", "yaw")
_DIGITS = (12, 12, 6, 12, 12, 12)  # of these columns


@dataclass(frozen=True, eq=False)
class FrameList:
    """N frames to render."""

    names: tuple[str, ...]  # each once; they become names of files
    camera: Cameras  # one for all
    poses: Poses  # N, in `world.CRS`
    weather: tuple[str, ...]  # see `shading.conditions`
    time_of_day: tuple[str, ...]
    seed: int = 0  # of the noise, together with each frame's name
    sequence: tuple[str, ...] = ()  # the flight that each is of

    @property
    def pinhole(self) -> tuple[float, ...]:
        """Width, height, focal lengths and principal point of the camera."""
        size = int(self.camera.width[0]), int(self.camera.height[0])
        return (*size, *self.camera.focal[0].tolist(), *self.camera.principal_point[0].tolist())


def _frames_csv(frames: FrameList) -> str:
    poses = frames.poses
    lonlat = to_lonlat(CRS, poses.centres[:, :2])
    turn = grid_convergence_deg(CRS, lonlat)
    angles = rotations_to_angles(poses.rotation, convergence_deg=turn)[:, ::-1]
    numbers = np.column_stack([lonlat, poses.centres[:, 2], angles]).T
    given = {"name": frames.names, "weather": frames.weather, "time_of_day": frames.time_of_day}
    table = pd.DataFrame(given)
    for name, digits, values in zip(PLACE_COLUMNS, _DIGITS, numbers, strict=True):
        # Adding 0 makes a negative zero positive.
        table[name] = [f"{value:.{digits}f}" for value in np.round(values, digits) + 0.0]
    table[["width", "height", "fx", "fy", "cx", "cy"]] = frames.pinhole
    return table.to_csv(index=False, lineterminator="\n")


def _colmap_texts(frames: FrameList, offset: Floats) -> dict[str, str]:
    """Return the files of a COLMAP text model by name: the camera and the poses, and no points."""
    local = Poses(rotation=frames.poses.rotation, centres=frames.poses.centres - offset)
    numbers = np.column_stack([matrix_to_quaternion(local.rotation), local.translation])
    shown = offset.tolist()
    world = f"# world: {CRS} less {' '.join(f'{value:g}' for value in shown)} (x y z, metres)\n"
    images = f"# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then an empty line\n{world}"
    for row, name in enumerate(frames.names):
        pose = " ".join(f"{value:.15g}" for value in numbers[row])
        images += f"{row + 1} {pose} 1 {name}{IMAGE_SUFFIX}\n\n"
    camera = f"1 PINHOLE {' '.join(map(repr, frames.pinhole))}\n"
    return {
        "colmap/cameras.txt": f"# CAMERA_ID MODEL WIDTH HEIGHT PARAMS\n{camera}",
        "colmap/images.txt": images,
        "colmap/points3D.txt": f"# no points\n{world}",
        "colmap/offset.json": json.dumps({"crs": CRS, "offset": shown}, indent=2) + "\n",
    }


def render_frames(
    frames: FrameList, world: Path, folder: Path, engine: Engine = HERE, progress: Progress = silent
) -> int:
    """Render frames of a stored world into a folder where they are not yet; return how many."""
    check_output_folder(folder, ("frames.csv",))
    region, _, key = read_index(world)
    tables = _colmap_texts(frames, np.array([region.west, region.south, 0.0]))
    tables["frames.csv"] = _frames_csv(frames)
    marks = [_mark(frames, key, row) for row in range(len(frames.names))]
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
    _load_renderer.cache_clear()
    for name, text in tables.items():
        with atomic_write(folder / name, "w") as stream:
            stream.write(text)
    return len(todo)


def _mark(frames: FrameList, key: str, row: int) -> str:
    given = [frames.weather[row], frames.time_of_day[row]]
    pose = [frames.poses.rotation[row].tolist(), frames.poses.centres[row].tolist()]
    seed = seed_of(frames.seed, frames.names[row])
    return fingerprint([RENDERER_VERSION, key, frames.pinhole, pose, given, seed])


def _render_frame(shared: tuple[FrameList, list[str], Path, str, Path], row: int) -> None:
    """Write a frame's files, each whole or not at all, with the mark of its inputs."""
    frames, marks, world, key, folder = shared
    name, given = frames.names[row], (frames.weather[row], frames.time_of_day[row])
    view = frames.camera, frames.poses.take(row), *given, seed_of(frames.seed, name)
    photo, distances = (Image.fromarray(part) for part in _load_renderer(world, key).render(*view))
    image, depth = frame_paths(folder, name)
    with atomic_write(depth) as stream:
        kind, predictor = "tiff_adobe_deflate", {317: 3}  # of floating point
        distances.save(stream, format="TIFF", compression=kind, tiffinfo=predictor)
    with atomic_write(image) as stream:  # after its depth, so that it says that both are there
        photo.save(stream, format="JPEG", quality=92, subsampling=0, comment=marks[row])


@lru_cache(maxsize=1)
def _load_renderer(world: Path, key: str) -> Renderer:
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
