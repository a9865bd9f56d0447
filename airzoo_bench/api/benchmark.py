"""Benchmarks from Python: everything that a method may know, without the truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
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
from airzoo_bench.core.errors import BenchmarkError
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

    Parameters
    ----------
    name_or_path : str or Path
        Its name, such as ``airzoo-mini``, or its folder, as ``airzoo-bench prepare`` wrote it.
    data : str or Path, optional
        The folder that holds benchmark folders; by default ``$AIRZOO_BENCH_DATA`` or the cache.

    Returns
    -------
    BlindBenchmark
        Scenes, photos, tiles, crops.

    Raises
    ------
    BenchmarkError
        It is not there, or a file of it is missing or was changed.
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
    tracks = tuple(source.file.tracks)
    return BlindBenchmark(source.name, source.folder, tracks, tuple(scenes), source)


@dataclass(frozen=True, eq=False)
class BlindBenchmark:
    """A benchmark without its truth, as `load_benchmark` opens it.

    Attributes
    ----------
    name : str
    folder : Path
    tracks : tuple of str
        The tracks that it serves: retrieval, matching, reconstruction.
    scenes : tuple of BlindScene
    """

    name: str
    folder: Path
    tracks: tuple[str, ...]
    scenes: tuple[BlindScene, ...]
    _source: Benchmark = field(repr=False)

    def scene(self, scene_id: str) -> BlindScene:
        """Return a scene by its id, such as "city"; raise a `BenchmarkError` where none has it."""
        by_id = {scene.id: scene for scene in self.scenes}
        if scene_id not in by_id:
            what = f"has no scene {scene_id!r}"
            raise BenchmarkError(what, where=self.folder, expected=", ".join(by_id))
        return by_id[scene_id]


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
        return self.photos_of("retrieval")

    def photos(self) -> tuple[Photo, ...]:
        """Return the photos for a reconstruction, sorted by id."""
        return self.photos_of("reconstruction")

    def photos_of(self, track: str) -> tuple[Photo, ...]:
        """Return the photos that a track asks for, sorted by id."""
        folder = self._home(track).parent
        table = read_queries(folder, read_excluded(self._source, self.id, track))
        return photos_of(table, self._source.resolve(self._source.scene(self.id).images))

    def tiles(self) -> tuple[Tile, ...]:
        """Return the tiles of the gallery, sorted by id."""
        table, entry = read_tiles(self._home("retrieval")), self._source.scene(self.id)
        gallery = self._source.resolve(needed(entry.gallery or entry.dom, "gallery", self.id))
        if "image" in table.columns:
            pairs = zip(table["id"], table["image"], strict=True)
            return tuple(Tile(name, gallery / image) for name, image in pairs)
        windows = table[["x", "y", "width", "height"]].to_numpy(np.int64).tolist()
        sizes, boxes = table["size_m"].astype(float), boxes_of(table).tolist()
        rows = zip(table["id"], windows, boxes, sizes, strict=True)
        return tuple(
            Tile(name, gallery, tuple(window), tuple(box), size) for name, window, box, size in rows
        )

    def crops(self) -> tuple[Crop, ...]:
        """Return the crop of each query of matching, sorted by the photo's id."""
        photos, truth = self.photos_of("matching"), read_matching_truth(self._source, self.id)
        windows, maps = truth.crops.tolist(), map(truth.map_of, range(len(photos)))
        return tuple(
            Crop(photo.id, photo, tuple(window), one.dom, one.dsm)
            for photo, window, one in zip(photos, windows, maps, strict=True)
        )

    def _home(self, track: str) -> Path:
        source = self._source
        if track not in source.file.tracks:
            what, served = f"{source.name} does not serve {track}", ", ".join(source.file.tracks)
            raise BenchmarkError(what, where=source.folder, expected=served)
        return source.scene_folder(self.id) / track


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
    come from the true pose.
    """

    id: str
    name: str = field(repr=False)
    path: Path = field(repr=False)
    conditions: Mapping[str, str] = field(repr=False)
    prior: Pose | None = field(default=None, repr=False)
    _camera: Camera | None = field(default=None, repr=False)

    @property
    def camera(self) -> Camera:
        """The camera of the photo at its full size."""
        if self._camera is None:
            raise BenchmarkError(f"the camera of {self.id} is not known", where=self.path)
        return self._camera

    @property
    def image(self) -> Image:
        """The photo (H, W, 3) at full size, read now."""
        return self.read()

    def read(self, long_side_px: int | None = None) -> Image:
        """Read the photo in colour, made smaller where a long side is given."""
        size, camera = photo_size(self.path), self._camera
        if camera is not None and size != camera[:2]:
            what, expected = f"the photo is {size[0]} x {size[1]} px", "the size of its camera"
            raise BenchmarkError(what, where=self.path, expected=expected)
        return read_rgb_photo(self.path, long_side_px or max(size))


def photos_of(table: pd.DataFrame, folder: Path) -> tuple[Photo, ...]:
    """Make photos of a scene's table, without its columns of true poses."""
    texts: Any = conditions_of(table).select_dtypes(exclude="number").astype(str).to_dict("records")
    known: list[dict[str, Any]] = [{} for _ in texts]
    if set(PRIOR_COLUMNS) <= set(table.columns):
        rows = np.flatnonzero(np.isfinite(table[list(PRIOR_COLUMNS)].to_numpy(float)).all(axis=1))
        poses = poses_of(table.iloc[rows], PRIOR_COLUMNS)
        for row, rotation, centre in zip(rows, poses.rotation, poses.centres, strict=True):
            known[row]["prior"] = Pose(rotation, centre)
    if set(CAMERA_COLUMNS) <= set(table.columns):
        batch = cameras_of(table)
        sizes = zip(batch.width.tolist(), batch.height.tolist(), strict=True)
        for place, size in enumerate(sizes):
            known[place]["_camera"] = Camera(*size, batch.matrices[place], batch.distortion[place])
    names = zip(table["id"], table["image"], texts, known, strict=True)
    return tuple(Photo(one, name, folder / name, text, **more) for one, name, text, more in names)


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
