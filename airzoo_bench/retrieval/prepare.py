"""Making the truth of one scene from cameras, poses, a map and a surface model."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.heightfield import HeightField
from airzoo_bench.geometry.poses import Poses, matrix_to_quaternion
from airzoo_bench.geometry.rasters import RasterInfo
from airzoo_bench.protocol import Gallery, GroundTruth
from airzoo_bench.retrieval.footprints import Footprints, cast_footprints
from airzoo_bench.retrieval.gallery import cut_gallery
from airzoo_bench.retrieval.pairs import Positives
from airzoo_bench.retrieval.positives import (
    overlap_of,
    overlaps,
    positives_from_iou,
    positives_from_points,
)
from airzoo_bench.retrieval.truth import (
    ANCHOR_COLUMNS,
    BOX_COLUMNS,
    CENTRE_COLUMNS,
    DISTORTION_COLUMNS,
    FOOTPRINT_COLUMNS,
    INTRINSICS_COLUMNS,
    QUATERNION_COLUMNS,
    RetrievalTruth,
)

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["PreparedScene", "SceneInputs", "build_truth"]


@dataclass(frozen=True)
class SceneInputs:
    """What the truth of a scene is made from.

    Attributes
    ----------
    scene : str
    images : (N,) str
        File names, relative to the photos' folder; their stems become the queries' ids.
    cameras, poses : Cameras, Poses
        Of the N photos.
    crs : str
        Projected CRS of poses and surface model, in metres.
    dom : RasterInfo
        The map that the gallery is cut from, in any CRS.
    dsm : Path
        The surface model.
    plane_height_m : float
        z0, the median of the valid heights.
    """

    scene: str
    images: tuple[str, ...]
    cameras: Cameras
    poses: Poses
    crs: str
    dom: RasterInfo
    dsm: Path
    plane_height_m: float


@dataclass(frozen=True)
class PreparedScene:
    """The truth of a scene, the overlap of all pairs, and how many photos see no ground."""

    truth: RetrievalTruth
    overlaps: Positives
    without_ground_point: int


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
    tiles = cut_gallery(inputs.dom, gallery, inputs.scene)
    boxes = tiles[list(BOX_COLUMNS)].to_numpy(np.float64)
    footprints = _footprints(inputs, rules)
    positives = _positives(footprints, boxes, rules)
    queries = _query_table(inputs, footprints)
    answerable = positives.counts > 0
    kept = answerable if rules.without_positive == "exclude" else np.ones_like(answerable)
    order = np.argsort(queries["id"].to_numpy(str), kind="stable")
    chosen = order[kept[order]]
    truth = RetrievalTruth(
        inputs.scene,
        queries.iloc[chosen].reset_index(drop=True),
        tiles,
        positives.take(chosen),
        _excluded(queries, footprints, order[~kept[order]]),
    )
    all_pairs = overlaps(footprints.lonlat, boxes).take(chosen)
    return PreparedScene(truth, all_pairs, int(footprints.without_ground_point.sum()))


def _footprints(inputs: SceneInputs, rules: GroundTruth) -> Footprints:
    ground: float | HeightField = inputs.plane_height_m
    if rules.rule == "dsm":
        ground = HeightField.read(inputs.dsm)
    return cast_footprints(
        inputs.cameras,
        inputs.poses,
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


def _query_table(inputs: SceneInputs, footprints: Footprints) -> pd.DataFrame:
    import pandas as pd

    cameras, poses = inputs.cameras, inputs.poses
    numbers = {
        "width": cameras.width,
        "height": cameras.height,
        **_named(INTRINSICS_COLUMNS, np.hstack([cameras.focal, cameras.principal_point])),
        **_named(DISTORTION_COLUMNS, cameras.distortion),
        **_named(QUATERNION_COLUMNS, matrix_to_quaternion(poses.rotation)),
        **_named(CENTRE_COLUMNS, poses.centres),
        **_named(ANCHOR_COLUMNS, footprints.lonlat.reshape(-1, 8)),
        **_named(FOOTPRINT_COLUMNS, footprints.centres),
        "altitude_m": np.round(poses.centres[:, 2] - inputs.plane_height_m, 3),
        "pitch_deg": np.round(_pitch_deg(poses), 3),
    }
    ids = [f"{inputs.scene}/{Path(name).with_suffix('').as_posix()}" for name in inputs.images]
    return pd.DataFrame({"id": ids, "image": list(inputs.images), **numbers})


def _named(names: tuple[str, ...], values: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    return dict(zip(names, values.T, strict=True))


def _pitch_deg(poses: Poses) -> NDArray[np.float64]:
    """Return how far the optical axis points below the horizon: 90 degrees is nadir."""
    axis_z = poses.rotation[:, 2, 2]
    return np.degrees(np.arcsin(np.clip(-axis_z, -1, 1)))


def _excluded(
    queries: pd.DataFrame, footprints: Footprints, rows: NDArray[np.intp]
) -> pd.DataFrame:
    excluded = queries.iloc[rows][["id", "image"]].reset_index(drop=True)
    blind = footprints.without_ground_point[rows]
    return excluded.assign(
        reason=np.where(blind, "no ray meets the ground", "the footprint meets no tile")
    )
