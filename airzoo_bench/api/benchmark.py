"""Benchmarks from Python: everything that a method may know, without the truth."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from airzoo_bench.benchmark.folder import Benchmark, data_here, find_benchmark, needed
from airzoo_bench.benchmark.images import photo_size, read_rgb_photo
from airzoo_bench.benchmark.queries import (
    CAMERA_COLUMNS,
    PRIOR_COLUMNS,
    cameras_of,
    conditions_of,
    poses_of,
    read_excluded,
    read_queries,
)
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.rasters import RasterInfo, pixel_to_world, read_rgb
from airzoo_bench.matching.solving import lift
from airzoo_bench.matching.truth import read_truth as read_matching_truth
from airzoo_bench.retrieval.truth import boxes_of, read_tiles

__all__ = ["BlindBenchmark", "load_benchmark"]

Image = NDArray[np.uint8]
Window = tuple[int, int, int, int]


def load_benchmark(name_or_path: str | Path, data: str | Path | None = None) -> BlindBenchmark:
    """Open a benchmark for a method that is to be scored on it: all except the truth.

    `name_or_path` is a name, such as ``airzoo-mini``, or a folder that ``airzoo-bench prepare``
    wrote; `data` is the folder that holds named ones, by default ``$AIRZOO_BENCH_DATA`` or the
    cache. Raises a `BenchmarkError` where it is not there, or a file is missing or was changed.
    """
    folder = data_here(name_or_path)
    if (folder / "benchmark.toml").is_file() or len(folder.parts) > 1:
        source = Benchmark.open(folder, sealed=True)
    else:
        source = find_benchmark(str(name_or_path), data_here(data), sealed=True)
    scenes = [
        BlindScene(one.id, one.title, one.crs, one.plane_height_m, source)
        for one in source.file.scenes
    ]
    return BlindBenchmark(
        source.name, source.folder, tuple(source.file.tracks), tuple(scenes), source
    )


@dataclass(frozen=True, eq=False)
class BlindBenchmark:
    """A benchmark without its truth, as `load_benchmark` opens it.

    `name` is its own and `folder` is its place; `tracks` is a tuple of the tracks that it serves,
    `scenes` is one of its scenes.
    """

    name: str
    folder: Path
    tracks: tuple[str, ...]
    scenes: tuple[BlindScene, ...]
    _source: Benchmark = field(repr=False)

    def scene(self, scene_id: str) -> BlindScene:
        """Return a scene by its id, such as "city"; raise a KeyError where none has it."""
        return {scene.id: scene for scene in self.scenes}[scene_id]


@dataclass(frozen=True, eq=False)
class BlindScene:
    """A scene without its truth; pictures are read when they are used.

    `crs` is the projected CRS of poses, surface model and clouds, in metres; `plane_height_m` the
    median height of the surface model, or of the ground by the dataset's word.
    """

    id: str
    title: str
    crs: str | None
    plane_height_m: float | None
    _source: Benchmark = field(repr=False)

    def queries(self) -> tuple[Photo, ...]:
        """Return the queries of retrieval, sorted by id."""
        return self.photos("retrieval")

    def photos(self, track: str = "reconstruction") -> tuple[Photo, ...]:
        """Return the photos for a track, sorted by id."""
        folder, images = self._folder(track).parent, self._source.scene(self.id).images
        table = read_queries(folder, read_excluded(self._source, self.id, track))
        texts: Any = conditions_of(table).select_dtypes(exclude="number").astype(str)
        priors: list[Pose | None] = [None] * len(table)
        cameras: list[Camera | None] = [None] * len(table)
        if {*PRIOR_COLUMNS} <= {*table.columns}:
            known = np.isfinite(table[list(PRIOR_COLUMNS)].to_numpy(float)).all(axis=1)
            poses = poses_of(table[known], PRIOR_COLUMNS)
            pairs = zip(poses.rotation, poses.centres, strict=True)
            for row, pose in zip(np.flatnonzero(known), pairs, strict=True):
                priors[row] = Pose(*pose)
        if {*CAMERA_COLUMNS} <= {*table.columns}:
            lens = cameras_of(table)
            sizes = lens.width.tolist(), lens.height.tolist()
            parts = zip(*sizes, lens.matrices, lens.distortion, strict=True)
            cameras = [Camera(*part) for part in parts]
        home, names = self._source.resolve(images), table["image"]
        rows = zip(table["id"], names, texts.to_dict("records"), priors, cameras, strict=True)
        return tuple(Photo(one, name, home / name, *rest) for one, name, *rest in rows)

    def tiles(self) -> tuple[Tile, ...]:
        """Return the tiles of the gallery, sorted by id."""
        table, entry = read_tiles(self._folder("retrieval")), self._source.scene(self.id)
        gallery = self._source.resolve(needed(entry.gallery or entry.dom, "gallery", self.id))
        if "image" in table.columns:
            pairs = zip(table["id"], table["image"], strict=True)
            return tuple(Tile(name, gallery / image) for name, image in pairs)
        windows = table[["x", "y", "width", "height"]].to_numpy(np.int64).tolist()
        sizes, boxes = table["size_m"].astype(float), boxes_of(table).tolist()
        rows = zip(table["id"], windows, boxes, sizes, strict=True)
        return tuple(Tile(one, gallery, tuple(w), tuple(b), size) for one, w, b, size in rows)

    def crops(self) -> tuple[Crop, ...]:
        """Return the crop of each query of matching, sorted by the photo's id."""
        photos, truth = self.photos("matching"), read_matching_truth(self._source, self.id)
        windows, maps = truth.crops.tolist(), map(truth.map_of, range(len(photos)))
        rows = zip(photos, windows, maps, strict=True)
        return tuple(Crop(one.id, one, tuple(w), its.dom, its.dsm) for one, w, its in rows)

    def _folder(self, track: str) -> Path:
        return self._source.scene_folder(self.id) / track


