"""Checks of a dataset's geometry: the chain of frames, depth against poses, splits; key frames.

The chain pixel -> ray -> ENU -> ECEF -> WGS84 -> CRS of the poses, and all the way back, closes to
rounding (about 1e-8 m) unless a pixel has no ray (beyond the range of the lens model), a position
is no place of the CRS, or the CRS cannot be inverted to a micrometre.

Splits, such as training and test, are compared by footprints: the quadrilateral of ground below the
four corners of a photo, on the plane of the ground. Two footprints overlap where they share an
area; to touch is not to overlap.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import shapely

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.benchmark.queries import (
    CAMERA_COLUMNS,
    POSE_COLUMNS,
    cameras_of,
    poses_of,
    read_queries,
)
from airzoo_bench.benchmark.tables import read_table
from airzoo_bench.core.errors import BenchmarkError, UsageError, counted, first_of
from airzoo_bench.core.files import MARK, data_root
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.datasets.cameras import grid_to_true_north
from airzoo_bench.datasets.content import photo_sizes
from airzoo_bench.datasets.depth_maps import DepthConsistency
from airzoo_bench.datasets.poses import read_poses
from airzoo_bench.geometry.arrays import Floats, Ints, apply_matrix
from airzoo_bench.geometry.cameras import Cameras, anchor_pixels, back_project, project
from airzoo_bench.geometry.crs import (
    LOCAL_CRS,
    ecef_to_geodetic,
    enu_axes,
    from_lonlat,
    geodetic_to_ecef,
    grid_convergence_deg,
    to_lonlat,
)
from airzoo_bench.geometry.poses import Poses, rays_to_world
from airzoo_bench.geometry.rays import intersect_plane
from airzoo_bench.retrieval.positives import untangled
from airzoo_bench.retrieval.truth import ANCHOR_COLUMNS
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


# --- the frame chain ---

CLOSES_M = 1e-6
"""The chain closes where no point comes back farther off than this."""
CLOSES_PX = 1e-3
"""Nor any pixel: 1e-6 m at 10 m from a camera of 10,000 px focal length."""
_RANGES_M = np.array((10.0, 100.0, 1000.0))
_SIDE = 5


def check_frame_chain(cameras: Cameras, poses: Poses, crs: Any) -> tuple[Floats, Floats]:
    """Send a grid of 5 x 5 pixels of each photo, borders included, through the chain and back.

    Return how far points (m) and pixels of N photos come back from where they started, at most;
    infinite where a pixel has no ray, or a place is none of the CRS.
    """
    share = np.linspace(0.0, 1.0, _SIDE)
    grid = np.stack(np.meshgrid(share, share), axis=-1).reshape(-1, 2)
    pixels = grid * np.stack((cameras.width, cameras.height), axis=-1)[:, None]
    rays = back_project(cameras, pixels)
    lonlat = to_lonlat(crs, poses.centres[:, :2])
    to_true = grid_to_true_north(grid_convergence_deg(crs, lonlat))
    directions = apply_matrix(to_true[:, None], rays_to_world(poses, rays))
    sent = (_RANGES_M[:, None] * directions[:, :, None]).reshape(len(poses), -1, 3)
    axes = enu_axes(lonlat)
    origin = geodetic_to_ecef(np.concatenate([lonlat, poses.centres[:, 2:]], axis=1))
    geodetic = ecef_to_geodetic(apply_matrix(axes[:, None], sent) + origin[:, None])
    plane = from_lonlat(crs, geodetic[..., :2])
    back = np.concatenate([to_lonlat(crs, plane), geodetic[..., 2:]], axis=-1)
    there = geodetic_to_ecef(back) - origin[:, None]
    returned = apply_matrix(np.swapaxes(axes, -1, -2)[:, None], there)
    on_grid = apply_matrix(np.swapaxes(to_true, -1, -2)[:, None], returned)
    seen = project(cameras, apply_matrix(poses.rotation[:, None], on_grid))
    return _worst(returned - sent), _worst(seen - np.repeat(pixels, len(_RANGES_M), axis=1))


def _worst(differences: Floats) -> Floats:
    """Return the greatest length (N,) of differences (N, M, D); infinite where one is NaN."""
    lengths = np.sqrt((differences * differences).sum(axis=-1))
    worst: Floats = np.where(np.isnan(lengths), np.inf, lengths).max(axis=1)
    return worst


# --- splits ---

_SHOWN = 20
_METRES_OF_A_DEGREE = np.pi / 180 * 6_371_008.8
_LEAST_AREA_M2 = 1e-4  # what rounding makes of borders that touch: 1e-9 degrees by 1 km
_CORNERS = list(ANCHOR_COLUMNS)


def read_footprints(place: Path, max_range_m: float) -> pd.DataFrame:
    """Return the corners of photos by id, of a benchmark folder or a CSV; NaN where not known."""
    if place.suffix.lower() == ".csv":
        table = read_table(place, ("id", *_CORNERS))  # which checks coordinates
        columns = {one: pd.to_numeric(table[one], errors="coerce").array for one in _CORNERS}
        return pd.DataFrame(columns, table["id"].astype(str))
    return pd.concat(
        pd.DataFrame(cast_corners(one, max_range_m).reshape(-1, 8), one.ids, _CORNERS)
        for one in scenes_of_benchmark(place)
    )


def cast_corners(scene: PosedScene, max_range_m: float) -> Floats:
    """Cast the corners of photos onto the plane of the ground: longitude and latitude (N, 4, 2).

    Corners in the sky are cut at the range; photos from below the plane, or without a place, have
    NaN.
    """
    poses, plane = scene.poses, scene.plane_height_m
    if plane is None or scene.crs is None:
        raise BenchmarkError("has no ground plane or no CRS", where=scene.name)
    rays = rays_to_world(poses, back_project(scene.cameras, anchor_pixels(scene.cameras, 0.0)))
    hits = intersect_plane(poses.centres, rays, plane, max_range_m)
    ends = poses.centres[:, None] + max_range_m * rays
    lonlat = to_lonlat(scene.crs, np.where(hits.valid[..., None], hits.points, ends)[..., :2])
    lonlat[(poses.centres[:, 2] <= plane) | (rays[..., 2] >= 0.0).all(axis=1)] = np.nan
    return lonlat


def compare_splits(train: pd.DataFrame, test: pd.DataFrame) -> pd.DataFrame:
    """Return the pairs of photos that see common ground, of `read_footprints`.

    A row is train and test id, shared m2, and the share of the test footprint.
    """
    known = [one[np.isfinite(one).all(axis=1)] for one in (train, test)]
    around, asked = (
        shapely.polygons(untangled(one.to_numpy(np.float64).reshape(-1, 4, 2))) for one in known
    )
    second, first = shapely.STRtree(around).query(asked, predicate="intersects")[::-1]
    shared = shapely.intersection(asked[first], around[second])
    # Degrees of longitude shrink with the latitude of what is seen.
    latitude = np.radians(shapely.get_y(shapely.centroid(asked[first])))
    square = _METRES_OF_A_DEGREE**2 * np.cos(latitude)
    area, whole = shapely.area(shared) * square, shapely.area(asked[first]) * square
    rows = np.lexsort((second, first))
    rows = rows[area[rows] > _LEAST_AREA_M2]
    return pd.DataFrame(
        {
            "train": known[0].index[second[rows]],
            "test": known[1].index[first[rows]],
            "shared_m2": np.round(area[rows], 3),
            "share_of_test": np.round(area[rows] / whole[rows], 6),
        }
    )


def split_table(pairs: pd.DataFrame, unknown: Sequence[str]) -> Table:
    """Lay out the first pairs that overlap, with the counts below."""
    columns = (
        *(Column("Training photo"), Column("Test photo"), Column("Shared", "m²", decimals=1)),
        Column("Of the test photo", "%", decimals=2),
    )
    rows = tuple(
        Row((Cell(train), Cell(test), Cell(area), Cell(100 * share)))
        for train, test, area, share in pairs.head(_SHOWN).itertuples(index=False)
    )
    tainted = counted(int(pairs["test"].nunique()), "test photo")
    notes = [f"{counted(len(pairs), 'pair')}, of {tainted}; --out writes all"]
    if unknown:
        notes.append(f"it is not known where photos look: {first_of(unknown)}")
    return Table("Ground that both sets see", columns, rows, tuple(notes))


# --- key frames ---

MOST_DEPTH_M = 400.0  # along the optical axis


def key_frames(poses: Poses, camera: Cameras, ground_height: float, overlap: float) -> Ints:
    """Choose key frames so that each overlaps the one before as is asked, above 0 and below 1.

    The overlap is the area that two frames see in common over the smaller of their areas.
    """
    seen = footprints(camera, poses, ground_height)
    chosen, row, before = [0], 1, 1.0
    while row < len(seen):
        one, other = seen[chosen[-1]], seen[row]
        shared = min(one.intersection(other).area / min(one.area, other.area), 1.0)
        if shared < overlap:
            # The frame before, where that is nearer to the overlap; always one after the last.
            row -= before - overlap < overlap - shared and row - 1 > chosen[-1]
            chosen.append(row)
            shared = 1.0
        row, before = row + 1, shared
    return np.array(chosen)


def footprints(camera: Cameras, poses: Poses, ground_height: float) -> list[shapely.Polygon]:
    """Return the part of a level plane that each frame sees down to a depth.

    A frame sees a pyramid as deep as that; the plane cuts its edges at the corners of the part.
    Beyond, an oblique view would go on to the horizon.
    """
    rays = back_project(camera, anchor_pixels(camera, 0.0))
    base = MOST_DEPTH_M * rays_to_world(poses, rays / rays[..., 2:])
    start = np.concatenate([np.zeros_like(base), base], axis=1)
    way = np.concatenate([base, np.roll(base, -1, axis=1) - base], axis=1)
    above = poses.centres[:, 2:] - ground_height + start[..., 2]
    cut = (above >= 0.0) != (above + way[..., 2] >= 0.0)
    share = np.divide(above, -way[..., 2], out=np.zeros_like(above), where=cut)
    places = start[..., :2] + share[..., None] * way[..., :2]
    places += (poses.centres[:, :2] - poses.centres[0, :2])[:, None]
    return [shapely.MultiPoint(at[met]).convex_hull for at, met in zip(places, cut, strict=True)]
