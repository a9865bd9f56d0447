"""A survey's scene out of cameras and poses, whatever program they are from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from pyproj import CRS

from airzoo_bench.core.errors import CameraError, UsageError
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.height_systems import check_accuracy, surface_altitudes, surface_centres
from airzoo_bench.datasets.native import NativeScene
from airzoo_bench.datasets.photos import metadata_priors, photo_metadata
from airzoo_bench.datasets.poses import PosedPhotos, check_centred
from airzoo_bench.datasets.sources import check_names, metric_crs
from airzoo_bench.datasets.surveys.survey import SurveyOptions
from airzoo_bench.geometry.crs import describe_crs, horizontal_crs
from airzoo_bench.geometry.rasters import open_info

__all__ = ["FoundSurvey", "map_crs", "stated_crs", "survey_scene"]


@dataclass(frozen=True, eq=False)
class FoundSurvey:
    """What was found in a source.

    Attributes
    ----------
    images : Path
    sizes : mapping of str to (width, height)
        Every photo below `images`.
    photos : PosedPhotos
        In a projected CRS.
    poses_from : Path
        For messages.
    dom, dsm : Path or None
    notes : tuple of str
    accuracy_m : float or None
        Standard error of the positions, as the source has it.
    """

    images: Path
    sizes: Mapping[str, tuple[int, int]]
    photos: PosedPhotos
    poses_from: Path
    dom: Path | None
    dsm: Path | None
    notes: tuple[str, ...] = ()
    accuracy_m: float | None = None


def stated_crs(options: SurveyOptions) -> CRS | None:
    """Return the CRS that ``--crs`` states, which must be projected and in metres."""
    return None if options.crs is None else metric_crs(options.crs, f"--crs {options.crs}")


def map_crs(options: SurveyOptions) -> CRS:
    """Return the projected CRS of the surface model, or of the map where there is none.

    Raises
    ------
    UserError
        There is neither, or it is not projected.
    """
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


def survey_scene(
    options: SurveyOptions, scene: str, found: FoundSurvey, progress: Progress
) -> NativeScene:
    """Make the scene, its priors from the photos' metadata and ``--priors``.

    Raises
    ------
    UserError
        A photo's metadata or the table of priors are damaged, names cannot become ids, or a camera
        is of another image size.
    """
    photos = found.photos
    check_names(photos.names, found.images)
    check_centred(photos, found.poses_from)
    stated = options.crs or photos.crs or ""
    place = f"--crs {options.crs}" if options.crs else str(found.poses_from)
    crs = metric_crs(stated, place).to_string()
    check_accuracy(options)
    centres, notes = surface_centres(photos.poses.centres, stated, crs, options, found.dsm, place)
    metadata = photo_metadata(photos.names, found.images, options.priors, found.sizes, progress)
    metadata, more = surface_altitudes(metadata, options, found.dsm)
    return NativeScene(
        scene,
        found.images,
        photos.names,
        photos.cameras,
        replace(photos.poses, centres=centres),
        crs,
        dom=found.dom,
        dsm=found.dsm,
        cloud=options.cloud,
        plane_height_m=options.plane_height,
        priors=metadata_priors(metadata, crs),
        metadata=metadata,
        unposed=tuple(sorted(set(found.sizes) - set(photos.names))),
        notes=(*found.notes, *notes, *more),
        truth_accuracy_m=options.truth_accuracy or found.accuracy_m,
        poses_from=found.poses_from,
        crs_from=place,
    )
