from __future__ import annotations

import json

import numpy as np
import pytest
from PIL import Image

from airzoo_bench.geometry.cameras import Cameras, back_project
from airzoo_bench.geometry.heightfield import HeightField
from airzoo_bench.geometry.poses import Poses, rays_to_world
from airzoo_bench.geometry.rasters import read_rgb, world_to_pixel
from airzoo_bench.geometry.rays import intersect_heightfield

from .support import BRIGHTON


@pytest.fixture(scope="module")
def brighton() -> tuple[list[str], Cameras, Poses, HeightField]:
    if not BRIGHTON.is_dir():
        pytest.skip("the real scene is not beside the checkout")
    scene = json.loads((BRIGHTON / "poses.json").read_text())
    images = sorted(scene["images"])
    count = len(images)
    lens = np.tile(scene["dist_k1k2p1p2"], (count, 1))
    K = np.tile(scene["K"], (count, 1, 1))
    cameras = Cameras.from_matrices(K, 4000, 2250, lens, names=images)
    poses = Poses.from_centres(
        [scene["images"][name]["R_w2c"] for name in images],
        [scene["images"][name]["center_utm"] for name in images],
        names=images,
    )
    return images, cameras, poses, HeightField.read(BRIGHTON / "dsm_10cm.tif")


Scene = tuple[list[str], Cameras, Poses, HeightField]


def test_real_photos_lie_on_their_ortho(brighton: Scene) -> None:
    images, cameras, poses, field = brighton
    dom = read_rgb(BRIGHTON / "dom_10cm.tif").mean(axis=-1)
    for row in (3, 9, 15):
        with Image.open(BRIGHTON / "images" / images[row]) as photo:
            photo.draft("L", (500, 281))
            grey = np.asarray(photo.convert("L"), float)
        camera = cameras.take(row).scaled(grey.shape[1], grey.shape[0])
        index = np.stack(np.indices(grey.shape)[::-1], axis=-1)[::5, ::5].reshape(-1, 2)
        directions = back_project(camera, index[None] + 0.5)
        pose = poses.take(row)
        directions = rays_to_world(pose, directions)
        hits = intersect_heightfield(pose.centres, directions, field, 1000.0)
        column, line = index[hits.valid[0]].T
        on_map = world_to_pixel(field.transform, hits.points[0, hits.valid[0], :2]).astype(int)
        seen = dom[on_map[:, 1], on_map[:, 0]]
        # Upright the photo is its ortho, bar shadows and leaves; half a turn off it is anything.
        assert np.corrcoef(grey[line, column], seen)[0, 1] > 0.6
        assert abs(np.corrcoef(grey[::-1, ::-1][line, column], seen)[0, 1]) < 0.4
