"""Where photos look on the ground, and which tiles of the gallery answer them."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from airzoo_bench.engines.engine import split
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.geometry.cameras import Cameras, anchor_pixels, back_project
from airzoo_bench.geometry.crs import to_lonlat, unwrap
from airzoo_bench.geometry.heightfield import HeightField
from airzoo_bench.geometry.poses import Poses, rays_to_world
from airzoo_bench.geometry.rays import intersect_heightfield, intersect_plane
from airzoo_bench.retrieval.truth import LONLAT_DECIMALS, Positives, offsets_of

_BLOCK = 4096  # queries at a time
_TILES = 1 << 18  # of a search tree, which bounds its memory
_PAIRS = 1 << 17  # query-tile pairs at a time; they stay in the cache
_TOUCH = 1e-12  # of the tile's area; rounding leaves less than this of two that only touch
_NONE = np.iinfo(np.int32).max
_MOST_GRIDS = 16
_MOST_CANDIDATES = 128  # a point; beyond this a search tree is faster
_FIT_TILES = 12  # a side; functions are fitted on at most 12 x 12 tiles
_SLACK = 1e-12  # of the terms' size; far above their rounding, far below a tile


class Footprints(NamedTuple):
    """The ground points of N photos in degrees, NaN where there is none."""

    lonlat: Floats  # (N, 4, 2), in the order of the image's corners
    centres: Floats  # (N, 2), the mean of the ground points that there are


def cast_footprints(
    cameras: Cameras,
    poses: Poses,
    crs: str,
    ground: float | HeightField,
    *,
    inset: float,
    max_range_m: float,
    about_lon: float,
) -> Footprints:
    """Cast the anchor rays of N photos onto a plane's height or a surface model.

    Longitudes are unwrapped about `about_lon`; see `crs.unwrap`.
    """
    rays = rays_to_world(poses, back_project(cameras, anchor_pixels(cameras, inset)))
    if isinstance(ground, HeightField):
        hits = intersect_heightfield(poses.centres, rays, ground, max_range_m)
    else:
        hits = intersect_plane(poses.centres, rays, ground, max_range_m)
    xy, count = hits.points[..., :2], hits.valid.sum(axis=1)[:, None]
    total = np.where(hits.valid[..., None], xy, 0.0).sum(axis=1)
    middle = np.divide(total, count, out=np.full_like(total, np.nan), where=count > 0)
    degrees = (np.round(to_lonlat(crs, part), LONLAT_DECIMALS) for part in (xy, middle))
    return Footprints(*(np.round(unwrap(one, about_lon), LONLAT_DECIMALS) for one in degrees))


def find_positives(points: Floats, boxes: Floats, iou_above: float | None) -> Positives:
    """Find the tiles that hold one of a query's points, or overlap by more than a ratio."""
    if iou_above is None:
        return find_holding_tiles(points, boxes)
    shared = find_overlaps(points, boxes)
    return shared.where(np.asarray(shared.overlap) > iou_above)


def find_overlaps(polygons: Floats, boxes: Floats) -> Positives:
    """Find every footprint (Q, 4, 2) and tile (G, 4) that overlap, with intersection over union."""
    met = _search_trees(polygons.min(axis=1), polygons.max(axis=1), boxes)
    pairs = with_overlap(polygons, boxes, met)
    return pairs.where(np.asarray(pairs.overlap) > 0)


def with_overlap(polygons: Floats, boxes: Floats, pairs: Positives) -> Positives:
    """Add the intersection over union to given pairs of footprint and tile, 0 with NaN."""
    shapes, query = untangled(polygons), pairs.queries
    found = np.zeros(len(query))
    for part in split(len(query), _PAIRS):
        some, tiles = shapes[query[part]], boxes[pairs.tiles[part]]
        common = _common_areas(some, tiles)
        sizes = (tiles[:, 2] - tiles[:, 0]) * (tiles[:, 3] - tiles[:, 1])
        union = polygon_areas(some) + sizes - common
        # A NaN corner makes `common` NaN, which is not above the rounding either.
        np.divide(common, union, out=found[part], where=common > _TOUCH * sizes)
    return Positives(pairs.offsets, pairs.tiles, np.minimum(found, 1))


def polygon_areas(polygons: Floats) -> Floats:
    """Return the areas of simple polygons (n, V, 2) by the shoelace formula."""
    x, y = np.moveaxis(polygons - polygons[:, :1], 2, 0)
    twice = x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y
    return np.asarray(np.abs(twice.sum(axis=1)) / 2)


