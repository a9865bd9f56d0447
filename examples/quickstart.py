"""Score a retrieval method from nothing: a made-up place, its photos, a baseline, the table.

Draws a small map with a surface model, photographs it from a made-up flight, and then runs the
commands that a user would type. Takes about half a minute and leaves everything in ./quickstart.
"""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import rasterio
from PIL import Image
from rasterio.transform import from_origin
from scipy.ndimage import map_coordinates, zoom

from airzoo_bench.geometry.cameras import Cameras, back_project
from airzoo_bench.geometry.grids import world_to_pixel
from airzoo_bench.geometry.medians import median_height
from airzoo_bench.geometry.poses import Poses, rays_to_world
from airzoo_bench.geometry.rays import intersect_plane

HOME = Path("quickstart")
CRS = "EPSG:4547"
WEST, NORTH, GSD_M = 402_000.0, 3_131_000.0, 0.25
MAP_PX = 1200
PHOTO_W, PHOTO_H, FOCAL_PX = 400, 300, 380.0
N_PHOTOS = 24


def noise(random: np.random.Generator, cells: int) -> np.ndarray:
    """Return smooth noise (H, W) of unit spread with so many bumps along a side."""
    coarse = zoom(random.standard_normal((cells, cells)), MAP_PX / cells, order=3)
    return coarse / coarse.std()


def draw_place(random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return colours (H, W, 3) uint8 and heights (H, W) float32 of fields, roads and houses."""
    colours = np.zeros((MAP_PX, MAP_PX, 3))
    for cells, weight in ((600, 25.0), (150, 25.0), (24, 40.0)):
        colours += weight * noise(random, cells)[..., None] * random.uniform(0.4, 0.8, 3)
    heights = 60 + 3 * noise(random, 6)
    colours += (90, 120, 70)
    for _ in range(260):
        x, y = random.integers(0, MAP_PX - 60, 2)
        w, h = random.integers(12, 60, 2)
        colours[y : y + h, x : x + w] = random.uniform(60, 220, 3) + random.normal(0, 6, (h, w, 1))
        heights[y : y + h, x : x + w] += random.uniform(3, 15)
    for road in random.integers(0, MAP_PX - 12, 8):
        colours[road : road + 12] = colours[:, road : road + 12] = 150
    return np.clip(colours, 1, 255).astype(np.uint8), heights.astype(np.float32)


def fly(random: np.random.Generator) -> Poses:
    """Return poses some 45 m above ground, turned any way, up to 15 degrees from nadir."""
    x = random.uniform(WEST + 60, WEST + MAP_PX * GSD_M - 60, N_PHOTOS)
    y = random.uniform(NORTH - MAP_PX * GSD_M + 60, NORTH - 60, N_PHOTOS)
    down = np.diag([1.0, -1.0, -1.0])  # x east, y south, z down: a camera that looks at nadir
    rotations = []
    for yaw, tilt in random.uniform(0, (2 * np.pi, 0.26), (N_PHOTOS, 2)):
        c, s, ct, st = np.cos(yaw), np.sin(yaw), np.cos(tilt), np.sin(tilt)
        turned = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]])
        rotations.append(np.array([[1, 0, 0], [0, ct, -st], [0, st, ct]]) @ turned @ down)
    return Poses.from_centres(rotations, np.stack([x, y, np.full(N_PHOTOS, 105.0)], axis=1))


def photograph(cameras: Cameras, poses: Poses, colours: np.ndarray, ground: float) -> np.ndarray:
    """Return photos (N, H, W, 3): the map as seen on level ground, in another light."""
    rows, columns = np.mgrid[:PHOTO_H, :PHOTO_W] + 0.5
    pixels = np.stack([columns, rows], axis=-1).reshape(1, -1, 2)
    rays = rays_to_world(poses, back_project(cameras, np.repeat(pixels, len(poses), axis=0)))
    points = intersect_plane(poses.centres, rays, ground, 1000.0).points
    place = world_to_pixel(from_origin(WEST, NORTH, GSD_M, GSD_M), points[..., :2]) - 0.5
    place = np.nan_to_num(place, nan=-1.0)
    seen = [
        map_coordinates(colours[..., band], [place[..., 1], place[..., 0]], order=1)
        for band in range(3)
    ]
    photos = np.stack(seen, axis=-1).reshape(len(poses), PHOTO_H, PHOTO_W, 3)
    return np.clip(photos * 0.85 + 12, 0, 255).astype(np.uint8)


def write_raster(path: Path, bands: np.ndarray) -> None:
    """Write bands (B, H, W) as GeoTIFF."""
    profile = {"driver": "GTiff", "crs": CRS, "transform": from_origin(WEST, NORTH, GSD_M, GSD_M)}
    shape = {"count": len(bands), "height": MAP_PX, "width": MAP_PX, "dtype": bands.dtype}
    with rasterio.open(path, "w", **profile, **shape) as raster:
        raster.write(bands)


def make_data() -> None:
    """Write map, surface model, photos and poses into the folder."""
    random = np.random.default_rng(7)
    colours, heights = draw_place(random)
    (HOME / "photos").mkdir(parents=True, exist_ok=True)
    write_raster(HOME / "dom.tif", np.moveaxis(colours, -1, 0))
    write_raster(HOME / "dsm.tif", heights[None])
    K = [[FOCAL_PX, 0, PHOTO_W / 2], [0, FOCAL_PX, PHOTO_H / 2], [0, 0, 1]]
    cameras = Cameras.from_matrices([K] * N_PHOTOS, PHOTO_W, PHOTO_H)
    poses = fly(random)
    photos = photograph(cameras, poses, colours, median_height(HOME / "dsm.tif"))
    images = {}
    for index, photo in enumerate(photos):
        name = f"photo_{index:02d}.png"
        Image.fromarray(photo).save(HOME / "photos" / name)
        centre, rotation = poses.centres[index], poses.rotation[index]
        images[name] = {"R_w2c": rotation.tolist(), "center": centre.tolist()}
    (HOME / "poses.json").write_text(json.dumps({"crs": CRS, "K": K, "images": images}))


def run(command: str) -> None:
    """Show a command as a user would type it, and run it."""
    print(f"\n$ airzoo-bench {command}", flush=True)
    subprocess.run([sys.executable, "-m", "airzoo_bench", *shlex.split(command)], check=True)


def main() -> None:
    """Make the data and run the commands."""
    print("drawing a place and flying over it ...", flush=True)
    make_data()
    data = f"{HOME}/benchmark"
    run(
        f"prepare photos --name place --images {HOME}/photos --poses {HOME}/poses.json "
        f"--dom {HOME}/dom.tif --dsm {HOME}/dsm.tif --tile-size 512 --tile-size 256 "
        f"--out {data} --force"
    )
    run(f"baseline retrieval place-retrieval --data {data} --out {HOME}/sift.npz")
    run(f"template place-retrieval --data {data} --out {HOME}/random.npz")
    for method in ("sift", "random"):
        run(f"eval retrieval {HOME}/{method}.npz --data {data} --out {HOME}/results/{method}")
    run(f"table {HOME}/results/sift/result.json {HOME}/results/random/result.json")


if __name__ == "__main__":
    main()
