"""The truth of a scene, made from photos, poses and maps."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pandas as pd
from rasterio.enums import MaskFlags
from rasterio.windows import Window

from airzoo_bench.benchmark.folder import needed
from airzoo_bench.benchmark.queries import SceneInputs, cameras_of, poses_of, with_unposed
from airzoo_bench.core.errors import RasterError, counted
from airzoo_bench.geometry import rasters
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.geometry.crs import LONLAT_CRS, geodesic_distance_m, to_lonlat, unwrap
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
from airzoo_bench.retrieval.settings import GeometricRules, MapGallery
from airzoo_bench.retrieval.truth import (
    ANCHOR_COLUMNS,
    BOX_COLUMNS,
    FOOTPRINT_COLUMNS,
    LONLAT_DECIMALS,
    NO_GROUND_POINT,
    TOO_EMPTY,
    Positives,
    RetrievalTruth,
    boxes_of,
)

_PIXEL_DECIMALS = 6


def build_truth(inputs: SceneInputs, gallery: MapGallery, rules: GeometricRules) -> RetrievalTruth:
    """Cut the gallery, cast the footprints, and find which tile answers which photo."""
    tiles = cut_gallery(inputs.gallery_map, gallery, inputs.scene)
    valid: Bools = np.ones(len(tiles), np.bool_)
    if gallery.least_valid_share != "none":
        share = tiles["valid_share"].to_numpy(np.float64)
        valid = (share > 0) & (share >= gallery.least_valid_share)
    dropped, tiles = (tiles[some].reset_index(drop=True) for some in (~valid, valid))
    if tiles.empty:
        raise RasterError(
            f"none of its {counted(len(dropped), 'tile')} holds enough valid pixels",
            where=inputs.gallery_map.path,
            fix="look at the nodata value and the alpha band of the map",
        )
    footprints = _cast_scene(inputs, rules)
    points, boxes, dropped_boxes = _in_one_frame(inputs, footprints, rules, tiles, dropped)
    overlaps = find_overlaps(points, boxes)
    positives = with_overlap(points, boxes, find_positives(points, boxes, rules.iou_above))
    reasons = {  # the first that holds
        NO_GROUND_POINT: np.isnan(footprints.centres).any(axis=1),
        f"only tiles {TOO_EMPTY}, which are in no gallery": (
            find_positives(points, dropped_boxes, rules.iou_above).counts > 0
        ),
        "the footprint overlaps tiles, and none of them answers": overlaps.counts > 0,
    }
    reason = np.select([*reasons.values()], [*reasons], "the footprint meets no tile")
    kept = (positives.counts > 0) | (rules.without_positive == "miss")
    left_out = inputs.photos[["id", "image"]].assign(reason=reason.astype(object))[~kept]
    columns = np.concatenate([footprints.lonlat.reshape(-1, 8), footprints.centres], axis=1)
    named = zip((*ANCHOR_COLUMNS, *FOOTPRINT_COLUMNS), columns.T, strict=True)
    return RetrievalTruth(
        inputs.scene,
        inputs.photos[kept].reset_index(drop=True),
        inputs.photos[["id"]].assign(**dict(named))[kept].reset_index(drop=True),
        tiles,
        positives.take(np.flatnonzero(kept)),
        with_unposed(left_out.reset_index(drop=True), inputs),
        dropped,
        overlaps.take(np.flatnonzero(kept)),
    )


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
    return np.append(np.arange(0, last, stride), last)


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
        what, fix = "reaches places that are not on the earth", "look at its geotransform and CRS"
        raise RasterError(what, where=info.path, fix=f"{fix}, or cut it")
    return ring


def _valid_shares(path: Path, windows: Ints) -> Floats:
    """Return the share of valid pixels of windows (n, 4) of a raster."""
    shares = np.ones(len(windows))
    with rasters.open_raster(path) as dataset:
        if any(flags != [MaskFlags.all_valid] for flags in dataset.mask_flag_enums):
            for row, (left, top, right, bottom) in enumerate(windows.tolist()):
                window = Window(left, top, right - left, bottom - top)
                shares[row] = (dataset.dataset_mask(window=window) > 0).mean()
    return shares
