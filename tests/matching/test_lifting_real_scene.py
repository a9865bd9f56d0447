from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from PIL import Image

from airzoo_bench.geometry.cameras import Cameras, back_project, project
from airzoo_bench.geometry.heightfield import HeightField
from airzoo_bench.geometry.poses import Poses, rays_to_world, world_to_camera
from airzoo_bench.geometry.rasters import open_info, read_rgb, world_to_pixel
from airzoo_bench.geometry.rays import intersect_heightfield
from airzoo_bench.matching.lifting import lift


def test_through_a_real_photo_and_back(brighton: Path) -> None:
    dom, field = open_info(brighton / "dom_10cm.tif"), HeightField.read(brighton / "dsm_10cm.tif")
    scene = json.loads((brighton / "poses.json").read_text())
    xy = np.random.default_rng(0).uniform((0, 0), (dom.width, dom.height), (20_000, 2))
    lifted = lift(xy, dom, brighton / "dsm_10cm.tif", jobs=2)
    # 44 % of the surface model have a height.
    assert 0.4 < lifted.valid.mean() < 0.6
    assert lifted.points[lifted.valid, 2].min() > 150
    for name in ("DJI_0022.JPG", "DJI_0030.JPG"):
        camera = Cameras.from_matrices([scene["K"]], 4000, 2250, np.array([scene["dist_k1k2p1p2"]]))
        image = scene["images"][name]
        pose = Poses.from_centres([image["R_w2c"]], [image["center_utm"]])
        pixels = project(camera, world_to_camera(pose, lifted.points[lifted.valid][None]))
        seen = ((pixels[0] >= 0) & (pixels[0] <= (4000, 2250))).all(axis=-1)
        rays = rays_to_world(pose, back_project(camera, pixels[:, seen]))
        hits = intersect_heightfield(pose.centres, rays, field, 200.0)
        back = world_to_pixel(dom.transform, hits.points[0, :, :2])
        off = np.linalg.norm(back - xy[lifted.valid][seen], axis=-1)
        assert seen.sum() > 500
        # Beside gaps the surface has walls, that hide what is behind them.
        assert np.mean(off < 1e-5) > 0.8


def test_real_map_and_photo_show_the_same(brighton: Path) -> None:
    dom = open_info(brighton / "dom_10cm.tif")
    scene = json.loads((brighton / "poses.json").read_text())
    image = scene["images"]["DJI_0030.JPG"]
    pose = Poses.from_centres([image["R_w2c"]], [image["center_utm"]])
    lens = np.array([scene["dist_k1k2p1p2"]])
    camera = Cameras.from_matrices([scene["K"]], 4000, 2250, lens).scaled(1000, 562)
    with Image.open(brighton / "images" / "DJI_0030.JPG") as photo:
        grey = np.asarray(photo.convert("L").resize((1000, 562)), np.float64)
    xy = np.random.default_rng(0).uniform((0, 0), (dom.width, dom.height), (20_000, 2))
    lifted = lift(xy, dom, brighton / "dsm_10cm.tif", jobs=1)
    pixels = project(camera, world_to_camera(pose, lifted.points[None]))[0]
    seen = ((pixels >= 0) & (pixels < (1000, 562))).all(axis=-1)
    column, row = pixels[seen].astype(int).T
    on_map = xy[seen].astype(int)
    colours = read_rgb(brighton / "dom_10cm.tif").mean(axis=-1)[on_map[:, 1], on_map[:, 0]]
    assert np.corrcoef(grey[row, column], colours)[0, 1] > 0.6
