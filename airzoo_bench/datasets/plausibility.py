"""What `prepare` and `check-geometry` warn of: the kinds, and those of map, surface and cloud."""

from __future__ import annotations

import math
from collections.abc import Iterator
from enum import Enum

from airzoo_bench.datasets.mistakes import datum_cause, height_cause
from airzoo_bench.datasets.photo_facts import OUTLIER_M
from airzoo_bench.datasets.raster_checks import (
    FAR_BELOW_M,
    LOWEST_SHARE,
    lowest_heights,
    often_lowest,
)
from airzoo_bench.datasets.scene_facts import SceneFacts
from airzoo_bench.geometry.blocks import HeightSurvey
from airzoo_bench.geometry.crs import LOCAL_CRS
from airzoo_bench.geometry.datums import datum_change, same_datum

__all__ = ["Found", "Kind", "height_warnings", "map_warnings"]

FAR_M = 10.0
"""Receivers without correction are good to 5 m in plan; altitudes to 10 m."""
FAR_SHARE = 0.1
"""Of the height above take-off: ground is not level."""
LARGE_ROTATION_DEG = 20.0
MAP_DATUM_M = 1.0
GPS_DATUM_M = 5.0
"""Receivers are no better themselves."""
LARGE_CROP = 0.5
LIKELY_CHANCE = 0.5
FEW_PIXELS = 32
FEW_ON = 0.5
LEAST_PLACES = 3
CLOUD_M = 5.0
"""A cloud also holds what lies below roofs and crowns."""
ONE_COLOUR = 0.2
LITTLE_SHOWN = 0.1
DAYS_APART = 30
NOT_SQUARE = 0.05


class Kind(Enum):
    """A kind of warning; its value is the line of docs/benchmark-folder.md about it."""

    NOT_SQUARE = f"camera matrices whose fx and fy differ by more than {NOT_SQUARE:.0%}"
    COPIES = "photos that are the same file under several names"
    SAME_POSE = "photos that share their pose, to the last digit, with another photo"
    CAMERAS = (
        "photos of several cameras (by model, serial number and focal length in EXIF, or by size) "
        "that share one camera matrix"
    )
    DAYS = f"photos taken more than {DAYS_APART} days apart"
    NO_PRIOR = "photos without a prior, where other photos have one or a part of one"
    FLOAT32 = "positions of poses that have gone through float32"
    PLACES = f"photos from fewer than {LEAST_PLACES} places, where there is a cloud to reconstruct"
    NO_HEIGHT = "cameras near which the surface model has no height"
    BELOW = "some cameras below the surface model"
    HEIGHT = (
        f"cameras above the surface model by {FAR_M:g} m (and {FAR_SHARE:.0%}) more or less than "
        "their photos say that they are above take-off"
    )
    GPS_PLAN = f"poses more than {FAR_M:g} m from their photos' GPS in plan (median)"
    GPS_HEIGHT = f"poses more than {FAR_M:g} m from their photos' GPS in height (median)"
    GPS_APART = (
        f"single photos whose pose is more than {OUTLIER_M:g} m from their GPS, and ten times as "
        "far as the others'"
    )
    TURNED = (
        "priors turned by more than 45 degrees that one mistake explains: yaw off by 180 or 90 "
        "degrees or with the wrong sign, pitch with the wrong sign or counted from nadir, roll off "
        "by 180 degrees, or all three in radians"
    )
    ROTATION = f"priors turned by more than {LARGE_ROTATION_DEG:g} degrees (median), unexplained"
    DATUM = (
        "a map in another datum than the poses, or poses in another than GPS, that PROJ cannot "
        f"convert to {MAP_DATUM_M:g} m and {GPS_DATUM_M:g} m"
    )
    FLAT = "a surface model all of whose heights are the same"
    PLANE = "a ground plane that is lower or higher than the whole surface model"
    LOWEST = (
        f"a lowest height that more than {LOWEST_SHARE:.0%} of the surface model has, or that is 0 "
        f"or repeated and {FAR_BELOW_M:g} m below all others: perhaps an untagged nodata value"
    )
    CLOUD = f"a true cloud more than {CLOUD_M:g} m off the surface model in height (median)"
    NO_CLOUD = "a true cloud without a point over a height of the surface model"
    LITTLE_SHOWN = f"a map of which less than {LITTLE_SHOWN:.0%} is not masked"
    ONE_COLOUR = f"a map of which more than {ONE_COLOUR:.0%} is exactly one colour"
    SHIFT = (
        "a map that lies beside the surface model, shown by grids of the same size and pixels with "
        "different corners, or by where both are empty"
    )
    FLIPPED = (
        "a map that is upside down or mirrored against the surface model, by where both are empty"
    )
    OFF_MAP = f"less than {FEW_ON:.0%} of the photos' corners on the map"
    OFF_SURFACE = f"less than {FEW_ON:.0%} of the photos' corners on the surface model"
    LITTLE_SURFACE = f"a surface model below less than {FEW_ON:.0%} of the map"
    COARSE = f"photos that see fewer than {FEW_PIXELS} pixels of the map"
    CROPS = f"crops that take more than {LARGE_CROP:.0%} of the map on average"
    EVERY_TILE = "every tile answers every photo"
    CHANCE = f"a random tile answers in more than {LIKELY_CHANCE:.0%} of cases"


