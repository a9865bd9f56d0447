"""Making the truth of one scene from cameras, poses, a map and a surface model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.heightfield import HeightField
from airzoo_bench.queries import cameras_of, poses_of
from airzoo_bench.retrieval.footprints import Footprints, cast_footprints
from airzoo_bench.retrieval.gallery import cut_gallery
from airzoo_bench.retrieval.pairs import Positives
from airzoo_bench.retrieval.positives import (
    overlap_of,
    overlaps,
    positives_from_iou,
    positives_from_points,
)
from airzoo_bench.retrieval.settings import Gallery, GroundTruth
from airzoo_bench.retrieval.truth import (
    ANCHOR_COLUMNS,
    BOX_COLUMNS,
    FOOTPRINT_COLUMNS,
    NO_GROUND_POINT,
    NO_TILE,
    RetrievalTruth,
)
from airzoo_bench.scene_inputs import SceneInputs, with_unposed

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["PreparedScene", "build_truth"]


@dataclass(frozen=True)
class PreparedScene:
    """The truth of a scene, and the overlap of all pairs."""

    truth: RetrievalTruth
    overlaps: Positives


def build_truth(inputs: SceneInputs, gallery: Gallery, rules: GroundTruth) -> PreparedScene:
    """Cut the gallery, cast the footprints, and find which tile answers which photo.

    Parameters
    ----------
    inputs : SceneInputs
    gallery, rules : Gallery, GroundTruth
        The protocol's.

    Raises
    ------
    RasterError
        The map's resolution is not the protocol's, or the surface model has no valid height.
    """
    tiles = cut_gallery(inputs.gallery_map, gallery, inputs.scene)
    boxes = tiles[list(BOX_COLUMNS)].to_numpy(np.float64)
    footprints = _footprints(inputs, rules)
    positives = _positives(footprints, boxes, rules)
    answerable = positives.counts > 0
    kept = answerable if rules.without_positive == "exclude" else np.ones_like(answerable)
    rows = np.flatnonzero(kept)
    truth = RetrievalTruth(
        inputs.scene,
        inputs.photos.iloc[rows].reset_index(drop=True),
        _footprint_table(inputs, footprints).iloc[rows].reset_index(drop=True),
        tiles,
        positives.take(rows),
        with_unposed(_excluded(inputs, footprints, ~kept), inputs),
    )
    return PreparedScene(truth, overlaps(footprints.lonlat, boxes).take(rows))


def _footprints(inputs: SceneInputs, rules: GroundTruth) -> Footprints:
    ground: float | HeightField = inputs.plane_height_m
    if rules.rule == "dsm":
        ground = HeightField.read(inputs.dsm)
    return cast_footprints(
        cameras_of(inputs.photos),
        poses_of(inputs.photos),
        inputs.crs,
        ground,
        inset=rules.anchor_inset,
        max_range_m=rules.max_range_m,
    )


def _positives(footprints: Footprints, boxes: NDArray[np.float64], rules: GroundTruth) -> Positives:
    if rules.iou_above is not None:
        return positives_from_iou(footprints.lonlat, boxes, rules.iou_above)
    found = positives_from_points(footprints.lonlat, boxes)
    ratios = overlap_of(footprints.lonlat, boxes, found)
    return Positives(found.offsets, found.tiles, ratios)


def _footprint_table(inputs: SceneInputs, footprints: Footprints) -> pd.DataFrame:
    anchors = zip(ANCHOR_COLUMNS, footprints.lonlat.reshape(-1, 8).T, strict=True)
    centres = zip(FOOTPRINT_COLUMNS, footprints.centres.T, strict=True)
    return inputs.photos[["id"]].assign(**dict(anchors), **dict(centres))


def _excluded(
    inputs: SceneInputs, footprints: Footprints, left_out: NDArray[np.bool_]
) -> pd.DataFrame:
    photos = inputs.photos[left_out][["id", "image"]].reset_index(drop=True)
    blind = footprints.without_ground_point[left_out]
    return photos.assign(reason=np.where(blind, NO_GROUND_POINT, NO_TILE))
