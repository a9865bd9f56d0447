"""A scene for a method that is to be scored on it: what it may know."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from airzoo_bench.api.map_parts import Crop, Items, Tile
from airzoo_bench.api.photos import Photo, Photos
from airzoo_bench.benchmark.folder import Benchmark, needed
from airzoo_bench.benchmark.queries import read_excluded, read_queries
from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.matching.truth import read_truth as read_matching_truth
from airzoo_bench.retrieval.truth import boxes_of, read_tiles

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["BlindScene"]

_WINDOW = ["x", "y", "width", "height"]


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
        """The projected CRS of poses, surface model and clouds, in metres."""
        return self._source.scene(self.id).crs

    @property
    def plane_height_m(self) -> float | None:
        """Median height of the surface model, or of the ground by the dataset's word, in metres."""
        return self._source.scene(self.id).plane_height_m

    def queries(self) -> Items[Photo]:
        """Return the photos that retrieval asks, sorted by id."""
        photos = self._photos("retrieval")
        return Items(f"queries of {self.id}", len(photos), photos.photo)

    def tiles(self) -> Items[Tile]:
        """Return the tiles of the gallery, sorted by id."""
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
        """Return the crop of each photo that matching asks, sorted by the photo's id."""
        photos = self._photos("matching")
        truth = read_matching_truth(self._source, self.id)
        windows, maps = truth.crops.copy(), [truth.map_of(row) for row in range(len(truth.crops))]

        def crop(row: int) -> Crop:
            window, of = tuple(windows[row].tolist()), maps[row]
            return Crop(photos.photo(row), window, of.dom, of.dsm)

        return Items(f"crops of {self.id}", len(windows), crop)

    def photos(self) -> Items[Photo]:
        """Return the photos that a reconstruction is made from, sorted by id."""
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
