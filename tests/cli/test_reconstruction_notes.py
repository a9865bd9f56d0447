"""What odd reconstructions get, through ``eval`` and ``check``: a stated note."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.reconstruction.world import PROTOCOL, World, predict_clouds, save, true_points
from tests.support import run_main

Make = Callable[[World, Path], Path]


def clouds(cameras: bool = True, **scenes: Callable[[Any], Any]) -> Make:
    """Predict the true clouds, those of some scenes changed."""

    def make(world: World, folder: Path) -> Path:
        points = {scene: true_points(scene) for scene in ("yard", "lot")}
        changed = {scene: change(points[scene]) for scene, change in scenes.items()}
        return predict_clouds(world, folder, points | changed, cameras)

    return make


def edited(edit: Callable[[Path], object]) -> Make:
    """Predict the true clouds, and change the folder."""

    def make(world: World, folder: Path) -> Path:
        path = clouds()(world, folder)
        edit(path)
        return path

    return make


def opengl(world: World, folder: Path) -> Path:
    path = clouds()(world, folder)
    fields = world.cameras("yard")
    axes = np.diag((1.0, -1, -1)) @ fields["extrinsics"]
    save(path / "yard.cameras.npz", world.cameras("yard", extrinsics=axes))
    return path


def views(**changes: Any) -> Make:
    """Predict exact depth maps, those of the yard with some fields changed."""

    def make(world: World, folder: Path) -> Path:
        save(folder / "yard.npz", world.views("yard", **changes))
        save(folder / "lot.npz", world.views("lot"))
        (folder / "protocol.txt").write_text(PROTOCOL)
        return folder

    return make


def four_poses(world: World, folder: Path) -> Path:
    poses = world.cameras("yard")["extrinsics"].copy()
    poses[4:] = np.nan
    return views(extrinsics=poses)(world, folder)


def add_nan(points: Any) -> Any:
    return np.concatenate([points, [[np.nan, 0, 0], [np.inf, 0, 0], [1e200, 0, 0]]])


NOTES: dict[str, tuple[Make, list[str]]] = {
    "nothing odd": (clouds(), []),
    "points that are no points": (clouds(yard=add_nan), ["scene yard", "3 points"]),
    "OpenGL axes": (opengl, ["scene yard", "OpenGL axes"]),
    "an empty cloud": (clouds(yard=lambda p: p[:0]), ["scene yard", "no point is left"]),
    "a strange scene": (edited(lambda p: shutil.copy(p / "lot.ply", p / "plaza.ply")), ["plaza"]),
    "a mistyped scene": (
        edited(lambda p: (p / "yard.ply").rename(p / "yrad.ply")),
        ["yrad (did you mean 'yard'?)", "1 (yard)"],
    ),
    "a strange file": (edited(lambda p: (p / "readme.md").write_text("hi")), ["readme.md"]),
    "a missing scene": (edited(lambda p: (p / "lot.ply").unlink()), ["worst: 1 (lot)"]),
    "fewer poses than photos": (four_poses, ["scene yard", "2 of 6 photos"]),
    "no names": (views(image_names=None), ["scene yard", "image_names"]),
}


@pytest.mark.parametrize("case", list(NOTES))
def test_notes_of_eval_and_of_check(
    case: str, world: World, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    make, fragments = NOTES[case]
    path = make(world, tmp_path / "p")
    assert run_main("eval", "reconstruction", path, "--out", tmp_path / "out") == 0
    notes = json.loads((tmp_path / "out" / "result.json").read_text())["notes"]
    assert bool(notes) == bool(fragments)
    for fragment in fragments:
        assert any(fragment in note for note in notes), notes
    if case in ("OpenGL axes", "a mistyped scene", "no names"):
        capsys.readouterr()
        assert run_main("check", path) == 0
        said = capsys.readouterr().err
        assert [note for note in notes if note not in said] == []
