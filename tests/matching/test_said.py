"""What is said of doubtful files, by check as by eval, and the right command for others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.matching.evaluated import evaluated
from tests.matching.world import World
from tests.support import run_main


def test_poor_matches_are_not_suspected_of_a_convention(
    world: World, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    far = [points + np.array((50_000.0, 0, 0)) for points in world.points]
    pairs = world.correspondences(world.query_xy, points3d=far)
    said = " | ".join(evaluated(world, tmp_path, pairs).result.notes)
    assert "5 of 5 poses lie more than 1,000 m" in said
    assert "poor pairs make such poses" in said
    assert "world-to-camera" not in said
    true = world.truth.poses
    away = -np.einsum("nij,nj->ni", true.rotation, true.centres + 5e4 + np.pi)
    poses = world.named(poses=np.concatenate([true.rotation, away[:, :, None]], axis=2))
    # Of centres that are given no convention is asked.
    centred = world.named(rotations=true.rotation, centres=true.centres + 5e4)
    for fields, asked in ((poses, True), (centred, False)):
        said = " | ".join(evaluated(world, tmp_path, fields).result.notes)
        path = world.write(tmp_path / "m.npz", fields)
        assert run_main("check", path, "--data", world.root) == 0
        for told in (said, capsys.readouterr().err):  # check says so too
            assert "all coordinates in the scene's CRS?" in told
            assert ("are they world-to-camera" in told) == asked


def test_check_notes_what_eval_notes(
    world: World, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    outside = [np.vstack([xy, [(-50.0, -50.0)] * 3]) for xy in world.map_xy]
    query_xy = [np.vstack([xy, [(1.0, 1.0)] * 3]) / 2 for xy in world.query_xy]
    fields = world.correspondences(query_xy, map_xy=outside)
    notes = evaluated(world, tmp_path, fields).result.notes
    path = world.write(tmp_path / "m.npz", fields)
    capsys.readouterr()
    assert run_main("check", path, "--data", world.root) == 0
    said = capsys.readouterr().err
    for part in ("could not be lifted", "smaller image", "outside the query's crop"):
        assert any(part in note and note in said for note in notes)


def test_a_protocol_of_another_track_is_named(
    world: World, tmp_path: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = {"protocol": "made-retrieval", "query_ids": ["east/q00000"], "ranked_ids": [["a"]]}
    path = world.write(tmp_path / "r.npz", {k: np.array(v) for k, v in other.items()})
    for command, track in (("matching", "retrieval"), ("reconstruction", "retrieval")):
        assert run_main("eval", command, path, "--data", data) == 2
        message = capsys.readouterr().err
        assert f"is of the {track} track" in message
        assert f"airzoo-bench eval {track}" in message
    path = world.write(tmp_path / "m.npz", world.matches())
    assert run_main("eval", "retrieval", path, "--data", world.root) == 2
    message = capsys.readouterr().err
    assert "airzoo-bench eval matching" in message
    assert "lacks" not in message


@pytest.mark.parametrize("ending", [".jpg", ".JPG", ".Jpeg", ".png", ".TIF", ".webp", ".heic"])
def test_ids_with_endings(
    world: World, tmp_path: Path, ending: str, capsys: pytest.CaptureFixture[str]
) -> None:
    fields = world.matches(query_ids=np.array([name + ending for name in world.ids]))
    path = world.write(tmp_path / "m.npz", fields)
    for command, code in ((("eval", "matching"), 2), (("check",), 1)):
        assert run_main(*command, path, "--data", world.root) == code
        message = capsys.readouterr().err
        assert "leave out the file's ending" in message
        assert "look like those of" not in message


def test_templates_never_replace_a_file(
    world: World, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "mine.npz"
    out.write_bytes(b"mine")
    ask = ("template", "hills-matching", "--data", world.root, "--out", out)
    assert run_main(*ask) == 2
    assert "--force" in capsys.readouterr().err
    assert out.read_bytes() == b"mine"
    assert run_main(*ask, "--force") == 0
    assert run_main("check", out, "--data", world.root) == 0