Found = Iterator[tuple[Kind, str]]
"""Warnings: their kind, and a sentence with the figures."""


def height_warnings(facts: SceneFacts) -> Found:
    """Yield warnings about a scene's surface model, and about its cloud over it."""
    if facts.survey is not None:
        yield from _of_surface(facts.survey)
        yield from _of_plane(facts.survey, facts.inputs.plane_height_m)
    yield from _of_cloud(facts)
    yield from _of_datums(facts)


def map_warnings(facts: SceneFacts) -> Found:
    """Yield warnings about a scene's map, and about the crops and tiles that are cut from it."""
    for part in (_of_picture, _of_map, _of_surface_bounds, _of_crops, _of_positives):
        yield from part(facts)


def _of_surface(survey: HeightSurvey) -> Found:
    if survey.low == survey.high:
        yield (
            Kind.FLAT,
            f"the surface model is flat: every height is exactly {survey.low:.10g} m; look "
            "whether it holds heights at all",
        )
    if often_lowest(survey):
        yield (
            Kind.LOWEST,
            f"{lowest_heights(survey)} of the surface model's heights are exactly "
            f"{survey.low:.10g} m, its lowest, and the next is {survey.next_low:.10g} m: unless "
            "that is water, tag it as missing (gdal_edit.py -a_nodata)",
        )


def _of_plane(survey: HeightSurvey, plane: float | None) -> Found:
    if plane is not None and not survey.low <= plane <= survey.high:
        yield (
            Kind.PLANE,
            f"the ground plane is at {plane:.1f} m, and the surface model is {survey.low:.1f} to "
            f"{survey.high:.1f} m high: footprints on the plane are not those on the ground; look "
            "at --plane-height and its vertical datum",
        )


def _of_cloud(facts: SceneFacts) -> Found:
    above_m = facts.cloud_over_surface_m
    if facts.survey is None or above_m is None:
        return
    if math.isnan(above_m):
        yield Kind.NO_CLOUD, "the true cloud has no point over a height of the surface model"
    elif abs(above_m) > CLOUD_M:
        yield (
            Kind.CLOUD,
            f"the true cloud is {above_m:+.1f} m from the surface model in height (median): they "
            "may have different vertical datums (ellipsoid and geoid) or units; "
            + height_cause(above_m, facts.lonlat, "the cloud", "the surface model"),
        )