def untangled(polygons: Floats) -> Floats:
    """Replace quadrilaterals that cross themselves with their convex hull."""
    a, b, c, d = np.moveaxis(polygons, 1, 0)
    order = np.broadcast_to(np.arange(4), (len(polygons), 4)).copy()
    order[_cross(a, b, c, d)] = 0, 2, 1, 3
    order[_cross(b, c, d, a)] = 0, 1, 3, 2
    return np.take_along_axis(polygons, order[:, :, None], axis=1)


def _cross(a: Floats, b: Floats, c: Floats, d: Floats) -> Bools:
    """Tell whether the segments a-b and c-d cross, each (n, 2); touching is not crossing."""

    def turn(a: Floats, b: Floats, c: Floats) -> Floats:
        ab, ac = b - a, c - a
        return np.sign(ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0])

    crossing = (turn(a, b, c) * turn(a, b, d) < 0) & (turn(c, d, a) * turn(c, d, b) < 0)
    return np.asarray(crossing)


def _common_areas(polygons: Floats, boxes: Floats) -> Floats:
    """Return the area common to each simple polygon and its box, side by side of the polygon.

    A side adds the area between itself, cut to the box, and the box's lower edge.
    """
    local = polygons - boxes[:, None, :2]  # near 0, so that no digits are lost to the offset
    width, height = (boxes[:, 2:] - boxes[:, :2]).T[:, :, None]
    xa, ya = np.moveaxis(local, 2, 0)
    xb, yb = np.roll(xa, -1, axis=1), np.roll(ya, -1, axis=1)
    start, stop = np.clip(xa, 0, width), np.clip(xb, 0, width)
    y_start = ya + (yb - ya) * _share(start - xa, xb - xa)
    y_stop = ya + (yb - ya) * _share(stop - xa, xb - xa)
    # The mean of clamp(y, 0, height) while y goes evenly from one to the other. A level side has
    # no share: `last` equals `first` and stands for the whole of it.
    first, last = np.clip(y_start, 0, height), np.clip(y_stop, 0, height)
    enters, leaves = (_share(one - y_start, y_stop - y_start) for one in (first, last))
    mean = enters * first + (leaves - enters) * (first + last) / 2 + (1 - leaves) * last
    return np.asarray(np.abs(((stop - start) * mean).sum(axis=1)))


def _share(part: Floats, whole: Floats) -> Floats:
    """Return part / whole, cut to [0, 1]; 0 where the whole is 0."""
    return np.clip(np.divide(part, whole, out=np.zeros_like(part), where=whole != 0), 0, 1)


def find_holding_tiles(points: Floats, boxes: Floats) -> Positives:
    """Find the tiles (G, 4) that hold at least one of a query's points (Q, A, 2), borders included.

    Points of NaN lie in no tile.
    """
    if points.size and (grids := _split_into_grids(boxes)):
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            parts = split(len(points), _BLOCK)
            found = list(pool.map(lambda part: _search_grids(grids, points[part]), parts))
        counts, tiles = (np.concatenate(one) for one in zip(*found, strict=True))
        return Positives(offsets_of(counts), tiles)
    places = points.reshape(-1, 2)
    return _search_trees(places, places, boxes, points.shape[1])


