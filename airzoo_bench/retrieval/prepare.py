"""The truth of a scene, made from photos, poses and maps, or as a benchmark states it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from rasterio.enums import MaskFlags
from rasterio.windows import Window

from airzoo_bench.benchmark.folder import needed
from airzoo_bench.benchmark.queries import SceneInputs, cameras_of, poses_of, with_unposed
from airzoo_bench.core.errors import RasterError, counted
from airzoo_bench.geometry import rasters
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.geometry.crs import (
    LONLAT_CRS,
    describe_crs,
    geodesic_distance_m,
    to_lonlat,
    unwrap,
)
from airzoo_bench.geometry.heightfield import HeightField
from airzoo_bench.geometry.rasters import RasterInfo, gsd_m, pixel_to_world, to_map_pixels
from airzoo_bench.retrieval.positives import (
    Footprints,
    cast_footprints,
    find_overlaps,
    find_positives,
    polygon_areas,
    with_overlap,
)
from airzoo_bench.retrieval.settings import GeometricRules, MapGallery, StatedRules
from airzoo_bench.retrieval.truth import (
    ANCHOR_COLUMNS,
    BOX_COLUMNS,
    FOOTPRINT_COLUMNS,
    LONLAT_DECIMALS,
    NO_GROUND_POINT,
    POSITION_COLUMNS,
    TOO_EMPTY,
    Positives,
    RetrievalTruth,
    boxes_of,
    offsets_of,
)

_PIXEL_DECIMALS = 6
_STRIP = 1024  # rows of a mask that are read at a time, at most


class PreparedScene(NamedTuple):
    """The truth of a scene, and the overlap of all pairs of its queries and tiles."""

    truth: RetrievalTruth
    overlaps: Positives


def build_truth(inputs: SceneInputs, gallery: MapGallery, rules: GeometricRules) -> PreparedScene:
    """Cut the gallery, cast the footprints, and find which tile answers which photo."""
    info = inputs.gallery_map
    tiles = cut_gallery(info, gallery, inputs.scene)
    valid: Bools = np.ones(len(tiles), np.bool_)
    if gallery.least_valid_share != "none":
        share = tiles["valid_share"].to_numpy(np.float64)
        valid = (share > 0) & (share >= gallery.least_valid_share)
    dropped, tiles = (tiles[some].reset_index(drop=True) for some in (~valid, valid))
    if tiles.empty:
        raise RasterError(
            f"none of its {counted(len(dropped), 'tile')} holds enough valid pixels",
            where=info.path,
            fix="look at the nodata value and the alpha band of the map",
        )
    footprints = _cast_scene(inputs, rules)
    points, boxes, outside = _in_one_frame(inputs, footprints, rules, tiles, dropped)
    shared = find_overlaps(points, boxes)
    positives, on_dropped = (
        find_positives(points, some, rules.iou_above) for some in (boxes, outside)
    )
    positives = with_overlap(points, boxes, positives)
    kept = positives.counts > 0
    choices = {  # the first that holds
        NO_GROUND_POINT: footprints.missed_rays == 4,
        f"only tiles {TOO_EMPTY}, which are in no gallery": on_dropped.counts > 0,
        "the footprint overlaps tiles, and none of them answers": shared.counts > 0,
    }
    reasons = np.select([*choices.values()], [*choices], "the footprint meets no tile")
    left_out = inputs.photos[["id", "image"]].assign(reason=reasons.astype(object))[~kept]
    if rules.without_positive == "miss":
        kept, left_out = np.ones_like(kept), left_out.iloc[:0]
    columns = np.concatenate([footprints.lonlat.reshape(-1, 8), footprints.centres], axis=1)
    named = zip((*ANCHOR_COLUMNS, *FOOTPRINT_COLUMNS), columns.T, strict=True)
    table = inputs.photos[["id"]].assign(**dict(named))
    truth = RetrievalTruth(
        inputs.scene,
        inputs.photos[kept].reset_index(drop=True),
        table[kept].reset_index(drop=True),
        tiles,
        positives.take(np.flatnonzero(kept)),
        with_unposed(left_out.reset_index(drop=True), inputs),
        dropped,
    )
    return PreparedScene(truth, shared.take(np.flatnonzero(kept)))


def answering_tiles(inputs: SceneInputs, tiles: pd.DataFrame, rules: GeometricRules) -> Positives:
    """Find which tiles of a gallery that was cut before answer each photo."""
    points, boxes = _in_one_frame(inputs, _cast_scene(inputs, rules), rules, tiles)
    return find_positives(points, boxes, rules.iou_above)


def _cast_scene(inputs: SceneInputs, rules: GeometricRules) -> Footprints:
    ground: float | HeightField
    if rules.rule == "dsm":
        ground = HeightField.read(needed(inputs.dsm, "surface model", inputs.scene))
    else:
        ground = needed(inputs.plane_height_m, "height of the ground", inputs.scene)
    return cast_footprints(
        cameras_of(inputs.photos),
        poses_of(inputs.photos),
        needed(inputs.crs, "CRS", inputs.scene),
        ground,
        inset=rules.anchor_inset,
        max_range_m=rules.max_range_m,
        about_lon=_middle_lon(inputs.gallery_map),
    )


def _in_one_frame(
    inputs: SceneInputs, footprints: Footprints, rules: GeometricRules, *tables: pd.DataFrame
) -> list[Floats]:
    """Return the points of footprints and the boxes of tables of tiles, the first not empty.

    They are in degrees, or in the map's pixels where boxes in degrees outgrow the tiles.
    """
    info = inputs.gallery_map
    if box_growth(info, tables[0]) <= rules.box_growth:
        return [footprints.lonlat, *map(boxes_of, tables)]
    points = np.round(to_map_pixels(LONLAT_CRS, info)(footprints.lonlat), _PIXEL_DECIMALS)
    return [points, *(_windows_of(table).astype(np.float64) for table in tables)]


# --- the gallery, cut from a map ---


def cut_gallery(info: RasterInfo, gallery: MapGallery, scene: str) -> pd.DataFrame:
    """Cut a map into tiles, as windows."""
    found = gsd_m(info)
    if gallery.gsd_m != "any":
        off = max(abs(axis / gallery.gsd_m - 1) for axis in found)
        if off > gallery.gsd_tolerance:
            raise RasterError(
                f"has {found[0]:.3f} x {found[1]:.3f} m per pixel on the ground",
                where=info.path,
                expected=f"{gallery.gsd_m} m, give or take {gallery.gsd_tolerance:.0%}",
                fix="resample the map (gdalwarp -tr), or choose a protocol of this resolution",
            )
    parts = [_cut_scale(info, size, gallery.overlap, scene) for size in gallery.tile_sizes_px]
    tiles = pd.concat(parts).sort_values("id", ignore_index=True)
    return tiles.assign(valid_share=_valid_shares(info.path, _windows_of(tiles)))


def tile_starts(length: int, size: int, overlap: float) -> Ints:
    """Return where tiles begin along one axis of the map; the last ends at its edge."""
    stride = max(1, math.floor(size * (1 - overlap) + 0.5))
    last = max(0, length - size)
    starts = np.arange(0, last + 1, stride)
    return starts if starts[-1] == last else np.append(starts, last)


def _cut_scale(info: RasterInfo, size: int, overlap: float, scene: str) -> pd.DataFrame:
    columns = tile_starts(info.width, size, overlap)
    rows = tile_starts(info.height, size, overlap)
    row, column = (index.ravel() for index in np.indices((len(rows), len(columns))))
    tiles = pd.DataFrame({"id": "", "size_px": size, "x": columns[column], "y": rows[row]})
    tiles["id"] = [f"{scene}/{size}_{r:05d}_{c:05d}" for r, c in zip(row, column, strict=True)]
    tiles["width"] = np.minimum(size, info.width - tiles["x"])
    tiles["height"] = np.minimum(size, info.height - tiles["y"])
    ring = _outlines(info, tiles)
    boxes = np.round(np.concatenate([ring.min(axis=1), ring.max(axis=1)], axis=1), LONLAT_DECIMALS)
    width = geodesic_distance_m(ring[:, 3], ring[:, 4])
    height = geodesic_distance_m(ring[:, 1], ring[:, 6])
    sides = np.round((width + height) / 2, 3)  # to the millimetre
    return tiles.assign(size_m=sides, **dict(zip(BOX_COLUMNS, boxes.T, strict=True)))


def _windows_of(tiles: pd.DataFrame) -> Ints:
    """Return the windows (G, 4) of tiles in the map: left, top, right, bottom in pixels."""
    x, y, width, height = tiles[["x", "y", "width", "height"]].to_numpy(np.int64).T
    return np.stack([x, y, x + width, y + height], axis=1)


def _middle_lon(info: RasterInfo) -> float:
    """Return the longitude of the map's middle, which longitudes are unwrapped about."""
    centre = np.array((info.width / 2.0, info.height / 2.0))
    return float(to_lonlat(info.crs, pixel_to_world(info.transform, centre))[0])


