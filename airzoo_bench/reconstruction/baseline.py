"""A reconstruction baseline that needs no weights: structure from motion over SIFT features.

Features and matches come from processes, the model from pycolmap's incremental pipeline
(Schönberger and Frahm, CVPR 2016), with seeds and one thread: with more, bundle adjustment sums in
another order on every run.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.benchmark.images import read_rgb_photo
from airzoo_bench.benchmark.queries import PRIOR_COLUMNS, poses_of
from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.files import atomic_write, check_output_folder, temporary_folder, write_npz
from airzoo_bench.core.optional_imports import load_pycolmap
from airzoo_bench.core.progress import with_progress
from airzoo_bench.evaluation.track import Run
from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.formats.clouds.ply import write_ply
from airzoo_bench.geometry.arrays import Floats, Ints
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.sift import extract, mutual_nearest
from airzoo_bench.reconstruction.info import SfmSettings
from airzoo_bench.reconstruction.settings import ReconstructionProtocol
from airzoo_bench.reconstruction.truth import read_truth

_LEAST_PHOTOS = 3
_GREY = np.array([0.299, 0.587, 0.114])  # ITU-R BT.601

Lens = tuple[int, int, tuple[float, ...]]
"""Width, height and parameters of COLMAP's model FULL_OPENCV."""
Features = tuple[Floats, NDArray[np.uint8]]
"""Of a photo: pixels at full size (F, 2) and descriptors (F, 128)."""
Pair = tuple[int, int, int, Ints]
"""Two photos, COLMAP's number of the motion or plane that explains them, and matches (M, 2)."""


class Model(NamedTuple):
    """A sparse reconstruction in COLMAP's frame: the photos that have a pose, poses and points."""

    rows: Ints
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
    for scene in protocol.scenes:
        truth = read_truth(benchmark, scene.id)
        images = benchmark.resolve(benchmark.scene(scene.id).images)
        names = truth.photos["image"].to_numpy(str)
        paths, positions = [images / name for name in names], None
        if set(PRIOR_COLUMNS) <= set(truth.photos.columns):
            # The positions by GPS, for finding neighbours; never the true ones.
            known = truth.photos[list(PRIOR_COLUMNS)].notna().all(axis=1).to_numpy()
            positions = np.full((len(names), 3), np.nan)
            positions[known] = poses_of(truth.photos[known], PRIOR_COLUMNS).centres
        with temporary_folder(out.parent, out.name) as scratch:
            found = sparse_reconstruction(paths, truth.cameras, positions, settings, scratch, run)
        posed = f"{len(found.rows)} of {len(names)} photos"
        note(f"{scene.id}: {posed}, {len(found.points):,} points")
        write_ply(out / f"{scene.id}.ply", Cloud(found.points))
        with atomic_write(out / f"{scene.id}.cameras.npz") as stream:
            named = names[found.rows].astype(str)
            write_npz(stream, {"image_names": named, "extrinsics": found.extrinsics})
    with atomic_write(out / "protocol.txt", "w") as text:
        text.write(protocol.name + "\n")


def sparse_reconstruction(
    photos: Sequence[Path],
    cameras: Cameras,
    positions: Floats | None,
    settings: SfmSettings,
    scratch: Path,
    run: Run,
) -> Model:
    """Reconstruct photos by structure from motion."""
    if len(photos) < _LEAST_PHOTOS:
        what = f"structure from motion needs {_LEAST_PHOTOS} photos, not {len(photos)}"
        raise UsageError(what, fix="name a folder with photos that overlap")
    # k1 k2 p1 p2 k3, and a denominator of 1.
    rows = np.hstack((cameras.focal, cameras.principal_point, cameras.distortion))
    lenses: list[Lens] = [
        (int(width), int(height), (*map(float, row), 0.0, 0.0, 0.0))
        for width, height, row in zip(cameras.width, cameras.height, rows, strict=True)
    ]

    extracted = run.processes.map(
        _extract_features,
        list(zip(photos, lenses, strict=True)),
        shared=settings,
        stage="features",
        name=lambda item: str(item[0]),
    )
    features = list(run.progress(extracted, "features", len(photos)))
    pairs = photo_pairs(len(photos), positions, settings.neighbours)
    firsts = np.unique(pairs[:, 0]).tolist()
    matched = run.processes.map(
        _match_photo,
        [(first, pairs[pairs[:, 0] == first, 1].tolist()) for first in firsts],
        shared=(settings, lenses, features),
        stage="matches",
        name=lambda item: str(photos[item[0]]),
    )
    views = [two for found in run.progress(matched, "matches", len(firsts)) for two in found]
    work = partial(_map_photos, lenses, features, views, scratch, settings)
    return with_progress(work, "model", run.progress)


def photo_pairs(count: int, positions: Floats | None, neighbours: int | None) -> Ints:
    """List pairs of photos to match, (P, 2): the first below the second; sorted."""
    wanted = np.ones((count, count), np.bool_)
    if positions is not None and neighbours is not None and neighbours < count - 1:
        rows = np.flatnonzero(np.isfinite(positions).all(axis=1))
        wanted[rows] = False
        if len(rows):
            local = positions[rows] - positions[rows[0]]
            _, near = cKDTree(local).query(local, k=min(neighbours + 1, len(rows)))
            wanted[rows[:, None], rows[near.reshape(len(rows), -1)]] = True
    return np.argwhere(np.triu(wanted | wanted.T, k=1))


