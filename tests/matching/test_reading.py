"""What a prediction file of the matching track may hold, and what a bad one gets."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.matching.predictions import Correspondences, GivenPoses, read_matching
from tests.geometry.support import looking_down

IDS = ["hills/a", "hills/b"]
FILE = {"protocol": "photos-matching", "query_ids": IDS}
PIXELS = {"offsets": np.array([0, 2, 5]), "query_xy": np.arange(10.0).reshape(5, 2)}
MATCHES: dict[str, Any] = FILE | PIXELS | {"map_xy": np.arange(10.0, 20.0).reshape(5, 2)}
POINTS = np.arange(15.0).reshape(5, 3) + np.array((500_000, 5_200_000, 100))
PAIRS = FILE | PIXELS | {"points3d": POINTS}
CENTRES = np.array([[500_000.0, 5_200_000.0, 200.0], [500_010.0, 5_200_020.0, 210.0]])
TRUE = Poses.from_centres(np.concatenate([looking_down(10, 30), looking_down(20, 80)]), CENTRES)
RT = np.concatenate([TRUE.rotation, TRUE.translation[:, :, None]], axis=2)
POSES = FILE | {"poses": RT}
CENTRED = FILE | {"rotations": TRUE.rotation, "centres": CENTRES}
# A quarter turn about x: y becomes z. With t = (1, 2, 3) the centre is -R^T t = (-1, -3, 2).
TURN = f"{0.5**0.5!r} {0.5**0.5!r} 0 0 1 2 3"


def read(folder: Path, given: Any) -> Any:
    """Read fields of an npz, or lines of poses."""
    path = folder / ("p.txt" if isinstance(given, str) else "p.npz")
    if isinstance(given, str):
        path.write_text(given, encoding="utf-8")
    else:
        np.savez(path, **{key: np.asarray(value) for key, value in given.items()})
    return read_matching(path, 1 << 20)


def test_matches_and_pairs_are_read_as_they_are(tmp_path: Path) -> None:
    size = np.array([[64, 48], [32, 24]])
    found = read(tmp_path, MATCHES | {"image_size": size, "map_frame": "crop"})
    assert (found.protocol, found.query_ids.tolist()) == ("photos-matching", IDS)
    assert isinstance(found.content, Correspondences)
    for name, values in (MATCHES | {"image_size": size}).items():
        if name not in FILE:
            np.testing.assert_array_equal(getattr(found.content, name), values)
    assert (found.content.kind, found.content.map_frame) == ("matches", "crop")
    assert read(tmp_path, PAIRS).content.kind == "pairs"
    none = {"offsets": [0, 0, 0], "query_xy": np.zeros((0, 2)), "map_xy": np.zeros((0, 2))}
    assert read(tmp_path, MATCHES | none).content.kind == "matches"
    for kind in ("i1", "u2", "f2", "f4"):
        whole = read(tmp_path, MATCHES | {"query_xy": np.full((5, 2), 7, kind)}).content
        assert whole.query_xy.dtype == np.float64
        assert whole.query_xy.tolist() == [[7.0, 7.0]] * 5


def test_poses_are_world_to_camera_and_nan_is_none(tmp_path: Path) -> None:
    values = RT.copy()
    values[1] = np.nan
    for fields in (POSES | {"poses": values}, CENTRED):
        content = read(tmp_path, fields).content
        assert isinstance(content, GivenPoses)
        assert content.has_pose.tolist() == [True, "centres" in fields]
        np.testing.assert_allclose(content.poses.centres[0], CENTRES[0], rtol=0, atol=1e-8)


def test_lines_become_poses(tmp_path: Path) -> None:
    found = read(
        tmp_path,
        f"# name q t\n\n  # more\nhills/a.b.jpg {TURN}\n hills/DJI  01.PNG 1 0 0 0 4 5 6\n"
        f"hills/2024.10.02 1 0 0 0 0 0 0\nhills/c {'nan ' * 7}\n",
    )
    names = ["hills/a.b", "hills/DJI  01", "hills/2024.10.02", "hills/c"]
    assert found.query_ids.tolist() == names
    assert found.content.has_pose.tolist() == [True, True, False, False]
    centres, rotation = found.content.poses.centres, found.content.poses.rotation[0]
    np.testing.assert_allclose(centres[:2], [[-1, -3, 2], [-4, -5, -6]], atol=1e-12)
    np.testing.assert_allclose(rotation, [[1, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-12)


FAR = {"poses": np.where(np.arange(4) == 3, 1e300, RT)}
NOT_TURNED = {"rotations": np.full((2, 3, 3), np.nan)}
SINGLE = (POINTS + np.pi * np.arange(5)[:, None]).astype("f4").astype("f8")
WRAPPED = [0, 2**63 - 1, -(2**63), -1, 5]
# What the file holds, and what the message names: faults beyond those of tests/goldens.
UNREADABLE: dict[str, tuple[Any, list[str]]] = {
    "frame of pairs": (PAIRS | {"map_frame": "crop"}, ["map_frame"]),
    "coarse points": (PAIRS | {"points3d": POINTS.astype("f4")}, ["'points3d'", "float64"]),
    "points through float32": (PAIRS | {"points3d": SINGLE}, ["'points3d'", "float32", "0.5 m"]),
    "coarse centres": (CENTRED | {"centres": CENTRES.astype("f4")}, ["'centres'", "0.5 m"]),
    "few sizes": (MATCHES | {"image_size": [[64, 48]]}, ["'image_size'"]),
    "beyond measure": (POSES | FAR, ["'poses'", "hills/a", "1e+12"]),
    "no rotation": (CENTRED | NOT_TURNED, ["'rotations'", "hills/a"]),
    "offsets that wrap around": (
        MATCHES | {"query_ids": ["h/a", "h/b", "h/c", "h/d"], "offsets": WRAPPED},
        ["'offsets'", "h/b"],
    ),
    "no lines": ("", ["name qw qx qy qz tx ty tz"]),
    "a norm of two": ("hills/a 2 0 0 0 1 2 3\n", ["hills/a (norm = 2)"]),
    "half a pose": ("hills/a 1 0 0 0 nan 2 3\n", ["hills/a"]),
    "a name that does not print": ("hills/\x1b[31ma 1 0 0 0 1 2 3\n", ["row"]),
    "a line beyond measure": (f"hills/a {TURN[:-1]} 1e200\n", ["hills/a"]),
    "no scene": (f"a {TURN}\n", ["'query_ids'"]),
}


@pytest.mark.parametrize("case", UNREADABLE)
def test_unreadable(tmp_path: Path, case: str) -> None:
    given, names = UNREADABLE[case]
    with pytest.raises(PredictionError) as caught:
        read(tmp_path, given)
    for name in ("p.txt" if isinstance(given, str) else "p.npz", *names):
        assert name in str(caught.value)