def box_growth(info: RasterInfo, tiles: pd.DataFrame) -> float:
    """Return by how much boxes are larger than their tiles, as a share of the tiles' area."""
    west, south, east, north = boxes_of(tiles).T
    areas = (east - west) * (north - south)
    corners = _outlines(info, tiles)[:, [0, 2, 7, 5]]
    return float(areas.sum() / polygon_areas(corners).sum() - 1)


def _outlines(info: RasterInfo, tiles: pd.DataFrame) -> Floats:
    """Return lon, lat (G, 8, 2) of the corners of tiles and of the middles of their sides."""
    right = np.array([0, 0.5, 1, 0, 1, 0, 0.5, 1])
    down = np.array([0, 0, 0, 0.5, 0.5, 1, 1, 1])
    x0, y0, x1, y1 = _windows_of(tiles).T[:, :, None].astype(np.float64)
    pixels = np.stack([x0 + (x1 - x0) * right, y0 + (y1 - y0) * down], axis=-1)
    lonlat = to_lonlat(info.crs, pixel_to_world(info.transform, pixels))
    ring = unwrap(lonlat, _middle_lon(info))
    if not (np.abs(ring[..., 1]) <= 90).all():  # also tells NaN
        expected = f"coordinates that {describe_crs(info.crs)} is defined for"
        fix = "look at the geotransform and the CRS of the map, or cut it"
        what = "reaches places that are not on the earth"
        raise RasterError(what, where=info.path, expected=expected, fix=fix)
    return ring


