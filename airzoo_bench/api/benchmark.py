"""Opening a benchmark for a method that is to be scored on it: all it may know, and no truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from airzoo_bench.api.arrays import path_of
from airzoo_bench.api.map_parts import Crop, Items, Tile
from airzoo_bench.api.photos import Photo, Photos
from airzoo_bench.benchmark.excluded import read_excluded
from airzoo_bench.benchmark.folder import Benchmark, TruthWanted, find_benchmark, needed
from airzoo_bench.benchmark.queries import read_queries
from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.core.places import data_root
from airzoo_bench.matching.truth import read_truth as read_matching_truth
from airzoo_bench.retrieval.truth import boxes_of, read_tiles

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["BlindBenchmark", "BlindScene", "load_benchmark"]


_WINDOW = ["x", "y", "width", "height"]


def load_benchmark(name_or_path: str | Path, data: str | Path | None = None) -> BlindBenchmark:
    """Open a benchmark for a method that is to be scored on it.

    What comes back leads to all that a method may know, and to nothing of the truth: no positives,
    no true pose, no true cloud.

    Parameters
    ----------
    name_or_path : str or Path
        The benchmark's name, such as ``airzoo-mini``, or its folder, as ``airzoo-bench prepare``
        wrote it.
    data : str or Path, optional
        The folder that holds benchmark folders; by default ``$AIRZOO_BENCH_DATA`` or the cache
        folder.

    Returns
    -------
    BlindBenchmark
        Scenes, photos, tiles, crops.

    Raises
    ------
    BenchmarkError
        It is not there, or a file of it is missing or was changed.

    Examples
    --------
    >>> load_benchmark("nowhere")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    ...
    airzoo_bench.core.errors.BenchmarkError: ...benchmark nowhere is not there...

    With one that is there::

        for scene in load_benchmark("airzoo-mini").scenes:
            gallery = [(tile.id, tile.image) for tile in scene.tiles()]
            photos = [(photo.id, photo.image) for photo in scene.queries()]
    """
    folder = path_of("name_or_path", name_or_path)
    if (folder / "benchmark.toml").is_file() or len(folder.parts) > 1:
        return BlindBenchmark.of(Benchmark.open(folder, sealed=True))
    root = data_root() if data is None else path_of("data", data)
    return BlindBenchmark.of(find_benchmark(str(name_or_path), root, sealed=True))


@dataclass(frozen=True, eq=False, repr=False)
class BlindBenchmark:
    """A benchmark without its truth, as `load_benchmark` opens it."""

    _source: Benchmark

    @classmethod
    def of(cls, benchmark: Benchmark) -> BlindBenchmark:
        """Leave the truth out of an opened benchmark folder.

        Parameters
        ----------
        benchmark : Benchmark
            With its truth.

        Returns
        -------
        BlindBenchmark
            Which leads to nothing of it.
        """
        return cls(_without_truth(benchmark))

    @property
    def name(self) -> str:
        """The benchmark's name, as protocols give it."""
        return self._source.name

    @property
    def folder(self) -> Path:
        """The benchmark folder."""
        return self._source.folder

    @property
    def tracks(self) -> tuple[str, ...]:
        """The tracks that it serves: retrieval, matching, reconstruction."""
        return tuple(self._source.file.tracks)

    @property
    def scenes(self) -> tuple[BlindScene, ...]:
        """All scenes."""
        return tuple(BlindScene(self._source, scene.id) for scene in self._source.file.scenes)

    def scene(self, scene_id: str) -> BlindScene:
        """Return a scene by its id.

        Parameters
        ----------
        scene_id : str
            Such as "city".

        Returns
        -------
        BlindScene
            Without its truth.

        Raises
        ------
        BenchmarkError
            There is none of that id.
        """
        for scene in self.scenes:
            if scene.id == scene_id:
                return scene
        raise BenchmarkError(
            f"has no scene {scene_id!r}",
            where=self.folder,
            expected=", ".join(scene.id for scene in self.scenes),
        )

    def scenes_of(self, protocol: TruthWanted) -> tuple[BlindScene, ...]:
        """Return the scenes of a protocol.

        Parameters
        ----------
        protocol : Protocol
            Of this benchmark.

        Returns
        -------
        tuple of BlindScene
            In the protocol's order.

        Raises
        ------
        BenchmarkError
            The benchmark was not prepared for it.
        """
        self._source.check_fits(protocol)
        return tuple(self.scene(scene.id) for scene in protocol.scenes)

    def __repr__(self) -> str:
        scenes = ", ".join(scene.id for scene in self.scenes)
        return f"BlindBenchmark({self.name!r}: {', '.join(self.tracks)}; scenes {scenes})"


