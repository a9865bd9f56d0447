"""Sheets of pictures of a world: its maps, a place in every condition, and the flights."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.geometry.attitude import angles_to_rotations
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.mini.contact_sheet import write_contact_sheet
from airzoo_bench.mini.flight_figure import draw_flight
from airzoo_bench.mini.flights import Airspace, barrel_roll, survey
from airzoo_bench.mini.render import Renderer, default_camera
from airzoo_bench.mini.weather import TIMES, WEATHERS
from airzoo_bench.mini.world import World

__all__ = ["draw_world"]

_CLOSE_M = 150.0  # side of the close look at the maps
_VIEWS = (("looking down", -90.0), ("oblique", -40.0), ("to the horizon", -12.0))
_IN_CONDITIONS = -40.0
_SHADE = np.array((-0.5, 0.5, 0.7)) / np.sqrt(0.99)


def draw_world(world: World, folder: Path, progress: Progress = silent) -> list[Path]:
    """Draw a world into JPEG and PNG files; returns them.

    Parameters
    ----------
    world : World
    folder : Path
    progress : Progress
        Shows photos as they are taken.
    """
    name = world.region.name
    maps = folder / f"{name}-maps.jpg"
    write_contact_sheet(*_maps(world), maps, columns=3, width_px=420)
    renderer, airspace = Renderer(world), Airspace.over(world.region, world.dsm)
    views = folder / f"{name}-views.jpg"
    taken = [_photo(renderer, airspace, pitch, "sunny", "day") for _, pitch in _VIEWS]
    write_contact_sheet(taken, [label for label, _ in _VIEWS], views, columns=3, width_px=480)
    pairs = [(weather, time) for time in TIMES for weather in WEATHERS]
    shown = progress(pairs, f"{name}, conditions", len(pairs))
    photos = [_photo(renderer, airspace, _IN_CONDITIONS, *pair) for pair in shown]
    labels = [f"{weather}, {time}" for weather, time in pairs]
    conditions = folder / f"{name}-conditions.jpg"
    write_contact_sheet(photos, labels, conditions, columns=5, width_px=300)
    flights = [folder / f"{name}-{flight}.png" for flight in ("barrel-roll", "survey")]
    flown = (barrel_roll(airspace, world.seed), survey(airspace))
    for path, flight in zip(flights, flown, strict=True):
        draw_flight(flight, world.region, path, path.stem)
    return [maps, views, conditions, *flights]


def _maps(world: World) -> tuple[list[NDArray[np.uint8]], list[str]]:
    """Return map, older map and surface, whole and close."""
    whole = [world.dom, world.satellite, _shaded(world)]
    labels = ["orthophoto", "older satellite mosaic", "surface model"]
    close = [_middle(picture, _CLOSE_M / world.region.side_m) for picture in whole]
    return whole + close, labels + [f"{label}, {_CLOSE_M:g} m" for label in labels]


def _middle(picture: NDArray[np.uint8], share: float) -> NDArray[np.uint8]:
    half, side = len(picture) // 2, round(len(picture) * share / 2)
    return picture[half - side : half + side, half - side : half + side]


def _shaded(world: World) -> NDArray[np.uint8]:
    """Light the surface model from the north-west."""
    step = world.region.side_m / len(world.dsm)
    south, east = np.gradient(world.dsm.astype(np.float64), step)
    normal = np.stack([-east, south, np.ones_like(east)], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    grey = np.clip(normal @ _SHADE, 0, 1) * 255
    return np.repeat(grey.astype(np.uint8)[..., None], 3, axis=-1)


def _photo(
    renderer: Renderer, airspace: Airspace, pitch_deg: float, weather: str, time: str
) -> NDArray[np.uint8]:
    """Take a photo from over the middle of the south, looking north."""
    region, height = airspace.region, airspace.floor_m + 20.0
    away = 0.0 if pitch_deg == -90.0 else 0.2
    centre = (region.west + region.side_m / 2, region.south + (0.5 - away) * region.side_m, height)
    rotation = angles_to_rotations(0.0, pitch_deg, 0.0, convergence_deg=0.0)
    pose = Poses.from_centres(rotation[None], np.array([centre]))
    return renderer.render(default_camera(), pose, weather, time, seed=0).rgb
