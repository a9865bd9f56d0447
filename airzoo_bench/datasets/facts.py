"""Figures of a scene's parts against each other: poses, photos' metadata, priors, maps, tiles."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.spatial import cKDTree

from airzoo_bench.benchmark.queries import PRIOR_COLUMNS, SceneInputs, cameras_of, poses_of
from airzoo_bench.core.errors import counted
from airzoo_bench.datasets.metadata import PhotoPrior
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.geometry.cameras import anchor_pixels, back_project
from airzoo_bench.geometry.crs import LOCAL_CRS, from_lonlat, geodesic_distance_m, to_lonlat
from airzoo_bench.geometry.heightfield import HeightSurvey, blocked_heights
from airzoo_bench.geometry.poses import rays_to_world, rotation_angle_deg
from airzoo_bench.geometry.rasters import (
    RasterInfo,
    gsd_m,
    open_info,
    pixel_to_world,
    to_map_pixels,
)
from airzoo_bench.geometry.rays import intersect_plane, nearest_heights
from airzoo_bench.matching.truth import MatchingTruth
from airzoo_bench.retrieval.truth import RetrievalTruth

__all__ = ["Cameras3D", "SceneFacts", "fact_lines", "often_lowest", "scene_facts"]

_FAR_M = 1e6
_NEAREST_OF_PX = 1_000_000
_GRID = 65
_LOWEST_SHARE, _FAR_BELOW_M = 0.01, 10.0


@dataclass(frozen=True, eq=False)
class Cameras3D:
    """Cameras over the surface model.

    `heights_m` are above the surface below, or the nearest height there is (`surface_m`); NaN where
    there is none. `relative_m` is above the place of take-off, as photos state it.
    """

    heights_m: Floats
    surface_m: Floats
    relative_m: Floats

    @property
    def height_m(self) -> float:
        """Median height above the surface."""
        return _median(self.heights_m)

    @property
    def below(self) -> int:
        """Cameras on the surface or below."""
        return int((self.heights_m <= 0.0).sum())

    @classmethod
    def measure(cls, inputs: SceneInputs, metadata: Mapping[str, PhotoPrior]) -> Cameras3D:
        """Measure cameras above the surface model, or else above the plane z0."""
        stated = [metadata.get(name, PhotoPrior()) for name in inputs.photos["image"]]
        centres = poses_of(inputs.photos).centres
        plane = math.nan if inputs.plane_height_m is None else inputs.plane_height_m
        surface: Floats = np.full(len(centres), plane)
        if inputs.dsm is not None:
            with blocked_heights(inputs.dsm) as field:
                surface = field.sample(centres[:, :2])
                gap = np.isnan(surface)
                if gap.any():
                    surface[gap] = nearest_heights(field, _NEAREST_OF_PX)(centres[gap, :2])
        relative = np.array([one.relative_altitude_m for one in stated], dtype=np.float64)
        return cls(centres[:, 2] - surface, surface, relative)


class GpsFacts(NamedTuple):
    """Medians of poses less the photos' own GPS; `photos` is the number with a position.

    `offset_m` is to the east and north; `height_m` is NaN without altitudes.
    """

    photos: int
    distance_m: float
    height_m: float
    offset_m: tuple[float, float]


class PriorFacts(NamedTuple):
    """Medians of the priors' errors, and each prior's rotation error (N,)."""

    ids: tuple[str, ...]
    position_m: float
    yaw_deg: float
    pitch_deg: float
    rotation_deg: float
    angles_deg: Floats


@dataclass(frozen=True, eq=False)
class SceneFacts:
    """Figures of a scene; None for parts that are missing, shares NaN.

    `without_prior` are ids by what they lack. `photo_gsd_m` and `footprint_m` are medians of the
    ground width of a pixel and of the longer side; `on_map` and `on_surface` shares of the photos'
    corners within the rectangle; `shared_ground` is the share of map or surface model, whichever is
    greater, that lies over the other. `crop_shares` and `positive_shares` (Q,) are of the map and
    of the gallery; `nearest_missed` is the share of queries that the tile does not answer whose
    centre is nearest to the footprint's.
    """

    inputs: SceneInputs
    survey: HeightSurvey | None
    cameras: Cameras3D
    is_metadata: bool
    gps: GpsFacts | None
    priors: PriorFacts | None
    without_prior: Mapping[str, tuple[str, ...]]
    has_metadata: bool
    photo_gsd_m: float
    footprint_m: float
    on_map: float
    on_surface: float
    shared_ground: float
    map_gsd_m: tuple[float, float] | None
    crop_shares: Floats | None
    positive_shares: Floats | None
    cloud_over_surface_m: float | None
    dropped_tiles: int
    dropped: str
    nearest_missed: float


def scene_facts(
    inputs: SceneInputs,
    metadata: Mapping[str, PhotoPrior] | None,
    survey: HeightSurvey | None,
    cameras: Cameras3D,
    retrieval: RetrievalTruth | None,
    matching: MatchingTruth | None,
    cloud_over_surface_m: float | None,
    dropped: str = "",
) -> SceneFacts:
    """Compare the parts of a scene; `metadata` is None where poses are the metadata's."""
    photos, dom = inputs.photos, inputs.dom
    dsm = None if inputs.dsm is None else open_info(inputs.dsm)
    stated = [(metadata or {}).get(name, PhotoPrior()) for name in photos["image"]]
    gsd, footprint, corners = _footprints(inputs)
    shares = None if retrieval is None else retrieval.positives.counts / len(retrieval.tiles)
    crops = None
    if matching is not None and dom is not None:
        crops = matching.crops[:, 2] * matching.crops[:, 3] / (dom.width * dom.height)
    return SceneFacts(
        inputs=inputs,
        survey=survey,
        cameras=cameras,
        is_metadata=metadata is None,
        gps=_gps_facts(inputs, stated),
        priors=_prior_facts(photos),
        without_prior=_without_prior(photos, stated if metadata is not None else None),
        has_metadata=any((one.lon, one.yaw_deg) != (None, None) for one in stated),
        photo_gsd_m=gsd,
        footprint_m=footprint,
        on_map=_share_inside(corners, inputs, dom),
        on_surface=_share_inside(corners, inputs, dsm),
        shared_ground=math.nan
        if dom is None or dsm is None
        else max(_share_over(dom, dsm), _share_over(dsm, dom)),
        map_gsd_m=None if dom is None else gsd_m(dom),
        crop_shares=crops,
        positive_shares=shares,
        cloud_over_surface_m=cloud_over_surface_m,
        dropped_tiles=0 if retrieval is None else len(retrieval.dropped_tiles),
        dropped=dropped,
        nearest_missed=_nearest_missed(retrieval),
    )


