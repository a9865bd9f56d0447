"""``prepare photos``: own photos, poses and maps become a benchmark folder."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from airzoo_bench.benchmark.queries import SceneInputs, photo_table
from airzoo_bench.core.errors import BenchmarkError, UserError
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.cloud_checks import check_cloud
from airzoo_bench.datasets.dataset import Prepared, PrepareSettings
from airzoo_bench.datasets.dji import PhotoPrior, priors_to_poses, read_prior
from airzoo_bench.datasets.folder import SceneContent, write_benchmark
from airzoo_bench.datasets.map_facts import check_overlap
from airzoo_bench.datasets.photo_options import PhotoOptions
from airzoo_bench.datasets.poses import read_poses
from airzoo_bench.datasets.priors import read_prior_file
from airzoo_bench.datasets.raster_checks import (
    check_above_surface,
    check_map,
    check_map_scale,
    check_tile_count,
    often_lowest,
    surveyed,
)
from airzoo_bench.datasets.scene_facts import MeasuredScene, scene_facts
from airzoo_bench.datasets.sources import (
    check_names,
    check_target,
    metric_crs,
    photo_sizes,
    vertical_unit_m,
)
from airzoo_bench.datasets.truths import BenchmarkProtocols, build_truths
from airzoo_bench.geometry.blocks import median_height
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.rasters import open_info
from airzoo_bench.retrieval.prepare import grouped_reasons
from airzoo_bench.retrieval.truth import RetrievalTruth

__all__ = ["prepare_photos"]


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
    check_target(sources, settings.folder)
    sizes = photo_sizes(sources.images, settings.progress)
    read = _read(sources, protocols.every[0].scenes[0].id, sizes, settings.progress)
    inputs = read.inputs
    check_above_surface(read.cameras, sources.dsm)
    check_overlap(inputs.dom, open_info(sources.dsm))
    check_map_scale(inputs)
    if protocols.retrieval is not None:
        check_tile_count(inputs.dom, protocols.retrieval.map_rules()[0])
    above = check_cloud(sources.cloud, inputs) if sources.cloud is not None else None
    truths = build_truths(inputs, protocols, sources.cloud)
    retrieval = None if truths.retrieval is None else truths.retrieval.truth
    if retrieval is not None and retrieval.queries.empty:
        raise _nothing_to_ask(retrieval, sources, read)
    dropped = "" if protocols.retrieval is None else protocols.retrieval.gallery.dropped
    facts = scene_facts(read, retrieval, truths.matching, above, dropped)
    scene = SceneContent(inputs, truths, sources.files, facts)
    return write_benchmark([scene], protocols, settings)


def _read(
    sources: PhotoOptions, scene: str, sizes: dict[str, tuple[int, int]], progress: Progress
) -> MeasuredScene:
    photos = read_poses(sources.poses, sizes)
    check_names(photos.names, sources.images)
    crs = metric_crs(sources, photos).to_string()
    centres = photos.poses.centres * (1.0, 1.0, vertical_unit_m(sources, photos))
    poses = replace(photos.poses, centres=centres)
    dom, survey = check_map(sources.dom), surveyed(sources.dsm)
    plane = median_height(sources.dsm)
    shown = progress(photos.names, "metadata", len(photos.names))
    given = read_prior_file(sources.priors, sizes) if sources.priors is not None else {}
    metadata = {
        name: replace(read_prior(sources.images / name), **given.get(name, {})) for name in shown
    }
    table = photo_table(scene, photos.names, photos.cameras, poses, _priors(metadata, crs), plane)
    unposed = tuple(sorted(set(sizes) - set(photos.names)))
    inputs = SceneInputs(scene, table, crs, dom, sources.dsm, plane, unposed)
    return MeasuredScene.of(inputs, metadata, survey, sources.images)


def _priors(metadata: dict[str, PhotoPrior], crs: str) -> Poses | None:
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


def _nothing_to_ask(truth: RetrievalTruth, sources: PhotoOptions, read: MeasuredScene) -> UserError:
    survey, centres = read.survey, read.inputs.photos[["x", "y", "z"]].median()
    lowest = f"{survey.at_low / survey.valid:.0%} of the heights are exactly {survey.low:.10g} m: "
    tag = f"{lowest}if that means none, tag it (gdal_edit.py -a_nodata); else "
    reasons, fixes = grouped_reasons(truth.excluded)
    return BenchmarkError(
        f"no photo has a tile that answers it ({'; '.join(reasons)}); cameras are about "
        f"({centres['x']:.0f}, {centres['y']:.0f}, {centres['z']:.0f}), the surface model is "
        f"{survey.low:.1f} to {survey.high:.1f} m high, {read.inputs.plane_height_m:.1f} in the "
        "median",
        where=sources.poses,
        expected="at least one photo that a tile answers",
        fix=(tag if often_lowest(survey) else "") + "; or ".join(fixes),
    )
