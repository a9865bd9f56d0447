"""A reconstruction baseline that needs no weights: COLMAP's structure from motion, with seeds.

The model (Schönberger and Frahm, CVPR 2016) is made by one thread: more sum in varying order.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.spatial import cKDTree

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.benchmark.queries import PRIOR_COLUMNS, cameras_of, poses_of
from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.files import atomic_write, check_output_folder, temporary_folder, write_npz
from airzoo_bench.core.optional_imports import load_pycolmap
from airzoo_bench.core.progress import with_progress
from airzoo_bench.evaluation.track import Run
from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.formats.clouds.ply import write_ply
from airzoo_bench.geometry.arrays import Floats, Ints
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.sift import mutual_nearest
from airzoo_bench.reconstruction.info import SfmSettings
from airzoo_bench.reconstruction.settings import ReconstructionProtocol
from airzoo_bench.reconstruction.truth import read_truth
from airzoo_bench.storage.urls import ensure_file

_LEAST_PHOTOS = 3


class Model(NamedTuple):
    """A sparse reconstruction in COLMAP's frame: the photos that have a pose, poses and points."""

    names: list[str]
    extrinsics: Floats  # (N, 3, 4), world-to-camera
    points: Floats


def predict(
    protocol: ReconstructionProtocol,
    benchmark: Benchmark,
    settings: SfmSettings,
    out: Path,
    run: Run,
    note: Callable[[str], None],
) -> None:
    """Reconstruct every scene, and write a cloud and cameras of each."""
    check_output_folder(out, ("protocol.txt",))
    out.parent.mkdir(parents=True, exist_ok=True)
    models: dict[str, Model] = {}
    for scene in protocol.scenes:
        photos = read_truth(benchmark, scene.id).photos
        images = benchmark.resolve(benchmark.scene(scene.id).images)
        with temporary_folder(out.parent, out.name) as scratch:
            models[scene.id] = one = sparse_reconstruction(images, photos, settings, scratch, run)
        note(f"{scene.id}: {len(one.names)} of {len(photos)} photos, {len(one.points):,} points")
    if not any(model.names for model in models.values()):
        raise UsageError("no photo found its pose", fix="take photos that overlap by half")
    for name, model in models.items():
        write_ply(out / f"{name}.ply", Cloud(model.points))
        arrays = {"image_names": np.array(model.names, str), "extrinsics": model.extrinsics}
        write_npz(out / f"{name}.cameras.npz", arrays)
    with atomic_write(out / "protocol.txt", "w") as text:
        text.write(protocol.name + "\n")


