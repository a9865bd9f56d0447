"""Scenes for geometry checks, from a benchmark folder or a pose file, and the results."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.benchmark.queries import (
    CAMERA_COLUMNS,
    POSE_COLUMNS,
    cameras_of,
    poses_of,
    read_queries,
)
from airzoo_bench.core.errors import UsageError, counted
from airzoo_bench.core.files import MARK, data_root
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.datasets.content import photo_sizes
from airzoo_bench.datasets.geometry_checks.depth import DepthConsistency
from airzoo_bench.datasets.geometry_checks.frame_chain import CLOSES_M, CLOSES_PX
from airzoo_bench.datasets.poses import read_poses
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.crs import LOCAL_CRS
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.tables.model import Cell, Column, Row, Table

_COLUMNS = (
    *(Column("Scene"), Column("Photos"), Column("Closure", "m"), Column("Closure", "px")),
    *(Column("Pairs"), *(Column(name, "%", decimals=4) for name in ("Median", "P90", "P95"))),
    Column("Verdict"),
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


def scenes_of_benchmark(place: Path, only: str | None = None) -> list[PosedScene]:
    """Read the scenes, or one, of a benchmark folder, by its path or its name in the data root."""
    named = data_root() / place
    is_name = not (place / MARK).is_file() and (named / MARK).is_file()
    benchmark, found = Benchmark.open(named if is_name else place), []
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
    name, crs = images.resolve().name, crs or photos.crs or None
    return PosedScene(name, photos.names, photos.names, photos.cameras, photos.poses, crs, images)


@dataclass(frozen=True, eq=False)
class SceneGeometry:
    """The closure (m, px) of the N photos of a scene, and its depth; None if not checked."""

    scene: PosedScene
    closure: tuple[Floats, Floats] | None
    depth: DepthConsistency | None

    @property
    def failures(self) -> list[str]:
        """Figures beyond their thresholds, a sentence each."""
        found = [] if self.depth is None else self.depth.failures
        if self.closure is not None:
            metres, pixels = self.closure
            is_open = ~((metres < CLOSES_M) & (pixels < CLOSES_PX))
            worst = (metres / CLOSES_M + pixels / CLOSES_PX).argmax()
            said = (
                f"the frame chain of {is_open.sum()} of {counted(len(metres), 'photo')} does not "
                f"close to {CLOSES_M:g} m and {CLOSES_PX:g} px (worst: {self.scene.ids[worst]}, "
                f"{metres[worst]:.2g} m, {pixels[worst]:.2g} px): look at the lens, whose model "
                "may fold back within the photo, and for positions that are no place of the CRS"
            )
            found = [said] * bool(is_open.any()) + found
        return found


def geometry_table(checked: Sequence[SceneGeometry]) -> Table:
    """Lay out the checks in a row for each scene, with failures and notes below."""
    rows, notes = [], []
    for one in checked:
        failures = one.failures
        found: list[Any] = [None] * 6
        if one.closure is not None:
            found[:2] = [f"{part.max():.1e}" for part in one.closure]
        if one.depth is not None:
            found[2:] = [one.depth.pairs, *(100 * one.depth.quantile(q) for q in (0.5, 0.9, 0.95))]
        verdict = "fails" if failures else "passes"
        values = (one.scene.name, len(one.scene.ids), *found, verdict)
        rows.append(Row(tuple(map(Cell, values))))
        if one.closure is None:
            failures.append("frame chain not checked: poses have no CRS (--crs), or a local frame")
        if one.depth is None:
            failures.append("depth not checked: there are no depth maps (--depth)")
        notes += [f"{one.scene.name}: {text}" for text in failures]
    return Table("Geometry checks", _COLUMNS, tuple(rows), tuple(notes))
