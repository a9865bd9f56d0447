"""What `prepare` and `check-geometry` warn of, each kind with what makes them do so."""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum

from airzoo_bench.datasets.photo_facts import OUTLIER_M
from airzoo_bench.datasets.raster_checks import LOWEST_SHARE

__all__ = ["Found", "Kind"]

FAR_M = 10.0
"""Receivers without correction are good to 5 m in plan; altitudes to 10 m."""
FAR_SHARE = 0.1
"""Of the height above take-off: ground is not level."""
LARGE_ROTATION_DEG = 20.0
LARGE_CROP = 0.5
LIKELY_CHANCE = 0.5
FEW_PIXELS = 32
FEW_ON = 0.5
LEAST_PLACES = 3
CLOUD_M = 5.0
"""A cloud also holds what lies below roofs and crowns."""
ONE_COLOUR = 0.2
LITTLE_SHOWN = 0.1
DAYS_APART = 30
NOT_SQUARE = 0.05


class Kind(Enum):
    """A kind of warning; its value is the line of docs/benchmark-folder.md about it."""

    NOT_SQUARE = f"camera matrices whose fx and fy differ by more than {NOT_SQUARE:.0%}"
    COPIES = "photos that are the same file under several names"
    SAME_POSE = "photos that share their pose, to the last digit, with another photo"
    CAMERAS = (
        "photos of several cameras (by model, serial number and focal length in EXIF, or by size) "
        "that share one camera matrix"
    )
    DAYS = f"photos taken more than {DAYS_APART} days apart"
    NO_PRIOR = "photos without a prior, where other photos have one or a part of one"
    FLOAT32 = "positions of poses that have gone through float32"
    PLACES = f"photos from fewer than {LEAST_PLACES} places, where there is a cloud to reconstruct"
    NO_HEIGHT = "cameras near which the surface model has no height"
    BELOW = "some cameras below the surface model"
    HEIGHT = (
        f"cameras above the surface model by {FAR_M:g} m (and {FAR_SHARE:.0%}) more or less than "
        "their photos say that they are above take-off"
    )
    GPS_PLAN = f"poses more than {FAR_M:g} m from their photos' GPS in plan (median)"
    GPS_HEIGHT = f"poses more than {FAR_M:g} m from their photos' GPS in height (median)"
    GPS_APART = (
        f"single photos whose pose is more than {OUTLIER_M:g} m from their GPS, and ten times as "
        "far as the others'"
    )
    TURNED = (
        "priors turned by more than 45 degrees that one mistake explains: yaw off by 180 or 90 "
        "degrees or with the wrong sign, pitch with the wrong sign or counted from nadir, roll off "
        "by 180 degrees"
    )
    ROTATION = f"priors turned by more than {LARGE_ROTATION_DEG:g} degrees (median), unexplained"
    FLAT = "a surface model all of whose heights are the same"
    LOWEST = (
        f"a lowest height that more than {LOWEST_SHARE:.0%} of the surface model has: perhaps an "
        "untagged nodata value"
    )
    CLOUD = f"a true cloud more than {CLOUD_M:g} m off the surface model in height (median)"
    NO_CLOUD = "a true cloud without a point over a height of the surface model"
    LITTLE_SHOWN = f"a map of which less than {LITTLE_SHOWN:.0%} is not masked"
    ONE_COLOUR = f"a map of which more than {ONE_COLOUR:.0%} is exactly one colour"
    SHIFT = (
        "a map that lies beside the surface model, shown by grids of the same size and pixels with "
        "different corners, or by where both are empty"
    )
    FLIPPED = (
        "a map that is upside down or mirrored against the surface model, by where both are empty"
    )
    OFF_MAP = f"less than {FEW_ON:.0%} of the photos' corners on the map"
    OFF_SURFACE = f"less than {FEW_ON:.0%} of the photos' corners on the surface model"
    LITTLE_SURFACE = f"a surface model below less than {FEW_ON:.0%} of the map"
    COARSE = f"photos that see fewer than {FEW_PIXELS} pixels of the map"
    CROPS = f"crops that take more than {LARGE_CROP:.0%} of the map on average"
    EVERY_TILE = "every tile answers every photo"
    CHANCE = f"a random tile answers in more than {LIKELY_CHANCE:.0%} of cases"


Found = Iterator[tuple[Kind, str]]
"""Kinds of suspicion that were found, each with a sentence."""