def _gps_facts(inputs: SceneInputs, stated: Sequence[PhotoPrior]) -> GpsFacts | None:
    rows = [(one.lon, one.lat, one.altitude_m) for one in stated]
    values = np.array(rows, np.float64).reshape(-1, 3)
    placed = np.isfinite(values[:, 0])
    if inputs.crs in (None, LOCAL_CRS) or not placed.any():
        return None
    centres, lonlat = poses_of(inputs.photos).centres, values[:, :2]
    apart = centres - np.column_stack((from_lonlat(inputs.crs, lonlat), values[:, 2]))
    east, north, up = (_median(apart[placed, axis]) for axis in range(3))
    # A position beyond the projection is far, not unknown.
    metres = np.hypot(apart[:, 0], apart[:, 1])
    true_lonlat = to_lonlat(inputs.crs, centres[:, :2])
    metres = np.where(np.isnan(metres), geodesic_distance_m(lonlat, true_lonlat), metres)
    return GpsFacts(int(placed.sum()), _median(metres[placed]), up, (east, north))


def _prior_facts(photos: pd.DataFrame) -> PriorFacts | None:
    there = photos[_with_prior(photos)]
    if there.empty:
        return None
    priors, poses = poses_of(there, PRIOR_COLUMNS), poses_of(there)
    # Rows of a rotation are the camera's axes in the world: this takes the pose's to the prior's.
    between = np.einsum("nki,nkj->nij", priors.rotation, poses.rotation)
    sine, cosine = between[:, 1, 0] - between[:, 0, 1], between[:, 0, 0] + between[:, 1, 1]
    down = [np.degrees(np.arcsin(np.clip(p.rotation[:, 2, 2], -1, 1))) for p in (priors, poses)]
    angles = rotation_angle_deg(priors.rotation, poses.rotation)
    return PriorFacts(
        tuple(there["id"]),
        _median(np.sqrt(((priors.centres - poses.centres) ** 2).sum(axis=-1))),
        _median(np.abs(np.degrees(np.arctan2(sine, cosine)))),
        _median(np.abs(down[0] - down[1])),
        _median(angles),
        angles,
    )