def _valid_shares(path: Path, windows: Ints) -> Floats:
    """Return the share of valid pixels of windows (n, 4) of a raster, exactly."""
    left, top, right, bottom = windows.T
    with rasters.open_raster(path) as dataset:
        if all(flags == [MaskFlags.all_valid] for flags in dataset.mask_flag_enums):
            return np.ones(len(windows))
        height, width = dataset.shape
        columns = np.unique(np.concatenate([left, right, [0, width]]))
        rows = np.unique(np.concatenate([top, bottom, np.arange(0, height, _STRIP), [height]]))
        # Pixels between two cuts, summed up to each cut: four look-ups then count any window.
        sums = np.zeros((len(rows), len(columns)), np.int64)
        for number, (start, stop) in enumerate(pairwise(rows.tolist()), start=1):
            mask = dataset.dataset_mask(window=Window(0, start, width, stop - start)) > 0
            counts = np.count_nonzero(mask, axis=0)
            sums[number, 1:] = np.add.reduceat(counts, columns[:-1])
    sums = sums.cumsum(axis=0).cumsum(axis=1)
    x0, x1 = np.searchsorted(columns, left), np.searchsorted(columns, right)
    y0, y1 = np.searchsorted(rows, top), np.searchsorted(rows, bottom)
    valid = sums[y1, x1] - sums[y0, x1] - sums[y1, x0] + sums[y0, x0]
    return np.asarray(valid / ((right - left) * (bottom - top)))


