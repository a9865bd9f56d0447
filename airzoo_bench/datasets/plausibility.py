"""What `prepare` and `check-geometry` warn of: mistakes that the data show and nobody sees."""

from __future__ import annotations

import math
from collections.abc import Iterator
from enum import Enum

import numpy as np

from airzoo_bench.benchmark.queries import poses_of
from airzoo_bench.core.errors import agreeing, counted, first_of
from airzoo_bench.datasets.priors import TURNED_DEG, PriorFacts, WithoutPrior
from airzoo_bench.datasets.raster_checks import (
    FAR_BELOW_M,
    FOOT_M,
    LOWEST_SHARE,
    lowest_heights,
    often_lowest,
)
from airzoo_bench.datasets.scene_facts import SceneFacts
from airzoo_bench.geometry.precision import COARSEST_M, rounding_errors, was_rounded_to

__all__ = ["Kind", "scene_warnings"]

_FAR_M = 10.0  # receivers without correction are good to 5 m in plan; altitudes to 10 m
_FAR_SHARE = 0.1  # of the height above take-off: ground is not level
_MEDIAN_TURN_DEG = 20.0
_LIKELY_CHANCE = 0.5
_OFTEN_MISSED = 0.5
_FEW_ON = 0.5
_CLOUD_M = 5.0  # a cloud also holds what lies below roofs and crowns
_ONE_COLOUR = 0.2
_TRUTH_STEP_M = 1e-4


class Kind(Enum):
    """A kind of warning; its value is the line of docs/benchmark-folder.md about it."""

    LOWEST = (
        f"a lowest height that more than {LOWEST_SHARE:.0%} of the surface model has, or that is 0 "
        f"or repeated and {FAR_BELOW_M:g} m below all others: perhaps an untagged nodata value"
    )
    CLOUD = (
        f"a true cloud more than {_CLOUD_M:g} m off the surface model in height (median), or "
        "without a point over a height of it"
    )
    FLOAT32 = "positions of poses that have gone through float32"
    BELOW = "cameras below the surface model"
    HEIGHT = (
        f"cameras above the surface model by {_FAR_M:g} m (and {_FAR_SHARE:.0%}) more or less than "
        "their photos say that they are above take-off"
    )
    GPS_PLAN = f"poses more than {_FAR_M:g} m from their photos' GPS in plan (median)"
    GPS_HEIGHT = f"poses more than {_FAR_M:g} m from their photos' GPS in height (median)"
    NO_PRIOR = "photos without a prior, where other photos have one or a part of one"
    TURNED = (
        f"priors turned by more than {TURNED_DEG:g} degrees, or more than {_MEDIAN_TURN_DEG:g} in "
        "the median"
    )
    ONE_COLOUR = f"a map of which more than {_ONE_COLOUR:.0%} is exactly one colour"
    OFF_MAP = f"less than {_FEW_ON:.0%} of the photos' corners on the map or the surface model"
    CHANCE = f"a random tile answers in more than {_LIKELY_CHANCE:.0%} of cases"
    NEAREST_TILE = (
        f"more than {_OFTEN_MISSED:.0%} of the photos that the tile does not answer whose centre "
        "is nearest: tiles smaller than footprints"
    )


_Found = Iterator[tuple[Kind, str]]


def scene_warnings(facts: SceneFacts) -> list[tuple[Kind, str]]:
    """Return the warnings about a scene: the kind, and a sentence with the figures."""
    parts = [_of_surface, _of_cloud]
    if "x" in facts.inputs.photos:
        parts += [_of_centres, _of_heights, _of_gps, _of_priors]
    return [found for part in [*parts, _of_map, _of_chance] for found in part(facts)]


def _of_surface(facts: SceneFacts) -> _Found:
    survey = facts.survey
    if survey is not None and often_lowest(survey):
        yield (
            Kind.LOWEST,
            f"{lowest_heights(survey)} of the surface model's heights are exactly "
            f"{survey.low:.10g} m, its lowest, and the next is {survey.next_low:.10g} m: unless "
            "that is water, tag it as missing (gdal_edit.py -a_nodata)",
        )


def _of_cloud(facts: SceneFacts) -> _Found:
    above_m = facts.cloud_over_surface_m
    if facts.survey is None or above_m is None:
        return
    if math.isnan(above_m):
        yield Kind.CLOUD, "the true cloud has no point over a height of the surface model"
    elif abs(above_m) > _CLOUD_M:
        yield (
            Kind.CLOUD,
            f"the true cloud is {above_m:+.1f} m from the surface model in height (median): they "
            "may have different vertical datums (ellipsoid and geoid) or units",
        )


def _of_centres(facts: SceneFacts) -> _Found:
    plan = poses_of(facts.inputs.photos).centres[:, :2]
    # Truth is rounded to 0.1 mm, which numbers of float32 need not be.
    narrow = plan.astype(np.float32).astype(np.float64)
    plan = narrow if (np.abs(plan - narrow) <= _TRUTH_STEP_M).all() else plan
    error = float(np.sqrt((rounding_errors(plan) ** 2).sum(axis=1).mean()))
    if was_rounded_to(plan, np.float32) and error > COARSEST_M:
        yield (
            Kind.FLOAT32,
            f"positions of the poses have gone through float32: an error of {error:.2g} m is to be "
            "expected; write them as float64",
        )


