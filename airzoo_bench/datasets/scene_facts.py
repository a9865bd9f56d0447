"""What `prepare` holds, compared: poses with GPS, priors, maps, crops and tiles."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from airzoo_bench.benchmark.queries import PRIOR_COLUMNS, cameras_of, poses_of
from airzoo_bench.benchmark.scene_inputs import SceneInputs
from airzoo_bench.datasets.dji import PhotoPrior
from airzoo_bench.datasets.map_shift import MapShift, map_shift
from airzoo_bench.datasets.prior_errors import Turned, prior_errors, turned_priors
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.geometry.blocks import HeightSurvey, blocked_heights
from airzoo_bench.geometry.cameras import anchor_pixels, back_project
from airzoo_bench.geometry.frames import from_lonlat
from airzoo_bench.geometry.grids import world_to_pixel
from airzoo_bench.geometry.missing_heights import nearest_heights
from airzoo_bench.geometry.planes import change_of_plane
from airzoo_bench.geometry.poses import rays_to_world
from airzoo_bench.geometry.rasters import gsd_m, open_info
from airzoo_bench.geometry.rays import intersect_plane
from airzoo_bench.matching.truth import MatchingTruth
from airzoo_bench.retrieval.truth import RetrievalTruth

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "Cameras3D",
    "GpsFacts",
    "PriorFacts",
    "SceneFacts",
    "camera_facts",
    "footprints_of",
    "scene_facts",
]

_NEAREST_OF_PX = 1_000_000
_FAR_M = 1e6


@dataclass(frozen=True, eq=False)
class Cameras3D:
    """Cameras over the surface model.

    Attributes
    ----------
    heights_m : (N,) array
        Of each camera above the surface below it, or the nearest height there is; NaN where there
        is none.
    surface_m : (N,) array
        The height of that surface.
    relative_m : (N,) array
        Above the place of take-off by the photo's own word; NaN where it has none.
    """

    heights_m: Floats
    surface_m: Floats
    relative_m: Floats

    @property
    def height_m(self) -> float:
        """Median height above the surface."""
        return _median(self.heights_m)

    @property
    def relative_height_m(self) -> float:
        """Median height above take-off; NaN where no photo has one."""
        return _median(self.relative_m)

    @property
    def below(self) -> int:
        """Cameras on the surface or below."""
        return int((self.heights_m <= 0.0).sum())


@dataclass(frozen=True)
class GpsFacts:
    """Poses against the photos' own GPS.

    Attributes
    ----------
    photos, with_angles : int
        Photos that have a position; and those that have altitude and gimbal angles with it.
    distance_m, height_m : float
        Median horizontal distance, and median of pose less GPS in height (NaN without altitudes).
    offset_m : tuple of float
        Median of pose less GPS, east and north.
    """

    photos: int
    with_angles: int
    distance_m: float
    height_m: float
    offset_m: tuple[float, float]


@dataclass(frozen=True)
class PriorFacts:
    """Median errors of the priors, and the mistakes that explain large ones."""

    photos: int
    position_m: float
    yaw_deg: float
    pitch_deg: float
    rotation_deg: float
    turned: tuple[tuple[str, tuple[str, ...]], ...]


@dataclass(frozen=True, eq=False)
class SceneFacts:
    """What a scene's parts say of each other; None for parts that are not there.

    Attributes
    ----------
    inputs : SceneInputs
    survey : HeightSurvey
        Of the surface model.
    cameras : Cameras3D
    gps : GpsFacts or None
    priors : PriorFacts or None
    photo_gsd_m, footprint_m : float
        Medians over photos: ground width of a pixel, and of the photo's longer side.
    on_map : float
        Share of the photos' corners, on the plane, that lie on the map.
    map_gsd_m : tuple of float
        Of the map, between columns and rows.
    crop_shares : (Q,) array or None
        Share of the map that each query's crop takes.
    positive_shares : (Q,) array or None
        Share of the gallery that answers each query.
    cloud_over_surface_m : float or None
        Median height of the true cloud above the surface model; NaN where they do not meet.
    shift : MapShift or None
        Of the map against the surface model, where one can be shown.
    dropped_tiles : int
        Tiles that are not in the gallery since they hold too little of the map.
    """

    inputs: SceneInputs
    survey: HeightSurvey
    cameras: Cameras3D
    gps: GpsFacts | None
    priors: PriorFacts | None
    photo_gsd_m: float
    footprint_m: float
    on_map: float
    map_gsd_m: tuple[float, float]
    crop_shares: Floats | None
    positive_shares: Floats | None
    cloud_over_surface_m: float | None
    shift: MapShift | None
    dropped_tiles: int

    def values(self) -> dict[str, Any]:
        """Return the figures as JSON values."""
        cameras, gps, priors = self.cameras, self.gps, self.priors
        return {
            "photos": len(self.inputs.photos),
            "height_over_surface_m": _json(cameras.height_m),
            "height_over_take_off_m": _json(cameras.relative_height_m),
            "cameras_below_surface": cameras.below,
            "photo_gsd_m": _json(self.photo_gsd_m),
            "gps": None
            if gps is None
            else {
                "photos": gps.photos,
                "with_gimbal_angles": gps.with_angles,
                "distance_m": _json(gps.distance_m),
                "height_m": _json(gps.height_m),
            },
            "priors": None
            if priors is None
            else {
                "photos": priors.photos,
                "position_m": _json(priors.position_m),
                "yaw_deg": _json(priors.yaw_deg),
                "pitch_deg": _json(priors.pitch_deg),
                "rotation_deg": _json(priors.rotation_deg),
            },
            "map_px": [self.inputs.dom.width, self.inputs.dom.height],
            "map_gsd_m": list(self.map_gsd_m),
            "corners_on_map": _json(self.on_map),
            "surface_valid_share": self.survey.valid_share,
            "surface_m": [self.survey.low, self.inputs.plane_height_m, self.survey.high],
            "cloud_over_surface_m": _json(math.nan)
            if self.cloud_over_surface_m is None
            else _json(self.cloud_over_surface_m),
            "dropped_tiles": self.dropped_tiles,
            "map_shift_px": None if self.shift is None else list(self.shift.pixels),
            "crop_share": _json(_mean(self.crop_shares)),
            "chance_of_positive": _json(_mean(self.positive_shares)),
        }


def camera_facts(photos: pd.DataFrame, dsm: Path, metadata: Mapping[str, PhotoPrior]) -> Cameras3D:
    """Measure how high cameras are above the surface model.

    Parameters
    ----------
    photos : DataFrame
        As `scene_inputs.photo_table` makes it.
    dsm : Path
    metadata : mapping of str to PhotoPrior
        By file name; photos without an entry have none.
    """
    centres = poses_of(photos).centres
    with blocked_heights(dsm) as field:
        found = field.sample(centres[:, :2])
        gap = np.isnan(found)
        if gap.any():
            found[gap] = nearest_heights(field, _NEAREST_OF_PX)(centres[gap, :2])
    relative = [_known(metadata.get(name), "relative_altitude_m") for name in photos["image"]]
    return Cameras3D(centres[:, 2] - found, found, np.array(relative, dtype=np.float64))


def scene_facts(
    inputs: SceneInputs,
    metadata: Mapping[str, PhotoPrior],
    retrieval: RetrievalTruth | None,
    matching: MatchingTruth | None,
    *,
    survey: HeightSurvey,
    cameras: Cameras3D,
    cloud_over_surface_m: float | None,
) -> SceneFacts:
    """Compare the parts of a scene with each other.

    Parameters
    ----------
    inputs : SceneInputs
    metadata : mapping of str to PhotoPrior
        By file name; photos without an entry have none.
    retrieval, matching
        The truths, where there are.
    survey, cameras, cloud_over_surface_m
        What was measured before.
    """
    gsd, footprint, on_map = footprints_of(inputs)
    area = inputs.dom.width * inputs.dom.height
    shares = None if retrieval is None else retrieval.positives.counts / len(retrieval.tiles)
    return SceneFacts(
        inputs,
        survey,
        cameras,
        _gps_facts(inputs, metadata),
        _prior_facts(inputs.photos),
        gsd,
        footprint,
        on_map,
        gsd_m(inputs.dom),
        None if matching is None else matching.crops[:, 2] * matching.crops[:, 3] / area,
        shares,
        cloud_over_surface_m,
        map_shift(inputs.dom, open_info(inputs.dsm)),
        0 if retrieval is None else len(retrieval.dropped_tiles),
    )


def footprints_of(inputs: SceneInputs) -> tuple[float, float, float]:
    """Median pixel and longer side (m) of photos on the plane, and share of corners on the map."""
    cameras, poses = cameras_of(inputs.photos), poses_of(inputs.photos)
    above = poses.centres[:, 2] - inputs.plane_height_m
    gsd = above / cameras.focal.mean(axis=1)
    rays = rays_to_world(poses, back_project(cameras, anchor_pixels(cameras, 0.0)))
    hits = intersect_plane(poses.centres, rays, inputs.plane_height_m, _FAR_M)
    to_map = change_of_plane(inputs.crs, inputs.dom.crs)
    pixels = world_to_pixel(inputs.dom.transform, to_map(hits.points[..., :2]))
    size = (inputs.dom.width, inputs.dom.height)
    inside = ((pixels >= 0.0) & (pixels <= size)).all(axis=-1)
    longer = np.maximum(cameras.width, cameras.height)
    return _median(gsd), _median(gsd * longer), float(inside.mean())


def _gps_facts(inputs: SceneInputs, metadata: Mapping[str, PhotoPrior]) -> GpsFacts | None:
    rows = [metadata.get(name) for name in inputs.photos["image"]]
    placed = np.array([_known(row, "lon") is not None for row in rows], dtype=bool)
    if not placed.any():
        return None
    lonlat = np.array([[_known(row, "lon"), _known(row, "lat")] for row in rows], np.float64)
    apart = poses_of(inputs.photos).centres.copy()
    apart[:, :2] -= from_lonlat(inputs.crs, lonlat)
    apart[:, 2] -= np.array([_known(row, "altitude_m") for row in rows], np.float64)
    east, north = (_median(apart[placed, axis]) for axis in (0, 1))
    return GpsFacts(
        int(placed.sum()),
        int((placed & _with_prior(inputs.photos)).sum()),
        _median(np.hypot(apart[placed, 0], apart[placed, 1])),
        _median(apart[placed, 2]),
        (east, north),
    )


def _prior_facts(photos: pd.DataFrame) -> PriorFacts | None:
    there = photos[_with_prior(photos)]
    if there.empty:
        return None
    priors, poses = poses_of(there, PRIOR_COLUMNS), poses_of(there)
    errors = prior_errors(priors, poses)
    return PriorFacts(
        len(there),
        _median(errors.position_m),
        _median(errors.yaw_deg),
        _median(errors.pitch_deg),
        _median(errors.rotation_deg),
        tuple((one.what, _ids(there, one)) for one in turned_priors(priors, poses)),
    )


def _with_prior(photos: pd.DataFrame) -> Bools:
    if not set(PRIOR_COLUMNS) <= set(photos.columns):
        return np.zeros(len(photos), dtype=bool)
    whole: Bools = np.isfinite(photos[list(PRIOR_COLUMNS)].to_numpy(np.float64)).all(axis=1)
    return whole


def _ids(photos: pd.DataFrame, turned: Turned) -> tuple[str, ...]:
    return tuple(photos["id"][turned.rows])


def _known(prior: PhotoPrior | None, name: str) -> float | None:
    return None if prior is None else getattr(prior, name)


def _median(values: Floats) -> float:
    there = values[np.isfinite(values)]
    return float(np.median(there)) if there.size else math.nan


def _mean(values: Floats | None) -> float:
    return math.nan if values is None or not len(values) else float(np.mean(values))


def _json(value: float) -> float | None:
    return value if math.isfinite(value) else None
