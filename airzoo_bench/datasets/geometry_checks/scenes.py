"""Scenes for geometry checks, from a benchmark folder or a pose file, and the results."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.benchmark.queries import (
    CAMERA_COLUMNS,
    POSE_COLUMNS,
    cameras_of,
    poses_of,
    read_queries,
)
from airzoo_bench.core.errors import CameraError, UsageError, counted
from airzoo_bench.core.files import MARK, data_root
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.datasets.content import photo_sizes
from airzoo_bench.datasets.geometry_checks.depth import DepthConsistency
from airzoo_bench.datasets.geometry_checks.frame_chain import FrameChain
from airzoo_bench.datasets.poses import read_poses
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.crs import LOCAL_CRS, check_true_metres, horizontal_crs, to_lonlat
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.tables.model import Cell, Column, Row, Table

_COLUMNS = (
    *(Column("Scene"), Column("Photos"), Column("Closure", "m"), Column("Closure", "px")),
    *(Column("Pairs"), *(Column(name, "%", decimals=4) for name in ("Median", "P90", "P95"))),
    *(Column("Floating", "%", decimals=2), Column("Verdict")),
)


@dataclass(frozen=True, eq=False)
class PosedScene:
    """The N photos of a scene, sorted by id.

    `images` are relative to `folder`; `crs` is None where nobody has named it, or it is local.
    """

    name: str
    ids: tuple[str, ...]
    images: tuple[str, ...]
    cameras: Cameras
    poses: Poses
    crs: str | None
    folder: Path
    plane_height_m: float | None = None


def open_benchmark(place: Path) -> Benchmark:
    """Open a benchmark folder, named by its path or by its name in the data root."""
    named = data_root() / place
    is_name = not (place / MARK).is_file() and (named / MARK).is_file()
    return Benchmark.open(named if is_name else place)


def scenes_of_benchmark(benchmark: Benchmark, only: str | None = None) -> list[PosedScene]:
    """Read the scenes of a benchmark, or one."""
    found = []
    for scene in benchmark.file.scenes:
        if only in (None, scene.id):
            numbers, none = (*CAMERA_COLUMNS, *POSE_COLUMNS), pd.DataFrame({"id": []})
            photos = read_queries(benchmark.scene_folder(scene.id), none, numbers)
            one = PosedScene(
                scene.id,
                tuple(photos["id"]),
                tuple(photos["image"]),
                cameras_of(photos),
                poses_of(photos),
                None if scene.crs == LOCAL_CRS else scene.crs,
                benchmark.resolve(scene.images),
                scene.plane_height_m,
            )
            found.append(one)
    if not found:
        known = "one of " + ", ".join(scene.id for scene in benchmark.file.scenes)
        raise UsageError(f"there is no scene {only!r}", where=benchmark.folder, expected=known)
    return found


def scene_from_poses(
    poses: Path, images: Path, crs: str | None, progress: Progress = silent
) -> PosedScene:
    """Read a scene from a pose file and the folder of its photos, as `prepare photos` does."""
    photos = read_poses(poses, photo_sizes(images, progress))
    name, crs = images.resolve().name, crs or photos.crs
    return PosedScene(name, photos.names, photos.names, photos.cameras, photos.poses, crs, images)


@dataclass(frozen=True, eq=False)
class SceneGeometry:
    """The checks of one scene; None for what was not checked."""

    scene: PosedScene
    chain: FrameChain | None
    depth: DepthConsistency | None

    @property
    def failures(self) -> list[str]:
        """Faults, a sentence each."""
        found = [] if self.scene.crs is None else _scale_failures(self.scene, self.scene.crs)
        found += [] if self.chain is None else self.chain.failures(self.scene.ids)
        return found + ([] if self.depth is None else self.depth.failures)

    @property
    def notes(self) -> list[str]:
        """Checks that were left out, a sentence each."""
        notes = []
        if self.chain is None:
            notes.append("frame chain not checked: poses have no CRS (--crs), or a local frame")
        if self.depth is None:
            notes.append("depth not checked: there are no depth maps (--depth)")
        elif self.depth.without_depth:
            notes.append(f"without a depth map: {counted(self.depth.without_depth, 'photo')}")
        return notes


def _scale_failures(scene: PosedScene, named: str) -> list[str]:
    crs = horizontal_crs(named)
    places = to_lonlat(crs, scene.poses.centres[:, :2])
    try:
        # Positions that are no place are the frame chain's.
        check_true_metres(crs, places[np.isfinite(places).all(axis=1)], scene.name)
    except CameraError as error:
        return [error.what]
    return []


def geometry_table(checked: Sequence[SceneGeometry]) -> Table:
    """Lay out the checks in a row for each scene, with failures and notes below."""
    rows, notes = [], []
    for one in checked:
        chain, depth, failures = one.chain, one.depth, one.failures
        closure: Sequence[Any] = (None, None)
        if chain is not None:
            closure = [f"{part.max():.1e}" for part in (chain.closure_m, chain.closure_px)]
        found: Sequence[Any] = (None,) * 5
        if depth is not None:
            shares = [*map(depth.quantile, (0.5, 0.9, 0.95)), depth.floating]
            found = (depth.pairs, *(100 * share for share in shares))
        verdict = "fails" if failures else "passes"
        values = (one.scene.name, len(one.scene.ids), *closure, *found, verdict)
        rows.append(Row(tuple(map(Cell, values))))
        notes += [f"{one.scene.name}: {text}" for text in (*failures, *one.notes)]
    return Table("Geometry checks", _COLUMNS, tuple(rows), tuple(notes))