class Camera(NamedTuple):
    """The camera of a photo; the image's corner is (0, 0), the first pixel's centre (0.5, 0.5).

    `K` is (3, 3) in pixels, `distortion` (5,) is k1 k2 p1 p2 k3, as OpenCV has them.
    """

    width: int
    height: int
    K: Floats
    distortion: Floats

    def scaled(self, width: int, height: int) -> Camera:
        """Return the camera of the photo resized to `width` x `height` pixels."""
        scale = np.array([[width / self.width], [height / self.height], [1.0]])
        return Camera(width, height, self.K * scale, self.distortion)


class Pose(NamedTuple):
    """The place of a camera in the scene's CRS: x_cam = R (X - C), R (3, 3), C (3,) in metres."""

    rotation: Floats
    centre: Floats


@dataclass(frozen=True, eq=False)
class Photo:
    """A photo as a method may know it, with the prior by its own GPS and gimbal.

    The id is ``scene/name``. Conditions that are numbers, such as altitude, are left out: they
    come from the true pose. Prior and camera are None where they are not known.
    """

    id: str
    name: str = field(repr=False)
    path: Path = field(repr=False)
    conditions: dict[str, str] = field(repr=False)
    prior: Pose | None = field(repr=False)
    camera: Any = field(repr=False)  # Camera | None

    @property
    def image(self) -> Image:
        """The photo (H, W, 3) at full size, read now."""
        return self.read()

    def read(self, long_side_px: int | None = None) -> Image:
        """Read the photo in colour, made smaller where a long side is given."""
        whole = max(photo_size(self.path))
        return read_rgb_photo(self.path, long_side_px or whole)


@dataclass(frozen=True, eq=False)
class Tile:
    """A tile of a gallery: a window (x, y, width, height) of a map, or an image.

    `box` is lon_min, lat_min, lon_max, lat_max in degrees, `size_m` the mean side on the ground;
    window, box and size are None for an image.
    """

    id: str
    map: Path
    window: Window | None = None
    box: tuple[float, float, float, float] | None = None
    size_m: float | None = None

    @property
    def image(self) -> Image:
        """The tile (H, W, 3), read now."""
        if self.window is None:
            return read_rgb_photo(self.map, max(photo_size(self.map)))
        return read_rgb(self.map, self.window)


@dataclass(frozen=True, eq=False)
class Crop:
    """The window (x, y, width, height) of an orthophoto that a query is matched with.

    It is chosen by the query's prior; `surface` is the surface model, on a grid of its own.
    """

    id: str
    query: Photo
    window: Window
    map: RasterInfo = field(repr=False)
    surface: Path = field(repr=False)

    @property
    def image(self) -> Image:
        """The crop of the orthophoto (H, W, 3), read now."""
        return read_rgb(self.map.path, self.window)

    def to_map(self, xy: ArrayLike) -> Floats:
        """Take pixels (M, 2) of the crop to pixels of the whole map, as predictions have them."""
        return np.asarray(xy, np.float64) + self.window[:2]

    def to_world(self, xy: ArrayLike) -> Floats:
        """Take pixels (M, 2) of the crop to coordinates of the map's CRS, x before y."""
        return pixel_to_world(self.map.transform, self.to_map(xy))

    def to_points(self, xy: ArrayLike) -> Floats:
        """Lift pixels (M, 2) of the crop onto the surface: (M, 3) in the scene's CRS, or NaN."""
        return lift(self.to_map(xy), self.map, self.surface, jobs=1).points
