"""Whether two sets of photos, such as training and test, see the same ground.

A footprint is the quadrilateral of ground below the four corners of a photo, on the plane of the
ground. Two footprints overlap where they share an area; to touch is not to overlap.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import shapely

from airzoo_bench.benchmark.tables import read_table
from airzoo_bench.core.errors import BenchmarkError, counted, first_of
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.datasets.geometry_checks.scenes import open_benchmark, scenes_of_benchmark
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.geometry.cameras import Cameras, anchor_pixels, back_project
from airzoo_bench.geometry.crs import to_lonlat
from airzoo_bench.geometry.poses import Poses, rays_to_world
from airzoo_bench.geometry.rays import intersect_plane
from airzoo_bench.retrieval.footprints import untangled
from airzoo_bench.retrieval.truth import ANCHOR_COLUMNS
from airzoo_bench.tables.model import Cell, Column, Row, Table

_BLOCK = 2048
_SHOWN = 20
_METRES_OF_A_DEGREE = np.pi / 180 * 6_371_008.8
_LEAST_AREA_M2 = 1e-4  # what rounding makes of borders that touch: 1e-9 degrees by 1 km


@dataclass(frozen=True, eq=False)
class NamedFootprints:
    """Corners (N, 4, 2) of N photos in order, NaN for one that sees no ground, or is `unknown`."""

    ids: tuple[str, ...]
    lonlat: Floats
    unknown: Bools

    @property
    def unknown_ids(self) -> list[str]:
        """Photos that may look anywhere."""
        return [self.ids[row] for row in np.flatnonzero(self.unknown)]


def read_footprints(place: Path, max_range_m: float) -> NamedFootprints:
    """Read footprints of a benchmark folder's photos, or of a CSV."""
    if place.suffix.lower() == ".csv":
        # Its coordinates are checked where any of the suite's tables are read.
        table = read_table(place, ("id", *ANCHOR_COLUMNS))
        columns = [pd.to_numeric(table[name], errors="coerce") for name in ANCHOR_COLUMNS]
        lonlat = np.stack(columns, axis=1).astype(np.float64).reshape(-1, 4, 2)
        unknown = np.asarray(~np.isfinite(lonlat).all(axis=(1, 2)))
        lonlat[unknown] = np.nan
        return NamedFootprints(tuple(table["id"].astype(str)), lonlat, unknown)
    parts, ids = [], list[str]()
    for one in scenes_of_benchmark(open_benchmark(place)):
        if one.plane_height_m is None or one.crs is None:
            raise BenchmarkError("has no ground plane or no CRS", where=one.name)
        parts.append(cast_corners(one.cameras, one.poses, one.crs, one.plane_height_m, max_range_m))
        ids += one.ids
    return NamedFootprints(tuple(ids), *map(np.concatenate, zip(*parts, strict=True)))


def cast_corners(
    cameras: Cameras, poses: Poses, crs: Any, plane_height_m: float, max_range_m: float
) -> tuple[Floats, Bools]:
    """Cast the corners of N photos onto a plane; return footprints and which are not known."""
    rays = rays_to_world(poses, back_project(cameras, anchor_pixels(cameras, 0.0)))
    hits = intersect_plane(poses.centres, rays, plane_height_m, max_range_m)
    ends = poses.centres[:, None] + max_range_m * rays
    lonlat = to_lonlat(crs, np.where(hits.valid[..., None], hits.points, ends)[..., :2])
    unknown = (poses.centres[:, 2] <= plane_height_m) | np.isnan(lonlat).any(axis=(1, 2))
    blind = (rays[..., 2] >= 0.0).all(axis=1)
    lonlat[unknown | blind] = np.nan
    return lonlat, unknown


def compare_splits(
    train: NamedFootprints, test: NamedFootprints, progress: Progress = silent
) -> pd.DataFrame:
    """Return the pairs of photos that see common ground.

    A row is train and test id, shared m2, and the share of the test footprint.
    """
    near, turn = _unwrapped(train.lonlat), np.array((360.0, 0.0))
    around, rows = _polygons(np.concatenate([near + n * turn for n in (-1, 0, 1)]))
    tree = shapely.STRtree(around)
    asked, kept = _polygons(_unwrapped(test.lonlat))
    parts = [np.empty((0, 4))]
    starts = range(0, len(asked), _BLOCK)
    for start in progress(starts, "footprints", len(starts)):
        block = asked[start : start + _BLOCK]
        first, second = tree.query(block, predicate="intersects")
        shared = shapely.intersection(block[first], around[second])
        # Degrees of longitude shrink with the latitude of what is seen.
        latitude = np.radians(shapely.get_y(shapely.centroid(block[first])))
        square = _METRES_OF_A_DEGREE**2 * np.cos(latitude)
        area, whole = shapely.area(shared) * square, shapely.area(block[first]) * square
        rows_test, rows_train = kept[start + first], rows[second] % max(len(train.ids), 1)
        found = np.column_stack((rows_train, rows_test, area, area / whole))
        parts.append(found[np.lexsort((rows_train, rows_test))])
    found = np.concatenate(parts)
    found = found[found[:, 2] > _LEAST_AREA_M2]
    of_train, of_test = found[:, :2].astype(np.int64).T
    return pd.DataFrame(
        {
            "train": [train.ids[row] for row in of_train],
            "test": [test.ids[row] for row in of_test],
            "shared_m2": np.round(found[:, 2], 3),
            "share_of_test": np.round(found[:, 3], 6),
        }
    )


def _polygons(lonlat: Floats) -> tuple[Any, Ints]:
    """Return shapes of the footprints that there are, and their rows."""
    there = np.isfinite(lonlat).all(axis=(1, 2))
    return shapely.polygons(untangled(lonlat[there])), np.flatnonzero(there)


def _unwrapped(lonlat: Floats) -> Floats:
    """Unwrap the corners of each footprint about its first, which is put within +-180 degrees."""
    lon = lonlat[..., 0]
    first = (lon[:, :1] + 180.0) % 360.0 - 180.0
    lon = first + (lon - lon[:, :1] + 180.0) % 360.0 - 180.0
    return np.stack((lon, lonlat[..., 1]), axis=-1)


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
