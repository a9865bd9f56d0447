"""What a prediction file of the matching track may hold, and what a bad one gets."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.matching.predictions import (
    Correspondences,
    GivenPoses,
    MatchingPredictions,
    read_matching,
)
from tests.geometry.support import looking_down
from tests.matching.world import without

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


def read(folder: Path, fields: dict[str, Any]) -> MatchingPredictions:
    np.savez(folder / "p.npz", **{key: np.asarray(value) for key, value in fields.items()})
    return read_matching(folder / "p.npz", 1 << 20)


def test_matches_and_pairs_are_read_as_they_are(tmp_path: Path) -> None:
    size = np.array([[64, 48], [32, 24]])
    found = read(tmp_path, MATCHES | {"image_size": size, "map_frame": "crop"})
    assert (found.protocol, found.query_ids.tolist()) == ("photos-matching", IDS)
    assert isinstance(found.content, Correspondences)
    for name, values in (MATCHES | {"image_size": size}).items():
        if name not in ("protocol", "query_ids"):
            np.testing.assert_array_equal(getattr(found.content, name), values)
    assert (found.content.kind, found.content.map_frame) == ("matches", "crop")
    pairs = read(tmp_path, PAIRS).content
    assert (pairs.kind, getattr(pairs, "map_xy", 0)) == ("pairs", None)
    none = {"offsets": [0, 0, 0], "query_xy": np.zeros((0, 2)), "map_xy": np.zeros((0, 2))}
    assert read(tmp_path, MATCHES | none).content.kind == "matches"
    for kind in ("i1", "u2", "i8", "f2", "f4", "f8"):
        whole = read(tmp_path, MATCHES | {"query_xy": np.full((5, 2), 7, kind)}).content
        assert isinstance(whole, Correspondences)
        assert whole.query_xy.dtype == np.float64
        assert whole.query_xy.tolist() == [[7.0, 7.0]] * 5


def test_poses_are_world_to_camera_and_nan_is_none(tmp_path: Path) -> None:
    values = RT.copy()
    values[1] = np.nan
    for fields in (POSES | {"poses": values}, CENTRED):
        content = read(tmp_path, fields).content
        assert isinstance(content, GivenPoses)
        assert content.kind == "poses"
        assert content.has_pose.tolist() == [True, "centres" in fields]
        np.testing.assert_allclose(content.poses.centres[0], CENTRES[0], rtol=0, atol=1e-8)


# Fields, and what the message names.
UNREADABLE: dict[str, tuple[dict[str, Any], list[str]]] = {
    "nothing": ({}, ["query_ids"]),
    "frame of pairs": (PAIRS | {"map_frame": "crop"}, ["map_frame"]),
    "frames": (MATCHES | {"map_frame": ["crop", "map"]}, ["'map_frame'"]),
    "coarse points": (PAIRS | {"points3d": POINTS.astype("f4")}, ["'points3d'", "float64"]),
    "points through float32": (
        PAIRS | {"points3d": (POINTS + np.pi * np.arange(5)[:, None]).astype("f4").astype("f8")},
        ["'points3d'", "float32", "0.5 m", "float64"],
    ),
    "coarse centres": (CENTRED | {"centres": CENTRES.astype("f4")}, ["'centres'", "0.5 m"]),
    "no numbers": (MATCHES | {"offsets": ["0", "2", "5"]}, ["'offsets'"]),
    "NaN offsets": (MATCHES | {"offsets": [0.0, np.nan, 5.0]}, ["'offsets'"]),
    "few sizes": (MATCHES | {"image_size": [[64, 48]]}, ["'image_size'"]),
    "beyond measure": (
        POSES | {"poses": np.where(np.arange(4) == 3, 1e300, RT)},
        ["'poses'", "hills/a", "1e+12"],
    ),
    "centre without rotation": (
        CENTRED | {"rotations": np.full((2, 3, 3), np.nan)},
        ["'rotations'", "hills/a"],
    ),
    "counts": (MATCHES | {"offsets": [2, 3]}, ["field 'offsets'", "2 queries", "np.cumsum"]),
    "offsets that wrap around": (
        MATCHES
        | {"query_ids": ["h/a", "h/b", "h/c", "h/d"], "offsets": [0, 2**63 - 1, -(2**63), -1, 5]},
        ["field 'offsets'", "h/b"],
    ),
    "infinite points": (
        PAIRS | {"points3d": np.where(POINTS[0, 0] == POINTS, np.inf, POINTS)},
        ["field 'points3d'", "hills/a"],
    ),
}


@pytest.mark.parametrize("case", UNREADABLE)
def test_unreadable(tmp_path: Path, case: str) -> None:
    fields, names = UNREADABLE[case]
    with pytest.raises(PredictionError) as caught:
        read(tmp_path, fields)
    assert caught.value.expected
    for name in ("p.npz", *names):
        assert name in str(caught.value)


# --- poses, a line each -------------------------------------------------------------------------

# A quarter turn about x: y becomes z. With t = (1, 2, 3) the centre is -R^T t = (-1, -3, 2).
TURN = f"{0.5**0.5!r} {0.5**0.5!r} 0 0 1 2 3"


def listed(folder: Path, text: str) -> MatchingPredictions:
    (folder / "poses.txt").write_text(text, encoding="utf-8")
    return read_matching(folder / "poses.txt", 1 << 20)


def test_lines_become_poses(tmp_path: Path) -> None:
    found = listed(
        tmp_path,
        f"# name q t\n\n  # more\nhills/a.b.jpg {TURN}\n hills/DJI  01.PNG 1 0 0 0 4 5 6\n"
        f"hills/2024.10.02 1 0 0 0 0 0 0\nhills/c {'nan ' * 7}\n",
    )
    assert isinstance(found.content, GivenPoses)
    names = ["hills/a.b", "hills/DJI  01", "hills/2024.10.02", "hills/c"]
    assert found.query_ids.tolist() == names
    assert found.content.has_pose.tolist() == [True, True, False, False]
    centres, rotation = found.content.poses.centres, found.content.poses.rotation[0]
    np.testing.assert_allclose(centres[:2], [[-1, -3, 2], [-4, -5, -6]], atol=1e-12)
    np.testing.assert_allclose(rotation, [[1, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-12)


BAD_LINES = {
    "": "name qw qx qy qz tx ty tz",
    "hills/a 1 0 0 0 1 2\n": "row 1",
    f"hills/a {TURN}\nhills/b 0 0 0 1 2 3\n": "row 2",
    "hills/a one 0 0 0 1 2 3\n": "hills/a",
    "hills/a 2 0 0 0 1 2 3\n": "hills/a (norm = 2)",
    "hills/a 1 0 0 0 nan 2 3\n": "hills/a",
    "hills/a 1 0 0 inf 1 2 3\n": "hills/a",
    "hills/\x1b[31ma 1 0 0 0 1 2 3\n": "row",
    f"hills/a {TURN.rsplit(' ', 1)[0]} 1e200\n": "hills/a",
    f"a {TURN}\n": "'query_ids'",
}


@pytest.mark.parametrize("text", BAD_LINES)
def test_bad_lines(tmp_path: Path, text: str) -> None:
    with pytest.raises(PredictionError) as caught:
        listed(tmp_path, text)
    assert "poses.txt" in str(caught.value)
    assert BAD_LINES[text] in str(caught.value)
