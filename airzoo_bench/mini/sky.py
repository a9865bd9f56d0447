"""The sky, and the air between a surface and the camera."""

from __future__ import annotations

import numpy as np

from airzoo_bench.mini.pixel_noise import Singles, volume_noise
from airzoo_bench.mini.weather import Conditions

__all__ = ["column", "haze", "sky_colour", "sky_with_clouds", "towards_sun"]

# Height of the clouds over the camera, in units of the clouds' grain.
_CLOUD_GRAINS = 2.2
_DISC_COSINE = np.float32(0.99985)


def column(colour: tuple[float, float, float]) -> Singles:
    """Return a colour as (3, 1) float32, to go with planes of (3, N)."""
    return np.array(colour, np.float32)[:, None]


def sky_colour(up: Singles, cosine: Singles, given: Conditions) -> Singles:
    """Return the clear gradient of the sky.

    Parameters
    ----------
    up : (N,) float32 array
        Upward component of unit directions; below the horizon as at the horizon.
    cosine : (N,) float32 array
        Cosine of the angle to the sun.
    given : Conditions

    Returns
    -------
    (3, N) float32 array
    """
    share = np.sqrt(np.clip(up, 0.0, 1.0))
    horizon = column(given.horizon)
    colour = horizon + (column(given.zenith) - horizon) * share
    if max(given.glow) > 0.0:
        near = np.clip(cosine, 0.0, 1.0)
        near = near * near
        near = near * near
        colour += column(given.glow) * (near * near)
    return colour


def sky_with_clouds(directions: Singles, given: Conditions) -> Singles:
    """Return the sky as the camera sees it, clouds and sun included.

    Parameters
    ----------
    directions : (3, N) float32 array
        Unit vectors.
    given : Conditions

    Returns
    -------
    (3, N) float32 array
    """
    towards = towards_sun(directions, given)
    colour = sky_colour(directions[2], towards, given)
    clouds = _clouds(directions) * np.float32(given.clouds)
    lit = column(given.horizon) * np.float32(1.04) + column(given.light.sun) * np.float32(0.05)
    colour += (lit - colour) * clouds
    if given.direct:
        colour += (towards > _DISC_COSINE) * np.float32(1.0)
    return colour


def haze(colour: Singles, distance: Singles, view: Singles, given: Conditions) -> Singles:
    """Return what is seen of a colour (3, N) through air.

    Parameters
    ----------
    colour : (3, N) float32 array
    distance : (N,) float32 array
        Metres.
    view : (3, N) float32 array
        Unit directions from the camera.
    given : Conditions

    Returns
    -------
    (3, N) float32 array
    """
    left = np.exp(distance * np.float32(-given.haze_per_m))
    air = np.repeat(column(given.horizon), len(distance), axis=1)
    if max(given.glow) > 0.0:
        near = np.clip(towards_sun(view, given), 0.0, 1.0)
        air += column(given.glow) * (np.float32(0.5) * near * near)
    seen: Singles = air + (colour - air) * left
    return seen


def towards_sun(directions: Singles, given: Conditions) -> Singles:
    """Return the cosine of the angle between unit directions (3, N) and the sun."""
    x, y, z = (np.float32(component) for component in given.light.direction)
    cosine: Singles = directions[0] * x + directions[1] * y + directions[2] * z
    return cosine


def _clouds(directions: Singles) -> Singles:
    up = np.maximum(directions[2], np.float32(0.02))
    scale = np.float32(_CLOUD_GRAINS) / (up + np.float32(0.12))
    x, y = directions[0] * scale, directions[1] * scale
    fine = np.full(len(up), 0.01, np.float32)
    billow = np.zeros(len(up), np.float32)
    for grain, weight in ((0.9, 0.5), (0.31, 0.3), (0.12, 0.2)):
        level = np.zeros_like(x)
        billow += np.float32(weight) * _smooth(x, y, level, grain, fine)
    thick = np.clip(billow * np.float32(0.9) + np.float32(0.2), 0.0, 1.0)
    rising = np.clip(directions[2] * 30.0, 0.0, 1.0)
    share: Singles = thick * rising
    return share


def _smooth(x: Singles, y: Singles, z: Singles, grain: float, fine: Singles) -> Singles:
    """Mean of the four voxels around a point, weighted by nearness."""
    noise = volume_noise()
    column0, row0 = np.floor(x / np.float32(grain)), np.floor(y / np.float32(grain))
    fx, fy = x / np.float32(grain) - column0, y / np.float32(grain) - row0
    total = np.zeros_like(x)
    for dx, wx in ((0, 1 - fx), (1, fx)):
        for dy, wy in ((0, 1 - fy), (1, fy)):
            places = ((column0 + dx + 0.5) * grain, (row0 + dy + 0.5) * grain, z)
            total += wx * wy * noise.sample(places, grain, fine)
    return total
