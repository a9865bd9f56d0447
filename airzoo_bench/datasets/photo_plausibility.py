"""Warnings about photos, their poses and their priors."""

from __future__ import annotations

import math

import numpy as np

from airzoo_bench.benchmark.queries import CAMERA_COLUMNS, poses_of
from airzoo_bench.core.errors import first_of
from airzoo_bench.core.plurals import agreeing, counted
from airzoo_bench.datasets.mistakes import height_cause
from airzoo_bench.datasets.photo_facts import GpsFacts, PhotoFiles
from airzoo_bench.datasets.plausibility import (
    DAYS_APART,
    FAR_M,
    FAR_SHARE,
    LARGE_ROTATION_DEG,
    LEAST_PLACES,
    NOT_SQUARE,
    Found,
    Kind,
)
from airzoo_bench.datasets.priors import PriorFacts, WithoutPrior
from airzoo_bench.datasets.raster_checks import FOOT_M
from airzoo_bench.datasets.scene_facts import SceneFacts
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.precision import COARSEST_M, rounding_errors, was_rounded_to

__all__ = ["photo_warnings"]

_LENS_COLUMNS = tuple(name for name in CAMERA_COLUMNS if name not in ("width", "height"))
_TRUTH_STEP_M = 1e-4


def photo_warnings(facts: SceneFacts) -> Found:
    """Yield warnings about the photos of a scene, their poses and their priors."""
    yield from _of_files(facts.files, len(facts.inputs.photos))
    if "x" not in facts.inputs.photos:
        return
    yield from _of_cameras(facts)
    yield from _of_focal_lengths(facts)
    yield from _of_poses(facts)
    yield from _of_centres(facts)
    if facts.survey is not None:
        yield from _of_heights(facts)
    elif facts.cameras.below:
        yield _below_plane(facts)
    if facts.gps is not None:
        yield from _of_gps(facts.gps, facts.lonlat)
    yield from _of_missing_priors(facts.without_prior)
    if facts.priors is not None:
        yield from _of_priors(facts.priors)


def _of_files(files: PhotoFiles, photos: int) -> Found:
    if files.copies:
        spare = sum(len(group) - 1 for group in files.copies)
        groups = [" = ".join(group[:3]) + " ..." * (len(group) > 3) for group in files.copies]
        yield (
            Kind.COPIES,
            f"{spare} of {counted(photos, 'photo')} "
            f"{agreeing(spare, 'is a copy', 'are copies')} of "
            "another, the same bytes: "
            f"{'; '.join(groups[:3])}: they count twice in every score; keep one of each",
        )
    if files.days and (files.days[-1] - files.days[0]).days > DAYS_APART:
        yield (
            Kind.DAYS,
            f"the photos were taken from {files.days[0]} to {files.days[-1]}: one surface model "
            "cannot be true of both where the place has changed; prepare a benchmark a flight",
        )


def _of_cameras(facts: SceneFacts) -> Found:
    photos, names = facts.inputs.photos, facts.files.cameras
    stated = {name: camera for camera, of in names.items() for name in of}
    lenses: dict[tuple[float, ...], dict[tuple[str, str], list[str]]] = {}
    numbers = photos[list(_LENS_COLUMNS)].to_numpy(np.float64).tolist()
    sizes = zip(photos["width"], photos["height"], strict=True)
    for name, lens, (width, height) in zip(photos["image"], numbers, sizes, strict=True):
        kind = stated.get(name, ""), f"{width}x{height} px"
        lenses.setdefault(tuple(lens), {}).setdefault(kind, []).append(name)
    for kinds in lenses.values():
        cameras, sides = {camera for camera, _ in kinds if camera}, {size for _, size in kinds}
        if len(cameras) > 1 or len(sides) > 1:
            yield Kind.CAMERAS, _shared_lens(facts.inputs.scene, kinds)


def _of_focal_lengths(facts: SceneFacts) -> Found:
    photos = facts.inputs.photos
    ratio = photos["fx"] / photos["fy"]
    odd = photos["id"][(ratio > 1.0 + NOT_SQUARE) | (ratio < 1.0 / (1.0 + NOT_SQUARE))]
    if len(odd):
        yield (
            Kind.NOT_SQUARE,
            f"fx is {ratio[odd.index[0]]:.2f} times fy in {first_of(odd, len(photos))}: pixels of "
            "cameras are square; look at the camera matrix",
        )


def _shared_lens(scene: str, kinds: dict[tuple[str, str], list[str]]) -> str:
    named = [
        f"{camera or 'camera not stated'}, {size}: {first_of(kinds[camera, size])}"
        for camera, size in sorted(kinds)
    ]
    return (
        f"scene {scene} has photos of {len(kinds)} cameras with one camera matrix "
        f"({'; '.join(named)}): give each image its own K and distortion in the pose file, or "
        "prepare a benchmark for each camera, from a folder of its own"
    )


def _of_poses(facts: SceneFacts) -> Found:
    if facts.same_pose:
        yield (
            Kind.SAME_POSE,
            f"{first_of(facts.same_pose, len(facts.inputs.photos), noun='photo')} "
            f"{agreeing(len(facts.same_pose), 'has', 'have')} the pose of another, to the last "
            "digit: look whether names and poses belong together",
        )


def _of_missing_priors(found: WithoutPrior) -> Found:
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


