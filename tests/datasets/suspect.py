"""Suspect places, and what `prepare photos` says of each."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from PIL import Image

from airzoo_bench.datasets.plausibility import Kind
from tests.datasets.suspect_places import (
    cloud_beside,
    coarse,
    coloured,
    copied,
    cut_surface,
    flipped,
    high_cloud,
    hole,
    in_beijing_1954,
    in_feet,
    in_float32,
    in_one_line,
    lowered,
    moved,
    no_metadata,
    one_far,
    one_height,
    retag,
    same_pose,
    shifted,
    shifted_holes,
    small_map,
    tower,
    two_cameras,
    two_flights,
    zeros,
)
from tests.datasets.tagged import LEVEL, NAMES
from tests.support import Place, write_raster

SUSPECT: dict[str, tuple[Callable[[Place], Any], list[str], set[Kind]]] = {
    "poses 40 m away": (
        moved,
        ["poses are 38.5", "all to one side (+38.5 m east, +1.5 m north)"],
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
        ["the priors' yaw is 180 degrees off in 2 of 4 (park/b, park/c)"],
        {Kind.TURNED},
    ),
    "yaw of another axis": (
        retag(NAMES, yaw=92.0),
        ["yaw is 90 degrees too large in 4 of 4 (first 3: park/a, park/b, park/c)"],
        {Kind.TURNED},
    ),
    "pitch negated": (
        retag(NAMES, pitch=89.0),
        ["pitch has the wrong sign in 4 of 4"],
        {Kind.TURNED},
    ),
    "pitch from nadir": (
        retag(NAMES, pitch=-3.0),
        ["pitch is counted from nadir in 4 of 4"],
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
    "copies": (
        copied,
        ["2 of 4 photos are copies of another, the same bytes: a.jpg = b.jpg = c"],
        {Kind.COPIES},
    ),
    "two cameras": (
        two_cameras,
        [
            "scene park has photos of 2 cameras with one camera matrix (FC300S, 64x48 px: 2 "
            "(a.jpg, b.jpg); FC6310, 64x48 px: 2 (c.jpg, sub/d.jpg)): give each image its own K",
        ],
        {Kind.CAMERAS},
    ),
    "two sizes": (
        lambda p: Image.new("L", (64, 40)).save(p.images / "b.jpg"),
        ["matrix (camera not stated, 64x40 px: 1 (b.jpg); camera not stated, 64x48 px: 3 (a.jpg"],
        {Kind.CAMERAS},
    ),
    "two flights": (
        two_flights,
        ["were taken from 2016-06-23 to 2019-07-01: one surface"],
        {Kind.DAYS},
    ),
    "one pose twice": (
        same_pose,
        ["1 of 4 photos (park/b) has the pose of another"],
        {Kind.SAME_POSE},
    ),
    "float32": (in_float32, ["have gone through float32: an error of 0.1"], {Kind.FLOAT32}),
    "two places": (
        in_one_line,
        ["taken from 2 places, and aligning a reconstruction needs 3"],
        {Kind.PLACES},
    ),
    "two heights": (one_height, ["no height near 4 of 4 cameras"], {Kind.NO_HEIGHT}),
    "a tower": (tower, ["1 of 4 cameras is below the surface model"], {Kind.BELOW}),
    "angles of another kind": (
        retag(NAMES, yaw=30.0),
        ["the priors' rotation is 30 degrees off (median)"],
        {Kind.ROTATION},
    ),
    "one height everywhere": (
        lambda p: write_raster(p.dsm, np.full_like(LEVEL, 100.0)) and None,
        ["the surface model is flat: every height is exactly 100 m"],
        {Kind.FLAT},
    ),
    "a cloud elsewhere": (
        cloud_beside,
        ["the true cloud has no point over a height"],
        {Kind.NO_CLOUD},
    ),
    "a map that is masked": (
        coloured(0, 0.97, 0),
        ["only 3.1% of the map shows anything"],
        {Kind.LITTLE_SHOWN},
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
    "a map upside down": (
        flipped(np.s_[:, ::-1]),
        ["the map is upside down against the surface model, by their empty pixels"],
        {Kind.FLIPPED},
    ),
    "a map mirrored": (
        flipped(np.s_[:, :, ::-1]),
        ["the map is mirrored against the surface"],
        {Kind.FLIPPED},
    ),
    "pixels not square": (
        lambda p: p.change_poses(K=[[64.0, 0, 32], [0, 72.0, 24], [0, 0, 1]]),
        ["fx is 0.89 times fy in 4 of 4 (first 3: park/a, park/b, park/c)"],
        {Kind.NOT_SQUARE},
    ),
    "one pose far from GPS": (
        one_far,
        ["poses are far from their own photos' GPS in 1 of 4 (park/a by 60 m), others are not"],
        {Kind.GPS_APART},
    ),
    "a surface model of a part": (
        cut_surface(100),
        ["the surface model lies below only 16% of the map", "only 6% of the photos' corners lie"],
        {Kind.LITTLE_SURFACE, Kind.OFF_SURFACE},
    ),
    "one tile": (
        lambda p: {"tile_size": 256},
        ["every tile answers every photo"],
        {Kind.EVERY_TILE},
    ),
    "few tiles": (
        lambda p: {"tile_size": 150},
        ["a random tile answers a photo in 67% of cases"],
        {Kind.CHANCE},
    ),
    "a plane of another datum": (
        lambda p: {"plane_height": 60},
        ["the ground plane is at 60.0 m, and the surface model is 99.5 to 100.0 m high"],
        {Kind.PLANE},
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
    "map shifted": (
        shifted,
        ["the map lies 30.0", "moved by -30.0 columns and +0.0"],
        {Kind.SHIFT},
    ),
    "map shifted, of another size": (
        shifted_holes,
        ["the map lies 10.8", "by their empty pixels: moved by -9.0 columns and +6.0 rows"],
        {Kind.SHIFT},
    ),
    "cloud of another datum": (
        high_cloud,
        ["the true cloud is +27.5 m from the surface model"],
        {Kind.CLOUD},
    ),
    "a map of one photo": (
        small_map,
        ["only 12% of the photos' corners lie on the map", "1 of 1 all of it", "more than half"],
        {Kind.OFF_MAP, Kind.CROPS},
    ),
    "a datum that PROJ cannot convert": (
        in_beijing_1954,
        ["poses and GPS have different datums, and PROJ knows no way from Beijing 1954 to WGS84"],
        {Kind.DATUM},
    ),
    "a coarse map": (coarse, ["a photo sees 12 pixels of the map"], {Kind.COARSE}),
}
