"""Scenes of planes and boxes, whose depth is known by a formula of its own."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from PIL import Image
from scipy.spatial.transform import Rotation

from airzoo_bench.benchmark.folder import BenchmarkFile, SceneFile, write_benchmark_file
from airzoo_bench.benchmark.queries import photo_table, write_queries
from airzoo_bench.datasets.geometry_checks import PosedScene
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses

Box = tuple[Sequence[float], Sequence[float]]

CRS = "EPSG:4547"
ORIGIN = np.array([401_000.0, 3_120_000.0, 0.0])
WIDTH, HEIGHT, FOCAL = 160, 120, 130.0


def looking(azimuth: float, pitch: float) -> np.ndarray:
    """World-to-camera rotation of a camera that looks `pitch` degrees below the horizon."""
    a, p = np.radians([azimuth, pitch])
    forward = np.array([np.sin(a) * np.cos(p), np.cos(a) * np.cos(p), -np.sin(p)])
    right = np.array([np.cos(a), -np.sin(a), 0.0])
    return np.array([right, np.cross(forward, right), forward])


@dataclass(frozen=True)
class Flight:
    """Cameras over boxes on the plane z = 0."""

    rotation: np.ndarray
    centres: np.ndarray
    boxes: Sequence[Box] = ()

    def depths(self, *, along_ray: bool = False) -> np.ndarray:
        """Depth at pixel centres: the nearest of the ground and of the slabs of each box."""
        v, u = np.mgrid[:HEIGHT, :WIDTH] + 0.5
        rays = np.stack([(u - WIDTH / 2) / FOCAL, (v - HEIGHT / 2) / FOCAL, np.ones_like(u)], -1)
        found = []
        for R, C in zip(self.rotation, self.centres, strict=True):
            world = rays @ R
            with np.errstate(divide="ignore", invalid="ignore"):
                z = np.where(world[..., 2] < 0, -C[2] / world[..., 2], np.inf)
                for low, high in self.boxes:
                    near, far = (np.array(low) - C) / world, (np.array(high) - C) / world
                    enter = np.minimum(near, far).max(axis=-1)
                    leave = np.maximum(near, far).min(axis=-1)
                    z = np.where((enter > 0) & (enter <= leave), np.minimum(z, enter), z)
            found.append(np.where(z < 2000.0, z, 0.0))
        lengths = np.linalg.norm(rays, axis=-1) if along_ray else 1.0
        return (np.array(found) * lengths).astype(np.float32)

    def turned(self, degrees: Sequence[float], frame: int) -> Flight:
        """Turn a stated pose by a rotation vector in the camera's axes."""
        rotation = self.rotation.copy()
        rotation[frame] = Rotation.from_rotvec(np.radians(degrees)).as_matrix() @ rotation[frame]
        return replace(self, rotation=rotation)


def orbit(count: int) -> Flight:
    """Go round a block of boxes, up and down, looking obliquely at it."""
    rng = np.random.default_rng(3)
    boxes: list[Box] = []
    for _ in range(14):
        x, y = rng.uniform(-60, 60, 2)
        w, d, h = rng.uniform((4, 4, 4), (14, 14, 25))
        boxes.append(((x - w, y - d, -1.0), (x + w, y + d, h)))
    azimuth = np.arange(count) * 14.0
    pitch = 45.0 + 15.0 * np.sin(np.arange(count) / 2.0)
    a = np.radians(azimuth)
    height = 90.0 + 25.0 * np.sin(np.arange(count) / 3.0)
    centres = np.stack([-95 * np.sin(a), -95 * np.cos(a), height], axis=1)
    rotation = np.array([looking(x, y) for x, y in zip(azimuth, pitch, strict=True)])
    return Flight(rotation, centres, boxes)


def scene(flight: Flight, **changes: float) -> PosedScene:
    """State the poses of a flight, with a camera of perhaps other intrinsics."""
    names = tuple(f"f{number:03d}.png" for number in range(len(flight.centres)))
    values = {"f": FOCAL, "cx": WIDTH / 2, "cy": HEIGHT / 2} | changes
    K = [[values["f"], 0, values["cx"]], [0, values["f"], values["cy"]], [0, 0, 1]]
    cameras = Cameras.from_matrices([K] * len(names), WIDTH, HEIGHT)
    poses = Poses.from_centres(flight.rotation, flight.centres + ORIGIN)
    return PosedScene("made", names, names, cameras, poses, CRS, Path(), 0.0)


def write_depths(folder: Path, depths: np.ndarray) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for number, depth in enumerate(depths):
        np.save(folder / f"f{number:03d}.npy", depth)
    return folder


def write_photos(folder: Path, flight: Flight) -> list[object]:
    """Write photos and their pose file, as a person has them; return the command's options."""
    made, images = scene(flight), folder / "images"
    images.mkdir(parents=True)
    for name in made.images:
        Image.new("L", (WIDTH, HEIGHT)).save(images / name)
    posed = zip(made.images, flight.rotation, flight.centres + ORIGIN, strict=True)
    content = {
        "crs": CRS,
        "K": made.cameras.matrices[0].tolist(),
        "images": {n: {"R_w2c": R.tolist(), "center": C.tolist()} for n, R, C in posed},
    }
    (folder / "poses.json").write_text(json.dumps(content))
    return ["--poses", folder / "poses.json", "--images", images]


def write_benchmark(folder: Path, flight: Flight) -> Path:
    made = scene(flight)
    table = photo_table("park", made.images, made.cameras, made.poses, None, 0.0)
    write_queries(folder / "scenes" / "park", table)
    places = {"images": "data/park/images", "dom": "dom.tif", "crs": CRS, "plane_height_m": 0.0}
    entries = (SceneFile(id="park", title="Park", **places),)
    file = BenchmarkFile(
        schema=1, name="made", version=1, title="m", tracks={}, scenes=entries, checksums={}
    )
    write_benchmark_file(folder, file)
    return folder
