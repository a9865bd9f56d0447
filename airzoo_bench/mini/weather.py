"""Weather and time of day: what the light, the air and the lens are like. Never geometry.

All colours are display values, 1.0 being the white of the image, as the survey's light is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import cos, radians, sin
from typing import Literal, get_args

from airzoo_bench.core.errors import UsageError
from airzoo_bench.mini.light import SURVEY_SUN, Light

__all__ = ["TIMES", "WEATHERS", "Conditions", "Time", "Weather", "conditions"]

Weather = Literal["sunny", "cloudy", "rainy", "foggy", "snowy"]
Time = Literal["day", "sunset", "night"]
WEATHERS: tuple[Weather, ...] = get_args(Weather)
TIMES: tuple[Time, ...] = get_args(Time)

Colour = tuple[float, float, float]


@dataclass(frozen=True)
class Conditions:
    """What a photo is taken in.

    Attributes
    ----------
    light : Light
        Sun (or moon) and sky.
    zenith, horizon : colour
        The sky straight up, and at the horizon, which haze takes on.
    glow : colour
        Added to the sky around the sun.
    clouds : float
        How much of the sky has visible clouds, 0 to 1.
    haze_per_m : float
        Extinction: after d metres exp(-d * haze_per_m) of a surface's light is left.
    shade : float
        How much less skylight narrow places get, 0 to 1: all of it under a grey sky, little in
        the sun, whose orthophoto knows nothing of it.
    wet, snow : float
        How wet surfaces are, how much snow lies, 0 to 1.
    lamps : float
        Strength of street lamps and lit windows.
    falling : {"nothing", "rain", "snow"}
    noise : float
        Standard deviation of the sensor's noise at mid-grey, in levels of 255.
    """

    light: Light
    zenith: Colour
    horizon: Colour
    glow: Colour
    clouds: float
    haze_per_m: float
    shade: float
    wet: float
    snow: float
    lamps: float
    falling: Literal["nothing", "rain", "snow"]
    noise: float

    @property
    def direct(self) -> bool:
        """Whether anything casts a shadow."""
        return max(self.light.sun) > 0.0


def conditions(weather: str, time: str) -> Conditions:
    """Return what weather and time of day mean for a photo.

    Parameters
    ----------
    weather : str
        One of `WEATHERS`.
    time : str
        One of `TIMES`.

    Raises
    ------
    UsageError
        Another weather or time.
    """
    _require("weather", weather, WEATHERS)
    _require("time of day", time, TIMES)
    clear = _CLEAR[time]
    return clear if weather == "sunny" else _OVERCAST[weather].over(clear)


@dataclass(frozen=True)
class _Overcast:
    """How weather changes what a clear sky of the same time of day is like."""

    brightness: float
    grey: Colour
    haze_per_m: float
    wet: float = 0.0
    snow: float = 0.0
    noise: float = 1.0
    falling: Literal["nothing", "rain", "snow"] = "nothing"

    def over(self, clear: Conditions) -> Conditions:
        """Return the clear conditions under this sky."""
        height = max(clear.light.direction[2], 0.3)
        whole = [
            self.brightness * (sky + 0.8 * sun * height)
            for sky, sun in zip(clear.light.sky, clear.light.sun, strict=True)
        ]
        sky = _mixed(_grey(whole), whole, 0.35)
        tinted = _times(sky, self.grey)
        cover = _mixed(_grey(clear.horizon), clear.horizon, 0.5)
        horizon = _times(cover, _times(self.grey, (min(self.brightness, 1.0),) * 3))
        return replace(
            clear,
            light=Light(clear.light.direction, (0.0, 0.0, 0.0), tinted),
            zenith=_times(horizon, (0.86, 0.88, 0.92)),
            horizon=horizon,
            glow=(0.0, 0.0, 0.0),
            clouds=0.4,
            haze_per_m=self.haze_per_m,
            shade=0.85,
            wet=self.wet,
            snow=self.snow,
            lamps=max(clear.lamps, 0.3) if clear.lamps > 0.0 else 0.0,
            falling=self.falling,
            noise=clear.noise * self.noise,
        )


def _direction(azimuth_deg: float, elevation_deg: float) -> Colour:
    azimuth, elevation = radians(azimuth_deg), radians(elevation_deg)
    level = cos(elevation)
    return level * sin(azimuth), level * cos(azimuth), sin(elevation)


_CLEAR: dict[str, Conditions] = {
    "day": Conditions(
        light=SURVEY_SUN,
        zenith=(0.33, 0.52, 0.82),
        horizon=(0.78, 0.85, 0.92),
        glow=(0.25, 0.22, 0.16),
        clouds=0.5,
        haze_per_m=1 / 7000,
        shade=0.15,
        wet=0.0,
        snow=0.0,
        lamps=0.0,
        falling="nothing",
        noise=1.6,
    ),
    "sunset": Conditions(
        light=Light(_direction(278.0, 11.0), (1.15, 0.62, 0.30), (0.43, 0.41, 0.50)),
        zenith=(0.34, 0.40, 0.60),
        horizon=(0.93, 0.68, 0.50),
        glow=(0.55, 0.30, 0.10),
        clouds=0.7,
        haze_per_m=1 / 4500,
        shade=0.4,
        wet=0.0,
        snow=0.0,
        lamps=0.12,
        falling="nothing",
        noise=2.4,
    ),
    "night": Conditions(
        light=Light(_direction(140.0, 45.0), (0.0, 0.0, 0.0), (0.21, 0.235, 0.32)),
        zenith=(0.04, 0.05, 0.11),
        horizon=(0.13, 0.12, 0.15),
        glow=(0.0, 0.0, 0.0),
        clouds=0.3,
        haze_per_m=1 / 6000,
        shade=0.6,
        wet=0.0,
        snow=0.0,
        lamps=1.0,
        falling="nothing",
        noise=4.5,
    ),
}

_OVERCAST: dict[str, _Overcast] = {
    "cloudy": _Overcast(1.0, (0.98, 1.0, 1.03), 1 / 4500),
    "rainy": _Overcast(0.88, (0.96, 1.0, 1.05), 1 / 1100, wet=1.0, noise=1.3, falling="rain"),
    "foggy": _Overcast(0.95, (1.0, 1.0, 1.0), 1 / 230, wet=0.35),
    "snowy": _Overcast(1.08, (0.98, 1.0, 1.03), 1 / 900, snow=1.0, noise=1.1, falling="snow"),
}


def _require(what: str, given: str, known: tuple[str, ...]) -> None:
    if given not in known:
        raise UsageError(
            f"unknown {what} {given!r}", expected=", ".join(known), mend="take one of these"
        )


def _grey(colour: tuple[float, ...] | list[float]) -> Colour:
    red, green, blue = colour
    return (0.299 * red + 0.587 * green + 0.114 * blue,) * 3


def _mixed(a: Colour, b: tuple[float, ...] | list[float], share: float) -> Colour:
    red, green, blue = (x + share * (y - x) for x, y in zip(a, b, strict=True))
    return red, green, blue


def _times(a: Colour, b: Colour) -> Colour:
    return a[0] * b[0], a[1] * b[1], a[2] * b[2]