def _of_centres(facts: SceneFacts) -> Found:
    centres = poses_of(facts.inputs.photos).centres
    # Truth is rounded to 0.1 mm, which numbers of float32 need not be.
    plan, narrow = centres[:, :2], centres[:, :2].astype(np.float32).astype(np.float64)
    plan = narrow if (np.abs(plan - narrow) <= _TRUTH_STEP_M).all() else plan
    error = float(np.sqrt((rounding_errors(plan) ** 2).sum(axis=1).mean()))
    if was_rounded_to(plan, np.float32) and error > COARSEST_M:
        yield (
            Kind.FLOAT32,
            f"positions of the poses have gone through float32: an error of {error:.2g} m is to be "
            "expected; write them as float64",
        )
    if facts.cloud_over_surface_m is None:
        return
    places = len(np.unique(np.round(centres, 2), axis=0))
    if places < LEAST_PLACES:
        yield (
            Kind.PLACES,
            f"the photos were taken from {places} place{'s' * (places != 1)}, and aligning a "
            f"reconstruction needs {LEAST_PLACES}: predictions with cameras will be refused",
        )


def _of_heights(facts: SceneFacts) -> Found:
    cameras = facts.cameras
    nowhere = int(np.isnan(cameras.heights_m).sum())
    if nowhere:
        yield (
            Kind.NO_HEIGHT,
            f"the surface model has no height near {nowhere} of {len(cameras.heights_m)} cameras: "
            "look at its nodata value and its extent",
        )
    if cameras.below:
        yield (
            Kind.BELOW,
            f"{cameras.below} of {counted(len(cameras.heights_m), 'camera')} "
            f"{agreeing(cameras.below, 'is', 'are')} below the surface model: "
            "look at its vertical datum and unit, and at heights that are none",
        )
    difference = np.array(cameras.heights_m - cameras.relative_m)
    difference = difference[np.isfinite(difference)]
    if not difference.size:
        return
    off = float(np.median(difference))
    if abs(off) > max(FAR_M, FAR_SHARE * cameras.relative_height_m):
        yield (
            Kind.HEIGHT,
            f"cameras are {cameras.height_m:.1f} m above the surface model, their own photos say "
            f"{cameras.relative_height_m:.1f} m above take-off ({off:+.1f} m): "
            + _height_cause(facts, off),
        )


def _below_plane(facts: SceneFacts) -> tuple[Kind, str]:
    below, all_of_them = facts.cameras.below, len(facts.inputs.photos)
    return (
        Kind.BELOW,
        f"{below} of {counted(all_of_them, 'camera')} {agreeing(below, 'is', 'are')} below the "
        f"ground, which is taken as a plane at {facts.inputs.plane_height_m:g} m: look at the "
        "vertical datum of the heights, and at --plane-height",
    )


def _height_cause(facts: SceneFacts, off: float) -> str:
    cameras, gps = facts.cameras, facts.gps
    in_feet = cameras.heights_m + cameras.surface_m * (1.0 - FOOT_M) - cameras.relative_m
    left = float(np.nanmedian(in_feet))
    if abs(left) < FAR_SHARE * abs(off):
        return f"in feet, the surface model would fit to {abs(left):.1f} m; name its unit"
    if gps is not None and abs(gps.height_m - off) < 0.5 * abs(off):
        return "poses are off in height from GPS by as much; look at their vertical datum"
    return (
        "poses and surface model may have different vertical datums (ellipsoid and geoid), unless "
        "the ground lies so much from the place of take-off; "
        + height_cause(off, facts.lonlat, "poses", "the surface model")
    )


def _of_gps(gps: GpsFacts, lonlat: Floats) -> Found:
    if gps.distance_m > FAR_M:
        east, north = gps.offset_m
        shifted = math.hypot(east, north) > gps.distance_m / 2
        cause = gps.cause or (
            f"all to one side ({east:+.1f} m east, {north:+.1f} m north); look at the CRS, the "
            "datum and any offset that the poses were reduced by"
            if shifted
            else "in different directions; look whether names and poses belong together"
        )
        yield (
            Kind.GPS_PLAN,
            f"poses are {gps.distance_m:.1f} m from their own photos' GPS (median), {cause}",
        )
    if abs(gps.height_m) > FAR_M:
        yield (
            Kind.GPS_HEIGHT,
            f"poses are {gps.height_m:+.1f} m from their own photos' GPS in height (median): they "
            "may have different vertical datums (ellipsoid and geoid), and priors are so far off; "
            + height_cause(gps.height_m, lonlat, "poses", "GPS"),
        )
    if gps.apart:
        named = [f"{one} by {metres:,.0f} m" for one, metres in gps.apart.items()]
        yield (
            Kind.GPS_APART,
            f"poses are far from their own photos' GPS in {first_of(named, gps.photos)}, others "
            "are not: look whether names and poses belong together",
        )


def _of_priors(priors: PriorFacts) -> Found:
    for what, ids in priors.turned:
        yield (
            Kind.TURNED,
            f"the priors' {what} in {first_of(ids, priors.photos)}: either the priors or the "
            "poses are wrong: look at the gimbal angles in the metadata or --priors, and at the "
            "angles of the poses (convention, unit, signs, axes) where it is most photos",
        )
    if not priors.turned and priors.rotation_deg > LARGE_ROTATION_DEG:
        yield (
            Kind.ROTATION,
            f"the priors' rotation is {priors.rotation_deg:.0f} degrees off (median)",
        )
