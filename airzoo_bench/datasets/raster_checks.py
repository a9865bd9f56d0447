"""Checks of map, surface model and cameras before truth is made from them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from airzoo_bench.benchmark.queries import SceneInputs
from airzoo_bench.core.errors import BenchmarkError, RasterError
from airzoo_bench.datasets.photo_facts import Cameras3D
from airzoo_bench.datasets.scene_facts import footprints_of
from airzoo_bench.geometry.crs import describe_crs
from airzoo_bench.geometry.heightfield import CORNERS, HeightSurvey, metres_of, survey_heights
from airzoo_bench.geometry.rasters import RasterInfo, gsd_m, open_info, opened, pixel_to_world
from airzoo_bench.retrieval.gallery import tile_starts
from airzoo_bench.retrieval.settings import Gallery

__all__ = [
    "FAR_BELOW_M",
    "FOOT_M",
    "LOWEST_SHARE",
    "check_above_surface",
    "check_map",
    "check_map_scale",
    "check_tile_count",
    "lowest_heights",
    "often_lowest",
    "surveyed",
]

# No ground is lower or higher, above sea level or ellipsoid.
_LOWEST_M, _HIGHEST_M = -1000.0, 10_000.0
# Some 130,000 px a side: a larger raster takes hours to pass over.
_MOST_PIXELS = 1 << 34
FOOT_M = 0.3048
LOWEST_SHARE = 0.01
"""From this share of heights on, the lowest height may stand for a missing one."""
FAR_BELOW_M = 10.0
_MOST_TILES = 500_000  # some 0.8 GB
_POLE_DEG = 90.0 + 1e-6


def check_map(path: Path) -> RasterInfo:
    """Open a map, and refuse one that is not on the earth or too large to process."""
    info = open_info(path)
    _check_pixels(info)
    corners = np.array((info.width, info.height)) * CORNERS
    y = pixel_to_world(info.transform, corners)[:, 1]
    if info.crs.is_geographic and np.abs(y).max() > _POLE_DEG:
        raise RasterError(
            f"reaches from {y.min():.4f} to {y.max():.4f} degrees of latitude",
            where=path,
            expected=f"latitudes of {describe_crs(info.crs)} from -90 to 90",
            fix="look at its geotransform, and whether its CRS is in degrees at all",
        )
    return info


def surveyed(path: Path) -> HeightSurvey:
    """Survey the heights of a surface model, and refuse heights that no ground has."""
    _check_pixels(open_info(path))
    found = survey_heights(path, _LOWEST_M, _HIGHEST_M)
    if not found.valid:
        raise RasterError("no valid height", where=path, fix="check its nodata value")
    if found.beyond:
        odd = found.low if found.low < _LOWEST_M else found.high
        raise RasterError(
            f"{found.beyond / found.valid:.1%} of its heights are no heights of the ground: they "
            f"go from {found.low:.10g} to {found.high:.10g} m",
            where=path,
            expected=f"{_LOWEST_M:g} to {_HIGHEST_M:g} m",
            fix="look at their unit: they must be in metres or feet"
            if found.beyond == found.valid
            else f"where {odd:.10g} m mean that there is no height, tag the number: "
            f"gdal_edit.py -a_nodata {_stored(path, odd):.10g}",
        )
    return found


def _stored(path: Path, height_m: float) -> float:
    """Return the number by which a file states a height."""
    with opened(path) as dataset:
        scale, offset = metres_of(dataset)
    return (height_m - offset) / scale


def check_tile_count(info: RasterInfo, gallery: Gallery) -> None:
    """Refuse a gallery of more than 500,000 tiles."""
    count = 0
    for size in gallery.tile_sizes_px:
        across, down = (
            len(tile_starts(length, size, gallery.overlap)) for length in (info.width, info.height)
        )
        count += across * down
    if count > _MOST_TILES:
        raise RasterError(
            f"{info.width} x {info.height} px make {count:,} tiles",
            where=info.path,
            expected=f"at most {_MOST_TILES:,}",
            fix="choose a larger --tile-size, or cut the map to the photos: "
            "gdal_translate -projwin",
        )


def _check_pixels(info: RasterInfo) -> None:
    if info.width * info.height > _MOST_PIXELS:
        raise RasterError(
            f"is {info.width:,} x {info.height:,} px",
            where=info.path,
            expected=f"at most {_MOST_PIXELS:,} pixels",
            fix="cut it to the photos (gdal_translate -projwin), or resample it (gdalwarp -tr)",
        )


def check_above_surface(cameras: Cameras3D, dsm: Path | None) -> None:
    """Refuse a scene whose cameras are all on or below the surface model, or else the plane z0."""
    known = np.isfinite(cameras.heights_m)
    if not known.any() or cameras.below < known.sum():
        return
    surface = float(np.median(cameras.surface_m[known]))
    centre = surface + cameras.height_m
    in_feet = centre - surface * FOOT_M
    hint = "look at the vertical datum and unit of both"
    if in_feet > 0.0:
        hint += (
            f"; were the DSM in feet, the cameras would be {in_feet:.1f} m above it: name the unit "
            "with gdal_edit.py -units ft"
        )
    raise BenchmarkError(
        f"every camera is below the surface: they are at {centre:.1f} m, the "
        f"surface below them is at {surface:.1f} m (medians)",
        where=dsm,
        expected="cameras above the surface model, both in the same vertical unit and datum",
        fix=hint,
    )


def check_map_scale(inputs: SceneInputs) -> None:
    """Refuse a map whose pixels are larger than what a photo sees."""
    dom = inputs.gallery_map
    pixel, (_, footprint, _) = max(gsd_m(dom)), footprints_of(inputs)
    if 0.0 < footprint < pixel:
        raise RasterError(
            f"a pixel is {pixel:,.1f} m wide on the ground, and a photo sees {footprint:,.1f} m",
            where=dom.path,
            expected="a map of about the photos' resolution",
            fix="look at the geotransform and the CRS of the map",
        )


def often_lowest(survey: HeightSurvey) -> bool:
    """Whether the lowest height may stand for a missing one."""
    repeated = survey.at_low > 1 or survey.low == 0.0
    alone = repeated and survey.next_low - survey.low > FAR_BELOW_M
    return survey.low < survey.high and (alone or survey.at_low > LOWEST_SHARE * survey.valid)


def lowest_heights(survey: HeightSurvey) -> str:
    """Say how many heights are the lowest: a share, or a count where they are few."""
    few = survey.at_low <= LOWEST_SHARE * survey.valid
    return f"{survey.at_low:,}" if few else f"{survey.at_low / survey.valid:.0%}"
