"""Figures of a scene's parts against each other, and the lines that `prepare` prints of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import pandas as pd
from scipy.spatial import cKDTree

from airzoo_bench.benchmark.queries import PRIOR_COLUMNS, SceneInputs, cameras_of, poses_of
from airzoo_bench.core.errors import counted
from airzoo_bench.datasets.metadata import PhotoPrior
from airzoo_bench.datasets.scenes import NativeScene
from airzoo_bench.datasets.truths import SceneTruths
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
from airzoo_bench.geometry.rays import NearestHeights, intersect_plane
from airzoo_bench.retrieval.truth import RetrievalTruth

_FAR_M = 1e6
_NEAREST_OF_PX = 1_000_000
_GRID = 65


class GpsFacts(NamedTuple):
    """Medians of poses less the photos' own GPS in metres, NaN where not known."""

    photos: int
    distance_m: float
    east_m: float
    north_m: float
    up_m: float


class PriorFacts(NamedTuple):
    """Medians of the priors' errors, of all (N,) in rotation, and from transposed poses."""

    ids: tuple[str, ...]
    position_m: float
    angles_deg: Floats
    transposed_deg: float

    @property
    def rotation_deg(self) -> float:
        """Median rotation error."""
        return _median(self.angles_deg)


@dataclass(frozen=True, eq=False)
class SceneFacts:
    """Figures of a scene; None for parts that are missing, shares NaN.

    `heights_m` (N,) are of cameras above the surface model or the plane below;
    `relative_m` above take-off, as photos state it. `without_prior` are ids.
    `photo_gsd_m` and `footprint_m` are medians of the ground width of a pixel and of the longer
    side; `on_map` and `on_surface` shares of the photos' corners within the rectangle;
    `shared_ground` is the share of map or surface model, whichever is greater, that lies over the
    other. `crop_share` and `positive_share` are means of the queries' shares of map and gallery;
    `nearest_missed` is the share of queries that the tile nearest to their centre does not answer,
    `unanswered` the share of photos that retrieval leaves out.
    """

    inputs: SceneInputs
    survey: HeightSurvey | None
    heights_m: Floats
    relative_m: Floats
    is_metadata: bool
    has_metadata: bool
    gps: GpsFacts | None
    priors: PriorFacts | None
    without_prior: tuple[str, ...]
    photo_gsd_m: float
    footprint_m: float
    on_map: float
    on_surface: float
    shared_ground: float
    crop_share: float
    positive_share: float
    nearest_missed: float
    unanswered: float
    cloud_over_surface_m: float | None


def measure_heights(inputs: SceneInputs) -> tuple[Floats, Floats]:
    """Return cameras' heights (N,) above the surface model or else the plane z0, and that below."""
    centres = poses_of(inputs.photos).centres
    plane = math.nan if inputs.plane_height_m is None else inputs.plane_height_m
    surface: Floats = np.full(len(centres), plane)
    if inputs.dsm is not None:
        with blocked_heights(inputs.dsm) as field:
            surface = field.sample(centres[:, :2])
            gap = np.isnan(surface)
            if gap.any():
                surface[gap] = NearestHeights(field, _NEAREST_OF_PX)(centres[gap, :2])
    return centres[:, 2] - surface, surface


def measure_facts(
    native: NativeScene,
    inputs: SceneInputs,
    heights_m: Floats,
    survey: HeightSurvey | None,
    truths: SceneTruths,
    cloud_over_surface_m: float | None,
) -> SceneFacts:
    """Compare the parts of a scene; `heights_m` come from `measure_heights`."""
    photos, dom, retrieval, matching = inputs.photos, inputs.dom, truths.retrieval, truths.matching
    dsm = None if inputs.dsm is None else open_info(inputs.dsm)
    every = [native.metadata.get(name, PhotoPrior()) for name in photos["image"]]
    stated = [PhotoPrior()] * len(every) if native.is_metadata else every
    gsd, footprint, corners = _footprints(inputs)
    shared = crop = positive = unanswered = math.nan
    if dom is not None and dsm is not None:
        shared = max(_share_over(dom, dsm), _share_over(dsm, dom))
    if dom is not None and matching is not None:
        crop = float(matching.crops[:, 2:].prod(axis=1).mean()) / (dom.width * dom.height)
    if retrieval is not None:
        positive = float(retrieval.positives.counts.mean()) / len(retrieval.tiles)
        unanswered = 1.0 - len(retrieval.queries) / len(photos)
    return SceneFacts(
        inputs,
        survey,
        heights_m,
        relative_m=np.array([one.relative_altitude_m for one in every], dtype=np.float64),
        is_metadata=native.is_metadata,
        has_metadata=any((one.lon, one.yaw_deg) != (None, None) for one in stated),
        gps=_compare_gps(inputs, stated),
        priors=_compare_priors(photos),
        without_prior=tuple(
            photos["id"][~_with_prior(photos) & [not one.is_complete for one in stated]]
        ),
        photo_gsd_m=gsd,
        footprint_m=footprint,
        on_map=_share_inside(corners, inputs, dom),
        on_surface=_share_inside(corners, inputs, dsm),
        shared_ground=shared,
        crop_share=crop,
        positive_share=positive,
        nearest_missed=_nearest_missed(retrieval),
        unanswered=unanswered,
        cloud_over_surface_m=cloud_over_surface_m,
    )


