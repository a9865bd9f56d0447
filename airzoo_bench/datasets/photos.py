"""``prepare photos``: own photos, poses and maps become a benchmark folder."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from airzoo_bench.benchmark import SceneFile
from airzoo_bench.datasets.dji import PhotoPrior, priors_to_poses, read_prior
from airzoo_bench.datasets.folder import copied, left_in_place, write_folder_files
from airzoo_bench.datasets.poses import read_poses
from airzoo_bench.datasets.sources import (
    PhotoSources,
    check_names,
    check_target,
    metric_crs,
    photo_sizes,
)
from airzoo_bench.datasets.tiles import write_crops, write_tiles
from airzoo_bench.errors import BenchmarkError, UserError
from airzoo_bench.files import atomic_folder, sha256_of
from airzoo_bench.geometry.medians import median_height
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.rasters import open_info
from airzoo_bench.matching.prepare import build_truth as build_matching_truth
from airzoo_bench.matching.truth import MatchingTruth
from airzoo_bench.matching.truth import write_truth as write_matching_truth
from airzoo_bench.progress import Progress, silent
from airzoo_bench.protocol import MatchingProtocol, RetrievalProtocol
from airzoo_bench.queries import write_queries
from airzoo_bench.retrieval.prepare import PreparedScene, build_truth
from airzoo_bench.retrieval.truth import write_truth
from airzoo_bench.scene_inputs import SceneInputs, photo_table

__all__ = ["Prepared", "prepare_photos"]


@dataclass(frozen=True)
class Prepared:
    """What `prepare_photos` made.

    Attributes
    ----------
    folder : Path
        The benchmark folder.
    protocols : tuple of str
        The names of the protocols in it.
    scene : PreparedScene
        The truth of the retrieval track.
    matching : MatchingTruth or None
        That of the matching track; None where no photo has a prior.
    without_pose : tuple of str
        Photos that the pose file lacks.
    """

    folder: Path
    protocols: tuple[str, ...]
    scene: PreparedScene
    matching: MatchingTruth | None
    without_pose: tuple[str, ...]


def prepare_photos(
    sources: PhotoSources,
    retrieval: RetrievalProtocol,
    matching: MatchingProtocol,
    folder: Path,
    *,
    tiles_on_disk: bool = False,
    crops_on_disk: bool = False,
    copy: bool = False,
    replace: bool = False,
    progress: Progress = silent,
) -> Prepared:
    """Make a benchmark folder with one scene, for retrieval and for matching.

    Parameters
    ----------
    sources : PhotoSources
    retrieval, matching : RetrievalProtocol, MatchingProtocol
        Of the same benchmark, with one scene. Without a prior in any photo (GPS position and
        gimbal angles in the metadata) there is no truth for matching.
    folder : Path
        Appears when it is complete.
    tiles_on_disk : bool
        Write each tile as PNG; otherwise tiles are windows of the map.
    crops_on_disk : bool
        Write the crop of each query as two GeoTIFF; otherwise crops are windows of the map.
    copy : bool
        Copy photos and rasters into the folder; otherwise they are left where they are.
    replace : bool
        Whether a folder that stands there is replaced.
    progress : Progress

    Raises
    ------
    UserError
        A source is missing or wrong, or no photo can be answered.
    """
    scene = retrieval.scenes[0]
    check_target(sources, folder, replace=replace)
    sizes = photo_sizes(sources.images, progress)
    inputs = _inputs(sources, scene.id, sizes, progress)
    prepared = build_truth(inputs, retrieval.gallery, retrieval.ground_truth)
    matched = _matching_truth(inputs, matching)
    if prepared.truth.queries.empty:
        raise _nothing_to_ask(prepared, sources)
    protocols = (retrieval, matching) if matched else (retrieval,)
    images = tuple(inputs.photos["image"])
    with atomic_folder(folder, replace=replace) as staged:
        home = staged / "scenes" / scene.id
        write_queries(home, inputs.photos)
        write_truth(home, prepared.truth, prepared.overlaps)
        if matched:
            write_matching_truth(home, matched)
        if matched and crops_on_disk:
            write_crops(home / "matching" / "crops", matched, progress)
        if tiles_on_disk:
            write_tiles(home / "retrieval" / "tiles", prepared.truth.tiles, sources.dom, progress)
        places = copied(staged, scene.id, sources, images) if copy else left_in_place(sources)
        entry = SceneFile(
            id=scene.id,
            title=scene.title,
            crs=inputs.crs,
            plane_height_m=inputs.plane_height_m,
            dsm_sha256=sha256_of(sources.dsm),
            **places,
        )
        write_folder_files(staged, protocols, entry)
    return Prepared(folder, tuple(p.name for p in protocols), prepared, matched, inputs.unposed)


def _inputs(
    sources: PhotoSources, scene: str, sizes: dict[str, tuple[int, int]], progress: Progress
) -> SceneInputs:
    photos = read_poses(sources.poses, sizes)
    check_names(photos.names, sources.images)
    crs = metric_crs(sources, photos).to_string()
    dom = open_info(sources.dom)
    plane = median_height(sources.dsm)
    shown = progress(photos.names, "metadata", len(photos.names))
    priors = _priors({name: read_prior(sources.images / name) for name in shown}, crs)
    table = photo_table(scene, photos.names, photos.cameras, photos.poses, priors, plane)
    unposed = tuple(sorted(set(sizes) - set(photos.names)))
    return SceneInputs(scene, table, crs, dom, sources.dsm, plane, unposed)


def _priors(metadata: dict[str, PhotoPrior], crs: str) -> Poses | None:
    """Return a prior for each photo, NaN where its metadata have none; None where none has any."""
    whole = {name: prior for name, prior in metadata.items() if prior.is_complete}
    if not whole:
        return None
    found = priors_to_poses(whole, crs)
    rows = np.array([prior.is_complete for prior in metadata.values()])
    rotation = np.full((len(metadata), 3, 3), np.nan)
    centres = np.full((len(metadata), 3), np.nan)
    rotation[rows], centres[rows] = found.rotation, found.centres
    return Poses(rotation=rotation, centres=centres)


def _matching_truth(inputs: SceneInputs, protocol: MatchingProtocol) -> MatchingTruth | None:
    if protocol.prior.source == "metadata" and "prior_x" not in inputs.photos.columns:
        return None
    truth = build_matching_truth(inputs, protocol.crop, protocol.prior)
    return None if truth.queries.empty else truth


def _nothing_to_ask(prepared: PreparedScene, sources: PhotoSources) -> UserError:
    excluded = prepared.truth.excluded
    reasons = excluded["reason"].value_counts()
    listed = "; ".join(f"{count} photos: {reason}" for reason, count in reasons.items())
    return BenchmarkError(
        f"no photo has a tile that answers it ({listed})",
        where=sources.poses,
        expected="photos over the map, with poses in the CRS of the DSM",
        mend="look at the CRS of poses, DOM and DSM, and whether poses are world-to-camera",
    )
