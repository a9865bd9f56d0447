"""The truth of a scene, made from photos, poses and maps, or as a benchmark states it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd

from airzoo_bench.benchmark.folder import needed
from airzoo_bench.benchmark.queries import NO_POSE, SceneInputs, cameras_of, poses_of, with_unposed
from airzoo_bench.core.errors import BenchmarkError, RasterError, counted, first_of
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.geometry.crs import LONLAT_CRS
from airzoo_bench.geometry.heightfield import HeightField
from airzoo_bench.geometry.rasters import RasterInfo, to_map_pixels
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
    Positives,
    RetrievalTruth,
    boxes_of,
    offsets_of,
)

_PIXEL_DECIMALS = 6


@dataclass(frozen=True)
class PreparedScene:
    """The truth of a scene, and the overlap of all pairs of its queries and tiles.

    `in_map_frame` tells whether positives were decided in the map's pixels, since boxes in degrees
    outgrow tiles.
    """

    truth: RetrievalTruth
    overlaps: Positives
    in_map_frame: bool


def build_truth(inputs: SceneInputs, gallery: MapGallery, rules: GeometricRules) -> PreparedScene:
    """Cut the gallery, cast the footprints, and find which tile answers which photo."""
    info = inputs.gallery_map
    tiles, dropped = _without_empty(cut_gallery(info, gallery, inputs.scene), gallery, info)
    footprints = _footprints(inputs, rules)
    in_map_frame = box_growth(info, tiles) > rules.box_growth
    points, boxes = footprints.lonlat, [boxes_of(tiles), boxes_of(dropped)]
    if in_map_frame:
        points = _in_pixels(info, points)
        boxes = [windows_of(table).astype(np.float64) for table in (tiles, dropped)]
    positives, on_dropped = (_positives(points, some, rules) for some in boxes)
    shared = overlaps(points, boxes[0])
    kept = positives.counts > 0
    reasons = _reasons(footprints, shared, on_dropped.counts > 0, gallery, rules)
    if rules.without_positive == "miss":
        kept[:] = True
    rows = np.flatnonzero(kept)
    left_out = inputs.photos[["id", "image"]].assign(reason=reasons)[~kept]
    anchors = zip(ANCHOR_COLUMNS, footprints.lonlat.reshape(-1, 8).T, strict=True)
    centres = zip(FOOTPRINT_COLUMNS, footprints.centres.T, strict=True)
    table = inputs.photos[["id"]].assign(**dict(anchors), **dict(centres))
    truth = RetrievalTruth(
        inputs.scene,
        inputs.photos.iloc[rows].reset_index(drop=True),
        table.iloc[rows].reset_index(drop=True),
        tiles,
        positives.take(rows),
        with_unposed(left_out.reset_index(drop=True), inputs),
        dropped,
    )
    return PreparedScene(truth, shared.take(rows), in_map_frame)


def answering_tiles(inputs: SceneInputs, tiles: pd.DataFrame, rules: GeometricRules) -> Positives:
    """Find which tiles of a gallery that was cut before answer each photo."""
    info, points = inputs.gallery_map, _footprints(inputs, rules).lonlat
    if box_growth(info, tiles) <= rules.box_growth:
        return _positives(points, boxes_of(tiles), rules)
    return _positives(_in_pixels(info, points), windows_of(tiles).astype(np.float64), rules)


def _without_empty(
    tiles: pd.DataFrame, gallery: MapGallery, info: RasterInfo
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Split off the tiles that hold too little of the map, or none of it."""
    kept = np.ones(len(tiles), bool)
    if gallery.least_valid_share != "none":
        share = tiles["valid_share"].to_numpy(np.float64)
        kept = (share > 0) & (share >= gallery.least_valid_share)
    if not kept.any():
        raise RasterError(
            f"none of its {counted(len(tiles), 'tile')} holds more than "
            f"{tiles['valid_share'].max():.0%} of valid pixels",
            where=info.path,
            expected=f"tiles of which {gallery.least_valid_share:.0%} are valid, and more than 0",
            fix="look at the nodata value and the alpha band of the map",
        )
    return tiles[kept].reset_index(drop=True), tiles[~kept].reset_index(drop=True)


def _footprints(inputs: SceneInputs, rules: GeometricRules) -> Footprints:
    ground: float | HeightField
    if rules.rule == "dsm":
        ground = HeightField.read(needed(inputs.dsm, "surface model", inputs.scene))
    else:
        ground = needed(inputs.plane_height_m, "height of the ground", inputs.scene)
    found = cast_footprints(
        cameras_of(inputs.photos),
        poses_of(inputs.photos),
        needed(inputs.crs, "CRS", inputs.scene),
        ground,
        inset=rules.anchor_inset,
        max_range_m=rules.max_range_m,
    )
    return found.about(middle_lon(inputs.gallery_map))