def _compare_gps(inputs: SceneInputs, stated: Sequence[PhotoPrior]) -> GpsFacts | None:
    rows = [(one.lon, one.lat, one.altitude_m) for one in stated]
    values = np.array(rows, np.float64).reshape(-1, 3)
    placed = np.isfinite(values[:, 0])
    if inputs.crs in (None, LOCAL_CRS) or not placed.any():
        return None
    centres, lonlat = poses_of(inputs.photos).centres, values[:, :2]
    apart = centres - np.column_stack((from_lonlat(inputs.crs, lonlat), values[:, 2]))
    # A position beyond the projection is far, not unknown.
    metres = np.hypot(apart[:, 0], apart[:, 1])
    true_lonlat = to_lonlat(inputs.crs, centres[:, :2])
    metres = np.where(np.isnan(metres), geodesic_distance_m(lonlat, true_lonlat), metres)
    medians = (_median(column[placed]) for column in (metres, *apart.T))
    return GpsFacts(int(placed.sum()), *medians)


def _compare_priors(photos: pd.DataFrame) -> PriorFacts | None:
    there = photos[_with_prior(photos)]
    if there.empty:
        return None
    priors, poses = poses_of(there, PRIOR_COLUMNS), poses_of(there)
    away = np.linalg.norm(priors.centres - poses.centres, axis=1)
    turned = rotation_angle_deg(priors.rotation, poses.rotation)
    opposite = rotation_angle_deg(priors.rotation, poses.rotation.swapaxes(1, 2))
    return PriorFacts(tuple(there["id"]), _median(away), turned, _median(opposite))


def _with_prior(photos: pd.DataFrame) -> Bools:
    if not set(PRIOR_COLUMNS) <= set(photos.columns):
        return np.zeros(len(photos), dtype=bool)
    whole: Bools = np.isfinite(photos[list(PRIOR_COLUMNS)].to_numpy(np.float64)).all(axis=1)
    return whole


def _nearest_missed(truth: RetrievalTruth | None) -> float:
    if truth is None or truth.has_images:
        return math.nan
    centres, queries = truth.tile_centres, truth.footprint_centres
    rows = np.flatnonzero(np.isfinite(queries).all(axis=1))
    scale = (np.cos(np.radians(centres[:, 1].mean())), 1.0)
    nearest = cKDTree(centres * scale).query(queries[rows] * scale)[1]
    missed = ~truth.positives.holds(rows, nearest, len(centres))
    return float(missed.mean()) if len(missed) else math.nan


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


def _median(values: Floats) -> float:
    """Median of the finite values; NaN where there are none."""
    there = values[np.isfinite(values)]
    return float(np.median(there)) if there.size else math.nan


def fact_lines(facts: SceneFacts) -> list[str]:
    """Return a line for each part of the scene: photos, lens, poses, priors, map and so on."""
    dom = facts.inputs.dom
    rows = {"photos": _photos_line(facts), "lens": _lens_line(facts)}
    rows["poses"] = _poses_line(facts)
    if (one := facts.priors) is not None:
        off = f"off by {one.position_m:.1f} m and {one.rotation_deg:.1f} degrees (medians)"
        rows["priors"] = f"{len(one.ids)}, {off}"
    if dom is not None:
        gsd = " x ".join(dict.fromkeys(f"{side:.3g}" for side in gsd_m(dom)))
        rows["map"] = f"{dom.width} x {dom.height} px, {gsd} m per pixel"
        if math.isfinite(facts.on_map):
            rows["map"] += f"; {facts.on_map:.0%} of the photos' corners lie on it"
    if (plane := facts.inputs.plane_height_m) is not None:
        rows["surface"] = f"none; the ground is taken as a plane at {plane} m"
        if (survey := facts.survey) is not None:
            heights = f"a height, {survey.low:.1f} to {survey.high:.1f} m; z0 is {plane:.1f} m"
            rows["surface"] = f"{survey.valid / survey.pixels:.0%} of its pixels have {heights}"
    if (above := facts.cloud_over_surface_m) is not None and math.isfinite(above):
        rows["cloud"] = f"{round(above, 2) + 0.0:.2f} m above the surface"
    if math.isfinite(facts.crop_share):
        rows["crops"] = f"{facts.crop_share:.0%} of the map each on average"
    if math.isfinite(facts.positive_share):
        rows["chance"] = f"a random tile is a right answer in {facts.positive_share:.1%} of cases"
    return [f"{name:15} {text}" for name, text in rows.items()]


def _photos_line(facts: SceneFacts) -> str:
    ground = "the ground" if facts.survey is None else "the surface"
    medians = {
        f"{{:.1f}} m above {ground}": _median(facts.heights_m),
        "{:.1f} m above take-off by their metadata": _median(facts.relative_m),
        "{:.3g} m per pixel": facts.photo_gsd_m,
    }
    known = [text.format(value) for text, value in medians.items() if math.isfinite(value)]
    return ", ".join([f"{len(facts.inputs.photos)}", *known]) + " (medians)" * bool(known)


def _lens_line(facts: SceneFacts) -> str:
    cameras = cameras_of(facts.inputs.photos)
    values = np.median(cameras.distortion, axis=0).tolist()
    pairs = zip(("k1", "k2", "p1", "p2", "k3"), values, strict=True)
    named = ", ".join(f"{name} {value:.4f}" for name, value in pairs if value)
    distortion = f"distortion {named}" if named else "no distortion"
    return f"fx {np.median(cameras.focal[:, 0]):.0f} px, {distortion}"


def _poses_line(facts: SceneFacts) -> str:
    gps = facts.gps
    if facts.inputs.crs == LOCAL_CRS:
        return "in a local frame, without a place on the earth"
    if facts.is_metadata:
        return "the photos' own positions and angles"
    if gps is None:
        return "not compared: the photos' metadata have no GPS position"
    up = f", {gps.up_m:+.1f} m in height" if math.isfinite(gps.up_m) else ""
    return f"{gps.distance_m:.1f} m from the GPS of {counted(gps.photos, 'photo')}{up} (medians)"
