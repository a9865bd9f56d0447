"""One made-up survey, its truth exactly known: photos, map, surface model, and poses.json.

Five photos of 40 x 30 px, tilted and turned, over a map of 240 x 200 m in a UTM zone's east, where
the grid's north is 1.2 degrees off.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from rasterio import Affine
from scipy.spatial.transform import Rotation

from airzoo_bench.core.progress import silent
from airzoo_bench.core.registry import DATASETS
from airzoo_bench.datasets.scenes import NativeScene
from airzoo_bench.geometry.crs import grid_convergence_deg, to_lonlat
from airzoo_bench.geometry.poses import angles_to_rotations, rotations_to_angles
from tests.support import write_raster

CRS = "EPSG:32633"
CORNER = (620_000.0, 5_200_200.0)
SIZE_M = (200, 240)
GROUND_M = 100.0
PHOTO = (40, 30)
NAMES = ("DJI_0001.JPG", "DJI_0002.JPG", "DJI_0003.JPG", "DJI_0004.JPG", "DJI_0005.JPG")
FOCAL = 42.0
CENTRE = (20.5, 14.25)
LENS = {"k1": 0.02, "k2": -0.01, "p1": 0.001, "p2": -0.002, "k3": 0.003}
PINHOLE = dict.fromkeys(LENS, 0.0)
# From the map's north-west corner to the east and south, height; yaw from true north, pitch, roll.
_AT = ((60, 60, 180), (120, 50, 190), (180, 65, 185), (80, 140, 175), (160, 130, 195))
_ANGLES = ((10, -90, 0), (100, -85, 0), (-170, -80, 2), (280, -88, -1), (45, -75, 0))


@dataclass(frozen=True)
class Made:
    """Where the survey is.

    Attributes
    ----------
    rotation : (5, 3, 3) array
        World-to-camera.
    centres, lonlat : (5, 3), (5, 2) arrays
    """

    folder: Path
    rotation: np.ndarray
    centres: np.ndarray
    lonlat: np.ndarray
    lens: dict[str, float]

    @property
    def images(self) -> Path:
        return self.folder / "photos"

    @property
    def dom(self) -> Path:
        return self.folder / "dom.tif"

    @property
    def dsm(self) -> Path:
        return self.folder / "dsm.tif"

    @property
    def maps(self) -> list[object]:
        return ["--dom", self.dom, "--dsm", self.dsm]

    def gimbal(self, convergence: Any = None) -> np.ndarray:
        turn = grid_convergence_deg(CRS, self.lonlat) if convergence is None else convergence
        return rotations_to_angles(self.rotation, convergence_deg=turn)


def make_survey(folder: Path, lens: dict[str, float] = LENS) -> Made:
    """Write photos, map and surface model."""
    east, south, up = np.array(_AT, dtype=float).T
    centres = np.stack((CORNER[0] + east + 0.1372, CORNER[1] - south - 0.2913, up), axis=-1)
    lonlat = to_lonlat(CRS, centres[:, :2])
    convergence = grid_convergence_deg(CRS, lonlat)
    rotation = angles_to_rotations(*np.array(_ANGLES, float).T, convergence_deg=convergence)
    (folder / "photos").mkdir(parents=True)
    rng = np.random.default_rng(3)
    for name in NAMES:
        pixels = rng.integers(0, 256, (PHOTO[1], PHOTO[0], 3), np.uint8)
        Image.fromarray(pixels).save(folder / "photos" / name, "JPEG")
    transform = Affine(1, 0, CORNER[0], 0, -1, CORNER[1])
    ground = rng.integers(0, 256, (3, *SIZE_M), np.uint8)
    surface = GROUND_M + rng.uniform(0, 1, (1, *SIZE_M)).astype(np.float32)
    write_raster(folder / "dom.tif", ground, crs=CRS, transform=transform)
    write_raster(folder / "dsm.tif", surface, crs=CRS, transform=transform)
    return Made(folder, rotation, centres, lonlat, dict(lens))


def matrix() -> list[list[float]]:
    return [[FOCAL, 0.0, CENTRE[0]], [0.0, FOCAL, CENTRE[1]], [0.0, 0.0, 1.0]]


def photos_layout(made: Made) -> list[object]:
    """Write poses.json, and return the arguments of `prepare` but for name and tiles."""
    images = {
        name: {"R_w2c": rotation.tolist(), "center": centre.tolist()}
        for name, rotation, centre in zip(NAMES, made.rotation, made.centres, strict=True)
    }
    file = {"crs": CRS, "K": matrix(), "distortion": list(made.lens.values()), "images": images}
    path = made.folder / "poses.json"
    path.write_text(json.dumps(file))
    return ["photos", "--poses", path, "--images", made.images, *made.maps]


ANGLE = -0.013
LOCAL_SCALE = 0.99978


def local_frame(made: Made) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a similarity to the CRS as a matrix, and rotations and centres in the frame before."""
    turn = Rotation.from_euler("z", ANGLE).as_matrix()
    matrix4 = np.eye(4)
    matrix4[:3, :3] = LOCAL_SCALE * turn
    matrix4[:3, 3] = (CORNER[0] + 100, CORNER[1] - 90, 3.0)
    centres = (made.centres - matrix4[:3, 3]) @ turn / LOCAL_SCALE
    return matrix4, made.rotation @ turn, centres


def options_of(arguments: list[object]) -> tuple[Any, Any]:
    """Return the dataset and its options, without the command line."""
    dataset = DATASETS.get(str(arguments[0]))
    given: dict[str, Any] = {}
    rest = iter(arguments[1:])
    for key in rest:
        field = str(key).removeprefix("--").replace("-", "_")
        given[field] = True if field == "from_exif" else next(rest)
    return dataset, dataset.options(name="place", **given)


def read_scene(arguments: list[object]) -> NativeScene:
    """Read a scene of a survey, or of own photos."""
    dataset, options = options_of(arguments)
    (scene,) = dataset.scenes(options)
    return dataset.read(options, scene, silent)