# --- a benchmark that gives images and says itself which belong together ---


@dataclass(frozen=True, eq=False)
class ImageSet:
    """The queries or the gallery of a scene, N images."""

    names: Sequence[str]  # what ids have after the scene
    images: Sequence[str]  # files, relative to the folder of the set
    positions: Floats | None = None  # (N, 2) longitude and latitude, or metres
    degrees: bool = False  # which of these they are
    conditions: Mapping[str, Sequence[Any]] = field(default_factory=dict)  # columns of queries


@dataclass(frozen=True, eq=False)
class StatedPairs:
    """Pairs of a query (by its row) and an image of the gallery, each once."""

    queries: Ints  # (P,)
    tiles: Ints  # (P,)
    positive: Bools  # (P,) which pairs are answers; the others are known to the benchmark
    weight: Floats | None = None  # (P,) overlap that the benchmark states, 0 to 1


def pairs_of_labels(queries: Sequence[str], gallery: Sequence[str]) -> StatedPairs:
    """Pair each query with all images of its class."""
    photos = pd.DataFrame({"label": [*map(str, queries)]}).reset_index(names="query")
    images = pd.DataFrame({"label": [*map(str, gallery)]}).reset_index(names="tile")
    found = photos.merge(images, on="label", sort=False).sort_values(["query", "tile"])
    query, tile = (found[name].to_numpy(np.int64) for name in ("query", "tile"))
    return StatedPairs(query, tile, np.ones(len(found), np.bool_))


def build_stated_truth(
    scene: str, queries: ImageSet, gallery: ImageSet, pairs: StatedPairs, rules: StatedRules
) -> PreparedScene:
    """Lay out queries, gallery and pairs as the truth of a scene."""
    photos, query_rows = _sorted_table(scene, queries)
    tiles, tile_rows = _sorted_table(scene, gallery)
    query, tile = query_rows[pairs.queries], tile_rows[pairs.tiles]
    order = np.lexsort((tile, query))
    stated = Positives(
        offsets_of(np.bincount(query, minlength=len(photos))),
        tile[order].astype(np.int32),
        None if pairs.weight is None else pairs.weight[order],
    )
    positives = stated.where(pairs.positive[order])
    kept = (positives.counts > 0) | (rules.without_positive == "miss")
    left_out = photos[["id", "image"]].assign(reason="no image of the gallery answers it")[~kept]
    rows, asked = np.flatnonzero(kept), photos[kept].reset_index(drop=True)
    truth = RetrievalTruth(
        scene,
        asked[["id", "image", *queries.conditions]],
        asked.drop(columns=["image", *queries.conditions]),
        tiles.drop(columns=list(gallery.conditions)),
        positives.take(rows),
        left_out.reset_index(drop=True),
        tiles[["id", "image"]].iloc[:0],
    )
    return PreparedScene(truth, stated.take(rows))


def _sorted_table(scene: str, images: ImageSet) -> tuple[pd.DataFrame, Ints]:
    """Lay out a set sorted by id; also give the new row of each image."""
    ids = np.array([f"{scene}/{name}" for name in images.names], dtype=str)
    table = pd.DataFrame({"id": ids.astype(object), "image": list(images.images)})
    if images.positions is not None:
        columns = POSITION_COLUMNS[0 if images.degrees else 1]
        table = table.assign(**dict(zip(columns, images.positions.T, strict=True)))
    table = table.assign(**{name: list(values) for name, values in images.conditions.items()})
    order = np.argsort(ids, kind="stable")
    return table.iloc[order].reset_index(drop=True), np.argsort(order, kind="stable")