def sparse_reconstruction(
    images: Path, photos: pd.DataFrame, settings: SfmSettings, scratch: Path, run: Run
) -> Model:
    """Reconstruct photos, rows with name, camera and perhaps a prior position, of a folder."""
    names, pycolmap = photos["image"].astype(str).tolist(), load_pycolmap()
    if len(names) < _LEAST_PHOTOS:
        what = f"structure from motion needs {_LEAST_PHOTOS} photos, not {len(names)}"
        raise UsageError(what, fix="name a folder with photos that overlap")
    for name in names:
        ensure_file(images / name)
    extraction = pycolmap.FeatureExtractionOptions(use_gpu=False, num_threads=run.jobs)
    extraction.max_image_size = settings.long_side_px
    extraction.sift.max_num_features = settings.max_features
    extraction.sift.peak_threshold = settings.peak_threshold
    extraction.sift.first_octave = -1 if settings.doubled else 0
    lenses, seed = cameras_of(photos), settings.seed
    longest = max(lenses.width.max(), lenses.height.max())
    error_px = settings.max_error_px * max(1.0, longest / settings.long_side_px)
    motion = pycolmap.TwoViewGeometryOptions(min_num_inliers=settings.least_inliers)
    motion.ransac.max_error, motion.ransac.random_seed = error_px, seed
    mapping = pycolmap.IncrementalPipelineOptions(
        min_num_matches=settings.least_inliers,
        min_model_size=_LEAST_PHOTOS,
        num_threads=1,
        random_seed=seed,
    )
    mapping.extract_colors = mapping.ba_refine_focal_length = mapping.ba_refine_extra_params = False
    mapper, triangulation = mapping.mapper, mapping.triangulation
    mapper.num_threads, mapper.random_seed, triangulation.random_seed = 1, seed, seed
    mapper.init_max_error = mapper.filter_max_reproj_error = error_px
    mapper.abs_pose_refine_focal_length = mapper.abs_pose_refine_extra_params = False
    triangulation.merge_max_reproj_error = triangulation.complete_max_reproj_error = error_px
    database_path = scratch / "database.db"
    _import_photos(pycolmap, database_path, images, names, lenses)
    extract = partial(pycolmap.extract_features, extraction_options=extraction)
    verify = partial(pycolmap.geometric_verification, two_view_geometry_options=motion)
    threads = pycolmap.GeometricVerifierOptions(num_threads=run.jobs)
    steps: dict[str, Callable[[], Any]] = {
        "features": partial(extract, database_path, images, names, device=pycolmap.Device.cpu),
        "matches": partial(_match_photos, pycolmap, database_path, photos, settings),
        "pairs of photos": partial(verify, database_path, threads),
        "model": partial(pycolmap.incremental_mapping, database_path, images, scratch, mapping),
    }
    pycolmap.set_random_seed(seed)
    *_, models = (with_progress(work, label, run.progress) for label, work in steps.items())
    empty = pycolmap.Reconstruction()
    model = max(models.values(), key=lambda one: one.num_reg_images(), default=empty)
    posed = sorted((one for one in model.images.values() if one.has_pose), key=lambda one: one.name)
    return Model(
        [image.name for image in posed],
        np.array([image.cam_from_world().matrix() for image in posed]).reshape(-1, 3, 4),
        np.array([model.points3D[key].xyz for key in sorted(model.points3D)]).reshape(-1, 3),
    )


def _import_photos(
    pycolmap: Any, database_path: Path, images: Path, names: list[str], lenses: Cameras
) -> None:
    """Write photos and their lenses, k1 k2 p1 p2 k3 and a denominator of 1, into a database."""
    parts = (lenses.focal, lenses.principal_point, lenses.distortion, lenses.width, lenses.height)
    groups: dict[tuple[float, ...], list[str]] = {}
    for name, row in zip(names, np.column_stack(parts).tolist(), strict=True):
        groups.setdefault(tuple(row), []).append(name)
    pycolmap.Database.open(database_path).close()
    for row, group in groups.items():
        params = ", ".join(map(repr, (*row[:9], 0.0, 0.0, 0.0)))
        lens = pycolmap.ImageReaderOptions(camera_model="FULL_OPENCV", camera_params=params)
        pycolmap.import_images(database_path, images, pycolmap.CameraMode.SINGLE, group, lens)


def _match_photos(
    pycolmap: Any, database_path: Path, photos: pd.DataFrame, settings: SfmSettings
) -> None:
    """Write matches of pairs of photos; COLMAP's own are approximate, and vary between runs."""
    with pycolmap.Database.open(database_path) as database:
        keys = [database.read_image_with_name(str(name)).image_id for name in photos["image"]]
        features = [database.read_descriptors(key).data.astype(np.float32) for key in keys]
        for one, other in _list_pairs(photos, settings.neighbours).tolist():
            pairs = mutual_nearest(features[one], features[other], settings.ratio)
            matches = np.stack(pairs, axis=1)
            if len(matches) >= settings.least_inliers:
                database.write_matches(keys[one], keys[other], matches.astype(np.uint32))


def _list_pairs(photos: pd.DataFrame, neighbours: int | None) -> Ints:
    """Return pairs to match, (P, 2): neighbours by GPS where all photos have it, else all."""
    count, known = len(photos), set(PRIOR_COLUMNS) <= set(photos.columns)
    wanted = np.ones((count, count), np.bool_)
    if known and neighbours and photos[list(PRIOR_COLUMNS)].notna().all(axis=None):
        centres = poses_of(photos, PRIOR_COLUMNS).centres  # never the true ones
        _, near = cKDTree(centres).query(centres, k=min(neighbours + 1, count))
        wanted[:] = False
        wanted[np.arange(count)[:, None], near] = True
    return np.argwhere(np.triu(wanted | wanted.T, k=1))
