"""What a map shows, and how much of it the surface model covers."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from rasterio.enums import Resampling

from airzoo_bench.core.errors import RasterError
from airzoo_bench.geometry.crs import change_of_plane
from airzoo_bench.geometry.heightfield import small_cache
from airzoo_bench.geometry.rasters import RasterInfo, opened, pixel_to_world, to_map_pixels

__all__ = ["MapFacts", "check_overlap", "map_facts"]

# A side of the pictures that are looked at, in cells.
_CELLS = 2048
_POINTS = 65
_COLOURS = 3


@dataclass(frozen=True)
class MapFacts:
    """What a map shows.

    Attributes
    ----------
    shown : float
        Share of its pixels that are not masked.
    one_colour : float
        Share of those that have the most frequent colour, to the last bit.
    colour : tuple of float
        That colour.
    over_surface : float
        Share of the map that lies over the surface model, whether this has a height there or not;
        NaN without one.
    """

    shown: float
    one_colour: float
    colour: tuple[float, ...]
    over_surface: float


def check_overlap(dom: RasterInfo, dsm: RasterInfo) -> None:
    """Refuse a map and a surface model of two places."""
    # One within the other may lie between the points that are looked at.
    if _share_over(dom, dsm) == 0.0 and _share_over(dsm, dom) == 0.0:
        raise RasterError(
            f"does not overlap the surface model: in the CRS of that, the map spans "
            f"{_bounds(dom, dsm)}, the surface model {_bounds(dsm, dsm)}",
            where=dom.path,
            expected=f"a map of the place of {dsm.path}",
            fix="look at the geotransform and the CRS of both",
        )


def map_facts(dom: RasterInfo, dsm: RasterInfo | None) -> MapFacts:
    """Measure what a map shows, in 2,048 cells a side at most, and how far the DSM covers it."""
    shown, share, colour = _commonest(dom)
    return MapFacts(shown, share, colour, math.nan if dsm is None else _share_over(dom, dsm))


def _share_over(above: RasterInfo, below: RasterInfo) -> float:
    """Share of a raster that lies within another's rectangle, sampled on a grid."""
    steps = np.linspace(0.0, 1.0, _POINTS)
    grid = np.stack(np.meshgrid(steps * above.width, steps * above.height), axis=-1)
    world = pixel_to_world(above.transform, grid.reshape(-1, 2))
    pixels = to_map_pixels(above.crs, below)(world)
    return float(((pixels >= 0) & (pixels <= (below.width, below.height))).all(axis=1).mean())


def _bounds(info: RasterInfo, frame: RasterInfo) -> str:
    corners = np.array(((0, 0), (1, 0), (0, 1), (1, 1))) * (info.width, info.height)
    world = pixel_to_world(info.transform, corners)
    world = change_of_plane(info.crs, frame.crs)(world)
    (west, south), (east, north) = world.min(axis=0), world.max(axis=0)
    return f"x {west:.1f} to {east:.1f}, y {south:.1f} to {north:.1f}"


def _commonest(dom: RasterInfo) -> tuple[float, float, tuple[float, ...]]:
    """Return the share of pixels shown, that of their most frequent colour, and the colour."""
    scale = max(1.0, max(dom.width, dom.height) / _CELLS)
    shape = tuple(max(1, round(side / scale)) for side in (dom.height, dom.width))
    with small_cache(), opened(dom.path) as dataset:
        bands = dataset.count if dataset.count < _COLOURS else _COLOURS
        colours = dataset.read(
            [*range(1, bands + 1)], out_shape=(bands, *shape), resampling=Resampling.nearest
        )
        mask = dataset.dataset_mask(out_shape=shape, resampling=Resampling.nearest) > 0
    if not mask.any():
        return 0.0, 0.0, ()
    shown = colours[:, mask]
    # Eight bits a band make one number, which sorts faster than a column; others are rare in maps.
    codes = shown[0] if shown.dtype != np.uint8 else 256 ** np.arange(bands) @ shown
    _, first, counts = np.unique(codes, return_index=True, return_counts=True)
    colour = shown[:, first[np.argmax(counts)]]
    same = (shown == colour[:, None]).all(axis=0)
    return float(mask.mean()), float(same.mean()), tuple(colour.tolist())
