"""The CRS of a survey's poses: the one that is stated, or its map's."""

from __future__ import annotations

from pyproj import CRS

from airzoo_bench.core.errors import CameraError, UsageError
from airzoo_bench.datasets.sources import metric_crs
from airzoo_bench.datasets.surveys.options import SurveyOptions
from airzoo_bench.geometry.crs import describe_crs, horizontal_crs
from airzoo_bench.geometry.rasters import open_info

__all__ = ["map_crs", "stated_crs"]


def stated_crs(options: SurveyOptions) -> CRS | None:
    """Return the CRS that ``--crs`` states, which must be projected and in metres."""
    return None if options.crs is None else metric_crs(options.crs, f"--crs {options.crs}")


def map_crs(options: SurveyOptions) -> CRS:
    """Return the projected CRS of the surface model, or of the map where there is none."""
    path = options.dsm or options.dom
    if path is None:
        raise UsageError("no map is given", where=options.source, fix="give --dom and --dsm")
    crs = horizontal_crs(open_info(path).crs)
    if not crs.is_projected:
        raise CameraError(
            f"is in {describe_crs(crs)}, in which poses have no metres",
            where=path,
            fix="give --crs, such as the UTM zone",
        )
    return crs
