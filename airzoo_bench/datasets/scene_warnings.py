"""Warnings of `prepare` and `check-geometry`: mistakes that the data show and users overlook."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np

from airzoo_bench.benchmark.queries import poses_of
from airzoo_bench.core.errors import counted, first_of
from airzoo_bench.datasets.facts import SceneFacts
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.precision import COARSEST_M, rounding_errors, was_rounded_to
from airzoo_bench.geometry.rasters import gsd_m

_FAR_M = 10.0  # receivers without correction are good to 5 m in plan; altitudes to 10 m
_FAR_SHARE = 0.1  # of the height above take-off: ground is not level
_TURNED_DEG = 45.0  # no gimbal is so far off; a mistake of convention is
_MEDIAN_TURN_DEG = 20.0
_GIMBAL_DEG = 3.0  # of error are common
_CLOUD_M = 5.0  # a cloud also holds what lies below roofs and crowns
_HALF = 0.5
_LEAST_FOOTPRINTS = 3.0  # that a map is wide, for tiles as large as footprints to differ
_WHOLE_MAP = 0.95
_LOWEST_SHARE, _FAR_BELOW_M = 0.01, 10.0
_TRUTH_STEP_M = 1e-4
_DATUMS = "they may have different vertical datums (ellipsoid and geoid) or units (feet)"


def scene_warnings(facts: SceneFacts) -> list[tuple[str, str]]:
    """Return the warnings about a scene: a code, which docs/brighton.md describes, and a text."""
    return [(code, text) for code, check in CHECKS.items() for text in check(facts)]


def _datum(facts: SceneFacts) -> Iterator[str]:
    gps = facts.gps
    if gps is not None and gps.distance_m > _FAR_M:
        yield (
            f"poses are {gps.distance_m:.1f} m from their own photos' GPS (median), by "
            f"{gps.east_m:+.1f} m east and {gps.north_m:+.1f} m north: look at the CRS, the datum "
            "and any offset that was taken off, and whether names and poses belong together"
        )


def _heights(facts: SceneFacts) -> Iterator[str]:
    gps, cloud, difference = facts.gps, facts.cloud_over_surface_m, facts.heights_m
    difference = difference - facts.relative_m
    if facts.survey is not None and np.isfinite(difference).any():
        off, take_off = float(np.nanmedian(difference)), float(np.nanmedian(facts.relative_m))
        if abs(off) > max(_FAR_M, _FAR_SHARE * take_off):
            yield (
                f"cameras are {take_off + off:.1f} m above the surface model, and {take_off:.1f} m "
                f"above take-off by their own metadata (medians): {_DATUMS}"
            )
    if gps is not None and abs(gps.up_m) > _FAR_M:
        yield f"poses are {gps.up_m:+.1f} m from their photos' GPS in height (median): {_DATUMS}"
    if facts.survey is not None and cloud is not None and abs(cloud) > _CLOUD_M:
        yield f"the true cloud is {cloud:+.1f} m from the surface model (median): {_DATUMS}"


def _surface(facts: SceneFacts) -> Iterator[str]:
    survey = facts.survey
    if survey is None:
        return
    if survey.low == survey.high:
        yield f"every height of the surface model is {survey.low:.10g} m: matches have no relief"
        return
    repeated = survey.at_low > 1 or survey.low == 0.0
    alone = repeated and survey.next_low - survey.low > _FAR_BELOW_M
    if alone or survey.at_low > _LOWEST_SHARE * survey.valid:
        yield (
            f"{survey.at_low:,} of the surface model's heights are exactly {survey.low:.10g} m, "
            f"its lowest, and the next is {survey.next_low:.10g} m: unless that is water, tag it "
            "as missing (gdal_edit.py -a_nodata)"
        )


def _below(facts: SceneFacts) -> Iterator[str]:
    below = int((facts.heights_m <= 0.0).sum())
    if below:
        yield (
            f"below the ground {'is' if below == 1 else 'are'} {below} of "
            f"{counted(len(facts.heights_m), 'camera')}: look at the vertical datum and unit of "
            "both, and at heights that are none"
        )


def _turned(facts: SceneFacts) -> Iterator[str]:
    priors = facts.priors
    if priors is None:
        return
    rows = np.flatnonzero(priors.angles_deg > _TURNED_DEG)
    opposite = _GIMBAL_DEG + 2.0 * priors.transposed_deg < priors.rotation_deg
    if rows.size or priors.rotation_deg > _MEDIAN_TURN_DEG or opposite:
        turned = first_of([priors.ids[row] for row in rows], len(priors.ids))
        by = ""
        if rows.size:
            by = f", and by about {np.median(priors.angles_deg[rows]):.0f} in {turned}"
        if opposite:
            by += f", and by {priors.transposed_deg:.0f} if these are camera-to-world"
        yield (
            f"the priors are turned from the poses by {priors.rotation_deg:.0f} degrees (median)"
            f"{by}: look at the angles of the priors and of the poses (unit, signs, axes)"
        )


def _map_beside(facts: SceneFacts) -> Iterator[str]:
    if facts.shared_ground < _HALF:
        yield (
            f"map and surface model share {facts.shared_ground:.0%} of their ground: look at the "
            "geotransform and the CRS of both"
        )
    cloud = facts.cloud_over_surface_m
    if facts.survey is not None and cloud is not None and math.isnan(cloud):
        yield "the true cloud has no point over a height of the surface model"


def _trivial(facts: SceneFacts) -> Iterator[str]:
    if facts.positive_share > _HALF:
        share = f"{facts.positive_share:.0%}"
        yield f"a random tile answers a photo in {share} of cases: take smaller ones (--tile-size)"
    if facts.crop_share > _WHOLE_MAP:
        share = f"{facts.crop_share:.0%}"
        yield f"a crop is {share} of the map (mean), whatever the prior: take a larger map"


def _small_tiles(facts: SceneFacts) -> Iterator[str]:
    found = {
        "are not answered by the tile nearest to their centre": facts.nearest_missed,
        "are left out, since no tile answers them": facts.unanswered,
    }
    for what, share in found.items():
        if share > _HALF:
            info, wide = facts.inputs.gallery_map, f"{facts.footprint_m:.0f} m"
            width, height = np.multiply((info.width, info.height), gsd_m(info))
            advice = f"take tiles of {wide}, and the rule iou above 0.39"
            if min(width, height) < _LEAST_FOOTPRINTS * facts.footprint_m:
                size = f"{width:.0f} x {height:.0f} m"
                advice = f"the map, {size}, is small for photos that see {wide}: take a larger one"
            yield f"{share:.0%} of the photos {what}: {advice}"


def _off_map(facts: SceneFacts) -> Iterator[str]:
    for what, share in (("map", facts.on_map), ("surface model", facts.on_surface)):
        if share < _HALF:
            yield (
                f"only {share:.0%} of the photos' corners lie on the {what}: look at the CRS and "
                "the extent of it and of the poses, or cut the photos to those over it"
            )


def _no_prior(facts: SceneFacts) -> Iterator[str]:
    photos, lacking = len(facts.inputs.photos), facts.without_prior
    if lacking and (facts.has_metadata or len(lacking) < photos):
        yield (
            f"photos have no prior, which matching needs: {first_of(lacking, photos)}: they lack a "
            "GPS position, an altitude or gimbal angles, which a file of priors can give"
        )


def _float32(facts: SceneFacts) -> Iterator[str]:
    plan = poses_of(facts.inputs.photos).centres[:, :2]
    # Truth is rounded to 0.1 mm, which numbers of float32 need not be.
    narrow = plan.astype(np.float32).astype(np.float64)
    plan = narrow if (np.abs(plan - narrow) <= _TRUTH_STEP_M).all() else plan
    error = float(np.sqrt((rounding_errors(plan) ** 2).sum(axis=1).mean()))
    if was_rounded_to(plan, np.float32) and error > COARSEST_M:
        yield f"positions of the poses went through float32, an error of {error:.2g} m: use float64"


def _copies(facts: SceneFacts) -> Iterator[str]:
    photos, poses = facts.inputs.photos, poses_of(facts.inputs.photos)
    rows: Floats = np.hstack((poses.centres, poses.rotation.reshape(len(photos), 9)))
    _, first, counts = np.unique(rows, axis=0, return_index=True, return_counts=True)
    twice = photos["id"].iloc[first[counts > 1]].tolist()
    if twice:
        yield (
            f"photos have the pose of another to the last digit: {first_of(twice, len(photos))}: "
            "copies count twice in every mean; keep one of each"
        )


CHECKS: dict[str, Callable[[SceneFacts], Iterator[str]]] = {
    "datum": _datum,
    "heights": _heights,
    "surface": _surface,
    "below-surface": _below,
    "turned-priors": _turned,
    "map-beside-surface": _map_beside,
    "trivial": _trivial,
    "small-tiles": _small_tiles,
    "off-map": _off_map,
    "no-prior": _no_prior,
    "float32": _float32,
    "copies": _copies,
}
"""The twelve checks by the codes of their warnings."""