def _search_trees(low: Floats, high: Floats, boxes: Floats, each: int = 1) -> Positives:
    """Find the tiles that meet one of the `each` boxes of a query, which go from low to high.

    Boxes that are not finite meet none.
    """
    finite = np.flatnonzero(np.isfinite(low).all(axis=1) & np.isfinite(high).all(axis=1))
    keys = [np.zeros(0, np.int64)]
    for some in split(len(boxes), _TILES):
        tree = shapely.STRtree(shapely.box(*boxes[some].T))
        for part in split(len(finite), _BLOCK):
            rows = finite[part]
            row, tile = tree.query(shapely.box(*low[rows].T, *high[rows].T))
            keys.append(rows[row] // each * len(boxes) + some.start + tile)
    query, tile = np.divmod(np.unique(np.concatenate(keys)), max(len(boxes), 1))
    counts = np.bincount(query, minlength=len(low) // each)
    return Positives(offsets_of(counts), tile.astype(np.int32))


# A gallery cut from one map is a few grids of tiles, one a scale, row by row. There arithmetic
# finds the tiles that may hold a point, more than 10 times as fast as a search tree.


class _Grid(NamedTuple):
    """Tiles that follow each other row by row, and which of them may hold a point.

    Rows and columns are nearly straight and parallel. Two linear functions of lon/lat give a tile's
    centre nearly its column and its row. Each column covers an interval of the first one's values,
    each row of the second one's, which are computed from every tile: a poor fit costs time, never
    a tile.
    """

    start: int  # index of the first tile
    columns: int  # tiles a row
    boxes: Floats  # (n, 4)
    fits: list[Floats]  # of columns and rows: offset, and factors of lon and lat
    ends: list[Floats]  # where the intervals of the columns and the rows end, ascending
    widths: list[int]  # the most columns and rows that one value can lie in


def _split_into_grids(boxes: Floats) -> list[_Grid]:
    """Split a gallery into grids of tiles; none where a search tree is faster."""
    if not len(boxes):
        return []
    starts = np.concatenate([[0], np.flatnonzero(boxes[1:, 0] <= boxes[:-1, 0]) + 1])
    step = np.sign(np.diff(boxes[starts, 3]))
    usual = -1 if step.sum() <= 0 else 1  # latitude falls from row to row, or rises
    lengths = np.diff(np.append(starts, len(boxes)))
    firsts = np.append(0, np.flatnonzero((np.diff(lengths) != 0) | (step != usual)) + 1)
    if len(firsts) > _MOST_GRIDS:
        return []
    ends = np.append(starts[firsts[1:]], len(boxes))
    runs = np.stack([starts[firsts], ends, lengths[firsts]], axis=1).tolist()
    grids = [_fit_grid(boxes[start:end], start, columns) for start, end, columns in runs]
    candidates = sum(grid.widths[0] * grid.widths[1] for grid in grids)
    return grids if candidates <= _MOST_CANDIDATES else []


def _fit_grid(boxes: Floats, start: int, columns: int) -> _Grid:
    west, south, east, north = boxes.T  # by column: reducing (n, 4) over n is 20 times slower
    lon, lat = ((one / 2).reshape(-1, columns) for one in (west + east, south + north))
    reach = (east - west).max() / 2, (north - south).max() / 2
    # Not by the last row and column: anchored to the map's edge, they are out of step.
    rows = [np.unique(np.linspace(0, max(n - 2, 0), _FIT_TILES).astype(int)) for n in lon.shape]
    some = np.ix_(*rows)
    terms = np.stack([one.ravel() for one in (np.ones_like(lon[some]), lon[some], lat[some])], 1)
    fits, ends, widths = [], [], []
    for axis, index in enumerate(np.broadcast_arrays(some[1], some[0])):
        fit: Floats = np.linalg.lstsq(terms, index.ravel().astype(np.float64))[0]
        margin = np.abs(fit[1:]) @ reach + _SLACK * float(1 + np.abs(fit * (1, 180, 90)).sum())
        values = fit[0] + fit[1] * lon + fit[2] * lat
        begin = np.minimum.accumulate((values.min(axis=axis) - margin)[::-1])[::-1]
        end = np.maximum.accumulate(values.max(axis=axis) + margin)
        met = np.searchsorted(begin, end, side="right") - np.arange(len(begin))
        fits.append(fit)
        ends.append(end)
        widths.append(int(met.max()))
    return _Grid(start, columns, boxes, fits, ends, widths)


def _search_grids(grids: list[_Grid], points: Floats) -> tuple[Ints, NDArray[np.int32]]:
    """Return how many tiles hold points of each query of a block, and these tiles."""
    lon, lat = np.ascontiguousarray(points.reshape(-1, 2).T)
    found = []
    with np.errstate(invalid="ignore", over="ignore"):  # NaN points lie in no tile
        for start, columns, boxes, fits, ends, widths in grids:
            column, row = (
                np.minimum(np.searchsorted(end, fit[0] + fit[1] * lon + fit[2] * lat), len(end) - n)
                for fit, end, n in zip(fits, ends, widths, strict=True)
            )
            for down, right in np.ndindex(widths[1], widths[0]):
                tile = (row + down) * columns + column + right
                box = boxes.take(tile, axis=0)
                inside = (box[:, 0] <= lon) & (lon <= box[:, 2])
                inside &= (box[:, 1] <= lat) & (lat <= box[:, 3])
                found.append(np.where(inside, tile + start, _NONE).astype(np.int32))
    hits = np.stack(found, axis=1).reshape(len(points), -1)
    hits.sort(axis=1)
    first = hits != _NONE
    first[:, 1:] &= hits[:, 1:] != hits[:, :-1]
    return first.sum(axis=1), hits[first]