def _of_heights(facts: SceneFacts) -> _Found:
    cameras, plane = facts.cameras, facts.inputs.plane_height_m
    if cameras.below:
        ground = (
            "the surface model: look at its vertical datum and unit, and at heights that are none"
            if facts.survey is not None
            else f"the ground, which is taken as a plane at {plane:g} m: look at the vertical "
            "datum of the heights, and at --plane-height"
        )
        yield (
            Kind.BELOW,
            f"{cameras.below} of {counted(len(cameras.heights_m), 'camera')} "
            f"{agreeing(cameras.below, 'is', 'are')} below {ground}",
        )
    difference = cameras.heights_m - cameras.relative_m
    if facts.survey is None or not np.isfinite(difference).any():
        return
    off = float(np.nanmedian(difference))
    if abs(off) > max(_FAR_M, _FAR_SHARE * cameras.relative_height_m):
        left = float(np.nanmedian(difference + cameras.surface_m * (1.0 - FOOT_M)))
        yield (
            Kind.HEIGHT,
            f"cameras are {cameras.height_m:.1f} m above the surface model, their own photos say "
            f"{cameras.relative_height_m:.1f} m above take-off ({off:+.1f} m): "
            + (
                f"in feet, the surface model would fit to {abs(left):.1f} m; name its unit"
                if abs(left) < _FAR_SHARE * abs(off)
                else "poses and surface model may have different vertical datums (ellipsoid and "
                "geoid), unless the ground lies so much from the place of take-off"
            ),
        )


def _of_gps(facts: SceneFacts) -> _Found:
    gps = facts.gps
    if gps is None:
        return
    if gps.distance_m > _FAR_M:
        east, north = gps.offset_m
        yield (
            Kind.GPS_PLAN,
            f"poses are {gps.distance_m:.1f} m from their own photos' GPS (median), by "
            f"{east:+.1f} m east and {north:+.1f} m north: look at the CRS, the datum and any "
            "offset that the poses were reduced by, and whether names and poses belong together",
        )
    if abs(gps.height_m) > _FAR_M:
        yield (
            Kind.GPS_HEIGHT,
            f"poses are {gps.height_m:+.1f} m from their own photos' GPS in height (median): they "
            "may have different vertical datums (ellipsoid and geoid), and priors are so far off",
        )


def _of_priors(facts: SceneFacts) -> _Found:
    yield from _of_missing_priors(facts.without_prior)
    if facts.priors is not None:
        yield from _of_turned_priors(facts.priors)


def _of_turned_priors(priors: PriorFacts) -> _Found:
    if priors.turned or priors.rotation_deg > _MEDIAN_TURN_DEG:
        many = (
            f" and more than {TURNED_DEG:g} in {first_of(priors.turned, priors.photos)}"
            if priors.turned
            else ""
        )
        yield (
            Kind.TURNED,
            f"the priors' rotation is {priors.rotation_deg:.0f} degrees off (median){many}: look "
            "at the gimbal angles in the metadata or --priors, and at the angles of the poses "
            "(convention, unit, signs, axes)",
        )


def _of_missing_priors(found: WithoutPrior) -> _Found:
    if found.lacking and (found.some_word or found.count < found.photos):
        parts = [f"{first_of(ids)} have no {what}" for what, ids in found.lacking.items()]
        asked = found.photos - found.count
        yield (
            Kind.NO_PRIOR,
            f"{found.count} of {counted(found.photos, 'photo')} "
            f"{agreeing(found.count, 'has', 'have')} no prior: {'; '.join(parts)}. Matching "
            + (f"asks the other {asked}" if asked else "has no query")
            + ", retrieval and reconstruction need none; --priors FILE gives what is missing "
            "(docs/benchmark-folder.md)",
        )


def _of_map(facts: SceneFacts) -> _Found:
    for what, share in (("map", facts.on_map), ("surface model", facts.on_surface)):
        if share < _FEW_ON:
            yield (
                Kind.OFF_MAP,
                f"only {share:.0%} of the photos' corners lie on the {what}: look at the CRS and "
                "the extent of it and of the poses, or cut the photos to those over it",
            )
    if facts.map is not None and facts.map.one_colour > _ONE_COLOUR:
        colour = " ".join(f"{value:g}" for value in facts.map.colour)
        yield (
            Kind.ONE_COLOUR,
            f"{facts.map.one_colour:.0%} of the map is exactly one colour ({colour}): unless that "
            "is what is there, mark it as missing, or tiles that show nothing stand in the gallery "
            f"(gdalwarp -srcnodata '{colour}' -dstalpha)",
        )


def _of_chance(facts: SceneFacts) -> _Found:
    shares = facts.positive_shares
    if shares is not None and len(shares) and shares.mean() > _LIKELY_CHANCE:
        yield (
            Kind.CHANCE,
            f"a random tile answers a photo in {shares.mean():.0%} of cases: take smaller tiles, "
            "or a larger map",
        )
    if facts.nearest_missed > _OFTEN_MISSED:
        yield (
            Kind.NEAREST_TILE,
            f"the tile nearest to a photo's centre is a miss for {facts.nearest_missed:.0%} of the "
            f"photos, which see {facts.footprint_m:.0f} m: take tiles as large, and --rule iou "
            "--iou-above 0.39, or tiles larger than that",
        )
