"""Facts about a scene, from comparing its poses with GPS, priors, maps, crops and tiles."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from airzoo_bench.benchmark.queries import SceneInputs, cameras_of, poses_of
from airzoo_bench.datasets.map_facts import MapFacts, map_facts
from airzoo_bench.datasets.photo_facts import (
    Cameras3D,
    GpsFacts,
    PhotoFiles,
    camera_facts,
    gps_facts,
    median,
    survey_photos,
)
from airzoo_bench.datasets.photo_metadata import PhotoPrior
from airzoo_bench.datasets.priors import (
    PriorFacts,
    WithoutPrior,
    prior_facts,
    without_prior,
)
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.geometry.cameras import anchor_pixels, back_project
from airzoo_bench.geometry.heightfield import HeightSurvey
from airzoo_bench.geometry.poses import rays_to_world
from airzoo_bench.geometry.rasters import (
    RasterInfo,
    gsd_m,
    open_info,
    to_map_pixels,
)
from airzoo_bench.geometry.rays import intersect_plane
from airzoo_bench.matching.truth import MatchingTruth
from airzoo_bench.retrieval.truth import RetrievalTruth

__all__ = ["MeasuredScene", "SceneFacts", "footprints_of", "scene_facts"]

_FAR_M = 1e6


@dataclass(frozen=True, eq=False)
class MeasuredScene:
    """A scene's parts, each measured by itself.

    Attributes
    ----------
    inputs : SceneInputs
    metadata : mapping of str to PhotoPrior
        By file name; photos without an entry have none.
    survey : HeightSurvey or None
        Of the surface model.
    files : PhotoFiles
    cameras : Cameras3D
    is_metadata : bool
        Whether poses are the metadata's.
    """

    inputs: SceneInputs
    metadata: Mapping[str, PhotoPrior]
    survey: HeightSurvey | None
    files: PhotoFiles
    cameras: Cameras3D
    is_metadata: bool

    @classmethod
    def of(
        cls,
        inputs: SceneInputs,
        metadata: Mapping[str, PhotoPrior],
        survey: HeightSurvey | None,
        images: Path,
        *,
        is_metadata: bool = False,
    ) -> MeasuredScene:
        """Measure the photos of a folder, those that have metadata, and the cameras."""
        cameras = camera_facts(inputs, metadata)
        files = survey_photos(images, metadata)
        return cls(inputs, metadata, survey, files, cameras, is_metadata)


@dataclass(frozen=True, eq=False)
class SceneFacts(MeasuredScene):
    """Figures from comparing a scene's parts; None for parts that are missing.

    Attributes
    ----------
    gps : GpsFacts or None
    without_prior : WithoutPrior
    priors : PriorFacts or None
    photo_gsd_m, footprint_m : float
        Medians over photos: ground width of a pixel, and of the photo's longer side.
    on_map, on_surface : float
        Share of the photos' corners, on the plane, that lie on the map, and within the rectangle
        of the surface model; NaN where there is none.
    map : MapFacts or None
    map_gsd_m : tuple of float or None
        Of the map, between columns and rows.
    crop_shares : (Q,) array or None
        Share of the map that each query's crop takes.
    positive_shares : (Q,) array or None
        Share of the gallery that answers each query.
    cloud_over_surface_m : float or None
        Median height of the true cloud above the surface model; NaN where they do not meet.
    dropped_tiles : int
        Tiles that are not in the gallery since they hold too little of the map.
    dropped : str
        Which tiles these are, see `Gallery.dropped`; empty where the protocol is not known.
    nearest_missed : float
        Share of queries that the tile does not answer whose centre is nearest to the footprint's;
        NaN where there are none.
    """

    gps: GpsFacts | None
    without_prior: WithoutPrior
    priors: PriorFacts | None
    photo_gsd_m: float
    footprint_m: float
    on_map: float
    on_surface: float
    map: MapFacts | None
    map_gsd_m: tuple[float, float] | None
    crop_shares: Floats | None
    positive_shares: Floats | None
    cloud_over_surface_m: float | None
    dropped_tiles: int
    dropped: str
    nearest_missed: float

    def values(self) -> dict[str, Any]:
        """Return the figures as JSON values."""
        cameras, over = self.cameras, self.cloud_over_surface_m
        dom, survey, found = self.inputs.dom, self.survey, self.map
        return {
            "photos": len(self.inputs.photos),
            "height_over_surface_m": _json(cameras.height_m),
            "height_over_take_off_m": _json(cameras.relative_height_m),
            "cameras_below_surface": cameras.below,
            "photo_gsd_m": _json(self.photo_gsd_m),
            "photos_by_camera": {name: len(of) for name, of in self.files.cameras.items()},
            "days": [day.isoformat() for day in self.files.days],
            "photos_without_prior": {
                what: len(ids) for what, ids in self.without_prior.lacking.items()
            },
            "gps": _figures(self.gps, "photos", "distance_m", "height_m"),
            "priors": _figures(
                self.priors, "photos", "position_m", "yaw_deg", "pitch_deg", "rotation_deg"
            ),
            "map_px": None if dom is None else [dom.width, dom.height],
            "map_gsd_m": None if self.map_gsd_m is None else list(self.map_gsd_m),
            "map_shown": None if found is None else found.shown,
            "map_in_one_colour": None if found is None else found.one_colour,
            "map_over_surface": None if found is None else _json(found.over_surface),
            "corners_on_map": _json(self.on_map),
            "corners_on_surface": _json(self.on_surface),
            "surface_valid_share": None if survey is None else survey.valid_share,
            "surface_m": None
            if survey is None
            else [survey.low, self.inputs.plane_height_m, survey.high],
            "cloud_over_surface_m": None if over is None else _json(over),
            "dropped_tiles": self.dropped_tiles,
            "crop_share": _json(_mean(self.crop_shares)),
            "chance_of_positive": _json(_mean(self.positive_shares)),
        }


def scene_facts(
    scene: MeasuredScene,
    retrieval: RetrievalTruth | None,
    matching: MatchingTruth | None,
    cloud_over_surface_m: float | None,
    dropped: str = "",
) -> SceneFacts:
    """Compare the parts of a scene with each other."""
    inputs, metadata = scene.inputs, scene.metadata
    gsd, footprint, corners = footprints_of(inputs)
    dom, dsm = inputs.dom, None if inputs.dsm is None else open_info(inputs.dsm)
    shares = None if retrieval is None else retrieval.positives.counts / len(retrieval.tiles)
    return SceneFacts(
        inputs,
        metadata,
        scene.survey,
        scene.files,
        scene.cameras,
        scene.is_metadata,
        gps_facts(inputs, metadata),
        without_prior(inputs.photos, None if scene.is_metadata else metadata),
        prior_facts(inputs.photos),
        gsd,
        footprint,
        _share_inside(corners, inputs, dom),
        _share_inside(corners, inputs, dsm),
        None if dom is None else map_facts(dom, dsm),
        None if dom is None else gsd_m(dom),
        None if matching is None or dom is None else _crop_shares(matching, dom),
        shares,
        cloud_over_surface_m,
        0 if retrieval is None else len(retrieval.dropped_tiles),
        dropped,
        _nearest_missed(retrieval),
    )


def _nearest_missed(truth: RetrievalTruth | None) -> float:
    from scipy.spatial import cKDTree

    if truth is None or truth.of_images:
        return math.nan
    centres, queries = (truth.boxes[:, :2] + truth.boxes[:, 2:]) / 2, truth.footprint_centres
    rows = np.flatnonzero(np.isfinite(queries).all(axis=1))
    scale = (np.cos(np.radians(centres[:, 1].mean())), 1.0)
    nearest = cKDTree(centres * scale).query(queries[rows] * scale)[1]
    return _mean(~truth.positives.holds(rows, nearest, len(centres)))


def _crop_shares(truth: MatchingTruth, dom: RasterInfo) -> Floats:
    shares: Floats = truth.crops[:, 2] * truth.crops[:, 3] / (dom.width * dom.height)
    return shares


def footprints_of(inputs: SceneInputs) -> tuple[float, float, Floats]:
    """Return medians of pixel size and longer side (m) on the plane, and the corners (N, 4, 2)."""
    if inputs.plane_height_m is None or "x" not in inputs.photos:
        return math.nan, math.nan, np.full((len(inputs.photos), 4, 2), np.nan)
    cameras, poses = cameras_of(inputs.photos), poses_of(inputs.photos)
    above = poses.centres[:, 2] - inputs.plane_height_m
    gsd = above / cameras.focal.mean(axis=1)
    rays = rays_to_world(poses, back_project(cameras, anchor_pixels(cameras, 0.0)))
    hits = intersect_plane(poses.centres, rays, inputs.plane_height_m, _FAR_M)
    longer = np.maximum(cameras.width, cameras.height)
    return median(gsd), median(gsd * longer), hits.points[..., :2]


def _share_inside(corners: Floats, inputs: SceneInputs, raster: RasterInfo | None) -> float:
    """Share of the photos' corners that lie within a raster; NaN where either is not known."""
    if raster is None or np.isnan(corners).all():
        return math.nan
    pixels = to_map_pixels(inputs.crs, raster)(corners)
    return float(((pixels >= 0.0) & (pixels <= (raster.width, raster.height))).all(axis=-1).mean())


def _mean(values: Floats | Bools | None) -> float:
    return math.nan if values is None or not len(values) else float(np.mean(values))


def _figures(facts: GpsFacts | PriorFacts | None, *names: str) -> dict[str, float | None] | None:
    return None if facts is None else {name: _json(getattr(facts, name)) for name in names}


def _json(value: float) -> float | None:
    return value if math.isfinite(value) else None
