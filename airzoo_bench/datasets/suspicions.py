"""What the facts of a scene make one suspect, a sentence each; and what cannot be at all."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from airzoo_bench.benchmark.queries import poses_of
from airzoo_bench.benchmark.scene_inputs import SceneInputs
from airzoo_bench.core.errors import BenchmarkError, RasterError, first_of
from airzoo_bench.core.plurals import agreeing, counted
from airzoo_bench.datasets.scene_facts import (
    Cameras3D,
    GpsFacts,
    PriorFacts,
    SceneFacts,
    footprints_of,
)
from airzoo_bench.geometry.blocks import HeightSurvey
from airzoo_bench.geometry.precision import COARSEST_M, rounding_errors, was_rounded_to
from airzoo_bench.geometry.rasters import gsd_m

__all__ = ["check_above_surface", "check_map_scale", "often_lowest", "suspicions"]

# Receivers without correction are good to 5 m in plan; altitudes to 10 m.
_FAR_M = 10.0
_FAR_SHARE = 0.1  # of the height above take-off: ground is not level
_LARGE_ROTATION_DEG = 20.0
_LARGE_CROP = 0.5
_LIKELY_CHANCE = 0.5
_FEW_PIXELS = 32
_LOWEST_SHARE = 0.01
_FOOT_M = 0.3048
_LEAST_PLACES = 3
_CLOUD_M = 5.0  # a cloud also holds what lies below roofs and crowns


def check_above_surface(cameras: Cameras3D, dsm: Path) -> None:
    """Refuse a scene all of whose cameras are on the surface model or below it.

    Raises
    ------
    BenchmarkError
        With the heights, and what they would be in feet.
    """
    known = np.isfinite(cameras.heights_m)
    if not known.any() or cameras.below < known.sum():
        return
    surface = float(np.median(cameras.surface_m[known]))
    centre = surface + cameras.height_m
    in_feet = centre - surface * _FOOT_M
    hint = "look at the vertical datum and unit of both"
    if in_feet > 0.0:
        hint += (
            f"; were the DSM in feet, the cameras would be {in_feet:.1f} m above it: name the unit "
            "with gdal_edit.py -units ft"
        )
    raise BenchmarkError(
        f"every camera is below the surface: they are at {centre:.1f} m, the "
        f"surface below them is at {surface:.1f} m (medians)",
        where=dsm,
        expected="cameras above the surface model, both in the same vertical unit and datum",
        mend=hint,
    )


def check_map_scale(inputs: SceneInputs) -> None:
    """Refuse a map of which a whole photo sees less than a pixel.

    Raises
    ------
    RasterError
        With both sizes.
    """
    pixel, (_, footprint, _) = max(gsd_m(inputs.dom)), footprints_of(inputs)
    if 0.0 < footprint < pixel:
        raise RasterError(
            f"a pixel is {pixel:,.1f} m wide on the ground, and a photo sees {footprint:,.1f} m",
            where=inputs.dom.path,
            expected="a map of about the photos' resolution",
            mend="look at the geotransform and the CRS of the map",
        )


def suspicions(facts: SceneFacts) -> list[str]:
    """Return what is suspect in a scene, a sentence each; none where nothing is."""
    found = [
        *_of_surface(facts),
        *_of_cloud(facts.cloud_over_surface_m),
        *_of_centres(facts),
        *_of_heights(facts.cameras, facts.gps),
    ]
    found += _of_gps(facts.gps, len(facts.inputs.photos)) if facts.gps else []
    found += _of_priors(facts.priors) if facts.priors else []
    return [*found, *_of_map(facts), *_of_crops(facts), *_of_positives(facts)]


def _of_surface(facts: SceneFacts) -> Iterator[str]:
    if often_lowest(facts.survey):
        share = facts.survey.at_low / facts.survey.valid
        yield (
            f"{share:.0%} of the surface model's heights are exactly {facts.survey.low:.10g} m, "
            "its lowest: unless that is water, tag it as missing (gdal_edit.py -a_nodata)"
        )


def often_lowest(survey: HeightSurvey) -> bool:
    """Whether the lowest height stands so often that it may stand for a missing one."""
    return survey.low < survey.high and survey.at_low > _LOWEST_SHARE * survey.valid


def _of_cloud(above_m: float | None) -> Iterator[str]:
    if above_m is not None and math.isnan(above_m):
        yield "the true cloud has no point over a height of the surface model"
    elif above_m is not None and abs(above_m) > _CLOUD_M:
        yield (
            f"the true cloud is {above_m:+.1f} m from the surface model in height (median): they "
            "may have different vertical datums (ellipsoid and geoid) or units"
        )


def _of_centres(facts: SceneFacts) -> Iterator[str]:
    centres = poses_of(facts.inputs.photos).centres
    # To a micrometre, since centres have gone through -R^T t.
    plan = np.round(centres[:, :2], 6)
    error = float(np.sqrt((rounding_errors(plan) ** 2).sum(axis=1).mean()))
    if was_rounded_to(plan, np.float32) and error > COARSEST_M:
        yield (
            f"positions of the poses have gone through float32: an error of {error:.2g} m is to be "
            "expected; write them as float64"
        )
    if facts.cloud_over_surface_m is None:
        return
    places = len(np.unique(np.round(centres, 2), axis=0))
    if places < _LEAST_PLACES:
        yield (
            f"the photos were taken from {places} place{'s' * (places != 1)}, and aligning a "
            f"reconstruction needs {_LEAST_PLACES}: predictions with cameras will be refused"
        )


def _of_heights(cameras: Cameras3D, gps: GpsFacts | None) -> Iterator[str]:
    nowhere = int(np.isnan(cameras.heights_m).sum())
    if nowhere:
        yield (
            f"the surface model has no height near {nowhere} of "
            f"{counted(len(cameras.heights_m), 'camera')}: look at its nodata value and its extent"
        )
    if cameras.below:
        yield (
            f"{cameras.below} of {counted(len(cameras.heights_m), 'camera')} "
            f"{agreeing(cameras.below, 'is', 'are')} below the surface model: "
            "look at its vertical datum and unit, and at heights that are none"
        )
    difference = np.array(cameras.heights_m - cameras.relative_m)
    difference = difference[np.isfinite(difference)]
    if not difference.size:
        return
    off = float(np.median(difference))
    if abs(off) > max(_FAR_M, _FAR_SHARE * cameras.relative_height_m):
        yield (
            f"cameras are {cameras.height_m:.1f} m above the surface model, their own photos say "
            f"{cameras.relative_height_m:.1f} m above take-off ({off:+.1f} m): "
            + _height_cause(cameras, off, gps)
        )


def _height_cause(cameras: Cameras3D, off: float, gps: GpsFacts | None) -> str:
    in_feet = cameras.heights_m + cameras.surface_m * (1.0 - _FOOT_M) - cameras.relative_m
    left = float(np.nanmedian(in_feet))
    if abs(left) < _FAR_SHARE * abs(off):
        return f"in feet, the surface model would fit to {abs(left):.1f} m; name its unit"
    if gps is not None and abs(gps.height_m - off) < 0.5 * abs(off):
        return "poses are off in height from GPS by as much; look at their vertical datum"
    return (
        "poses and surface model may have different vertical datums (ellipsoid and geoid), unless "
        "the ground lies so much from the place of take-off"
    )


def _of_gps(gps: GpsFacts, photos: int) -> Iterator[str]:
    if gps.distance_m > _FAR_M:
        east, north = gps.offset_m
        shifted = math.hypot(east, north) > gps.distance_m / 2
        cause = (
            f"all to one side ({east:+.1f} m east, {north:+.1f} m north); look at the CRS, the "
            "datum and any offset that the poses were reduced by"
            if shifted
            else "in different directions; look whether names and poses belong together"
        )
        yield f"poses are {gps.distance_m:.1f} m from their own photos' GPS (median), {cause}"
    if abs(gps.height_m) > _FAR_M:
        yield (
            f"poses are {gps.height_m:+.1f} m from their own photos' GPS in height (median): they "
            "may have different vertical datums (ellipsoid and geoid), and priors are so far off"
        )
    if gps.with_angles < gps.photos:
        bare = gps.photos - gps.with_angles
        yield (
            f"{bare} of {counted(photos, 'photo')} {agreeing(bare, 'has', 'have')} a GPS position "
            "but no altitude or gimbal angles, and so no prior: give these by --priors FILE "
            "(docs/benchmark-folder.md)"
        )


def _of_priors(priors: PriorFacts) -> Iterator[str]:
    for what, ids in priors.turned:
        yield (
            f"the priors' {what} in {first_of(ids, priors.photos)}: look at the gimbal angles in "
            "the metadata, and at the axes of the poses where it is all of them"
        )
    if not priors.turned and priors.rotation_deg > _LARGE_ROTATION_DEG:
        yield f"the priors' rotation is {priors.rotation_deg:.0f} degrees off (median)"


def _of_map(facts: SceneFacts) -> Iterator[str]:
    if facts.shift is not None:
        across, down = (round(value, 1) + 0.0 for value in facts.shift.pixels)
        yield (
            f"the map lies {facts.shift.metres:.2f} m beside the surface model, by "
            f"{facts.shift.by}: moved by {across:+.1f} columns and {down:+.1f} rows of its pixels "
            "it would fit; look at the georeference of both"
        )
    if facts.on_map < 0.5:
        yield (
            f"only {facts.on_map:.0%} of the photos' corners lie on the map: look at the CRS of "
            "map and poses, or cut the photos to those over the map"
        )
    seen = facts.footprint_m / max(facts.map_gsd_m)
    if seen < _FEW_PIXELS:
        yield f"a photo sees {seen:.0f} pixels of the map: the map is too coarse to match"


def _of_crops(facts: SceneFacts) -> Iterator[str]:
    if facts.crop_shares is None or not len(facts.crop_shares):
        return
    share, whole = float(facts.crop_shares.mean()), int((facts.crop_shares >= 1.0).sum())
    if share > _LARGE_CROP:
        all_of_it = f", {whole} of {len(facts.crop_shares)} all of it" if whole else ""
        yield (
            f"crops take more than half of the map on average ({share:.1%}{all_of_it}): priors "
            "narrow the search by little; take a larger map, or look at their heights and angles"
        )


def _of_positives(facts: SceneFacts) -> Iterator[str]:
    shares = facts.positive_shares
    if shares is None or not len(shares):
        return
    if (shares == 1.0).all():
        yield "every tile answers every photo: retrieval measures nothing; take smaller tiles"
    elif shares.mean() > _LIKELY_CHANCE:
        yield (
            f"a random tile answers a photo in {shares.mean():.0%} of cases: take smaller tiles, "
            "or a larger map"
        )
