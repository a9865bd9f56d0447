"""Prediction files of the matching track: right ones, and the faults of others."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from airzoo_bench.geometry.poses import Poses
from tests.geometry.support import looking_down
from tests.matching.world import without

LIMIT = 1 << 20
IDS = ["hills/a", "hills/b"]
MATCHES: dict[str, Any] = {
    "protocol": "photos-matching",
    "query_ids": IDS,
    "offsets": np.array([0, 2, 5]),
    "query_xy": np.arange(10.0).reshape(5, 2),
    "map_xy": np.arange(10.0, 20.0).reshape(5, 2),
}
POINTS = np.arange(15.0).reshape(5, 3) + np.array((500_000, 5_200_000, 100))
PAIRS = without(MATCHES, "map_xy") | {"points3d": POINTS}
CENTRES = np.array([[500_000.0, 5_200_000.0, 200.0], [500_010.0, 5_200_020.0, 210.0]])
TRUE = Poses.from_centres(np.concatenate([looking_down(10, 30), looking_down(20, 80)]), CENTRES)
RT = np.concatenate([TRUE.rotation, TRUE.translation[:, :, None]], axis=2)
POSES = {"protocol": "photos-matching", "query_ids": IDS, "poses": RT}
CENTRED = without(POSES, "poses") | {"rotations": TRUE.rotation, "centres": CENTRES}
NAN_ROW = np.where(np.arange(5)[:, None] == 3, np.nan, MATCHES["query_xy"])


def written(path: Path, fields: dict[str, Any]) -> Path:
    np.savez(path, **{key: np.asarray(value) for key, value in fields.items()})
    return path


SCALED = RT * np.array([2.0, 2.0, 2.0, 1.0])
MIRRORED = RT * np.array([-1.0, 1.0, 1.0, 1.0])
PARTLY = np.where(np.arange(12).reshape(3, 4) == 11, np.nan, RT)

# What is refused when the file is read: fields, and what the message holds.
UNREADABLE: dict[str, tuple[dict[str, Any], list[str]]] = {
    "no matches": (
        without(MATCHES, "map_xy"),
        ["lacks the field map_xy", "or poses", "template"],
    ),
    "no ids": (without(MATCHES, "query_ids"), ["lacks the field query_ids"]),
    "no offsets": (without(MATCHES, "offsets"), ["lacks the field offsets"]),
    "no pixels, pairs": (without(PAIRS, "query_xy"), ["lacks the field query_xy"]),
    "no ids, poses": (without(POSES, "query_ids"), ["lacks the field query_ids"]),
    "nothing": ({}, ["lacks the fields", "it has: none"]),
    "two kinds": (
        MATCHES | {"points3d": POINTS},
        ["holds map_xy and points3d", "disagree", "keep one"],
    ),
    "all kinds": (MATCHES | POSES | {"points3d": POINTS}, ["map_xy and points3d and poses"]),
    "misspelt": (MATCHES | {"image_sizes": [[1, 1]] * 2}, ["'image_sizes'", "not read here"]),
    "frame of pairs": (PAIRS | {"map_frame": "crop"}, ["not read here", "map_frame"]),
    "other frame": (MATCHES | {"map_frame": "dom"}, ["'map_frame' is 'dom'", "'crop'"]),
    "frame a number": (MATCHES | {"map_frame": 1}, ["'map_frame' is not one text"]),
    "frames": (MATCHES | {"map_frame": ["crop", "map"]}, ["not one text"]),
    "x y 1": (
        MATCHES | {"query_xy": np.ones((5, 3))},
        ["'query_xy' is float64 of shape (5, 3)", "(any, 2)"],
    ),
    "flat": (MATCHES | {"map_xy": np.ones(10)}, ["'map_xy' is float64 of shape (10,)"]),
    "flat points": (PAIRS | {"points3d": np.ones((5, 2))}, ["'points3d' is", "(any, 3)"]),
    "coarse points": (
        PAIRS | {"points3d": POINTS.astype(np.float32)},
        ["'points3d' is float32", "0.5 m only", "expected: float64"],
    ),
    "points through float32": (
        PAIRS | {"points3d": (POINTS + np.pi * np.arange(5)[:, None]).astype("f4").astype("f8")},
        ["'points3d' went through float32", "0.5 m only", "expected: float64"],
    ),
    "coarse centres": (
        CENTRED | {"centres": CENTRES.astype(np.float32)},
        ["'centres' is float32", "0.5 m only"],
    ),
    "rows differ": (
        MATCHES | {"map_xy": np.ones((4, 2))},
        ["'map_xy' has 4 rows, 'query_xy' has 5"],
    ),
    "counts": (
        MATCHES | {"offsets": [2, 3]},
        ["'offsets' has 2 entries for 2 queries", "expected: 3", "np.cumsum"],
    ),
    "float offsets": (MATCHES | {"offsets": [0.0, 2.0, 5.0]}, ["'offsets' is float64", "integers"]),
    "square offsets": (MATCHES | {"offsets": [[0, 2, 5]]}, ["of shape (1, 3)"]),
    "one size": (MATCHES | {"image_size": [64, 48]}, ["'image_size' is", "(any, 2)"]),
    "few sizes": (MATCHES | {"image_size": [[64, 48]]}, ["'image_size' has 1 row"]),
    "float sizes": (MATCHES | {"image_size": [[64.0, 48.0]] * 2}, ["integers"]),
    "ids are numbers": (MATCHES | {"query_ids": [1, 2]}, ["'query_ids' is int64"]),
    "4x4": (
        POSES | {"poses": np.tile(np.eye(4), (2, 1, 1))},
        ["'poses' is float64 of shape (2, 4, 4)", "(any, 3, 4)"],
    ),
    "few poses": (POSES | {"poses": RT[:1]}, ["'poses' has 1 row, 'query_ids' has 2"]),
    "nan in part": (
        POSES | {"poses": PARTLY},
        ["2 poses are NaN or infinite in part", "NaN in all of it"],
    ),
    "infinite": (POSES | {"poses": np.full((2, 3, 4), np.inf)}, []),
    "beyond measure": (
        POSES | {"poses": np.where(np.arange(4) == 3, 1e300, RT)},
        ["translations have entries beyond 1e+12", "hills/a", "field 'poses'", "NaN in all"],
    ),
    "scaled": (POSES | {"poses": SCALED}, ["not orthonormal", "hills/a", "field 'poses'", "fix"]),
    "no rotations": (without(CENTRED, "rotations"), ["lacks the field rotations"]),
    "poses twice": (CENTRED | {"poses": RT}, ["holds poses and centres", "disagree"]),
    "few centres": (CENTRED | {"centres": CENTRES[:1]}, ["'centres' has 1 row"]),
    "centre without rotation": (
        CENTRED | {"rotations": np.full((2, 3, 3), np.nan)},
        ["2 poses are NaN or infinite in part", "'rotations' and 'centres'"],
    ),
    "scaled rotations": (CENTRED | {"rotations": 2 * TRUE.rotation}, ["not orthonormal"]),
    "mirrored": (POSES | {"poses": MIRRORED}, ["reflection", "hills/a", "axes"]),
}


# What `check` lists and `eval` stops at.
FAULTY: dict[str, tuple[dict[str, Any], list[str]]] = {
    "offsets short": (
        MATCHES | {"offsets": [0, 2, 4]},
        ["do not add up: from 0 to 4", "rising from 0 to 5", "np.cumsum"],
    ),
    "offsets from 1": (MATCHES | {"offsets": [1, 2, 5]}, ["from 1 to 5"]),
    "offsets fall": (MATCHES | {"offsets": [0, 7, 5]}, ["falling first at query hills/b"]),
    "offsets wrap": (
        {
            **MATCHES,
            "query_ids": ["hills/a", "hills/b", "hills/c", "hills/d"],
            "offsets": [0, 2**63 - 1, -(2**63), -1, 5],
        },
        ["do not add up", "falling first at query hills/b"],
    ),
    "nan": (
        MATCHES | {"query_xy": NAN_ROW},
        ["1 row is NaN", "hills/b", "field 'query_xy'", "leave out"],
    ),
    "nan on map": (MATCHES | {"map_xy": NAN_ROW}, ["hills/b", "field 'map_xy'"]),
    "infinite points": (
        PAIRS | {"points3d": np.where(POINTS[0, 0] == POINTS, np.inf, POINTS)},
        ["hills/a", "field 'points3d'"],
    ),
    "twice": (MATCHES | {"query_ids": ["hills/a"] * 2}, ["more than once", "hills/a"]),
    "no scene": (MATCHES | {"query_ids": ["a", "b"]}, ["without a scene"]),
}