def _of_datums(facts: SceneFacts) -> Found:
    crs, dom = facts.inputs.crs, facts.inputs.dom
    if crs is None or crs == LOCAL_CRS:
        return
    own = datum_change(crs, facts.lonlat)
    if dom is not None and not same_datum(crs, dom.crs):
        for change in (own, datum_change(dom.crs, facts.lonlat)):
            if change.worse_than(MAP_DATUM_M):
                yield Kind.DATUM, f"map and poses have different datums, and {datum_cause(change)}"
    elif facts.gps is not None and own.worse_than(GPS_DATUM_M):
        yield Kind.DATUM, f"poses and GPS have different datums, and {datum_cause(own)}"


def _of_map(facts: SceneFacts) -> Found:
    if facts.shift is not None and facts.shift.flipped:
        yield (
            Kind.FLIPPED,
            f"the map is {facts.shift.flipped} against the surface model, by {facts.shift.by}: "
            "look at the georeference of both",
        )
    elif facts.shift is not None:
        across, down = (round(value, 1) + 0.0 for value in facts.shift.pixels)
        yield (
            Kind.SHIFT,
            f"the map lies {facts.shift.metres:.2f} m beside the surface model, by "
            f"{facts.shift.by}: moved by {across:+.1f} columns and {down:+.1f} rows of its pixels "
            "it would fit; look at the georeference of both",
        )
    if facts.on_map < FEW_ON:
        yield (
            Kind.OFF_MAP,
            f"only {facts.on_map:.0%} of the photos' corners lie on the map: look at the CRS of "
            "map and poses, or cut the photos to those over the map",
        )
    seen = math.nan if facts.map_gsd_m is None else facts.footprint_m / max(facts.map_gsd_m)
    if seen < FEW_PIXELS:
        yield (
            Kind.COARSE,
            f"a photo sees {seen:.0f} pixels of the map: the map is too coarse to match",
        )


def _of_crops(facts: SceneFacts) -> Found:
    if facts.crop_shares is None or not len(facts.crop_shares):
        return
    share, whole = float(facts.crop_shares.mean()), int((facts.crop_shares >= 1.0).sum())
    if share > LARGE_CROP:
        all_of_it = f", {whole} of {len(facts.crop_shares)} all of it" if whole else ""
        yield (
            Kind.CROPS,
            f"crops take more than half of the map on average ({share:.1%}{all_of_it}): priors "
            "narrow the search by little; take a larger map, or look at their heights and angles",
        )


def _of_positives(facts: SceneFacts) -> Found:
    shares = facts.positive_shares
    if shares is None or not len(shares):
        return
    if (shares == 1.0).all():
        yield (
            Kind.EVERY_TILE,
            "every tile answers every photo: retrieval measures nothing; take smaller tiles",
        )
    elif shares.mean() > LIKELY_CHANCE:
        yield (
            Kind.CHANCE,
            f"a random tile answers a photo in {shares.mean():.0%} of cases: take smaller tiles, "
            "or a larger map",
        )


def _of_picture(facts: SceneFacts) -> Found:
    if facts.map is None:
        return
    shown, share = facts.map.shown, facts.map.one_colour
    if shown < LITTLE_SHOWN:
        yield Kind.LITTLE_SHOWN, f"only {shown:.1%} of the map shows anything: the rest is masked"
    if share > ONE_COLOUR:
        colour = " ".join(f"{value:g}" for value in facts.map.colour)
        yield (
            Kind.ONE_COLOUR,
            f"{share:.0%} of the map is exactly one colour ({colour}): unless that is what is "
            "there, mark it as missing, or tiles that show nothing stand in the gallery "
            f"(gdalwarp -srcnodata '{colour}' -dstalpha)",
        )


def _of_surface_bounds(facts: SceneFacts) -> Found:
    if facts.on_surface < FEW_ON:
        yield (
            Kind.OFF_SURFACE,
            f"only {facts.on_surface:.0%} of the photos' corners lie on the surface model: look at "
            "the CRS and the extent of it and of the poses",
        )
    if facts.map is not None and facts.map.over_surface < FEW_ON:
        yield (
            Kind.LITTLE_SURFACE,
            f"the surface model lies below only {facts.map.over_surface:.0%} of the map: look at "
            "the CRS and the extent of both",
        )
