"""What the command says of each source of `prepare photos` that is wrong."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from PIL import Image

from tests.cli.bad_sources import (
    broken_colmap,
    control_name,
    empty_colmap,
    no_crs,
    no_poses_key,
    options,
    over_the_sources,
    renamed,
    resolution,
    swapped,
    turned,
    unseen,
)
from tests.support import MAP_SIZE_M, Place, write_raster

FLAT = np.full((1, MAP_SIZE_M, MAP_SIZE_M), 100, np.float32)
MIRRORED = [[1.0, 0, 0], [0, 1.0, 0], [0, 0, -1.0]]
STRETCHED = [[1.01, 0, 0], [0, -1.0, 0], [0, 0, -1.0]]


CASES: dict[str, tuple[Callable[[Place], Any], list[str]]] = {
    "no photos": (
        lambda p: [path.unlink() for path in p.images.rglob("*.jpg")],
        ["photos: holds no photo", "files ending in .jpg"],
    ),
    "no folder of photos": (options(images="nowhere"), ["nowhere: no such folder of photos"]),
    "photo is text": (
        lambda p: (p.images / "b.jpg").write_text("hello"),
        ["b.jpg: not a readable photo", "a complete .jpg", "copy it again"],
    ),
    "photo is cut off": (
        lambda p: (p.images / "b.jpg").write_bytes((p.images / "b.jpg").read_bytes()[:100]),
        ["b.jpg: not a readable photo"],
    ),
    "photo is turned": (
        turned,
        ["a.jpg: is to be shown turned (EXIF orientation 6)", "orientation 1", "exiftool"],
    ),
    "photos of one stem": (
        lambda p: (
            Image.new("RGB", (64, 48)).save(p.images / "a.png")
            or p.change_poses(
                images=p.read_poses()["images"] | {"a.png": p.read_poses()["images"]["a.jpg"]}
            )
        ),
        ["differ in their ending only: 1 of 5 (a)", "keep one of each"],
    ),
    "photo's name does not print": (
        control_name,
        [r"names that cannot become ids: 1 of 4 ('a\x1b[2J.jpg')", "rename"],
    ),
    "no pose file": (options(poses="none.json"), ["none.json: no such pose file"]),
    "poses are not JSON": (
        lambda p: p.poses.write_text("K = 3"),
        ["poses.json: not valid JSON", "line 1 column 1", "images: {name: {R_w2c, center}}"],
    ),
    "poses are not text": (
        lambda p: p.poses.write_bytes(b"\xff\xfe\x00"),
        ["poses.json: not text: byte 0 is not UTF-8"],
    ),
    "no rotation": (no_poses_key, ["poses.json: key 'images.b.jpg.R_w2c' is missing", "docs/"]),
    "NaN in a centre": (
        lambda p: p.change_image("a.jpg", center=[1.0, float("nan"), 2.0]),
        ["poses.json: key 'images.a.jpg.center.1' is nan", "finite number"],
    ),
    "centre of two numbers": (
        lambda p: p.change_image("a.jpg", center=[1.0, 2.0]),
        ["poses.json: key 'images.a.jpg.center.2' is missing"],
    ),
    "no images": (
        lambda p: p.change_poses(images={}),
        ["poses.json: key 'images' is {}", "at least 1"],
    ),
    "no camera matrix": (
        lambda p: p.change_poses(K=None),
        ["poses.json: no camera matrix for a.jpg", "'K' for the image, or one for all"],
    ),
    "singular camera": (
        lambda p: p.change_poses(K=[[64, 0, 32], [0, 0, 24], [0, 0, 1]]),
        ["poses.json: K has no positive focal length in 4 of 4 (first 3: a.jpg, b.jpg, c.jpg)"],
    ),
    "skewed camera": (
        lambda p: p.change_image("c.jpg", K=[[64, 1, 32], [0, 64, 24], [0, 0, 1]]),
        ["poses.json: K has skew in 1 of 4 (c.jpg)", "K = [fx 0 cx; 0 fy cy; 0 0 1]"],
    ),
    "camera of another size": (
        lambda p: p.change_poses(K=[[640, 0, 320], [0, 640, 240], [0, 0, 1]]),
        ["poses.json: camera matrices of another image size: 4 of 4", "64x48", "(320.0, 240.0)"],
    ),
    "two cameras and one K": (
        lambda p: Image.new("L", (640, 480)).save(p.images / "c.jpg"),
        [
            "another image size: 1 of 4 (c.jpg)",
            "photos of 2 cameras: 64x48 px: 3 (a.jpg, b.jpg, sub/d.jpg), 640x480 px: 1 (c.jpg)",
            "need a K each (in their entry of 'images'), or a benchmark for each camera",
        ],
    ),
    "not a rotation": (
        lambda p: p.change_image("b.jpg", R_w2c=STRETCHED),
        [
            "poses.json: rotation is not orthonormal in 1 of 4 (b.jpg (|R^T R - I| = 0.02))",
            "0.0002 in every",
        ],
    ),
    "reflection": (
        lambda p: p.change_image("b.jpg", R_w2c=MIRRORED),
        ["poses.json: rotation is a reflection in 1 of 4 (b.jpg (det = -1))", "det = +1", "axes"],
    ),
    "names that match no photo": (
        renamed,
        ["poses.json: none of its 4 images is among 4 photos", "such as a.jpg", "'IMG_0.jpg'"],
    ),
    "poses look up": (
        lambda p: [
            p.change_image(n, R_w2c=[[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]]) for n in p.centres
        ],
        ["no photo has a tile that answers it (4 photos: no ray meets", "world-to-camera"],
    ),
    "poses elsewhere": (
        unseen,
        ["poses.json: no photo has a tile", "4 photos: the footprint meets no tile", "CRS of"],
    ),
    "CRS is not known": (no_crs, ["poses.json: the CRS of the poses is not known", "--crs EPSG"]),
    "CRS is nonsense": (
        lambda p: p.change_poses(crs="EPSG:0"),
        ["poses.json, key 'crs': unknown CRS 'EPSG:0'", "such as EPSG:4547"],
    ),
    "option CRS is nonsense": (options(crs="moon"), ["--crs moon: unknown CRS 'moon'"]),
    "CRS in degrees": (
        lambda p: p.change_poses(crs="EPSG:4326"),
        ["key 'crs': poses are in EPSG:4326 (WGS 84), which is not in metres", "UTM"],
    ),
    "CRS in feet": (
        lambda p: p.change_poses(crs="EPSG:2263"),
        ["key 'crs': poses are in EPSG:2263", "not in metres"],
    ),
    "DSM in another CRS": (
        lambda p: write_raster(p.dsm, FLAT, crs="EPSG:32632"),
        ["poses.json) and the DSM", "EPSG:32633", "EPSG:32632", "one CRS", "gdalwarp"],
    ),
    "DSM without CRS": (
        lambda p: write_raster(p.dsm, FLAT, crs=None),
        ["dsm.tif: no georeference: no CRS", "-a_srs"],
    ),
    "DSM without heights": (
        lambda p: write_raster(p.dsm, FLAT, nodata=100.0),
        ["dsm.tif: no valid height", "nodata"],
    ),
    "DSM is text": (
        lambda p: p.dsm.write_text("heights"),
        ["dsm.tif: cannot be read as a raster", "GeoTIFF"],
    ),
    "DSM is cut off": (
        lambda p: p.dsm.write_bytes(p.dsm.read_bytes()[:3000]),
        ["dsm.tif: cannot be read as a raster"],
    ),
    "map is not there": (options(dom="none.tif"), ["none.tif: no such file"]),
    "map and DSM swapped": (
        swapped,
        ["dom.tif: has 3 bands", "one band of heights", "wrong way round"],
    ),
    "map of another resolution": (
        resolution,
        ["dom.tif: has 1.000 x 1.000 m per pixel", "0.3 m, give or take 15%", "gdalwarp"],
    ),
    "COLMAP model without images": (empty_colmap, ["model: has no image with a pose"]),
    "COLMAP model broken": (
        broken_colmap,
        ["model: not a COLMAP model: rigs, ", "cameras, images", "sparse/0"],
    ),
    "name climbs": (
        options(name="../x"),
        ["--name '../x' cannot be the name of a benchmark", "letters, digits"],
    ),
    "name with slashes": (options(name="a/b"), ["--name 'a/b' cannot be"]),
    "name is empty": (options(name=""), ["--name '' cannot be"]),
    "name without end": (options(name="x" * 60), ["--name 'xxx", "at most 48"]),
    "name of a shipped protocol": (
        options(name="uav-visloc"),
        ["a second protocol uav-visloc-retrieval", "another --name"],
    ),
    "no tiles": (
        options(tile_size=0),
        ["key 'gallery.tile_sizes_px.0' is 0", "greater than or equal to 16"],
    ),
    "threshold without rule": (
        options(iou_above=0.3),
        ["key 'ground_truth': iou_above is given with rule = 'iou', and only then"],
    ),
    "rule without threshold": (
        options(rule="iou"),
        ["iou_above is given with rule = 'iou', and only then"],
    ),
    "impossible threshold": (
        options(rule="iou", iou_above=1.5),
        ["key 'ground_truth.iou_above' is 1.5", "less than 1"],
    ),
    "output is a file": (
        lambda p: {"out": p.poses, "force": ""},
        ["poses.json: is not a benchmark folder, and so is not replaced"],
    ),
    "output exists": (lambda p: {"out": p.images}, ["photos: the folder exists already"]),
    "output would replace the photos": (
        lambda p: {"out": p.images, "force": ""},
        ["photos: is not a benchmark folder, and so is not replaced"],
    ),
    "output would replace all sources": (
        over_the_sources,
        ["the folder to make holds", "which it is made from"],
    ),
    "output below a file": (
        lambda p: {"out": p.poses / "park"},
        ["poses.json: a file, not a folder"],
    ),
}
