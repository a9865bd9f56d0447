"""Photos of a world with the depth of every pixel, and folders of them.

Embree, by Open3D, finds the triangle that a ray meets, in single precision. The distance is then
that to the triangle's plane in double precision: exact for the ray as given, and the same wherever
Embree's own rounding would have put it.

A folder holds ``images/``, ``depth/`` and ``frames.csv``. Photos are JPEG of quality 92 without
chroma subsampling, as drones store them, and carry a mark of their inputs. Depth is TIFF of 32-bit
floats, compressed without loss. A run goes on where an earlier one ended.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFilter

from airzoo_bench.core.files import atomic_write, check_output_folder, fingerprint
from airzoo_bench.core.optional_imports import load_open3d
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.datasets.mini import shading
from airzoo_bench.datasets.mini.noise import Singles, hash_of, seed_of, uniforms
from airzoo_bench.datasets.mini.shading import RANKS, Conditions, Points, Shader, column, dot
from airzoo_bench.datasets.mini.world import CRS, Material, Mesh, World, load_world, read_index
from airzoo_bench.engines.engine import HERE, Engine
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.crs import grid_convergence_deg, to_lonlat
from airzoo_bench.geometry.poses import Poses, rotations_to_angles

_Indices = NDArray[np.int64]
_View = tuple[Floats, np.float32, Conditions]  # place, and angle of a pixel, of the camera
# To be raised with every change that changes photos, so that older ones are rendered again.
RENDERER_VERSION = 3
_DITHER_STREAM, _GRAINS = 73, 1_000_003
# How many pixels are worked on at once: as many as a processor's cache holds.
_BLOCK_PIXELS = 320 * 240

# A ray that grazes a triangle within Embree's rounding of its edge may meet the plane far off the
# triangle; beyond this (m, and share of the distance) Embree's own distance is the better one.
_TRUST_M, _TRUST_SHARE = 0.02, 1e-4
# How far shadow rays start above their surface: above single precision at 1.5 km (0.1 mm).
_LIFT_M = 0.02
# Shares of the light of a pixel's neighbours: of all four, and of those of another surface.
_BLUR, _EDGE_BLUR = np.float32(0.08), np.float32(0.08)
_VIGNETTE, _SHOULDER = np.float32(0.12), np.float32(0.88)
_DROPS = {"rain": 420, "snow": 520}
IMAGE_SUFFIX = ".jpg"
PLACE_COLUMNS = ("longitude", "latitude", "altitude", "roll", "pitch", "yaw")


def default_camera(width: int = 640, height: int = 480) -> Cameras:
    """Return a pinhole of a horizontal field of view of 62 degrees, centred on the image."""
    focal = width / 2 / np.tan(np.radians(62.0) / 2)
    K = [[[focal, 0.0, width / 2], [0.0, focal, height / 2], [0.0, 0.0, 1.0]]]
    return Cameras.from_matrices(K, width, height)


class Raycaster:
    """A mesh that rays can be cast at, on one thread (frames are spread over processes).

    `normal` are unit normals of its triangles, (T, 3); 0 where one has no area.
    """

    def __init__(self, mesh: Mesh) -> None:
        open3d = load_open3d()
        self._tensor: Any = open3d.core.Tensor.from_numpy
        self._scene: Any = open3d.t.geometry.RaycastingScene(nthreads=1)
        self._scene.add_triangles(
            self._tensor(np.ascontiguousarray(mesh.vertices, np.float32)),
            self._tensor(np.ascontiguousarray(mesh.triangles, np.uint32)),
        )
        a, b, c = (mesh.vertices[mesh.triangles[:, corner]] for corner in range(3))
        normal = np.cross(b - a, c - a)
        length = np.sqrt((normal * normal).sum(axis=1))
        self.normal = normal / np.where(length > 0.0, length, 1.0)[:, None]
        # Of three corners each has its own rounding; their middle keeps the plane from tilting.
        offset = (self.normal * (a + b + c)).sum(axis=1) / 3.0
        # The last plane is that of rays which meet nothing.
        self._planes = np.zeros((4, len(offset) + 1))
        self._planes[:, :-1] = *self.normal.T, offset

    def trace(self, origin: Floats, directions: Floats) -> tuple[_Indices, Floats, Floats]:
        """Cast rays from one point (3,), or each from its own (3, N), in directions (3, N).

        Returns triangles (N,), T where none is met; distances (N,), 0 there; and normals (3, N) on
        the side that is met.
        """
        answer = self._scene.cast_rays(self._rays(origin, directions), nthreads=1)
        nothing = len(self.normal)
        triangle = np.minimum(answer["primitive_ids"].numpy(), nothing).astype(np.int64)
        rough = answer["t_hit"].numpy().astype(np.float64)
        plane = self._planes.take(triangle, axis=1)
        normal, distance = plane[:3], plane[3]
        slope = dot(normal, directions)
        for component, start in zip(normal, origin, strict=True):
            distance -= component * start
        with np.errstate(divide="ignore", invalid="ignore"):
            distance /= slope
            far = np.flatnonzero(~(np.abs(distance - rough) <= _TRUST_M + _TRUST_SHARE * rough))
        distance[far] = rough[far]
        distance[triangle == nothing] = 0.0
        normal *= np.copysign(1.0, 0.0 - slope)
        return triangle, distance, normal

    def occluded(self, points: Floats, normals: Floats, direction: Floats) -> Bools:
        """Return which points (3, N), lifted off their surface, are occluded."""
        rays = self._rays(points + normals * _LIFT_M, direction)
        return np.asarray(self._scene.test_occlusions(rays, nthreads=1).numpy())

    def _rays(self, origin: Floats, direction: Floats) -> Any:
        rays = np.empty((max(origin.size, direction.size) // 3, 6), np.float32)
        for lane, part in enumerate((*origin, *direction)):
            rays[:, lane] = part.astype(np.float32)  # faster one by one than all at once
        return self._tensor(rays)


class Renderer:
    """Takes photos of a world, one at a time on one thread."""

    def __init__(self, world: World) -> None:
        self._caster, self._shader = Raycaster(world.mesh), Shader(world)
        material, owner = world.mesh.material, world.mesh.owner
        # Each surface has a number, so that edges show where neighbours' numbers differ.
        land = np.isin(material, (Material.GROUND, Material.APRON))
        built = np.isin(material, (Material.ROOF, Material.WALL))
        side = np.where(built, np.rint(self._caster.normal.T * 20.0), 0.0).astype(np.int64)
        number = hash_of(0, material, owner, *side) >> 33
        self._surfaces = np.append(np.where(land, 0, number), -1).astype(np.int32)
        self._owners = np.append(owner, -1)
        ranks = np.argsort([*RANKS.values()])[material]
        self._ranks = np.append(ranks, len(RANKS)).astype(np.uint8)
        self._corner = np.array([world.region.west, world.region.south, 0.0])

    def render(
        self, camera: Cameras, pose: Poses, weather: str, time: str, seed: int
    ) -> tuple[NDArray[np.uint8], Singles]:
        """Take a photo (H, W, 3) with one camera at one pose; return its depth (H, W), too.

        Depth is along the optical axis, in metres, 0 where there is no surface.
        """
        width, height = int(camera.width[0]), int(camera.height[0])
        centre, given = pose.centres[0] - self._corner, shading.conditions(weather, time)
        view = centre, np.float32(1.0 / float(camera.focal[0].mean())), given
        (fx, fy), (cx, cy) = camera.focal[0], camera.principal_point[0]
        x, y = (np.arange(width) + (0.5 - cx)) / fx, ((np.arange(height) + (0.5 - cy)) / fy)
        count, axes = height * width, pose.rotation[0].T.tolist()
        light, dither = np.empty((3, count), np.float32), _dither(count)
        depth, surface = np.empty(count, np.float32), np.empty(count, np.int32)
        for row, end in _bands(height, width):
            block, down = slice(row * width, end * width), y[row:end, None]
            rays = np.stack([x * a + down * b + c for a, b, c in axes]).reshape(3, -1)
            triangle, depth[block] = self._see(view, rays, dither[block], light[:, block])
            surface[block] = self._surfaces.take(triangle)
        sharp = _blur(light.reshape(3, height, width), surface.reshape(height, width))
        return _develop(sharp, pose.rotation[0], given, seed), depth.reshape(height, width)

    def _see(
        self, camera: _View, rays: Floats, dither: Singles, light: Singles
    ) -> tuple[_Indices, Floats]:
        """Return triangles that rays (3, N) meet and their depth; write the light that comes."""
        centre, pixel_angle, given = camera
        triangle, depth, normal = self._caster.trace(centre, rays)
        xyz, length = rays * depth, np.sqrt(dot(rays, rays))
        xyz += centre[:, None]
        # Points of a material lie side by side from here on.
        rank = self._ranks.take(triangle)
        counts = np.bincount(rank, minlength=len(RANKS))
        order = np.concatenate([np.flatnonzero(rank == one) for one in np.flatnonzero(counts)])
        spans = shading.spans_of(counts[: len(RANKS)].tolist())
        hits, lanes = spans["walls"].stop, np.empty((12, len(order)), np.float32)
        values = [*xyz, *normal, *rays / length, depth * length, dither]
        if given.direct:
            values.append(self._sunlight(xyz, normal, np.array(given.light.direction)))
        for lane, part in zip(lanes, values, strict=False):
            part.astype(np.float32).take(order, out=lane, mode="clip")
        hit, owner = lanes[:, :hits], self._owners.take(triangle.take(order[:hits]))
        parts: list[Any] = [*hit[:9].reshape(3, 3, -1), *hit[9:], hit[9] * pixel_angle, owner]
        seen = self._shader.colour(Points(*parts), spans, given)
        if hits < len(order):
            seen = np.append(seen, self._shader.horizon(lanes[6:9, hits:], centre, given), axis=1)
        for channel, part in zip(light, seen, strict=True):
            channel[order] = part
        return triangle, depth

    def _sunlight(self, xyz: Floats, normal: Floats, sun: Floats) -> Floats:
        """Return the cosine of the angle between normals (3, N) and the sun, 0 in shadow."""
        cosine: Floats = np.maximum(dot(normal, sun), 0.0)
        facing = np.flatnonzero(cosine)
        at, up = (parts.take(facing, axis=1) for parts in (xyz, normal))
        cosine[facing] *= ~self._caster.occluded(at, up, sun)
        return cosine


def _bands(height: int, width: int) -> list[tuple[int, int]]:
    """Return where parts of a photo that are worked on at once begin and end."""
    step = max(_BLOCK_PIXELS // width, 1)
    return [(row, min(row + step, height)) for row in range(0, height, step)]


def _blur(light: Singles, surface: NDArray[np.int32]) -> Singles:
    """Spread light (3, H, W) over neighbours, as a lens does, more where surfaces (H, W) meet."""
    result = light.copy()
    for row, end in _bands(*surface.shape):
        above = max(row - 1, 0)
        for here, there in (
            (np.s_[row:end, 1:], np.s_[row:end, :-1]),
            (np.s_[above + 1 : end], np.s_[above : end - 1]),
        ):
            share = _BLUR + _EDGE_BLUR * (surface[here] != surface[there])
            for plane, sharp in zip(result, light, strict=True):
                step = sharp[there] - sharp[here]
                step *= share
                plane[here] += step
                plane[there] -= step
    return result


def _develop(sharp: Singles, rotation: Floats, given: Conditions, seed: int) -> NDArray[np.uint8]:
    """Turn the light (3, H, W) that reaches the lens into an image (H, W, 3)."""
    _, height, width = sharp.shape
    random = np.random.Generator(np.random.PCG64(seed))
    drops = _drops(width, height, rotation, given.falling, random) if given.falling else None
    start, count = _GRAINS - random.integers(_GRAINS), 4 * height * width
    grain = _grain(count)[start : start + count].reshape(4, height, width)
    half, air = np.hypot(width, height) / 2, column(given.horizon)[..., None] * np.float32(1.05)
    x, y = (((np.arange(n) + 0.5 - n / 2) / half).astype(np.float32) for n in (width, height))
    image = np.empty((height, width, 3), np.uint8)
    for rows in (slice(*band) for band in _bands(height, width)):
        light = sharp[:, rows]
        if drops is not None:
            light += (air - light) * (drops[rows] * np.float32(1 / 255))
        square = (y[rows] * y[rows])[:, None] + (x * x)[None]
        light = light * (1 - _VIGNETTE * square * square)
        # Highlights bend to white softly.
        levels = light.ravel()
        bright = np.flatnonzero(levels > _SHOULDER)
        over = levels[bright] - _SHOULDER
        levels[bright] = _SHOULDER + over / (1 + over / (1 - _SHOULDER))
        light *= 255
        # Shot noise grows with the root of the light; read noise is always there.
        strength = np.sqrt(np.maximum(light, 4.0) * np.float32(1 / 128)) * np.float32(given.noise)
        normal = np.float32(0.8) * grain[:3, rows] + np.float32(0.6) * grain[3, rows]
        light += normal * strength
        for channel, values in enumerate(np.rint(light.clip(0.0, 255.0)).astype(np.uint8)):
            image[rows, :, channel] = values
    return image


@cache
def _dither(count: int) -> Singles:
    """Return a number in [0, 1) for each pixel of a photo, the same in all photos."""
    return uniforms(hash_of(_DITHER_STREAM, np.arange(count)))


@cache
def _grain(count: int) -> Singles:
    """Return normal numbers that the noise of all photos is cut from, each at another place."""
    normal = np.random.Generator(np.random.PCG64(0)).standard_normal(_GRAINS, np.float32)
    return np.resize(normal, _GRAINS + count)


def _drops(
    width: int, height: int, rotation: Floats, falling: str, random: np.random.Generator
) -> NDArray[np.uint8]:
    """Return how much of each pixel (H, W) rain or snow in the air covers, in 255ths."""
    image = Image.new("L", (width, height))
    draw, chance = ImageDraw.Draw(image), random.random((6, _DROPS[falling]))
    start = (chance[:2] * 1.2 - 0.1) * [[width], [height]]
    near = chance[2] ** 3
    if falling == "rain":
        # Streaks lie along the way that drops fall as the camera sees it.
        fall = (rotation @ np.array([0.16, 0.05, -1.0]))[:2, None] + (chance[3:5] - 0.5) * 0.12
        ends = np.concatenate([start, start + fall * (0.02 + 0.09 * near) * height]).T
        thick, blur = max(round(height / 500), 1), 0.4
        for line, strength in zip(ends.tolist(), (26 + 60 * chance[5]).tolist(), strict=True):
            draw.line(line, fill=int(strength), width=thick)
    else:
        size, blur = (0.0012 + 0.0055 * near) * height, 0.7
        boxes = np.concatenate([start - size, start + size]).T
        for box, strength in zip(boxes.tolist(), (210 - 120 * near).tolist(), strict=True):
            draw.ellipse(box, fill=int(strength))
    return np.asarray(image.filter(ImageFilter.BoxBlur(blur * height / 480)))


# --- folders ---


@dataclass(frozen=True, eq=False)
class FrameList:
    """N frames to render."""

    names: tuple[str, ...]  # each once; they become names of files
    camera: Cameras  # one for all
    poses: Poses  # N, in `world.CRS`
    weather: tuple[str, ...]  # see `shading.conditions`
    time_of_day: tuple[str, ...]
    seed: int = 0  # of the noise, together with each frame's name
    sequence: tuple[str, ...] = ()  # the flight that each is of

    @property
    def pinhole(self) -> tuple[float, ...]:
        """Width, height, focal lengths and principal point of the camera."""
        size = int(self.camera.width[0]), int(self.camera.height[0])
        return (*size, *self.camera.focal[0].tolist(), *self.camera.principal_point[0].tolist())


def _frames_csv(frames: FrameList) -> str:
    poses = frames.poses
    lonlat = to_lonlat(CRS, poses.centres[:, :2])
    turn = grid_convergence_deg(CRS, lonlat)
    angles = rotations_to_angles(poses.rotation, convergence_deg=turn)[:, ::-1]
    given = {"name": frames.names, "weather": frames.weather, "time_of_day": frames.time_of_day}
    table = pd.DataFrame(given)
    numbers = np.column_stack([lonlat, poses.centres[:, 2], angles])
    table[list(PLACE_COLUMNS)] = np.round(numbers, 12) + 0.0  # no negative zeros
    table[["width", "height", "fx", "fy", "cx", "cy"]] = frames.pinhole
    return table.to_csv(index=False, lineterminator="\n")


def render_frames(
    frames: FrameList, world: Path, folder: Path, engine: Engine = HERE, progress: Progress = silent
) -> int:
    """Render frames of a stored world into a folder where they are not yet; return how many."""
    table = folder / "frames.csv"
    check_output_folder(folder, (table.name,))
    key = read_index(world)[2]
    marks = [_mark(frames, key, row) for row in range(len(frames.names))]
    found = [_read_mark(*frame_paths(folder, name)) for name in frames.names]
    todo = [row for row, mark in enumerate(marks) if found[row] != mark]
    if todo:  # it would describe photos about to be replaced
        table.unlink(missing_ok=True)
    done = engine.map(
        _render_frame,
        todo,
        shared=(frames, marks, world, key, folder),
        stage="rendering",
        name=lambda row: f"frame {frames.names[row]}",
    )
    for _ in progress(done, "rendering", len(todo)):
        pass
    _load_renderer.cache_clear()
    with atomic_write(table, "w") as stream:
        stream.write(_frames_csv(frames))
    return len(todo)


def _mark(frames: FrameList, key: str, row: int) -> str:
    given = [frames.weather[row], frames.time_of_day[row]]
    pose = [frames.poses.rotation[row].tolist(), frames.poses.centres[row].tolist()]
    seed = seed_of(frames.seed, frames.names[row])
    return fingerprint([RENDERER_VERSION, key, frames.pinhole, pose, given, seed])


def _render_frame(shared: tuple[FrameList, list[str], Path, str, Path], row: int) -> None:
    """Write a frame's files, each whole or not at all, with the mark of its inputs."""
    frames, marks, world, key, folder = shared
    name, given = frames.names[row], (frames.weather[row], frames.time_of_day[row])
    view = frames.camera, frames.poses.take(row), *given, seed_of(frames.seed, name)
    photo, distances = (Image.fromarray(part) for part in _load_renderer(world, key).render(*view))
    image, depth = frame_paths(folder, name)
    with atomic_write(depth) as stream:
        kind, predictor = "tiff_adobe_deflate", {317: 3}  # of floating point
        distances.save(stream, format="TIFF", compression=kind, tiffinfo=predictor)
    with atomic_write(image) as stream:  # after its depth, so that it says that both are there
        photo.save(stream, format="JPEG", quality=92, subsampling=0, comment=marks[row])


@lru_cache(maxsize=1)
def _load_renderer(world: Path, key: str) -> Renderer:
    del key  # tells worlds apart
    return Renderer(load_world(world))


def frame_paths(folder: Path, name: str) -> tuple[Path, Path]:
    """Return the places of a frame's photo and depth."""
    return folder / "images" / f"{name}{IMAGE_SUFFIX}", folder / "depth" / f"{name}.tif"


def _read_mark(image: Path, depth: Path) -> str | None:
    """Return the mark of a photo; None where it or its depth is missing or damaged."""
    try:
        with Image.open(image) as picture:
            mark: bytes = picture.info.get("comment", b"")
    except OSError:
        return None
    return mark.decode("ascii", "replace") if depth.is_file() else None


def read_depth(path: Path) -> Floats:
    """Read a frame's depth, (H, W) metres along the optical axis, 0 where there is no surface."""
    with Image.open(path) as image:
        return np.asarray(image, np.float64)
