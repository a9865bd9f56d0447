"""What a scene gives a method a piece at a time: sequences of tiles and crops of maps.

Each item is made, and each picture read, when it is asked for.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Generic, TypeVar, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray
from rasterio import Affine

from airzoo_bench.api.photos import Photo
from airzoo_bench.benchmark.images import photo_size, read_rgb_photo
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.crs import describe_crs
from airzoo_bench.geometry.rasters import RasterInfo, pixel_to_world, read_rgb
from airzoo_bench.matching.lifting import lift

__all__ = ["Crop", "Items", "Tile"]

T = TypeVar("T", covariant=True)

_POINTS = 1 << 19  # of a crop that are lifted at a time


class Items(Sequence[T], Generic[T]):
    """Photos, tiles or crops of a scene: each is made when it is asked for, and none is kept.

    Parameters
    ----------
    what : str
        Such as ``"tiles of city"``.
    count : int
    make : callable
        Takes a number from 0 to `count` and returns the item.

    Examples
    --------
    >>> items = Items("tiles of city", 3, lambda row: f"tile {row}")
    >>> items, items[-1], list(items[:2])
    (<3 tiles of city>, 'tile 2', ['tile 0', 'tile 1'])
    """

    def __init__(self, what: str, count: int, make: Callable[[int], T]) -> None:
        self._what, self._count, self._make = what, count, make

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[T]:
        return map(self._make, range(self._count))

    @overload
    def __getitem__(self, index: int) -> T: ...
    @overload
    def __getitem__(self, index: slice) -> Items[T]: ...
    def __getitem__(self, index: int | slice) -> T | Items[T]:
        rows = range(self._count)[index]
        if isinstance(rows, int):
            return self._make(rows)
        return Items(f"of the {self._what}", len(rows), lambda row: self._make(rows[row]))

    def __repr__(self) -> str:
        return f"<{self._count:,} {self._what}>"


@dataclass(frozen=True, eq=False, repr=False)
class Tile:
    """A tile of a gallery: a window of a map or, where the benchmark gives images, an image.

    Attributes
    ----------
    id : str
        ``scene/size_row_column``, or that of the image.
    box : tuple of 4 float or None
        lon_min, lat_min, lon_max, lat_max in degrees, WGS84; None for an image.
    size_m : float or None
        Mean side on the ground, in metres; None for an image.
    window : tuple of 4 int or None
        x, y, width, height in pixels of the map that it is cut from; None for an image.
    map : Path
        That map, or the image's file.
    """

    id: str
    box: tuple[float, float, float, float] | None
    size_m: float | None
    window: tuple[int, int, int, int] | None
    map: Path

    @property
    def image(self) -> NDArray[np.uint8]:
        """The tile (H, W, 3), read now."""
        if self.window is None:
            return read_rgb_photo(self.map, max(photo_size(self.map)))
        return read_rgb(self.map, self.window)

    def __repr__(self) -> str:
        if self.window is None:
            return f"Tile({self.id!r}, {self.map.name})"
        return f"Tile({self.id!r}, {self.window[2]} x {self.window[3]} px, {self.size_m:.1f} m)"


@dataclass(frozen=True, eq=False, repr=False)
class Crop:
    """The part of the map that a query is matched to, found from its prior.

    Attributes
    ----------
    query : Photo
    window : tuple of 4 int
        x, y, width, height in pixels of the whole map.
    map : RasterInfo
        The whole map: path, size, geotransform, CRS.
    surface : Path
        The surface model of the scene, on a grid of its own.
    """

    query: Photo
    window: tuple[int, int, int, int]
    map: RasterInfo
    surface: Path

    @property
    def offset(self) -> tuple[int, int]:
        """Where the crop begins in the whole map: column and row in pixels."""
        return self.window[:2]

    @property
    def crs(self) -> str:
        """CRS of the map, such as ``EPSG:32615``, or its WKT where it has no code."""
        code = self.map.crs.to_epsg()
        return self.map.crs.to_wkt() if code is None else f"EPSG:{code}"

    @property
    def transform(self) -> Affine:
        """Affine transform from pixels of the crop (column, row) to coordinates of `crs`."""
        a, b, _, d, e, _ = self.map.transform[:6]
        c, f = pixel_to_world(self.map.transform, self.offset).tolist()
        return Affine(a, b, c, d, e, f)

    @property
    def image(self) -> NDArray[np.uint8]:
        """The crop of the orthophoto (H, W, 3), read now."""
        return read_rgb(self.map.path, self.window)

    @property
    def heights(self) -> NDArray[np.float32]:
        """Heights (H, W) of the surface at the centres of the crop's pixels, in metres, read now.

        Interpolated as scoring does; NaN where the surface model has none.

        Raises
        ------
        RasterError
            The surface model is not there or cannot be read.
        """
        _, _, width, height = self.window
        heights = np.empty((height, width), np.float32)
        step = max(1, _POINTS // width)
        for top in range(0, height, step):
            part = heights[top : top + step]
            row, column = np.indices(part.shape, np.float64)
            xy = np.stack((column + 0.5, row + 0.5 + top), axis=-1).reshape(-1, 2)
            part[...] = self.to_points(xy)[:, 2].reshape(part.shape)
        return heights

    def to_map(self, xy: ArrayLike) -> Floats:
        """Take pixels (M, 2) of the crop to pixels of the whole map, as predictions have them."""
        return np.asarray(xy, np.float64) + self.offset

    def to_world(self, xy: ArrayLike) -> Floats:
        """Take pixels (M, 2) of the crop to coordinates of `crs`, x before y."""
        return pixel_to_world(self.map.transform, self.to_map(xy))

    def to_points(self, xy: ArrayLike) -> Floats:
        """Lift pixels (M, 2) of the crop onto the surface: (M, 3) in the scene's CRS, or NaN."""
        return lift(self.to_map(xy), self.map, self.surface, jobs=1).points

    def __repr__(self) -> str:
        _, _, width, height = self.window
        crs = describe_crs(self.map.crs)
        return f"Crop({self.query.id!r}, {width} x {height} px at {self.offset}, {crs})"