def _in_pixels(info: RasterInfo, lonlat: Floats) -> Floats:
    return np.round(to_map_pixels(LONLAT_CRS, info)(lonlat), _PIXEL_DECIMALS)


def _positives(points: Floats, boxes: Floats, rules: GeometricRules) -> Positives:
    if rules.iou_above is not None:
        return positives_from_iou(points, boxes, rules.iou_above)
    found = positives_from_points(points, boxes)
    return Positives(found.offsets, found.tiles, overlap_of(points, boxes, found))


_BETWEEN = "the footprint overlaps tiles, but none of its 4 points lies in one"
_FIXES = (  # for reasons that contain the text, the first that does
    (NO_POSE, ""),
    ("overlaps by more", "lower --iou-above, or choose a --tile-size nearer to the footprints"),
    (_BETWEEN, "take a map that is larger than the footprints, or --rule iou, or look at heights"),
    ("only tiles", "take a map that is valid below the photos, or lower least_valid_share"),
    ("", "look at the CRS of poses, DOM and DSM, and whether poses are world-to-camera"),
)


def _reasons(
    footprints: Footprints,
    shared: Positives,
    on_dropped: Bools,
    gallery: MapGallery,
    rules: GeometricRules,
) -> list[str]:
    """Return for each photo why no tile answers it, if none does."""
    missed, outside = (footprints.missed_rays, "would answer it, and they are not in the gallery")
    too_little = f"no tile overlaps by more than {rules.iou_above or 0:g}"
    choices = {  # the first that holds
        NO_GROUND_POINT: missed == 4,
        f"only tiles {gallery.dropped} {outside}": on_dropped,
        _BETWEEN if rules.iou_above is None else too_little: shared.counts > 0,
        "some of its 4 rays do not meet the ground, and the others meet no tile": missed > 0,
    }
    reasons = np.select([*choices.values()], [*choices], "the footprint meets no tile")
    return [str(reason) for reason in reasons]


def grouped_reasons(excluded: pd.DataFrame) -> tuple[list[str], list[str]]:
    """Return why photos have no tile, a clause a reason, and what may help, commonest first."""
    counts = excluded["reason"].value_counts()
    clauses = [f"{counted(count, 'photo')}: {reason}" for reason, count in counts.items()]
    fixes = [next(fix for text, fix in _FIXES if text in reason) for reason in counts.index]
    return clauses, list(dict.fromkeys(filter(None, fixes)))


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
    asked, asked_order = _table(scene, queries, "queries")
    tiles, tile_order = _table(scene, gallery, "images of the gallery")
    query, tile = asked_order[pairs.queries], tile_order[pairs.tiles]
    order = np.lexsort((tile, query))
    stated = Positives(
        offsets_of(np.bincount(query, minlength=len(asked))),
        tile[order].astype(np.int32),
        None if pairs.weight is None else pairs.weight[order],
    )
    positives = stated.where(pairs.positive[order])
    kept = positives.counts > 0
    if rules.without_positive == "miss":
        kept[:] = True
    if not kept.any():
        raise BenchmarkError(
            f"scene {scene} has no query that an image of its gallery answers",
            fix="look whether queries and gallery are of one benchmark",
        )
    rows, conditions = np.flatnonzero(kept), list(queries.conditions)
    reason = "the benchmark states no image that answers it"
    if rules.rule == "labels":
        reason = "no image of its class is in the gallery"
    truth = RetrievalTruth(
        scene,
        asked[["id", "image", *conditions]].iloc[rows].reset_index(drop=True),
        asked.drop(columns=["image", *conditions]).iloc[rows].reset_index(drop=True),
        tiles.drop(columns=list(gallery.conditions)),
        positives.take(rows),
        asked[["id", "image"]].assign(reason=reason)[~kept].reset_index(drop=True),
        tiles[["id", "image"]].iloc[:0],
    )
    return PreparedScene(truth, stated.take(rows), in_map_frame=False)


def _table(scene: str, images: ImageSet, what: str) -> tuple[pd.DataFrame, Ints]:
    """Lay out a set sorted by id; also give the new row of each image."""
    ids = [f"{scene}/{name}" for name in images.names]
    table = pd.DataFrame({"id": ids, "image": list(images.images)})
    twice = table[table["id"].duplicated(keep=False)].sort_values("id", kind="stable")
    if len(twice):
        raise BenchmarkError(
            f"{what} of scene {scene} of which several have one name: "
            f"{first_of(twice['image'], len(table))}",
            expected="each name once, without its ending",
            fix="remove the copies",
        )
    if images.positions is not None:
        degrees, metres = POSITION_COLUMNS
        columns = degrees if images.degrees else metres
        table = table.assign(**dict(zip(columns, images.positions.T, strict=True)))
    table = table.assign(**{name: list(values) for name, values in images.conditions.items()})
    order = np.argsort(table["id"].to_numpy(str), kind="stable")
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    return table.iloc[order].reset_index(drop=True), place
