"""Scenes of planes, steps and boxes, whose depth is known by a formula of its own."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from scipy.spatial.transform import Rotation

from airzoo_bench.datasets.geometry_checks.scenes import PosedScene
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses

Box = tuple[Sequence[float], Sequence[float]]

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
    boxes: Sequence[Box] = field(default=())

    def depths(self, *, along_ray: bool = False) -> np.ndarray:
        return np.array(
            [
                depth_of(R, C, self.boxes, along_ray=along_ray)
                for R, C in zip(self.rotation, self.centres, strict=True)
            ]
        )

    def turned(self, degrees: Sequence[float], frames: Any = slice(None)) -> Flight:
        """Turn stated poses by a rotation vector in the camera's axes."""
        rotation = self.rotation.copy()
        turn = Rotation.from_rotvec(np.radians(degrees)).as_matrix()
        rotation[frames] = turn @ rotation[frames]
        return replace(self, rotation=rotation)


def depth_of(
    R: np.ndarray, C: np.ndarray, boxes: Sequence[Box], *, along_ray: bool = False
) -> np.ndarray:
    """Depth at pixel centres: the nearest of the ground and of the slabs of each box."""
    v, u = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    rays = np.stack([(u - WIDTH / 2) / FOCAL, (v - HEIGHT / 2) / FOCAL, np.ones_like(u)], axis=-1)
    world = rays @ R
    with np.errstate(divide="ignore", invalid="ignore"):
        z = np.where(world[..., 2] < 0, -C[2] / world[..., 2], np.inf)
        for low, high in boxes:
            near, far = (np.array(low) - C) / world, (np.array(high) - C) / world
            enter = np.minimum(near, far).max(axis=-1)
            leave = np.maximum(near, far).min(axis=-1)
            z = np.where((enter > 0) & (enter <= leave), np.minimum(z, enter), z)
    z = np.where(z < 2000.0, z, 0.0)
    return (z * (np.linalg.norm(rays, axis=-1) if along_ray else 1.0)).astype(np.float32)


def orbit(count: int = 16) -> Flight:
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


def names(count: int) -> tuple[str, ...]:
    return tuple(f"f{number:03d}.png" for number in range(count))


def cameras(count: int, **changes: float) -> Cameras:
    values = {"f": FOCAL, "cx": WIDTH / 2, "cy": HEIGHT / 2} | changes
    K = [[values["f"], 0, values["cx"]], [0, values["f"], values["cy"]], [0, 0, 1]]
    return Cameras.from_matrices([K] * count, WIDTH, HEIGHT)


def scene(flight: Flight, **changes: float) -> PosedScene:
    """State the poses of a flight, with a camera of perhaps other intrinsics."""
    count = len(flight.centres)
    poses = Poses.from_centres(flight.rotation, flight.centres + ORIGIN)
    return PosedScene(
        "made", names(count), names(count), cameras(count, **changes), poses, "EPSG:4547", Path()
    )


def write_depths(folder: Path, depths: np.ndarray) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for name, depth in zip(names(len(depths)), depths, strict=True):
        np.save(folder / Path(name).with_suffix(".npy"), depth)
    return folder


def write_photos(folder: Path, flight: Flight) -> tuple[Path, Path]:
    """Write photos and their pose file, as a person has them; return both places."""
    images = folder / "images"
    images.mkdir(parents=True)
    for name in names(len(flight.centres)):
        Image.new("L", (WIDTH, HEIGHT)).save(images / name)
    posed = zip(names(len(flight.centres)), flight.rotation, flight.centres + ORIGIN, strict=True)
    content = {
        "crs": "EPSG:4547",
        "K": cameras(1).matrices[0].tolist(),
        "images": {n: {"R_w2c": R.tolist(), "center": C.tolist()} for n, R, C in posed},
    }
    path = folder / "poses.json"
    path.write_text(json.dumps(content))
    return images, path
