"""A small benchmark of every track whose photos show its map, and calls that tests share."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from PIL import Image
from rasterio import Affine

import airzoo_bench as ab
from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.formats.clouds.ply import write_ply
from airzoo_bench.geometry.crs import to_lonlat
from tests.geometry.support import looking_down
from tests.support import NORTH_WEST, PLACE_CRS, run_main, write_raster

NAME = "field"
RETRIEVAL, MATCHING, RECONSTRUCTION = (
    f"{NAME}-{track}" for track in ("retrieval", "matching", "reconstruction")
)
A, B = f"{NAME}/a", f"{NAME}/b"  # photos
TILES = [f"{NAME}/160_00000_0000{n}" for n in range(6)]
GROUND_M = 100.0
MAP_PX, MAP_GSD = 640, 0.4
PHOTO_SIZE, FOCAL = (320, 240), 320.0
NAMES = ("a.png", "b.png", "sub/c.png", "sub/d.png", "e.png")
# From the map's north-west corner, with digits that nothing else has.
CENTRES_M = np.array(
    [(70.37, 81.73), (101.91, 150.59), (150.23, 99.47), (177.61, 171.13), (120.83, 120.29)]
)
PRIOR_OFF_M = (1.37, -0.83, 0.71)


def true_poses() -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Return rotations (N, 3, 3) and centres (N, 3) of the photos."""
    rows = np.arange(len(NAMES))
    rotation = np.concatenate([looking_down(2.3 + 1.7 * n, 13.0 * n - 20.0) for n in rows])
    height = GROUND_M + 91.39 + 2.17 * rows
    east, north = NORTH_WEST[0] + CENTRES_M[:, 0], NORTH_WEST[1] - CENTRES_M[:, 1]
    return rotation, np.stack([east, north, height], axis=1)


def make_field(root: Path, *options: object) -> Path:
    """Prepare the benchmark below `root` / data, which must be the data root, from its sources."""
    sources = root / "sources"
    ground = _map()
    rotation, centres = true_poses()
    matrix = [[FOCAL, 0, PHOTO_SIZE[0] / 2], [0, FOCAL, PHOTO_SIZE[1] / 2], [0, 0, 1]]
    images = {}
    for name, R, C in zip(NAMES, rotation, centres, strict=True):
        (sources / "photos" / name).parent.mkdir(parents=True, exist_ok=True)
        seen = _photo(ground, np.array(matrix), R, C)
        Image.fromarray(seen).save(sources / "photos" / name)
        images[name] = {"R_w2c": R.tolist(), "center": C.tolist()}
    poses = {"crs": PLACE_CRS, "K": matrix, "images": images}
    (sources / "poses.json").write_text(json.dumps(poses))
    corner = Affine(MAP_GSD, 0, NORTH_WEST[0], 0, -MAP_GSD, NORTH_WEST[1])
    write_raster(sources / "dom.tif", np.moveaxis(ground, -1, 0), transform=corner)
    heights = np.full((1, 256, 256), GROUND_M, np.float32)
    write_raster(sources / "dsm.tif", heights, transform=Affine(1, 0, corner.c, 0, -1, corner.f))
    _write_priors(sources / "priors.csv", rotation, centres)
    write_ply(sources / "cloud.ply", Cloud(_level_points()))
    files = {"images": "photos", "poses": "poses.json", "priors": "priors.csv"}
    files |= {"dom": "dom.tif", "dsm": "dsm.tif", "cloud": "cloud.ply"}
    arguments = [text for key, file in files.items() for text in (f"--{key}", sources / file)]
    sizes = ("--tile-size", 160, "--tile-size", 80)
    assert run_main("prepare", "photos", "--name", NAME, *arguments, *sizes, *options) == 0
    return root / "data" / NAME


def _map() -> np.ndarray[Any, Any]:
    """Return a coloured map (MAP_PX, MAP_PX, 3) with blobs of all sizes, nowhere black."""
    random = np.random.default_rng(3)
    layers = np.zeros((MAP_PX, MAP_PX, 3))
    for cells, weight in ((5, 1.0), (20, 0.8), (80, 0.6), (320, 0.3)):
        coarse = random.random((cells, cells, 3)).astype(np.float32)
        for band in range(3):
            layer = Image.fromarray(coarse[..., band]).resize((MAP_PX, MAP_PX), Image.BICUBIC)
            layers[..., band] += weight * np.asarray(layer)
    return np.clip(20 + 80 * layers, 1, 255).astype(np.uint8)


def _photo(ground: Any, matrix: Any, rotation: Any, centre: Any) -> np.ndarray[Any, Any]:
    """Look up the colour of the map where the ray of each pixel meets the ground."""
    row, column = np.indices(PHOTO_SIZE[::-1]) + 0.5
    rays = np.stack((column, row, np.ones_like(row)), axis=-1) @ np.linalg.inv(matrix).T @ rotation
    away = (GROUND_M - centre[2]) / rays[..., 2:]
    east, north = np.moveaxis(centre + away * rays, -1, 0)[:2]
    x, y = (east - NORTH_WEST[0]) / MAP_GSD, (NORTH_WEST[1] - north) / MAP_GSD
    assert 0 <= min(x.min(), y.min()) <= max(x.max(), y.max()) < MAP_PX
    return ground[y.astype(int), x.astype(int)]


def _write_priors(path: Path, rotation: Any, centres: Any) -> None:
    lon, lat = to_lonlat(PLACE_CRS, (centres + PRIOR_OFF_M)[:, :2]).T
    up = -rotation[:, 1]
    table = {
        "image": NAMES,
        "lon": lon,
        "lat": lat,
        "altitude_m": centres[:, 2] + PRIOR_OFF_M[2],
        "yaw_deg": np.degrees(np.arctan2(up[:, 0], up[:, 1])) + 1.9,
        "pitch_deg": np.degrees(np.arcsin(rotation[:, 2, 2])) + 0.8,
        "roll_deg": 0.6,
    }
    pd.DataFrame(table).to_csv(path, index=False)


def _level_points() -> np.ndarray[Any, Any]:
    along = np.arange(0.5, MAP_PX * MAP_GSD)
    east, south = (grid.ravel() for grid in np.meshgrid(along, along))
    north_west = np.stack([east, -south], axis=1) + NORTH_WEST
    # Not level to the last bit: a cloud without any height has no cells.
    return np.column_stack([north_west, GROUND_M + 0.05 * np.sin(east / 7)])


def made_errors(metres: Any, degrees: Any) -> ab.PoseErrors:
    """Return errors of poses, all of them over x and y."""
    return ab.PoseErrors(np.array(metres), np.array(metres), 0 * np.array(metres), degrees)


def refused(call: Callable[..., Any], *arguments: Any, where: str, **options: Any) -> str:
    """Call, and return the message of the refusal, which names the argument."""
    with pytest.raises(ab.ArgumentError) as caught:
        call(*arguments, **options)
    assert isinstance(caught.value, ValueError)
    assert where in str(caught.value.where)
    return str(caught.value)


def scored(
    track: str, path: Path, data: Path, capsys: pytest.CaptureFixture[str]
) -> dict[str, str]:
    """Return the averages that `eval` prints, by column, of a file that `check` finds sound."""
    assert ab.check(path, data=data).errors == []
    capsys.readouterr()
    assert run_main("eval", track, path, "--data", data, "--format", "csv") == 0
    rows = list(csv.DictReader(capsys.readouterr().out.splitlines()))
    return next(row for row in rows if row["Scene"] == "Average")
