"""The truth of a scene, made from photos, poses and maps, or as a benchmark states it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from airzoo_bench.benchmark.folder import needed
from airzoo_bench.benchmark.queries import SceneInputs, cameras_of, poses_of, with_unposed
from airzoo_bench.core.errors import BenchmarkError, RasterError, counted, first_of
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.geometry.crs import LONLAT_CRS
from airzoo_bench.geometry.heightfield import HeightField
from airzoo_bench.geometry.rasters import to_map_pixels
from airzoo_bench.retrieval.footprints import Footprints, cast_footprints
from airzoo_bench.retrieval.gallery import box_growth, cut_gallery, middle_lon, windows_of
from airzoo_bench.retrieval.positives import (
    overlap_of,
    overlaps,
    positives_from_iou,
    positives_from_points,
)
from airzoo_bench.retrieval.settings import GeometricRules, MapGallery, StatedRules
from airzoo_bench.retrieval.truth import (
    ANCHOR_COLUMNS,
    FOOTPRINT_COLUMNS,
    NO_GROUND_POINT,
    POSITION_COLUMNS,
    TOO_EMPTY,
    Positives,
    RetrievalTruth,
    boxes_of,
    offsets_of,
)

_PIXEL_DECIMALS = 6


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
    footprints = _footprints(inputs, rules)
    missed = footprints.missed_rays
    points, boxes, outside = _in_one_frame(inputs, footprints, rules, tiles, dropped)
    positives, on_dropped = (_positives(points, some, rules) for some in (boxes, outside))
    shared = overlaps(points, boxes)
    kept = positives.counts > 0
    # The first that holds says why no tile answers a photo.
    between = "the footprint overlaps tiles, but none of its 4 points lies in one"
    too_little = f"no tile overlaps by more than {rules.iou_above or 0:g}"
    choices = {
        NO_GROUND_POINT: missed == 4,
        f"only tiles {TOO_EMPTY}, which are in no gallery": on_dropped.counts > 0,
        between if rules.iou_above is None else too_little: shared.counts > 0,
        "some of its 4 rays do not meet the ground, and the others meet no tile": missed > 0,
    }
    reasons = np.select([*choices.values()], [*choices], "the footprint meets no tile")
    left_out = inputs.photos[["id", "image"]].assign(reason=reasons.astype(object))[~kept]
    if rules.without_positive == "miss":
        kept, left_out = np.ones_like(kept), left_out.iloc[:0]
    rows = np.flatnonzero(kept)
    columns = np.concatenate([footprints.lonlat.reshape(-1, 8), footprints.centres], axis=1)
    named = zip((*ANCHOR_COLUMNS, *FOOTPRINT_COLUMNS), columns.T, strict=True)
    table = inputs.photos[["id"]].assign(**dict(named))
    truth = RetrievalTruth(
        inputs.scene,
        inputs.photos.iloc[rows].reset_index(drop=True),
        table.iloc[rows].reset_index(drop=True),
        tiles,
        positives.take(rows),
        with_unposed(left_out.reset_index(drop=True), inputs),
        dropped,
    )
    return PreparedScene(truth, shared.take(rows))


def answering_tiles(inputs: SceneInputs, tiles: pd.DataFrame, rules: GeometricRules) -> Positives:
    """Find which tiles of a gallery that was cut before answer each photo."""
    points, boxes = _in_one_frame(inputs, _footprints(inputs, rules), rules, tiles)
    return _positives(points, boxes, rules)


def _footprints(inputs: SceneInputs, rules: GeometricRules) -> Footprints:
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
        about_lon=middle_lon(inputs.gallery_map),
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
    return [points, *(windows_of(table).astype(np.float64) for table in tables)]


def _positives(points: Floats, boxes: Floats, rules: GeometricRules) -> Positives:
    if rules.iou_above is not None:
        return positives_from_iou(points, boxes, rules.iou_above)
    found = positives_from_points(points, boxes)
    return Positives(found.offsets, found.tiles, overlap_of(points, boxes, found))


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
    asked, given = pd.factorize(np.array([*queries, *gallery], dtype=str))[0], len(queries)
    images = pd.DataFrame({"label": asked[given:], "tile": np.arange(len(gallery))})
    photos = pd.DataFrame({"label": asked[:given], "query": np.arange(given)})
    found = photos.merge(images, on="label", sort=False).sort_values(["query", "tile"])
    query, tile = (found[name].to_numpy(np.int64) for name in ("query", "tile"))
    return StatedPairs(query, tile, np.ones(len(found), np.bool_))


def build_stated_truth(
    scene: str, queries: ImageSet, gallery: ImageSet, pairs: StatedPairs, rules: StatedRules
) -> PreparedScene:
    """Lay out queries, gallery and pairs as the truth of a scene."""
    asked, asked_order = _table(scene, queries)
    tiles, tile_order = _table(scene, gallery)
    query, tile = asked_order[pairs.queries], tile_order[pairs.tiles]
    order = np.lexsort((tile, query))
    stated = Positives(
        offsets_of(np.bincount(query, minlength=len(asked))),
        tile[order].astype(np.int32),
        None if pairs.weight is None else pairs.weight[order],
    )
    positives = stated.where(pairs.positive[order])
    kept = (positives.counts > 0) | (rules.without_positive == "miss")
    if not kept.any():
        raise BenchmarkError(
            f"scene {scene} has no query that an image of its gallery answers",
            fix="look whether queries and gallery are of one benchmark",
        )
    rows, conditions = np.flatnonzero(kept), list(queries.conditions)
    left_out = asked[["id", "image"]].assign(reason="no image of the gallery answers it")[~kept]
    truth = RetrievalTruth(
        scene,
        asked[["id", "image", *conditions]].iloc[rows].reset_index(drop=True),
        asked.drop(columns=["image", *conditions]).iloc[rows].reset_index(drop=True),
        tiles.drop(columns=list(gallery.conditions)),
        positives.take(rows),
        left_out.reset_index(drop=True),
        tiles[["id", "image"]].iloc[:0],
    )
    return PreparedScene(truth, stated.take(rows))


def _table(scene: str, images: ImageSet) -> tuple[pd.DataFrame, Ints]:
    """Lay out a set sorted by id; also give the new row of each image."""
    table = pd.DataFrame({"id": [f"{scene}/{name}" for name in images.names]})
    table["image"] = list(images.images)
    twice = table[table["id"].duplicated(keep=False)]
    if len(twice):
        raise BenchmarkError(
            f"images of scene {scene} with one name: {first_of(twice['image'], len(table))}",
            expected="each name once, without its ending",
        )
    if images.positions is not None:
        columns = POSITION_COLUMNS[0 if images.degrees else 1]
        table = table.assign(**dict(zip(columns, images.positions.T, strict=True)))
    table = table.assign(**{name: list(values) for name, values in images.conditions.items()})
    order = np.argsort(table["id"].to_numpy(str), kind="stable")
    return table.iloc[order].reset_index(drop=True), np.argsort(order, kind="stable")
