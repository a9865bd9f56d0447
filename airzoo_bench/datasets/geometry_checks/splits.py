"""Whether two sets of photos, such as training and test, see the same ground.

A footprint is the quadrilateral of ground below the four corners of a photo, on the plane of the
ground. Two footprints overlap where they share an area; to touch is not to overlap.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import shapely

from airzoo_bench.benchmark.tables import read_table
from airzoo_bench.core.errors import BenchmarkError, counted, first_of
from airzoo_bench.datasets.geometry_checks.scenes import PosedScene, scenes_of_benchmark
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.cameras import anchor_pixels, back_project
from airzoo_bench.geometry.crs import to_lonlat
from airzoo_bench.geometry.poses import rays_to_world
from airzoo_bench.geometry.rays import intersect_plane
from airzoo_bench.retrieval.footprints import untangled
from airzoo_bench.retrieval.truth import ANCHOR_COLUMNS
from airzoo_bench.tables.model import Cell, Column, Row, Table

_SHOWN = 20
_METRES_OF_A_DEGREE = np.pi / 180 * 6_371_008.8
_LEAST_AREA_M2 = 1e-4  # what rounding makes of borders that touch: 1e-9 degrees by 1 km
_COLUMNS = list(ANCHOR_COLUMNS)


def read_footprints(place: Path, max_range_m: float) -> pd.DataFrame:
    """Return the corners of photos by id, of a benchmark folder or a CSV; NaN where not known."""
    if place.suffix.lower() == ".csv":
        table = read_table(place, ("id", *_COLUMNS))  # which checks coordinates
        columns = {one: pd.to_numeric(table[one], errors="coerce").array for one in _COLUMNS}
        return pd.DataFrame(columns, table["id"].astype(str))
    return pd.concat(
        pd.DataFrame(cast_corners(one, max_range_m).reshape(-1, 8), one.ids, _COLUMNS)
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
