"""What the facts of a scene make one suspect, a sentence each."""

from __future__ import annotations

import math
from collections.abc import Callable

from airzoo_bench.datasets.photo_plausibility import photo_warnings
from airzoo_bench.datasets.plausibility_kinds import (
    CLOUD_M,
    FEW_ON,
    FEW_PIXELS,
    LARGE_CROP,
    LIKELY_CHANCE,
    LITTLE_SHOWN,
    ONE_COLOUR,
    Found,
    Kind,
)
from airzoo_bench.datasets.raster_checks import often_lowest
from airzoo_bench.datasets.scene_facts import SceneFacts

__all__ = ["kinds_and_warnings", "plausibility_warnings"]


def plausibility_warnings(facts: SceneFacts) -> list[str]:
    """Return what is suspect in a scene, a sentence each; none where nothing is."""
    return [sentence for _, sentence in kinds_and_warnings(facts)]


def kinds_and_warnings(facts: SceneFacts) -> list[tuple[Kind, str]]:
    """Return what is suspect in a scene: the kind, and a sentence with the figures."""
    parts: tuple[Callable[[SceneFacts], Found], ...] = (
        *(_of_surface, _of_cloud, photo_warnings, _of_picture, _of_map, _of_surface_extent),
        *(_of_crops, _of_positives),
    )
    return [found for part in parts for found in part(facts)]


def _of_surface(facts: SceneFacts) -> Found:
    if facts.survey.low == facts.survey.high:
        yield (
            Kind.FLAT,
            f"the surface model is flat: every height is exactly {facts.survey.low:.10g} m; look "
            "whether it holds heights at all",
        )
    if often_lowest(facts.survey):
        share = facts.survey.at_low / facts.survey.valid
        yield (
            Kind.LOWEST,
            f"{share:.0%} of the surface model's heights are exactly {facts.survey.low:.10g} m, "
            "its lowest: unless that is water, tag it as missing (gdal_edit.py -a_nodata)",
        )


def _of_cloud(facts: SceneFacts) -> Found:
    above_m = facts.cloud_over_surface_m
    if above_m is not None and math.isnan(above_m):
        yield Kind.NO_CLOUD, "the true cloud has no point over a height of the surface model"
    elif above_m is not None and abs(above_m) > CLOUD_M:
        yield (
            Kind.CLOUD,
            f"the true cloud is {above_m:+.1f} m from the surface model in height (median): they "
            "may have different vertical datums (ellipsoid and geoid) or units",
        )


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
    seen = facts.footprint_m / max(facts.map_gsd_m)
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


def _of_surface_extent(facts: SceneFacts) -> Found:
    if facts.on_surface < FEW_ON:
        yield (
            Kind.OFF_SURFACE,
            f"only {facts.on_surface:.0%} of the photos' corners lie on the surface model: look at "
            "the CRS and the extent of it and of the poses",
        )
    if facts.map.over_surface < FEW_ON:
        yield (
            Kind.LITTLE_SURFACE,
            f"the surface model lies below only {facts.map.over_surface:.0%} of the map: look at "
            "the CRS and the extent of both",
        )