@dataclass(frozen=True, eq=False, repr=False)
class BlindScene:
    """A scene without its truth.

    Photos, tiles and crops come as sequences of which each item is made, and each picture read,
    when it is asked for.

    Attributes
    ----------
    id : str
    """

    _source: Benchmark
    id: str

    @property
    def title(self) -> str:
        """How tables show the scene."""
        return self._source.scene(self.id).title

    @property
    def crs(self) -> str | None:
        """The projected CRS of poses, surface model and clouds, in metres.

        "local" for a frame in metres that has no place on the earth; None without poses.
        """
        return self._source.scene(self.id).crs

    @property
    def plane_height_m(self) -> float | None:
        """Median height of the surface model, or of the ground by the dataset's word, in metres."""
        return self._source.scene(self.id).plane_height_m

    def queries(self) -> Items[Photo]:
        """Return the photos that retrieval asks, sorted by id.

        Raises
        ------
        BenchmarkError
            The benchmark does not serve retrieval, or a table is damaged.
        """
        photos = self._photos("retrieval")
        return Items(f"queries of {self.id}", len(photos), photos.photo)

    def tiles(self) -> Items[Tile]:
        """Return the tiles of the gallery, sorted by id.

        Raises
        ------
        BenchmarkError
            The benchmark does not serve retrieval, or the table of tiles is damaged.
        """
        tiles = read_tiles(self._home("retrieval"))
        entry = self._source.scene(self.id)
        if "image" in tiles.columns:
            return self._images(tiles, needed(entry.gallery, "gallery", self.id))
        gallery = self._source.resolve(needed(entry.gallery or entry.dom, "map", self.id))
        ids, sizes = tiles["id"].tolist(), tiles["size_m"].to_numpy(np.float64)
        boxes, windows = boxes_of(tiles), tiles[_WINDOW].to_numpy(np.int64)

        def tile(row: int) -> Tile:
            box, window = tuple(boxes[row].tolist()), tuple(windows[row].tolist())
            return Tile(ids[row], box, float(sizes[row]), window, gallery)

        return Items(f"tiles of {self.id}", len(ids), tile)

    def _images(self, tiles: pd.DataFrame, gallery: str) -> Items[Tile]:
        """Return the tiles of a gallery that is a folder of images."""
        ids, images = tiles["id"].tolist(), tiles["image"].tolist()
        folder = self._source.resolve(gallery)

        def tile(row: int) -> Tile:
            return Tile(ids[row], None, None, None, folder / images[row])

        return Items(f"tiles of {self.id}", len(ids), tile)

    def crops(self) -> Items[Crop]:
        """Return the crop of each photo that matching asks, sorted by the photo's id.

        Raises
        ------
        BenchmarkError
            The benchmark does not serve matching, a table is damaged, or map or surface model are
            not those that were prepared.
        RasterError
            Map or surface model cannot be read.
        """
        photos = self._photos("matching")
        truth = read_matching_truth(self._source, self.id)
        windows, maps = truth.crops.copy(), [truth.map_of(row) for row in range(len(truth.crops))]

        def crop(row: int) -> Crop:
            window, of = tuple(windows[row].tolist()), maps[row]
            return Crop(photos.photo(row), window, of.dom, of.dsm)

        return Items(f"crops of {self.id}", len(windows), crop)

    def photos(self) -> Items[Photo]:
        """Return the photos that a reconstruction is made from, sorted by id.

        Raises
        ------
        BenchmarkError
            The benchmark does not serve reconstruction, or a table is damaged.
        """
        photos = self._photos("reconstruction")
        return Items(f"photos of {self.id}", len(photos), photos.photo)

    def _photos(self, track: str) -> Photos:
        self._home(track)
        excluded = read_excluded(self._source, self.id, track)
        table = read_queries(self._source.scene_folder(self.id), excluded)
        images = self._source.resolve(self._source.scene(self.id).images)
        return Photos.of(table, images)

    def _home(self, track: str) -> Path:
        if track not in self._source.file.tracks:
            raise BenchmarkError(
                f"benchmark {self._source.name} does not serve {track}",
                where=self._source.folder,
                expected=", ".join(self._source.file.tracks),
            )
        return self._source.scene_folder(self.id) / track

    def __repr__(self) -> str:
        return f"BlindScene({self.id!r}, {self.crs})"


def _without_truth(benchmark: Benchmark) -> Benchmark:
    """Return a benchmark folder whose manifest does not name the true cloud."""
    nothing = {"cloud": None, "cloud_sha256": None}
    scenes = tuple(scene.model_copy(update=nothing) for scene in benchmark.file.scenes)
    file = benchmark.file.model_copy(update={"scenes": scenes, "checksums": {}})
    return Benchmark(benchmark.folder, file)
