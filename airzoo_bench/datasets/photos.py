"""``prepare photos``: own photos, poses and maps as a scene."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import numpy as np
from pyproj import CRS

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.dataset import Prepared, PrepareSettings
from airzoo_bench.datasets.dji import PhotoPrior, priors_to_poses, read_prior
from airzoo_bench.datasets.height_systems import (
    heights_of_surface,
    named_heights_crs,
    surface_heights_crs,
)
from airzoo_bench.datasets.native import NativeScene
from airzoo_bench.datasets.native_prepare import prepare_scenes
from airzoo_bench.datasets.photo_options import PhotoOptions
from airzoo_bench.datasets.poses import read_poses
from airzoo_bench.datasets.priors import read_prior_file
from airzoo_bench.datasets.sources import check_target, metric_crs, photo_sizes, vertical_unit_m
from airzoo_bench.datasets.truths import BenchmarkProtocols
from airzoo_bench.evaluation.truth_accuracy import accuracy_notes
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.frames import to_lonlat
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.vertical import stated_heights_crs

__all__ = ["metadata_priors", "prepare_photos", "read_photos"]


def prepare_photos(
    sources: PhotoOptions, protocols: BenchmarkProtocols, settings: PrepareSettings
) -> Prepared:
    """Make a benchmark folder with one scene, for every track that its sources serve.

    Without a prior in any photo (GPS position and gimbal angles in the metadata) there is no truth
    for matching, without a cloud none for reconstruction.

    Raises
    ------
    UserError
        A source is missing or wrong, or no photo can be answered.
    """
    if sources.truth_accuracy is not None and not 0.0 < sources.truth_accuracy < math.inf:
        raise UsageError(
            f"--truth-accuracy {sources.truth_accuracy:g} is no accuracy",
            expected="metres, greater than 0",
        )
    check_target((sources.poses, *sources.files.values()), settings.folder)
    scenes = [scene.id for scene in protocols.every[0].scenes]
    read = partial(read_photos, sources, progress=settings.progress)
    prepared = prepare_scenes(scenes, read, protocols, settings)
    accuracy = dict.fromkeys(scenes, sources.truth_accuracy)
    for protocol in protocols.every:
        if protocol.name in prepared.protocols:
            for sentence in accuracy_notes(protocol, accuracy):
                settings.note(f"warning: {sentence}")
    return prepared


def read_photos(sources: PhotoOptions, scene: str, progress: Progress) -> NativeScene:
    """Read the poses of own photos, and what the photos' metadata say.

    Raises
    ------
    UserError
        A source is missing or wrong.
    """
    sizes = photo_sizes(sources.images, progress)
    photos = read_poses(sources.poses, sizes)
    place = f"--crs {sources.crs}" if sources.crs else f"{sources.poses}, key 'crs'"
    named = sources.crs or photos.crs
    if named is None:
        raise UsageError(
            "the CRS of the poses is not known",
            where=sources.poses,
            expected="a projected CRS in metres",
            fix="add the key 'crs' to the file, or give --crs EPSG:...",
        )
    crs = metric_crs(named, place).to_string()
    centres, notes = _centres(photos.poses.centres, named, crs, sources)
    shown = progress(photos.names, "metadata", len(photos.names))
    given = read_prior_file(sources.priors, sizes) if sources.priors is not None else {}
    metadata = {
        name: replace(read_prior(sources.images / name), **given.get(name, {})) for name in shown
    }
    if sources.priors_vertical_crs is not None:
        metadata, note = _altitudes(metadata, sources.priors_vertical_crs, sources)
        notes += note
    return NativeScene(
        scene,
        sources.images,
        photos.names,
        photos.cameras,
        replace(photos.poses, centres=centres),
        crs,
        dom=sources.dom,
        dsm=sources.dsm,
        cloud=sources.cloud,
        priors=metadata_priors(metadata, crs),
        metadata=metadata,
        unposed=tuple(sorted(set(sizes) - set(photos.names))),
        notes=notes,
        truth_accuracy_m=sources.truth_accuracy,
        poses_from=sources.poses,
        crs_from=place,
    )


def _centres(
    centres: Floats, named: str, crs: str, sources: PhotoOptions
) -> tuple[Floats, tuple[str, ...]]:
    """Return camera centres in metres, heights as the surface model has them, and notes."""
    own = sources.vertical_crs
    place = f"--vertical-crs {own}" if own else f"{sources.poses}, heights of {named}"
    stated = named_heights_crs(own, place) if own else stated_heights_crs(CRS(named))
    in_metres: Floats = centres * (1.0, 1.0, vertical_unit_m(own or named))
    surface = surface_heights_crs(sources.dsm, sources.dsm_vertical_crs)
    if stated is None or (own is None and surface is None):
        return in_metres, ()
    lonlat = to_lonlat(crs, in_metres[:, :2])
    heights, by = heights_of_surface(in_metres[:, 2], lonlat, stated, surface, place)
    notes = (f"heights of the poses are converted to the surface model's, by {by}",) if by else ()
    return np.column_stack((in_metres[:, :2], heights)), notes


def _altitudes(
    metadata: dict[str, PhotoPrior], own: str, sources: PhotoOptions
) -> tuple[dict[str, PhotoPrior], tuple[str, ...]]:
    """Return priors whose altitudes are as the surface model has heights, and notes."""
    rows = [(prior.lon, prior.lat, prior.altitude_m) for prior in metadata.values()]
    values = np.array(rows, dtype=np.float64).reshape(-1, 3)
    surface = surface_heights_crs(sources.dsm, sources.dsm_vertical_crs)
    place = f"--priors-vertical-crs {own}"
    source = named_heights_crs(own, place)
    heights, by = heights_of_surface(values[:, 2], values[:, :2], source, surface, place)
    found = {
        name: prior if prior.altitude_m is None else replace(prior, altitude_m=float(height))
        for (name, prior), height in zip(metadata.items(), heights, strict=True)
    }
    return found, (f"altitudes of the photos are converted likewise, by {by}",) if by else ()


def metadata_priors(metadata: dict[str, PhotoPrior], crs: str) -> Poses | None:
    """Return a prior for each photo, NaN where its metadata lack one; None where all lack one."""
    whole = {name: prior for name, prior in metadata.items() if prior.is_complete}
    if not whole:
        return None
    found = priors_to_poses(whole, crs)
    rows = np.array([prior.is_complete for prior in metadata.values()])
    rotation = np.full((len(metadata), 3, 3), np.nan)
    centres = np.full((len(metadata), 3), np.nan)
    rotation[rows], centres[rows] = found.rotation, found.centres
    return Poses(rotation=rotation, centres=centres)
