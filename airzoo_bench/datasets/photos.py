"""``prepare photos``: own photos, poses and maps as a scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.dataset import Prepared, PrepareSettings
from airzoo_bench.datasets.height_systems import check_accuracy, surface_altitudes, surface_centres
from airzoo_bench.datasets.native import files_among, paths_among
from airzoo_bench.datasets.native_prepare import prepare_scenes
from airzoo_bench.datasets.native_scene import NativeScene
from airzoo_bench.datasets.photo_metadata import PhotoPrior, priors_to_poses, read_prior
from airzoo_bench.datasets.photo_options import PhotoOptions, SceneOptions
from airzoo_bench.datasets.posed_photos import PosedPhotos, check_centred
from airzoo_bench.datasets.poses import read_poses
from airzoo_bench.datasets.priors import read_prior_file
from airzoo_bench.datasets.scene_parts import SceneSource
from airzoo_bench.datasets.sources import check_names, check_target, metric_crs, photo_sizes
from airzoo_bench.datasets.truths import BenchmarkProtocols
from airzoo_bench.geometry.poses import Poses

__all__ = [
    "FoundPhotos",
    "metadata_priors",
    "photo_metadata",
    "photo_source",
    "posed_scene",
    "prepare_photos",
    "read_photos",
]


@dataclass(frozen=True, eq=False)
class FoundPhotos:
    """Photos and their poses as a source has them.

    Attributes
    ----------
    images : Path
    sizes : mapping of str to (width, height)
        Every photo below `images`.
    photos : PosedPhotos
        In a projected CRS, which ``--crs`` states where the source does not.
    poses_from, crs_from
        For messages: the file of the poses, and what states their CRS.
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
    crs_from: str = ""


def prepare_photos(
    sources: PhotoOptions, protocols: BenchmarkProtocols, settings: PrepareSettings
) -> Prepared:
    """Make a benchmark folder with one scene, for every track that its sources serve."""
    check_target(paths_among(sources), settings.folder)
    return prepare_scenes(photo_source(sources, protocols), protocols, settings)


def photo_source(sources: PhotoOptions, protocols: BenchmarkProtocols) -> SceneSource:
    """Return the one scene of own photos as something to prepare."""
    scenes = tuple(scene.id for scene in protocols.every[0].scenes)
    return SceneSource(scenes, read_photos, partial(files_among, sources), sources)


def read_photos(sources: PhotoOptions, scene: str, progress: Progress) -> NativeScene:
    """Read the poses of own photos, and what the photos' metadata say."""
    if sources.dsm is None and sources.plane_height is None:
        raise UsageError(
            "the height of the ground is not known",
            expected="a surface model (--dsm), or the ground as a plane (--plane-height)",
        )
    sizes = photo_sizes(sources.images, progress)
    photos = read_poses(sources.poses, sizes)
    if sources.crs is None and photos.crs is None:
        raise UsageError(
            "the CRS of the poses is not known",
            where=sources.poses,
            expected="a projected CRS in metres",
            fix="add the key 'crs' to the file, or give --crs EPSG:...",
        )
    found = FoundPhotos(
        sources.images,
        sizes,
        photos,
        sources.poses,
        sources.dom,
        sources.dsm,
        crs_from=f"{sources.poses}, key 'crs'",
    )
    return posed_scene(sources, scene, found, progress)


def posed_scene(
    options: SceneOptions, scene: str, found: FoundPhotos, progress: Progress
) -> NativeScene:
    """Make the scene, its priors from the photos' metadata and ``--priors``."""
    photos = found.photos
    check_names(photos.names, found.images)
    check_centred(photos, found.poses_from)
    stated = options.crs or photos.crs or ""
    place = f"--crs {options.crs}" if options.crs else found.crs_from or str(found.poses_from)
    crs = metric_crs(stated, place).to_string()
    check_accuracy(options)
    centres, notes = surface_centres(photos.poses.centres, stated, crs, options, found.dsm, place)
    metadata = photo_metadata(photos.names, found.images, options.priors, found.sizes, progress)
    metadata, more = surface_altitudes(
        metadata, options.priors_vertical_crs, "--priors-vertical", options, found.dsm
    )
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


def photo_metadata(
    names: Sequence[str],
    images: Path,
    priors: Path | None,
    sizes: Mapping[str, tuple[int, int]],
    progress: Progress,
) -> dict[str, PhotoPrior]:
    """Read what photos say of themselves; what a table of priors says of them goes before."""
    given = read_prior_file(priors, sizes) if priors is not None else {}
    shown = progress(names, "metadata", len(names))
    return {name: replace(read_prior(images / name), **given.get(name, {})) for name in shown}


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
