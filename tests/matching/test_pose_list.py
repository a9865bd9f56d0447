"""Poses a line each, as hloc and AerialExtreMatch write them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.matching.pose_list import read_pose_list
from airzoo_bench.matching.predictions import GivenPoses
from tests.support import run_main

# A quarter turn about x: y becomes z. With t = (1, 2, 3) the centre is -R^T t = (-1, -3, 2).
LIMIT = 1 << 24
TURN = f"{0.5**0.5!r} {0.5**0.5!r} 0 0 1 2 3"


def written(folder: Path, text: str) -> Path:
    path = folder / "poses.txt"
    path.write_text(text, encoding="utf-8")
    return path


def test_lines_become_poses(tmp_path: Path) -> None:
    text = f"# name q t\n\n  # more\nhills/a.jpg {TURN}\nhills/b.PNG 1 0 0 0 4 5 6\n"
    read = read_pose_list(written(tmp_path, text), LIMIT)
    assert isinstance(read.content, GivenPoses)
    assert (read.protocol, read.content.kind) == (None, "poses")
    assert read.query_ids.tolist() == ["hills/a", "hills/b"]
    assert read.content.found.all()
    np.testing.assert_allclose(read.content.poses.centres, [[-1, -3, 2], [-4, -5, -6]], atol=1e-12)
    np.testing.assert_allclose(
        read.content.poses.rotation[0], [[1, 0, 0], [0, 0, -1], [0, 1, 0]], atol=1e-12
    )


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("hills/a.b.JPG", "hills/a.b"),
        ("hills/a.b", "hills/a.b"),
        ("v1.2/a", "v1.2/a"),
        ("hills/2024.10.02", "hills/2024.10.02"),
        ("hills/sub/a.tiff", "hills/sub/a"),
    ],
)
def test_only_the_ending_of_a_photo_is_taken_off(tmp_path: Path, name: str, expected: str) -> None:
    assert read_pose_list(written(tmp_path, f"{name} {TURN}"), LIMIT).query_ids.tolist() == [
        expected
    ]


def test_names_may_have_spaces(tmp_path: Path) -> None:
    read = read_pose_list(written(tmp_path, f"  hills/DJI  (1).JPG {TURN}\n"), LIMIT)
    assert read.query_ids.tolist() == ["hills/DJI  (1)"]
    for number in ("0001", "nan", "1e5 x.jpg 2"):
        with pytest.raises(PredictionError, match="rows without 8 columns"):
            read_pose_list(written(tmp_path, f"hills/DJI {number} {TURN}\n"), LIMIT)


@pytest.mark.parametrize("failure", ["1 0 0 0 0 0 0", "nan " * 7])
def test_failures_are_no_poses(tmp_path: Path, failure: str) -> None:
    content = read_pose_list(
        written(tmp_path, f"hills/a {failure}\nhills/b {TURN}\n"), LIMIT
    ).content
    assert isinstance(content, GivenPoses)
    assert content.found.tolist() == [False, True]


BAD = {
    "": ["holds no pose", "name qw qx qy qz tx ty tz"],
    "# only a comment\n": ["holds no pose"],
    "hills/a 1 0 0 0 1 2\n": ["rows without 8 columns", "row 1"],
    f"hills/a {TURN}\nhills/b 1 0 0 0 1 2 3 4\n": ["1 of 2", "row 2"],
    "hills/a one 0 0 0 1 2 3\n": ["not numbers in the row of hills/a"],
    "hills/a 2 0 0 0 1 2 3\n": ["not of unit length", "hills/a", "length 2", "normalise", "order"],
    "hills/a 0 0 0 0 1 2 3\n": ["not of unit length", "length 0"],
    "hills/a 1 0 0 0 nan 2 3\n": ["in part", "hills/a", "all seven"],
    "hills/a 1 0 0 inf 1 2 3\n": ["in part"],
    "hills/\x1b[31ma 1 0 0 0 1 2 3\n": ["cannot be ids", "row 1"],
    f"{'a' * 300} 1 0 0 0 1 2 3\n": ["cannot be ids"],
}


@pytest.mark.parametrize("text", BAD)
def test_bad_lines(tmp_path: Path, text: str) -> None:
    path = written(tmp_path, text)
    with pytest.raises(PredictionError) as caught:
        read_pose_list(path, LIMIT)
    assert str(path) in str(caught.value)
    assert caught.value.expected
    for fragment in BAD[text]:
        assert fragment in str(caught.value)


def test_not_text(tmp_path: Path) -> None:
    path = tmp_path / "poses.txt"
    path.write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(PredictionError, match=r"poses\.txt"):
        read_pose_list(path, LIMIT)
    with pytest.raises(PredictionError, match=r"absent\.txt"):
        read_pose_list(tmp_path / "absent.txt", LIMIT)


def test_the_command_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = written(tmp_path, "hills/a 2 0 0 0 1 2 3\n")
    ask = ("--protocol", "photos-matching", "--data", tmp_path)
    for command, code in ((("eval", "matching"), 2), (("check",), 1)):
        assert run_main(*command, path, *ask) == code
        assert "not of unit length" in capsys.readouterr().err
    far = written(tmp_path, f"hills/a {TURN.rsplit(' ', 1)[0]} 1e200\n")
    assert run_main("check", far, *ask) == 1
    path = written(tmp_path, f"a {TURN}\nphotos/a {TURN}\nphotos/a {TURN}\n")
    assert run_main("check", path, "--protocol", "photos-matching", "--data", tmp_path) == 1


def test_a_camera_beyond_all_space_is_refused(tmp_path: Path) -> None:
    with pytest.raises(PredictionError, match=r"poses\.txt: translations .* 1e\+12 in 1 of 1 \(h"):
        read_pose_list(written(tmp_path, f"hills/a {TURN.rsplit(' ', 1)[0]} 1e200\n"), LIMIT)
