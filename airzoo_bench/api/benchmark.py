"""Benchmarks from Python: everything that a method may know, without the truth."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from airzoo_bench.benchmark import queries
from airzoo_bench.benchmark.folder import Benchmark, data_here, find_benchmark, needed
from airzoo_bench.benchmark.images import photo_size, read_rgb_photo
from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.rasters import pixel_to_world, read_rgb
from airzoo_bench.matching.solving import lift
from airzoo_bench.matching.truth import read_truth as read_matching_truth
from airzoo_bench.retrieval.truth import boxes_of, read_tiles

Image = NDArray[np.uint8]


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
    scenes = tuple(
        BlindScene(one.id, one.title, one.crs, one.plane_height_m, source)
        for one in source.file.scenes
    )
    return BlindBenchmark(source.name, source.folder, tuple(source.file.tracks), scenes, source)


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

    def queries(self) -> tuple[Picture, ...]:
        """Return the queries of retrieval, sorted by id."""
        return self.photos("retrieval")

    def photos(self, track: str = "reconstruction") -> tuple[Picture, ...]:
        """Return the photos for a track, sorted by id."""
        table = queries.read_queries(
            self._folder(track).parent, queries.read_excluded(self._source, self.id, track)
        )
        home = self._source.resolve(self._source.scene(self.id).images)
        texts: Any = queries.conditions_of(table).select_dtypes(exclude="number").astype(str)
        priors: dict[int, Pose] = {}
        cameras: dict[int, Camera] = {}
        if {*queries.PRIOR_COLUMNS} <= {*table.columns}:
            known = np.isfinite(table[list(queries.PRIOR_COLUMNS)].to_numpy(float)).all(axis=1)
            poses = queries.poses_of(table[known], queries.PRIOR_COLUMNS)
            pairs = map(Pose, poses.rotation, poses.centres)
            priors = dict(zip(np.flatnonzero(known).tolist(), pairs, strict=True))
        if {*queries.CAMERA_COLUMNS} <= {*table.columns}:
            lens = queries.cameras_of(table)
            sizes = lens.width.tolist(), lens.height.tolist()
            cameras = dict(enumerate(map(Camera, *sizes, lens.matrices, lens.distortion)))
        rows = enumerate(zip(table["id"], table["image"], texts.to_dict("records"), strict=True))
        return tuple(
            Picture(one, home / name, None, name, said, priors.get(row), cameras.get(row))
            for row, (one, name, said) in rows
        )

    def tiles(self) -> tuple[Picture, ...]:
        """Return the tiles of the gallery, sorted by id."""
        table, entry = read_tiles(self._folder("retrieval")), self._source.scene(self.id)
        gallery = self._source.resolve(needed(entry.gallery or entry.dom, "gallery", self.id))
        if "image" in table.columns:
            pairs = zip(table["id"], table["image"], strict=True)
            return tuple(Picture(one, gallery / image) for one, image in pairs)
        windows = table[["x", "y", "width", "height"]].to_numpy(np.int64).tolist()
        sizes, boxes = table["size_m"].astype(float), boxes_of(table).tolist()
        return tuple(
            Picture(one, gallery, tuple(window), box=tuple(box), size_m=size)
            for one, window, box, size in zip(table["id"], windows, boxes, sizes, strict=True)
        )

    def crops(self) -> tuple[Picture, ...]:
        """Return the crop of each query of matching, sorted by the photo's id."""
        photos, truth = self.photos("matching"), read_matching_truth(self._source, self.id)
        maps, windows = map(truth.map_of, range(len(photos))), map(tuple, truth.crops.tolist())
        return tuple(
            Picture(one.id, its.dom.path, window, query=one, map=its.dom, surface=its.dsm)
            for one, window, its in zip(photos, windows, maps, strict=True)
        )

    def _folder(self, track: str) -> Path:
        if track not in self._source.file.tracks:
            what = f"serves no {track}, only {', '.join(self._source.file.tracks)}"
            raise BenchmarkError(what, where=self._source.folder)
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


@dataclass(frozen=True, eq=False, repr=False)
class Picture:
    """A photo, a tile of the gallery or a crop of the map; each has its own of these fields.

    Photos have a `name`, `conditions` (without numbers, which come from the true pose), a `camera`
    and a `prior` by their own GPS and gimbal, or None; the id is ``scene/name``. Tiles of a map
    have a `box`, lon_min, lat_min, lon_max, lat_max in degrees, and `size_m`, the mean side on the
    ground. Crops are chosen by the prior of their `query`; `surface` is the surface model of `map`,
    on a grid of its own. `window` is x, y, width, height in the map.
    """

    id: str
    path: Path
    window: Any = None
    name: str = ""
    conditions: dict[str, str] = field(default_factory=dict)
    prior: Pose | None = None
    camera: Any = None
    box: Any = None
    size_m: float | None = None
    query: Any = None
    map: Any = None
    surface: Any = None

    def __repr__(self) -> str:
        return f"Picture({self.id})"

    @property
    def image(self) -> Image:
        """The picture (H, W, 3) at full size, read now."""
        return self.read()

    def read(self, long_side_px: int | None = None) -> Image:
        """Read the picture in colour; a photo is made smaller where a long side is given."""
        if self.window is not None:
            return read_rgb(self.path, self.window)
        whole = max(photo_size(self.path))
        return read_rgb_photo(self.path, long_side_px or whole)

    def to_map(self, xy: ArrayLike) -> Floats:
        """Take pixels (M, 2) of the crop to pixels of the whole map, as predictions have them."""
        return np.asarray(xy, np.float64) + np.asarray(self.window[:2], np.float64)

    def to_world(self, xy: ArrayLike) -> Floats:
        """Take pixels (M, 2) of the crop to coordinates of the map's CRS, x before y."""
        return pixel_to_world(self.map.transform, self.to_map(xy))

    def to_points(self, xy: ArrayLike) -> Floats:
        """Lift pixels (M, 2) of the crop onto the surface: (M, 3) in the scene's CRS, or NaN."""
        return lift(self.to_map(xy), self.map, self.surface, jobs=1).points
