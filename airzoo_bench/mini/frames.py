"""Rendering a list of frames into a folder, over processes, going on where an earlier run ended.

The folder holds ``images/``, ``depth/``, and, once all frames are there, ``frames.csv`` and a
COLMAP model in ``colmap/``.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from airzoo_bench.core.files import atomic_write, check_output_folder, fingerprint
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.core.workers import spread
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.mini.colmap_model import colmap_texts
from airzoo_bench.mini.frame_files import is_complete, write_frame
from airzoo_bench.mini.frame_list import FrameList, frames_csv
from airzoo_bench.mini.pixel_noise import seed_of
from airzoo_bench.mini.render import RENDERER_VERSION, Renderer
from airzoo_bench.mini.world import World

__all__ = ["RenderCounts", "render_frames", "world_key"]


@dataclass(frozen=True)
class RenderCounts:
    """How many frames were rendered, and how many were there already."""

    rendered: int
    kept: int


def render_frames(
    frames: FrameList,
    load: Callable[[], World],
    folder: Path,
    *,
    workers: int = 1,
    progress: Progress = silent,
) -> RenderCounts:
    """Render frames into a folder; those that are there and made from the same are kept.

    Parameters
    ----------
    frames : FrameList
    load : callable
        Returns the world; with several workers each process calls its own, so that it must be
        picklable then and should be quick, such as ``partial(load_world, folder)``.
    folder : Path
        Made where it is missing. Files of other frames in it are left alone.
    workers : int
        Processes, at least 1.
    progress : Progress

    Returns
    -------
    RenderCounts

    Raises
    ------
    UserError
        A file cannot be written, or the disk is full.
    """
    check_output_folder(folder, ("frames.csv",))
    world = load()
    source = _Source(world_key(world), load if workers > 1 else lambda: world)
    tables = _tables(frames, world)
    _remove_stale(folder, tables)
    jobs = [_job(frames, number, source.key) for number in range(len(frames))]
    todo = [job for job in jobs if not is_complete(folder, job.name, job.fingerprint)]
    if workers > 1:
        del world  # each worker has its own
    _render(todo, source, folder, min(workers, len(todo)), progress)
    for name, text in tables.items():
        with atomic_write(folder / name, "w") as stream:
            stream.write(text)
    return RenderCounts(rendered=len(todo), kept=len(jobs) - len(todo))


def world_key(world: World) -> str:
    """Return the SHA-256 of all that a world's photos depend on."""
    digest = hashlib.sha256(repr((world.region, world.seed)).encode())
    mesh, walls = world.mesh, world.buildings
    arrays: tuple[Any, ...] = (mesh.vertices, mesh.triangles, mesh.material, mesh.owner)
    arrays += (walls.wall_colour, walls.window_colour, walls.base_m, walls.storey_m, walls.bay_m)
    arrays += (walls.style, world.tree_colours, world.ground_albedo, world.top_albedo)
    arrays += (world.water, world.dsm)
    for array in arrays:
        digest.update(repr((array.dtype.str, array.shape)).encode())
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()


@dataclass(frozen=True)
class _Source:
    """How a process comes by a world; equal where the world is."""

    key: str
    load: Callable[[], World] = field(compare=False)


@dataclass(frozen=True, eq=False)
class _Job:
    name: str
    camera: Cameras
    pose: Poses
    weather: str
    time_of_day: str
    seed: int
    fingerprint: str


def _job(frames: FrameList, number: int, world: str) -> _Job:
    name, camera, pose = frames.names[number], frames.camera(number), frames.poses.take(number)
    seed = seed_of(frames.seed, name)
    parts = (camera.width, camera.height, camera.focal, camera.principal_point, camera.distortion)
    made_from = {
        "renderer": RENDERER_VERSION,
        "world": world,
        "camera": [part.tolist() for part in parts],
        "pose": [pose.rotation.tolist(), pose.centres.tolist()],
        "conditions": [frames.weather[number], frames.time_of_day[number]],
        "seed": seed,
    }
    return _Job(
        name,
        camera,
        pose,
        frames.weather[number],
        frames.time_of_day[number],
        seed,
        fingerprint(made_from),
    )


def _render(
    jobs: Sequence[_Job], source: _Source, folder: Path, workers: int, progress: Progress
) -> None:
    if not jobs:
        return
    try:
        for _ in progress(
            spread(partial(_render_job, source, folder), jobs, workers), "rendering", len(jobs)
        ):
            pass
    finally:
        _renderer.cache_clear()


def _render_job(source: _Source, folder: Path, job: _Job) -> None:
    frame = _renderer(source).render(job.camera, job.pose, job.weather, job.time_of_day, job.seed)
    write_frame(folder, job.name, frame, job.fingerprint)


@lru_cache(maxsize=1)
def _renderer(source: _Source) -> Renderer:
    return Renderer(source.load())


def _tables(frames: FrameList, world: World) -> dict[str, str]:
    region = world.region
    model = colmap_texts(frames, np.array([region.west, region.south, 0.0]))
    tables = {f"colmap/{name}": text for name, text in model.items()}
    return tables | {"frames.csv": frames_csv(frames)}


def _remove_stale(folder: Path, tables: dict[str, str]) -> None:
    """Take away tables of other frames, which would describe photos about to be replaced."""
    for name, text in tables.items():
        path = folder / name
        if path.is_file() and path.read_bytes() != text.encode():
            path.unlink()
