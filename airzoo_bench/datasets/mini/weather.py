"""Weather and time of day: the light, the sky and the air. They never change geometry.

All colours are display values, 1.0 being the white of the image, as the survey's light is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from airzoo_bench.core.errors import UsageError
from airzoo_bench.datasets.mini.noise import Singles
from airzoo_bench.datasets.mini.plan import LOOKS
from airzoo_bench.datasets.mini.world import SURVEY_SUN, Light

Colour = tuple[float, ...]
_BLACK: Colour = (0.0, 0.0, 0.0)
WEATHERS, TIMES = ("sunny", *LOOKS["weathers"]), tuple(LOOKS["skies"])


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


def conditions(weather: str, time: str) -> Conditions:
    """Return the conditions of a weather, one of `WEATHERS`, and a time of day, one of `TIMES`."""
    if weather not in WEATHERS or time not in TIMES:
        expected = f"one of {', '.join(WEATHERS)}; one of {', '.join(TIMES)}"
        raise UsageError("unknown weather or time", where=f"{weather}, {time}", expected=expected)
    sky: dict[str, Any] = dict(LOOKS["skies"][time])
    light = Light(*map(tuple, sky.pop("light"))) if "light" in sky else SURVEY_SUN
    clear = Conditions(light=light, **sky)
    if weather == "sunny":
        return clear
    grey: dict[str, Any] = dict(LOOKS["weathers"][weather])
    bright, tint = grey.pop("bright"), grey.pop("tint")
    height = max(light.direction[2], 0.3)
    lit = zip(light.sky, light.sun, strict=True)
    soft = _greyed([bright * (sky + 0.8 * sun * height) for sky, sun in lit], 0.35)
    horizon = _times(_greyed(clear.horizon, 0.5), [part * min(bright, 1.0) for part in tint])
    return replace(
        clear,
        light=Light(light.direction, _BLACK, _times(soft, tint)),
        zenith=_times(horizon, (0.86, 0.88, 0.92)),
        horizon=horizon,
        glow=_BLACK,
        clouds=0.4,
        shade=0.85,
        noise=clear.noise * grey.pop("noisier"),
        lamps=max(clear.lamps, 0.3) if clear.lamps > 0.0 else 0.0,
        **grey,
    )


def _greyed(colour: Sequence[float], share: float) -> Colour:
    """Mix a colour with grey, keeping only a share of it."""
    grey = 0.299 * colour[0] + 0.587 * colour[1] + 0.114 * colour[2]
    return tuple(grey + share * (part - grey) for part in colour)


def _times(a: Sequence[float], b: Sequence[float]) -> Colour:
    return tuple(one * other for one, other in zip(a, b, strict=True))


def column(colour: Sequence[float]) -> Singles:
    """Return a colour as (3, 1) float32, to go with planes of (3, N)."""
    return np.array(colour, np.float32)[:, None]


def towards_sun(directions: Singles, given: Conditions) -> Singles:
    """Return the cosine of the angle between unit directions (3, N) and the sun, at least 0."""
    x, y, z = (np.float32(component) for component in given.light.direction)
    cosine: Singles = directions[0] * x + directions[1] * y + directions[2] * z
    return np.clip(cosine, 0.0, 1.0)


def sky_colour(directions: Singles, given: Conditions) -> Singles:
    """Return the clear sky in unit directions (3, N); below the horizon as at the horizon."""
    share = np.sqrt(np.clip(directions[2], 0.0, 1.0))
    horizon = column(given.horizon)
    colour: Singles = horizon + (column(given.zenith) - horizon) * share
    if max(given.glow) > 0.0:
        near = towards_sun(directions, given)
        near = near * near
        near = near * near
        colour += column(given.glow) * (near * near)
    return colour


def haze(colour: Singles, distance: Singles, view: Singles, given: Conditions) -> Singles:
    """Return colours (3, N) as seen from metres (N,) off in unit directions (3, N)."""
    left = np.exp(distance * np.float32(-given.haze_per_m))
    air = column(given.horizon)
    if max(given.glow) > 0.0:
        near = towards_sun(view, given)
        air = air + column(given.glow) * (np.float32(0.5) * near * near)
    seen: Singles = air + (colour - air) * left
    return seen
