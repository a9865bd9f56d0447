"""Suspect places, and what `prepare photos` says of each."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from airzoo_bench.datasets.plausibility import Kind
from tests.datasets.suspect_places import (
    cloud_beside,
    coloured,
    cut_surface,
    high_cloud,
    hole,
    in_feet,
    in_float32,
    lowered,
    moved,
    no_metadata,
    retag,
    small_map,
    tower,
    zeros,
)
from tests.datasets.tagged import NAMES
from tests.support import Place

SUSPECT: dict[str, tuple[Callable[[Place], Any], list[str], set[Kind]]] = {
    "poses 40 m away": (
        moved,
        ["poses are 38.5", "by +38.5 m east and +1.5 m north"],
        {Kind.GPS_PLAN},
    ),
    "a surface model lowered by 27.5 m": (
        lowered,
        ["cameras are 127.5 m above the surface model", "100.0 m above take-off (+27.5 m): poses"],
        {Kind.HEIGHT},
    ),
    "a surface model in feet": (
        in_feet,
        ["134.4 m above the surface", "in feet, the surface model would fit to 0.0 m"],
        {Kind.HEIGHT},
    ),
    "GPS of another datum": (
        retag(NAMES, up=30.0),
        ["poses are -30.0 m from their own photos' GPS in height"],
        {Kind.GPS_HEIGHT},
    ),
    "yaw turned": (
        retag(NAMES[1:3], yaw=178.0),
        ["degrees off (median) and more than 45 in 2 of 4 (park/b, park/c)"],
        {Kind.TURNED},
    ),
    "no gimbal": (
        retag(NAMES[:1], yaw=None),
        [
            "1 of 4 photos has no prior: 1 (park/a) have no gimbal angles. Matching asks the "
            "other 3, retrieval and reconstruction need none; --priors FILE",
        ],
        {Kind.NO_PRIOR},
    ),
    "no metadata in one": (
        no_metadata,
        ["no prior: 1 (park/a) have no GPS position. Matching"],
        {Kind.NO_PRIOR},
    ),
    "no gimbal at all": (
        retag(NAMES, yaw=None),
        ["4 of 4 photos have no prior: 4 (first 3: park/a, park/b, park/c) have no gimbal angles"],
        {Kind.NO_PRIOR},
    ),
    "float32": (in_float32, ["have gone through float32: an error of 0.1"], {Kind.FLOAT32}),
    "a tower": (tower, ["1 of 4 cameras is below the surface model"], {Kind.BELOW}),
    "angles of another kind": (
        retag(NAMES, yaw=30.0),
        ["the priors' rotation is 30 degrees off (median)"],
        {Kind.TURNED},
    ),
    "a cloud elsewhere": (
        cloud_beside,
        ["the true cloud has no point over a height"],
        {Kind.CLOUD},
    ),
    "a black map": (
        coloured(0, 1.0),
        ["100% of the map is exactly one colour (0 0 0)", "gdalwarp -srcnodata '0 0 0'"],
        {Kind.ONE_COLOUR},
    ),
    "a white collar": (
        coloured(255, 0.3),
        ["30% of the map is exactly one colour (255 255 255)"],
        {Kind.ONE_COLOUR},
    ),
    "a surface model of a part": (
        cut_surface(100),
        ["only 6% of the photos' corners lie on the surface model"],
        {Kind.OFF_MAP},
    ),
    "few tiles": (
        lambda p: {"tile_size": 150},
        ["a random tile answers a photo in 67% of cases"],
        {Kind.CHANCE},
    ),
    "tiles smaller than footprints": (
        lambda p: {"tile_size": 32},
        ["a miss for 100% of the photos, which see 100 m"],
        {Kind.NEAREST_TILE},
    ),
    "untagged zeros": (
        zeros,
        ["8% of the surface model's heights are exactly 0 m", "a_nodata"],
        {Kind.LOWEST},
    ),
    "a small hole of zeros": (
        hole,
        ["2 of the surface model's heights are exactly 0 m, its lowest, and the next is 99.5 m"],
        {Kind.LOWEST},
    ),
    "cloud of another datum": (
        high_cloud,
        ["the true cloud is +27.5 m from the surface model"],
        {Kind.CLOUD},
    ),
    "a map of one photo": (
        small_map,
        ["only 12% of the photos' corners lie on the map"],
        {Kind.OFF_MAP},
    ),
}
