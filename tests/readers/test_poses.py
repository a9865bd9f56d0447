"""Poses as text and in COLMAP models: what they mean, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from airzoo_bench.core.errors import PredictionError, UserError
from airzoo_bench.evaluation.reader import find_reader
from tests.matching.world import World
from tests.readers import matching_files

Evaluated = Callable[..., Any]


def test_hloc_results_score_as_the_same_poses_do(
    world: World, tmp_path: Path, evaluated: Evaluated
) -> None:
    path = matching_files.write_hloc_poses(tmp_path, world)
    assert find_reader(path) == "hloc-poses"
    found = evaluated(path)
    assert found.overall["error_m"] < 1e-6
    own = [f"hills/{line}" for line in matching_files.hloc_lines(world).values()]
    same = evaluated(matching_files.write_lines(tmp_path / "own.txt", own))
    assert same.overall == found.overall
    assert same.result.predictions.reader is None
    used = found.result.predictions.reader
    assert used.name == "hloc-poses"
    assert "quaternions w x y z" in used.conventions[0]


def test_the_identity_is_no_pose(world: World, tmp_path: Path, evaluated: Evaluated) -> None:
    lines = matching_files.hloc_lines(world)
    lines["q1.png"] = f"q1.png {matching_files.IDENTITY}"
    lines["other.png"] = f"other.png {matching_files.IDENTITY}"
    path = matching_files.write_lines(tmp_path / "mast3r_ltvl.txt", list(lines.values()))
    found = evaluated(path)
    assert found.records.set_index("query").loc["hills/q1", "error_m"] == float("inf")
    notes = " | ".join(found.result.notes)
    assert "1 pose of photos that are no queries left out" in notes
    assert "1 photo at the identity or NaN count as not found" in notes


@pytest.mark.parametrize(
    ("name", "write"), [("tum", matching_files.write_tum), ("kitti", matching_files.write_kitti)]
)
def test_trajectories_with_names(
    name: str, write: Callable[..., Path], world: World, tmp_path: Path, evaluated: Evaluated
) -> None:
    path = write(tmp_path, world)
    assert find_reader(path) is None
    assert find_reader(path, "matching") == name
    found = evaluated(path, names=tmp_path / "names.txt")
    assert found.overall["error_m"] < 1e-6
    assert found.result.predictions.reader.name == name
    with pytest.raises(UserError, match="5 poses, and 0 names"):
        evaluated(path)
    matching_files.write_lines(tmp_path / "names.txt", ["q0.png"])
    with pytest.raises(UserError, match="5 poses, and 1 name"):
        evaluated(path, names=tmp_path / "names.txt")


def test_another_order_of_quaternions_is_refused(
    world: World, tmp_path: Path, evaluated: Evaluated
) -> None:
    """CUT3R's pred_traj.txt looks like TUM's, and has w first."""
    path = matching_files.write_tum(tmp_path, world)
    rows = [line.split() for line in path.read_text().splitlines()]
    matching_files.write_lines(path, [" ".join([*row[:4], row[7], *row[4:7]]) for row in rows])
    with pytest.raises(PredictionError, match="quaternions in the order w x y z"):
        evaluated(path, names=tmp_path / "names.txt")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("q0.png 1 0 0 0 1 2\n", "row 1 has 7 columns"),
        ("q0.png 1 0 0 0 1 2 x\n", "words where numbers should be"),
        ("", "holds no pose"),
        ("zz.png 1 0 0 0 1 2 3\n", "none of its names is that of a query"),
        ("q0.png 1 0 0 0 1 2 3\nx/q0.jpg 1 0 0 0 1 2 3\n", "are both hills/q0"),
        ("q0.png 2 0 0 0 1 2 3\n", "unit"),
    ],
)
def test_refusals(
    text: str, words: str, world: World, tmp_path: Path, evaluated: Evaluated
) -> None:
    path = tmp_path / "r.txt"
    path.write_text(text)
    with pytest.raises(PredictionError, match=words):
        evaluated(path, reader="hloc-poses")


def test_a_colmap_model_below_a_folder(world: World, tmp_path: Path, evaluated: Evaluated) -> None:
    home = tmp_path / "out" / "sparse/0"
    home.parent.mkdir(parents=True)
    matching_files.write_colmap(tmp_path, world).rename(home)
    path = tmp_path / "out"
    assert find_reader(path) is None
    assert find_reader(path, "matching") == "colmap-poses"
    found = evaluated(path)
    assert found.overall["error_m"] < 1e-6
    assert "1 pose of photos that are no queries left out" in found.result.notes