def _with_prior(photos: pd.DataFrame) -> Bools:
    if not set(PRIOR_COLUMNS) <= set(photos.columns):
        return np.zeros(len(photos), dtype=bool)
    whole: Bools = np.isfinite(photos[list(PRIOR_COLUMNS)].to_numpy(np.float64)).all(axis=1)
    return whole


def _without_prior(
    photos: pd.DataFrame, stated: Sequence[PhotoPrior] | None
) -> dict[str, tuple[str, ...]]:
    """Return the photos that have no prior, by the first that each lacks."""
    lacking: dict[str, tuple[str, ...]] = {}
    has_prior = _with_prior(photos)
    for row, one in enumerate(stated or [PhotoPrior()] * len(photos)):
        if has_prior[row] or one.is_complete:
            continue
        what = "GPS position" if one.lon is None else "gimbal angles"
        if one.lon is not None and one.altitude_m is None:
            what = "altitude"
        what = what if stated is not None else "whole row in --priors"
        lacking[what] = (*lacking.get(what, ()), photos["id"].iloc[row])
    return lacking


def _nearest_missed(truth: RetrievalTruth | None) -> float:
    if truth is None or truth.of_images:
        return math.nan
    centres, queries = (truth.boxes[:, :2] + truth.boxes[:, 2:]) / 2, truth.footprint_centres
    rows = np.flatnonzero(np.isfinite(queries).all(axis=1))
    scale = (np.cos(np.radians(centres[:, 1].mean())), 1.0)
    nearest = cKDTree(centres * scale).query(queries[rows] * scale)[1]
    return _mean(~truth.positives.holds(rows, nearest, len(centres)))


def _footprints(inputs: SceneInputs) -> tuple[float, float, Floats]:
    """Return medians of pixel size and longer side (m) on the plane, and the corners (N, 4, 2)."""
    if inputs.plane_height_m is None:
        return math.nan, math.nan, np.full((len(inputs.photos), 4, 2), np.nan)
    cameras, poses = cameras_of(inputs.photos), poses_of(inputs.photos)
    gsd = (poses.centres[:, 2] - inputs.plane_height_m) / cameras.focal.mean(axis=1)
    rays = rays_to_world(poses, back_project(cameras, anchor_pixels(cameras, 0.0)))
    hits = intersect_plane(poses.centres, rays, inputs.plane_height_m, _FAR_M)
    longer = np.maximum(cameras.width, cameras.height)
    return _median(gsd), _median(gsd * longer), hits.points[..., :2]


def _share_inside(corners: Floats, inputs: SceneInputs, raster: RasterInfo | None) -> float:
    """Share of the photos' corners that lie within a raster; NaN where either is not known."""
    if raster is None or np.isnan(corners).all():
        return math.nan
    pixels = to_map_pixels(inputs.crs, raster)(corners)
    return float(((pixels >= 0.0) & (pixels <= (raster.width, raster.height))).all(axis=-1).mean())


def _share_over(above: RasterInfo, below: RasterInfo) -> float:
    """Share of a raster that lies within another's rectangle, sampled on a grid."""
    steps = np.linspace(0.0, 1.0, _GRID)
    grid = np.stack(np.meshgrid(steps * above.width, steps * above.height), axis=-1)
    pixels = to_map_pixels(above.crs, below)(pixel_to_world(above.transform, grid.reshape(-1, 2)))
    return float(((pixels >= 0) & (pixels <= (below.width, below.height))).all(axis=1).mean())


def often_lowest(survey: HeightSurvey) -> bool:
    """Whether the lowest height may mean that there is none."""
    repeated = survey.at_low > 1 or survey.low == 0.0
    alone = repeated and survey.next_low - survey.low > _FAR_BELOW_M
    return survey.low < survey.high and (alone or survey.at_low > _LOWEST_SHARE * survey.valid)


