"""The facts of a scene for people: a line for each part, a sentence for each warning."""

from __future__ import annotations

import math

from airzoo_bench.core.errors import counted
from airzoo_bench.datasets.plausibility import scene_warnings
from airzoo_bench.datasets.priors import PriorFacts
from airzoo_bench.datasets.scene_facts import SceneFacts
from airzoo_bench.geometry.crs import LOCAL_CRS

__all__ = ["fact_lines", "plausibility_warnings"]

_SAME_M = 0.001


def fact_lines(facts: SceneFacts) -> list[str]:
    """Return a line for each part of the scene: photos, poses, priors, map, surface, crops."""
    rows = [
        ("photos", _photos(facts)),
        ("taken", _taken(facts)),
        ("poses", _poses(facts)),
        ("priors", _priors(facts.priors)),
        ("map", _map(facts)),
        ("surface", _surface(facts)),
        ("cloud", _cloud(facts.cloud_over_surface_m)),
        ("crops", _crops(facts)),
        ("chance", _chance(facts)),
    ]
    return [f"{name:15} {text}" for name, text in rows if text]


def plausibility_warnings(facts: SceneFacts) -> list[str]:
    """Return the warnings about a scene, a sentence each."""
    return [sentence for _, sentence in scene_warnings(facts)]


def _photos(facts: SceneFacts) -> str:
    cameras = facts.cameras
    text = f"{len(facts.inputs.photos)}"
    if math.isfinite(cameras.height_m):
        ground = "the ground" if facts.survey is None else "the surface"
        text += f", {cameras.height_m:.1f} m above {ground}"
    if math.isfinite(cameras.relative_height_m):
        text += f" ({cameras.relative_height_m:.1f} m above take-off by their metadata)"
    if math.isfinite(facts.photo_gsd_m):
        text += f", {facts.photo_gsd_m:.3g} m per pixel"
    return text if "," not in text else f"{text} (medians)"


def _taken(facts: SceneFacts) -> str:
    cameras = [f"{name} ({len(of)})" for name, of in facts.files.cameras.items()]
    days = [day.isoformat() for day in facts.files.days]
    when = (
        f"on {days[0]}"
        if len(days) == 1
        else f"on {len(days)} days, {days[0]} to {days[-1]}"
        if days
        else ""
    )
    return " ".join(part for part in (f"by {', '.join(cameras)}" if cameras else "", when) if part)


def _poses(facts: SceneFacts) -> str:
    gps, photos = facts.gps, len(facts.inputs.photos)
    if facts.inputs.crs is None:
        return ""
    if facts.inputs.crs == LOCAL_CRS:
        return "in a local frame, without a place on the earth"
    if gps is None:
        return "no photo has a GPS position to hold them against"
    if facts.is_metadata and gps.distance_m < _SAME_M:
        return "the photos' own positions and angles"
    text = f"{gps.distance_m:.1f} m from the photos' GPS"
    text += f" ({gps.photos} of {photos} have it)" if gps.photos < photos else ""
    text += f", {gps.height_m:+.1f} m in height" if math.isfinite(gps.height_m) else ""
    return f"{text} (medians)"


def _priors(priors: PriorFacts | None) -> str:
    if priors is None:
        return ""
    return (
        f"{priors.photos}, off by {priors.position_m:.1f} m; yaw {priors.yaw_deg:.1f}, pitch "
        f"{priors.pitch_deg:.1f}, rotation {priors.rotation_deg:.1f} degrees (medians)"
    )


def _map(facts: SceneFacts) -> str:
    dom = facts.inputs.dom
    if dom is None or facts.map_gsd_m is None:
        return ""
    across, down = facts.map_gsd_m
    gsd = (
        f"{across:.3g}"
        if math.isclose(across, down, rel_tol=0.01)
        else f"{across:.3g} x {down:.3g}"
    )
    text = f"{dom.width} x {dom.height} px, {gsd} m per pixel"
    if math.isfinite(facts.on_map):
        text += f"; {facts.on_map:.0%} of the photos' corners lie on it"
    return text


def _surface(facts: SceneFacts) -> str:
    survey, plane = facts.survey, facts.inputs.plane_height_m
    if survey is None:
        return "" if plane is None else f"none; the ground is taken as a plane at {plane:.1f} m"
    within = plane is None or survey.low <= plane <= survey.high
    what = "median" if within else "the plane at"
    return (
        f"{survey.valid_share:.0%} of its pixels have a height, {survey.low:.1f} to "
        f"{survey.high:.1f} m, {what} {plane:.1f} m"
    )


def _cloud(above_m: float | None) -> str:
    if above_m is None or math.isnan(above_m):
        return ""
    return f"{round(above_m, 2) + 0.0:.2f} m above the surface (median)"


def _crops(facts: SceneFacts) -> str:
    shares = facts.crop_shares
    if shares is None or not len(shares):
        return ""
    return f"{shares.mean():.0%} of the map each on average, at most {shares.max():.0%}"


def _chance(facts: SceneFacts) -> str:
    shares = facts.positive_shares
    if shares is None or not len(shares):
        return ""
    text = f"a random tile is a right answer in {shares.mean():.1%} of cases"
    if facts.dropped_tiles:
        text += f"; {counted(facts.dropped_tiles, 'tile')} {facts.dropped} left out"
    return text