def _extract_features(settings: SfmSettings, item: tuple[Path, Lens]) -> Features:
    path, (width, height, _) = item
    grey = np.round(read_rgb_photo(path, settings.long_side_px) @ _GREY).astype(np.uint8)
    limits = settings.max_features, settings.peak_threshold
    seen, found = extract(grey, *limits, doubled=settings.doubled)
    scale = np.array((width, height)) / (grey.shape[1], grey.shape[0])
    return seen * scale, found.astype(np.uint8)


def _match_photo(
    shared: tuple[SfmSettings, list[Lens], list[Features]], item: tuple[int, list[int]]
) -> list[Pair]:
    """Match a photo with others, and keep what one motion of the camera explains."""
    settings, lenses, features = shared
    pycolmap = load_pycolmap()
    options = pycolmap.TwoViewGeometryOptions(min_num_inliers=settings.least_inliers)
    options.ransac.random_seed, options.ransac.num_threads = settings.seed, 1
    first, found = item[0], []
    for second in item[1]:
        (here, a), (there, b) = features[first], features[second]
        matched = mutual_nearest(a.astype(np.float32), b.astype(np.float32), settings.ratio)
        matches = np.stack(matched, axis=1).astype(np.uint32)
        if len(matches) < settings.least_inliers:
            continue
        one, other = (_camera(lenses[photo], 1) for photo in (first, second))
        options.ransac.max_error = _max_error_px([lenses[first], lenses[second]], settings)
        pycolmap.set_random_seed(settings.seed)
        two = pycolmap.estimate_two_view_geometry(one, here, other, there, matches, options)
        inliers = np.asarray(two.inlier_matches, np.int64).reshape(-1, 2)
        if len(inliers):
            found.append((first, second, int(two.config), inliers))
    return found


def _max_error_px(lenses: Sequence[Lens], settings: SfmSettings) -> float:
    """Return the largest reprojection error in pixels at full size."""
    longest = max(max(width, height) for width, height, _ in lenses)
    return settings.max_error_px * max(1.0, longest / settings.long_side_px)


def _camera(lens: Lens, number: int) -> Any:
    width, height, params = lens
    camera = load_pycolmap().Camera(
        camera_id=number, model="FULL_OPENCV", width=width, height=height, params=list(params)
    )
    camera.has_prior_focal_length = True
    return camera


def _map_photos(
    lenses: list[Lens],
    features: list[Features],
    pairs: Sequence[Pair],
    folder: Path,
    settings: SfmSettings,
) -> Model:
    """Reconstruct incrementally, and return the model with the most photos."""
    pycolmap, seed, error_px = load_pycolmap(), settings.seed, _max_error_px(lenses, settings)
    with pycolmap.Database.open(folder / "database.db") as database:
        _write_photos(pycolmap, database, lenses, [places for places, _ in features])
        for first, second, config, found in pairs:
            matches = found.astype(np.uint32)
            kind = pycolmap.TwoViewGeometryConfiguration(config)
            geometry = pycolmap.TwoViewGeometry(config=kind, inlier_matches=matches)
            database.write_matches(first + 1, second + 1, matches)
            database.write_two_view_geometry(first + 1, second + 1, geometry)
    options = pycolmap.IncrementalPipelineOptions(
        min_num_matches=settings.least_inliers,
        min_model_size=_LEAST_PHOTOS,
        extract_colors=False,
        num_threads=1,
        random_seed=seed,
        ba_refine_focal_length=False,
        ba_refine_extra_params=False,
    )
    mapper, triangulation = options.mapper, options.triangulation
    mapper.num_threads, mapper.random_seed, triangulation.random_seed = 1, seed, seed
    mapper.init_max_error = mapper.filter_max_reproj_error = error_px
    mapper.abs_pose_refine_focal_length = mapper.abs_pose_refine_extra_params = False
    triangulation.merge_max_reproj_error = triangulation.complete_max_reproj_error = error_px
    pycolmap.set_random_seed(seed)
    models = pycolmap.incremental_mapping(folder / "database.db", folder, folder, options)
    sizes = {key: (one.num_reg_images(), one.num_points3D()) for key, one in models.items()}
    best = max(sorted(models), key=lambda key: sizes[key], default=None)
    model = pycolmap.Reconstruction() if best is None else models[best]
    images = [model.images[key] for key in sorted(model.images) if model.images[key].has_pose]
    poses = [image.cam_from_world().matrix() for image in images]
    points = [model.points3D[key].xyz for key in sorted(model.points3D)]
    return Model(
        np.array([image.image_id - 1 for image in images], np.int64),
        np.array(poses).reshape(-1, 3, 4),
        np.array(points).reshape(-1, 3),
    )


def _write_photos(pycolmap: Any, database: Any, lenses: list[Lens], places: list[Floats]) -> None:
    # Photos of one lens share its camera. Image n + 1 is photo n.
    numbers = {lens: n for n, lens in enumerate(dict.fromkeys(lenses), start=1)}
    for lens, number in numbers.items():
        database.write_camera(_camera(lens, number), use_camera_id=True)
        rig = pycolmap.Rig(rig_id=number)
        rig.add_ref_sensor(pycolmap.sensor_t(pycolmap.SensorType.CAMERA, number))
        database.write_rig(rig, use_rig_id=True)
    for row, (lens, keypoints) in enumerate(zip(lenses, places, strict=True), start=1):
        image = pycolmap.Image(name=f"{row}", camera_id=numbers[lens], image_id=row)
        database.write_image(image, use_image_id=True)
        frame = pycolmap.Frame(frame_id=row, rig_id=numbers[lens])
        frame.add_data_id(image.data_id)
        database.write_frame(frame, use_frame_id=True)
        database.write_keypoints(row, keypoints.astype(np.float32))
