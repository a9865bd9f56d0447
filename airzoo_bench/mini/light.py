"""The light of the survey: the sun and the sky that the orthophoto and a sunny day are lit with.

A surface of albedo ``a`` (display values of 0 to 255, per channel) with the outward unit normal
``n`` shows ::

    a * (sky_colour + sun_colour * max(0, n . sun_direction) * visible)

cut at 255, where ``visible`` is 1 in the sun and 0 in a cast shadow. Directions are in the local
frame of a world (x east, y north, z up) and point to the sun. They are rational, so that they have
length 1 and are the same on every machine without a sine.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["OLDER_SUN", "SURVEY_SUN", "Light"]


@dataclass(frozen=True)
class Light:
    """Sunlight and skylight.

    Attributes
    ----------
    direction : (3,) floats
        Unit vector to the sun: east, north, up.
    sun, sky : (3,) floats
        Factors of red, green and blue.
    """

    direction: tuple[float, float, float]
    sun: tuple[float, float, float]
    sky: tuple[float, float, float]


# An early afternoon in summer: sun in the south-south-west, 52 degrees high.
SURVEY_SUN = Light((-6 / 19, -10 / 19, 15 / 19), (0.95, 0.90, 0.78), (0.30, 0.36, 0.46))

# A morning in winter: sun in the south-east, 39 degrees high, a paler light.
OLDER_SUN = Light((6 / 11, -6 / 11, 7 / 11), (1.02, 0.94, 0.80), (0.36, 0.40, 0.47))
