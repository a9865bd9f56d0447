"""What a map shows, how much of it the surface model covers, and whether the two are aligned.

A shift is found by the grids of both and by where they are empty; what cannot be seen so is not
found: maps and models without holes whose grids differ anyway.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rasterio.enums import Resampling

from airzoo_bench.core.errors import RasterError
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.geometry.blocks import small_cache
from airzoo_bench.geometry.frames import change_of_plane
from airzoo_bench.geometry.map_pixels import to_map_pixels
from airzoo_bench.geometry.rasters import RasterInfo, gsd_m, opened, pixel_to_world, world_to_pixel

__all__ = ["MapFacts", "MapShift", "check_overlap", "map_facts", "map_shift"]

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
    """Refuse a map and a surface model of two places.

    Raises
    ------
    RasterError
        With the bounds of both.
    """
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
    """Measure what a map shows, in 2,048 cells a side at most, and how far the DSM covers it.

    Raises
    ------
    RasterError
        The map cannot be read.
    """
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


# Cells a side of the pictures that are compared, and how far they are moved against each other.
_SHIFT_CELLS, _REACH = 2048, 128
# Correlation of the best shift, its lead over none, and its least length in cells.
_ALIKE, _LEAD, _LEAST = 0.6, 0.1, 1.5


@dataclass(frozen=True)
class MapShift:
    """A shift of the map against the surface model.

    Attributes
    ----------
    pixels : tuple of float
        Columns and rows of the map by which it must be moved to fit.
    metres : float
    by : str
        What shows it.
    flipped : str
        How the map lies the wrong way round, ``"upside down"`` or so, and is no shift at all.
    """

    pixels: tuple[float, float]
    metres: float
    by: str
    flipped: str = ""


def map_shift(dom: RasterInfo, dsm: RasterInfo) -> MapShift | None:
    """Look for a shift between a map and a surface model; None where none can be shown.

    Two proofs are tried. Grids of the same size and pixels, in one CRS, are one grid, and one of
    them was moved where their corners differ. Otherwise, where both have empty pixels, their
    masks are correlated (normalised, over shifts of up to 128 of at most 2,048 cells): the map is
    shifted where another shift than none fits clearly better, and flipped where it fits flipped
    only.
    """
    return _by_grids(dom, dsm) or _by_masks(dom, dsm)


def _by_grids(dom: RasterInfo, dsm: RasterInfo) -> MapShift | None:
    same_size = (dom.width, dom.height) == (dsm.width, dsm.height)
    steps = [np.array(info.transform[:6])[[0, 1, 3, 4]] for info in (dom, dsm)]
    if not same_size or dom.crs.to_2d() != dsm.crs.to_2d() or (steps[0] != steps[1]).any():
        return None
    corner = pixel_to_world(dsm.transform, (0.0, 0.0))
    return _shift(dom, world_to_pixel(dom.transform, corner), "grids of one size and pixel", 1e-3)


def _by_masks(dom: RasterInfo, dsm: RasterInfo) -> MapShift | None:
    with small_cache():
        shown, scale = _coloured(dom), _scale(dom)
        known = _with_height(dsm, dom, shown.shape)
    if not (0.02 < shown.mean() < 0.98 and 0.02 < known.mean() < 0.98):
        return None
    fits = _correlation(known, shown)
    down, across = np.unravel_index(int(np.argmax(fits)), fits.shape)
    best, still = float(fits[down, across]), float(fits[_REACH, _REACH])
    if best < _ALIKE or best - still < _LEAD:
        return _flipped(known, shown, best)
    moved = np.array((across - _REACH, down - _REACH), dtype=np.float64) * scale
    return _shift(dom, moved, "their empty pixels", _LEAST * scale)


def _flipped(known: Bools, shown: Bools, upright: float) -> MapShift | None:
    """Find a map that fits the surface model only when it is flipped."""
    ways = {
        "upside down": shown[::-1],
        "mirrored": shown[:, ::-1],
        "turned by 180 degrees": shown[::-1, ::-1],
    }
    fits = {way: float(_correlation(known, turned).max()) for way, turned in ways.items()}
    way = max(fits, key=lambda name: fits[name])
    if fits[way] < _ALIKE or fits[way] - upright < _LEAD:
        return None
    return MapShift((0.0, 0.0), 0.0, "their empty pixels", way)


def _shift(
    dom: RasterInfo, pixels: NDArray[np.floating[Any]], by: str, least_px: float
) -> MapShift | None:
    if np.abs(pixels).max() < least_px:
        return None
    metres = float(np.hypot(*(pixels * gsd_m(dom))))
    return MapShift((float(pixels[0]), float(pixels[1])), metres, by)


def _scale(info: RasterInfo) -> float:
    """Pixels of the map along a cell."""
    return float(-(-max(info.width, info.height) // _SHIFT_CELLS))


def _coloured(dom: RasterInfo) -> Bools:
    """Cells of the map that are not empty: neither masked nor black in all bands."""
    shape = tuple(max(1, round(side / _scale(dom))) for side in (dom.height, dom.width))
    with opened(dom.path) as dataset:
        bands = min(dataset.count, 3)
        colours = _decimated(dataset, [*range(1, bands + 1)], (bands, *shape))
        mask = dataset.dataset_mask(out_shape=shape, resampling=Resampling.nearest)
    shown: Bools = (mask > 0) & (colours != 0).any(axis=0)
    return shown


def _with_height(dsm: RasterInfo, dom: RasterInfo, shape: tuple[int, ...]) -> Bools:
    """Cells of the map over which the surface model has a height."""
    rows, columns = shape
    size = np.array((dom.width, dom.height)) / (columns, rows)
    cell = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1)
    world = pixel_to_world(dom.transform, (cell + 0.5) * size)
    pixels = world_to_pixel(dsm.transform, change_of_plane(dom.crs, dsm.crs)(world))
    scale = _scale(dsm)
    thin = tuple(max(1, round(side / scale)) for side in (dsm.height, dsm.width))
    with opened(dsm.path) as dataset:
        heights = _decimated(dataset, [1], (1, *thin))[0]
        mask = dataset.dataset_mask(out_shape=thin)
    valid = (mask > 0) & np.isfinite(heights)
    place = pixels / (dsm.width, dsm.height) * thin[::-1]
    inside: Bools = np.asarray(((place >= 0) & (place < thin[::-1])).all(axis=-1))
    column, row = np.where(inside[..., None], place, 0).astype(np.int64).transpose(2, 0, 1)
    known: Bools = inside & valid[row, column]
    return known


def _decimated(dataset: Any, bands: list[int], shape: tuple[int, ...]) -> Any:
    return dataset.read(bands, out_shape=shape, resampling=Resampling.nearest)


def _correlation(fixed: Bools, moving: Bools) -> Floats:
    """Pearson correlation of two pictures for shifts of the second, -_REACH to _REACH a side."""
    size = [side + 2 * _REACH for side in fixed.shape]
    parts = [np.fft.rfft2(_normed(picture), size) for picture in (fixed, moving)]
    fits = np.fft.irfft2(parts[0] * np.conj(parts[1]), size)
    around = np.roll(fits, (_REACH, _REACH), axis=(0, 1))
    return np.asarray(around[: 2 * _REACH + 1, : 2 * _REACH + 1], dtype=np.float64)


def _normed(picture: Bools) -> Floats:
    centred = picture - picture.mean()
    normed: Floats = centred / np.sqrt((centred**2).sum())
    return normed
