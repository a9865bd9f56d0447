"""``prepare photos``: own photos, poses and maps as a scene."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.dataset import Prepared, PrepareSettings
from airzoo_bench.datasets.dji import PhotoPrior, priors_to_poses, read_prior
from airzoo_bench.datasets.native import NativeScene
from airzoo_bench.datasets.native_prepare import prepare_scenes
from airzoo_bench.datasets.photo_options import PhotoOptions
from airzoo_bench.datasets.poses import read_poses
from airzoo_bench.datasets.priors import read_prior_file
from airzoo_bench.datasets.sources import check_target, metric_crs, photo_sizes, vertical_unit_m
from airzoo_bench.datasets.truths import BenchmarkProtocols
from airzoo_bench.geometry.poses import Poses

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
    check_target((sources.poses, *sources.files.values()), settings.folder)
    scenes = [scene.id for scene in protocols.every[0].scenes]
    read = partial(read_photos, sources, progress=settings.progress)
    return prepare_scenes(scenes, read, protocols, settings)


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
    centres = photos.poses.centres * (1.0, 1.0, vertical_unit_m(named))
    shown = progress(photos.names, "metadata", len(photos.names))
    given = read_prior_file(sources.priors, sizes) if sources.priors is not None else {}
    metadata = {
        name: replace(read_prior(sources.images / name), **given.get(name, {})) for name in shown
    }
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
        poses_from=sources.poses,
        crs_from=place,
    )


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
