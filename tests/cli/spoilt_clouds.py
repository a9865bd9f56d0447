"""Clouds and cameras of the reconstruction track, right and spoilt."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from tests.reconstruction.world import (
    PROTOCOL,
    World,
    camera_poses,
    predict_clouds,
    save,
    true_points,
)

Make = Callable[[World, Path], Path]


RIGHT = ("yard", "lot")


def clouds(cameras: bool = True, **scenes: Any) -> Make:
    """Predict the true clouds but for some, given as points or as what changes them."""

    def make(world: World, folder: Path) -> Path:
        points = {scene: true_points(scene) for scene in RIGHT}
        for scene, given in scenes.items():
            points[scene] = given(points[scene]) if callable(given) else given
        return predict_clouds(world, folder, points, cameras)

    return make


def yard(**changes: Any) -> Make:
    """Predict exact depth maps, those of the yard with some fields changed."""

    def make(world: World, folder: Path) -> Path:
        found = {k: v(world) if callable(v) else v for k, v in changes.items()}
        save(folder / "yard.npz", world.views("yard", **found))
        save(folder / "lot.npz", world.views("lot"))
        (folder / "protocol.txt").write_text(PROTOCOL)
        return folder

    return make


def cameras(**changes: Any) -> Make:
    """Predict the true clouds with other cameras of the yard."""

    def make(world: World, folder: Path) -> Path:
        clouds()(world, folder)
        found = {k: v(world) if callable(v) else v for k, v in changes.items()}
        save(folder / "yard.cameras.npz", world.cameras("yard", **found))
        return folder

    return make


def with_file(name: str, write: Callable[[Path], object]) -> Make:
    """Predict the true clouds, with a file instead of the yard's cloud."""

    def make(world: World, folder: Path) -> Path:
        clouds()(world, folder)
        (folder / "yard.ply").unlink()
        (folder / name).parent.mkdir(exist_ok=True)
        write(folder / name)
        return folder

    return make


def taken(count: int) -> Callable[[World], Any]:
    """Return the extrinsics of the yard with so many poses, NaN in the others."""

    def poses(world: World) -> Any:
        found = world.cameras("yard")["extrinsics"].copy()
        found[count:] = np.nan
        return found

    return poses


def inverted(world: World) -> Any:
    poses = camera_poses("yard")
    local = poses.centres - poses.centres.mean(axis=0)
    return np.concatenate([poses.rotation.swapaxes(1, 2), local[..., None]], axis=2)


def nan_at(rows: Any) -> Callable[[Any], Any]:
    def change(points: Any) -> Any:
        changed = points.copy()
        changed[rows, 1] = np.nan
        return changed

    return change


def other(matrix: Any) -> Any:
    return lambda world: np.tile(matrix, (6, 1, 1))


def edited(make: Make, edit: Callable[[Path], object]) -> Make:
    def made_and_edited(world: World, folder: Path) -> Path:
        path = make(world, folder)
        edit(path)
        return path

    return made_and_edited
