"""Weather and time of day: the light, the sky and the air. They never change geometry.

All colours are display values, 1.0 being the white of the image, as the survey's light is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import cos, radians, sin
from typing import Any

import numpy as np

from airzoo_bench.core.errors import UsageError
from airzoo_bench.datasets.mini.noise import Singles, volume_noise
from airzoo_bench.datasets.mini.world import SURVEY_SUN, Light

Colour = tuple[float, ...]
_BLACK: Colour = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Conditions:
    """Light, sky and air that a photo is taken in."""

    light: Light  # sun (or moon) and sky
    zenith: Colour  # the sky straight up
    horizon: Colour  # the sky at the horizon, which haze takes on
    glow: Colour  # added to the sky around the sun
    clouds: float  # how much of the sky has visible clouds, 0 to 1
    # extinction: after d metres exp(-d * haze_per_m) of a surface's light is left
    haze_per_m: float
    # how much less skylight narrow places get, 0 to 1: all of it under a grey sky, little
    # in the sun, whose orthophoto knows nothing of it
    shade: float
    noise: float  # standard deviation of the sensor's noise at mid-grey, in levels of 255
    lamps: float = 0.0  # strength of street lamps and lit windows
    wet: float = 0.0  # how wet surfaces are, 0 to 1
    snow: float = 0.0  # how much snow lies, 0 to 1
    falling: str = ""  # "rain" or "snow" in the air

    @property
    def direct(self) -> bool:
        """Whether anything casts a shadow."""
        return max(self.light.sun) > 0.0


def _light(azimuth_deg: float, elevation_deg: float, sun: Colour, sky: Colour) -> Light:
    azimuth, elevation = radians(azimuth_deg), radians(elevation_deg)
    level = cos(elevation)
    return Light((level * sin(azimuth), level * cos(azimuth), sin(elevation)), sun, sky)


# Light, zenith, horizon, glow, clouds, haze, shade, noise, lamps.
_CLEAR = {
    "day": Conditions(
        SURVEY_SUN, (0.33, 0.52, 0.82), (0.78, 0.85, 0.92), (0.25, 0.22, 0.16),
        0.5, 1 / 7000, 0.15, 1.6,
    ),
    "sunset": Conditions(
        _light(278.0, 11.0, (1.15, 0.62, 0.30), (0.43, 0.41, 0.50)),
        (0.34, 0.40, 0.60), (0.93, 0.68, 0.50), (0.55, 0.30, 0.10), 0.7, 1 / 4500, 0.4, 2.4, 0.12,
    ),
    "night": Conditions(
        _light(140.0, 45.0, _BLACK, (0.21, 0.235, 0.32)),
        (0.04, 0.05, 0.11), (0.13, 0.12, 0.15), _BLACK, 0.3, 1 / 6000, 0.6, 4.5, 1.0,
    ),
}  # fmt: skip

# Brightness, tint and haze of grey skies, how much noisier they are, and what else they change.
_GREY: dict[str, tuple[float, Colour, float, float, dict[str, Any]]] = {
    "cloudy": (1.0, (0.98, 1.0, 1.03), 1 / 4500, 1.0, {}),
    "rainy": (0.88, (0.96, 1.0, 1.05), 1 / 1100, 1.3, {"wet": 1.0, "falling": "rain"}),
    "foggy": (0.95, (1.0, 1.0, 1.0), 1 / 230, 1.0, {"wet": 0.35}),
    "snowy": (1.08, (0.98, 1.0, 1.03), 1 / 900, 1.1, {"snow": 1.0, "falling": "snow"}),
}
WEATHERS, TIMES = ("sunny", *_GREY), tuple(_CLEAR)


def conditions(weather: str, time: str) -> Conditions:
    """Return the conditions of a weather, one of `WEATHERS`, and a time of day, one of `TIMES`."""
    if weather not in WEATHERS or time not in TIMES:
        expected = f"one of {', '.join(WEATHERS)}; one of {', '.join(TIMES)}"
        raise UsageError("unknown weather or time", where=f"{weather}, {time}", expected=expected)
    clear = _CLEAR[time]
    if weather == "sunny":
        return clear
    brightness, tint, haze_per_m, noisier, changes = _GREY[weather]
    light, dim = clear.light, min(brightness, 1.0)
    height = max(light.direction[2], 0.3)
    lit = zip(light.sky, light.sun, strict=True)
    sky = _greyed([brightness * (sky + 0.8 * sun * height) for sky, sun in lit], 0.35)
    horizon = _times(_greyed(clear.horizon, 0.5), [part * dim for part in tint])
    return replace(
        clear,
        light=Light(light.direction, _BLACK, _times(sky, tint)),
        zenith=_times(horizon, (0.86, 0.88, 0.92)),
        horizon=horizon,
        glow=_BLACK,
        clouds=0.4,
        haze_per_m=haze_per_m,
        shade=0.85,
        noise=clear.noise * noisier,
        lamps=max(clear.lamps, 0.3) if clear.lamps > 0.0 else 0.0,
        **changes,
    )


def _greyed(colour: Sequence[float], share: float) -> Colour:
    """Mix a colour with grey, keeping only a share of it."""
    grey = 0.299 * colour[0] + 0.587 * colour[1] + 0.114 * colour[2]
    return tuple(grey + share * (part - grey) for part in colour)


def _times(a: Sequence[float], b: Sequence[float]) -> Colour:
    return tuple(one * other for one, other in zip(a, b, strict=True))


# Height of the clouds over the camera, in units of the clouds' grain.
_CLOUD_GRAINS = np.float32(2.2)
_DISC_COSINE = np.float32(0.99985)


def column(colour: Colour) -> Singles:
    """Return a colour as (3, 1) float32, to go with planes of (3, N)."""
    return np.array(colour, np.float32)[:, None]


def _towards_sun(directions: Singles, given: Conditions) -> Singles:
    """Return the cosine of the angle between unit directions (3, N) and the sun."""
    x, y, z = (np.float32(component) for component in given.light.direction)
    cosine: Singles = directions[0] * x + directions[1] * y + directions[2] * z
    return cosine


def sky_colour(directions: Singles, given: Conditions) -> Singles:
    """Return the clear sky in unit directions (3, N); below the horizon as at the horizon."""
    share = np.sqrt(np.clip(directions[2], 0.0, 1.0))
    horizon = column(given.horizon)
    colour: Singles = horizon + (column(given.zenith) - horizon) * share
    if max(given.glow) > 0.0:
        near = np.clip(_towards_sun(directions, given), 0.0, 1.0)
        near = near * near
        near = near * near
        colour += column(given.glow) * (near * near)
    return colour


def sky_with_clouds(directions: Singles, given: Conditions) -> Singles:
    """Return the sky as the camera sees it in unit directions (3, N), clouds and sun included."""
    colour = sky_colour(directions, given)
    lit = column(given.horizon) * np.float32(1.04) + column(given.light.sun) * np.float32(0.05)
    up = np.maximum(directions[2], np.float32(0.02))
    scale = _CLOUD_GRAINS / (up + np.float32(0.12))
    x, y = directions[0] * scale, directions[1] * scale
    billow = np.zeros(len(up), np.float32)
    for grain, weight in ((0.9, 0.5), (0.31, 0.3), (0.12, 0.2)):
        billow += np.float32(weight) * _smooth_noise(x, y, grain)
    thick = np.clip(billow * np.float32(0.9) + np.float32(0.2), 0.0, 1.0)
    clouds = thick * np.clip(directions[2] * 30.0, 0.0, 1.0)
    colour += (lit - colour) * (clouds * np.float32(given.clouds))
    if given.direct:
        colour += (_towards_sun(directions, given) > _DISC_COSINE) * np.float32(1.0)
    return colour


def _smooth_noise(x: Singles, y: Singles, grain: float) -> Singles:
    """Mean of the four voxels around a point, weighted by nearness."""
    level, fine = np.zeros_like(x), np.full(len(x), 0.01, np.float32)
    x0, y0 = np.floor(x / np.float32(grain)), np.floor(y / np.float32(grain))
    fx, fy = x / np.float32(grain) - x0, y / np.float32(grain) - y0
    total = np.zeros_like(x)
    for dx, wx in ((0, 1 - fx), (1, fx)):
        for dy, wy in ((0, 1 - fy), (1, fy)):
            places = ((x0 + dx + 0.5) * grain, (y0 + dy + 0.5) * grain, level)
            total += wx * wy * volume_noise(places, grain, fine)
    return total


def haze(colour: Singles, distance: Singles, view: Singles, given: Conditions) -> Singles:
    """Return colours (3, N) as seen from metres (N,) off in unit directions (3, N)."""
    left = np.exp(distance * np.float32(-given.haze_per_m))
    air = np.repeat(column(given.horizon), len(distance), axis=1)
    if max(given.glow) > 0.0:
        near = np.clip(_towards_sun(view, given), 0.0, 1.0)
        air += column(given.glow) * (np.float32(0.5) * near * near)
    seen: Singles = air + (colour - air) * left
    return seen
