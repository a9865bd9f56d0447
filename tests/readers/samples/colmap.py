"""A COLMAP model with the queries registered in it, by pycolmap."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pycolmap

from tests.matching.world import FOCAL, SIZE, World


def write_model(folder: Path, world: World, *, text: bool = False, offset: float = 0.0) -> Path:
    home = folder / "colmap"
    home.mkdir()
    model = pycolmap.Reconstruction()
    camera = pycolmap.Camera(
        model="SIMPLE_PINHOLE",
        width=SIZE[0],
        height=SIZE[1],
        params=[FOCAL, SIZE[0] / 2, SIZE[1] / 2],
        camera_id=1,
    )
    model.add_camera_with_trivial_rig(camera)
    poses = world.truth.poses
    centres = poses.centres - (offset, offset, 0)
    for number, name in enumerate([*world.truth.queries["image"], "other.jpg"], 1):
        row = min(number, len(centres)) - 1
        rotation = poses.rotation[row]
        image = pycolmap.Image(name=f"photos/{name}", camera_id=1, image_id=number)
        image.points2D = pycolmap.Point2DList([pycolmap.Point2D(np.array([1.0, 2.0]))])
        pose = pycolmap.Rigid3d(pycolmap.Rotation3d(rotation), -rotation @ centres[row])
        model.add_image_with_trivial_frame(image, pose)
    (model.write_text if text else model.write_binary)(str(home))
    return home