def _median(values: Floats) -> float:
    """Median of the finite values; NaN where there are none."""
    there = values[np.isfinite(values)]
    return float(np.median(there)) if there.size else math.nan


def _mean(values: Floats | Bools | None) -> float:
    return math.nan if values is None or not len(values) else float(np.mean(values))


def fact_lines(facts: SceneFacts) -> list[str]:
    """Return a line for each part of the scene: photos, poses, priors, map, surface, crops."""
    crops, cloud = facts.crop_shares, facts.cloud_over_surface_m
    rows = {"photos": _photos_line(facts), "poses": _poses_line(facts)}
    if facts.priors is not None:
        one = facts.priors
        rows["priors"] = (
            f"{len(one.ids)}, off by {one.position_m:.1f} m; yaw {one.yaw_deg:.1f}, pitch "
            f"{one.pitch_deg:.1f}, rotation {one.rotation_deg:.1f} degrees (medians)"
        )
    rows |= _map_lines(facts)
    if cloud is not None and math.isfinite(cloud):
        rows["cloud"] = f"{round(cloud, 2) + 0.0:.2f} m above the surface (median)"
    if crops is not None and len(crops):
        rows["crops"] = f"{crops.mean():.0%} of the map each on average, at most {crops.max():.0%}"
    if facts.positive_shares is not None and len(facts.positive_shares):
        chance = facts.positive_shares.mean()
        rows["chance"] = f"a random tile is a right answer in {chance:.1%} of cases"
        if facts.dropped_tiles:
            tiles = counted(facts.dropped_tiles, "tile")
            rows["chance"] += f"; {tiles} {facts.dropped} left out"
    return [f"{name:15} {text}" for name, text in rows.items()]


def _photos_line(facts: SceneFacts) -> str:
    cameras, relative = facts.cameras, _median(facts.cameras.relative_m)
    text = f"{len(facts.inputs.photos)}"
    if math.isfinite(cameras.height_m):
        ground = "the ground" if facts.survey is None else "the surface"
        text += f", {cameras.height_m:.1f} m above {ground}"
    if math.isfinite(relative):
        text += f" ({relative:.1f} m above take-off by their metadata)"
    if math.isfinite(facts.photo_gsd_m):
        text += f", {facts.photo_gsd_m:.3g} m per pixel"
    return text if "," not in text else f"{text} (medians)"


def _poses_line(facts: SceneFacts) -> str:
    gps, photos = facts.gps, len(facts.inputs.photos)
    if facts.inputs.crs == LOCAL_CRS:
        return "in a local frame, without a place on the earth"
    if facts.is_metadata:
        return "the photos' own positions and angles"
    if gps is None:
        return "no photo has a GPS position to hold them against"
    text = f"{gps.distance_m:.1f} m from the photos' GPS"
    text += f" ({gps.photos} of {photos} have it)" if gps.photos < photos else ""
    text += f", {gps.height_m:+.1f} m in height" if math.isfinite(gps.height_m) else ""
    return f"{text} (medians)"


def _map_lines(facts: SceneFacts) -> dict[str, str]:
    """Return the lines on map and surface model."""
    dom, survey, plane, rows = facts.inputs.dom, facts.survey, facts.inputs.plane_height_m, {}
    if dom is not None and facts.map_gsd_m is not None:
        across, down = facts.map_gsd_m
        square = math.isclose(across, down, rel_tol=0.01)
        gsd = f"{across:.3g}" if square else f"{across:.3g} x {down:.3g}"
        rows["map"] = f"{dom.width} x {dom.height} px, {gsd} m per pixel"
        if math.isfinite(facts.on_map):
            rows["map"] += f"; {facts.on_map:.0%} of the photos' corners lie on it"
    if survey is not None:
        within = plane is None or survey.low <= plane <= survey.high
        rows["surface"] = (
            f"{survey.valid_share:.0%} of its pixels have a height, {survey.low:.1f} to "
            f"{survey.high:.1f} m, {'median' if within else 'the plane at'} {plane:.1f} m"
        )
    elif plane is not None:
        rows["surface"] = f"none; the ground is taken as a plane at {plane:.1f} m"
    return rows
