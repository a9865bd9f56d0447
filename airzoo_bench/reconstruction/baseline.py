"""A reconstruction baseline that needs no weights: structure from motion over SIFT features.

Features and matches come from processes, the model from pycolmap's incremental pipeline
(Schönberger and Frahm, CVPR 2016), with seeds and one thread: with more, bundle adjustment sums in
another order on every run.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.benchmark.images import read_rgb_photo
from airzoo_bench.benchmark.queries import PRIOR_COLUMNS, poses_of
from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.files import atomic_write, check_output_folder, temporary_folder, write_npz
from airzoo_bench.core.optional_imports import load_pycolmap
from airzoo_bench.evaluation.track import Run
from airzoo_bench.formats.clouds.cloud import Cloud
from airzoo_bench.formats.clouds.ply import write_ply
from airzoo_bench.geometry.arrays import Floats, Ints
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.sift import extract, mutual_nearest
from airzoo_bench.reconstruction.info import SfmSettings
from airzoo_bench.reconstruction.settings import ReconstructionProtocol
from airzoo_bench.reconstruction.truth import read_truth

_LEAST_PHOTOS = 3
_GREY = np.array([0.299, 0.587, 0.114])  # ITU-R BT.601


class Lens(NamedTuple):
    """A known camera, with COLMAP's parameters of the model FULL_OPENCV."""

    width: int
    height: int
    params: tuple[float, ...]


class TwoViews(NamedTuple):
    """Matches (M, 2) of two photos that one motion of the camera, or one plane, explains."""

    first: int
    second: int
    config: int
    matches: Ints


@dataclass(frozen=True, eq=False)
class _Features:
    """Features of all photos; photo n begins at row ``starts[n]``; places at full size."""

    starts: Ints
    places: Floats
    descriptors: NDArray[np.uint8]
    colours: NDArray[np.uint8]

    def rows(self, photo: int) -> slice:
        """Return the rows of a photo."""
        return slice(int(self.starts[photo]), int(self.starts[photo + 1]))


@dataclass(frozen=True, eq=False)
class Model:
    """A sparse reconstruction in COLMAP's frame; `rows` are the photos that have a pose."""

    rows: Ints
    poses: Poses
    points: Floats
    colours: NDArray[np.uint8]


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
        paths, positions = [images / name for name in names], _positions(truth.photos)
        with temporary_folder(out.parent, out.name) as scratch:
            found = sparse_reconstruction(paths, truth.cameras, positions, settings, scratch, run)
        posed = f"{len(found.rows)} of {len(names)} photos"
        note(f"{scene.id}: {posed}, {len(found.points):,} points")
        write_ply(out / f"{scene.id}.ply", Cloud(found.points, found.colours))
        poses = found.poses
        extrinsics = np.concatenate([poses.rotation, poses.translation[..., None]], axis=2)
        cameras = {"image_names": names[found.rows].astype(str), "extrinsics": extrinsics}
        with atomic_write(out / f"{scene.id}.cameras.npz") as stream:
            write_npz(stream, cameras)
    with atomic_write(out / "protocol.txt", "w") as text:
        text.write(protocol.name + "\n")


def _positions(photos: pd.DataFrame) -> Floats | None:
    """Return where GPS has the photos (N, 3), for finding neighbours; never the true positions."""
    if not set(PRIOR_COLUMNS) <= set(photos.columns):
        return None
    known = photos[list(PRIOR_COLUMNS)].notna().all(axis=1).to_numpy()
    positions = np.full((len(photos), 3), np.nan)
    positions[known] = poses_of(photos[known], PRIOR_COLUMNS).centres
    return positions


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
        raise UsageError(
            f"structure from motion needs {_LEAST_PHOTOS} photos, not {len(photos)}",
            fix="name a folder with photos that overlap",
        )
    engine, progress = run.processes, run.progress
    lenses = _lenses_of(cameras)
    extracted = engine.map(
        _extract_features,
        list(zip(photos, lenses, strict=True)),
        shared=settings,
        stage="features",
        name=lambda item: str(item[0]),
    )
    parts = list(progress(extracted, "features", len(photos)))
    starts = np.cumsum([0, *(len(places) for places, *_ in parts)])
    features = _Features(starts, *map(np.concatenate, zip(*parts, strict=True)))
    pairs = photo_pairs(len(photos), positions, settings.neighbours)
    firsts = np.unique(pairs[:, 0]).tolist()
    matched = engine.map(
        _match_photo,
        [(first, pairs[pairs[:, 0] == first, 1].tolist()) for first in firsts],
        shared=(settings, lenses, features),
        stage="matches",
        name=lambda item: str(photos[item[0]]),
    )
    views = [two for found in progress(matched, "matches", len(firsts)) for two in found]
    modelled = (_map_photos(lenses, features, views, scratch, settings) for _ in range(1))
    (model,) = progress(modelled, "model", 1)
    return model


def photo_pairs(count: int, positions: Floats | None, neighbours: int | None) -> Ints:
    """List pairs of photos to match, (P, 2): the first below the second; sorted."""
    first, second = np.triu_indices(count, k=1)
    if positions is None or neighbours is None or neighbours >= count - 1:
        return np.stack((first, second), axis=1)
    known = np.isfinite(positions).all(axis=1)
    wanted = np.zeros((count, count), np.bool_)
    wanted[~known] = True
    rows = np.flatnonzero(known)
    if len(rows):
        local = positions[rows] - positions[rows[0]]
        _, near = cKDTree(local).query(local, k=min(neighbours + 1, len(rows)))
        wanted[rows[:, None], rows[near.reshape(len(rows), -1)]] = True
    chosen = (wanted | wanted.T)[first, second]
    return np.stack((first[chosen], second[chosen]), axis=1)


def _extract_features(
    settings: SfmSettings, item: tuple[Path, Lens]
) -> tuple[Floats, NDArray[np.uint8], NDArray[np.uint8]]:
    """Return pixels at full size, descriptors and colours of a photo's features."""
    path, lens = item
    colour = read_rgb_photo(path, settings.long_side_px)
    grey = np.round(colour @ _GREY).astype(np.uint8)
    seen, found = extract(
        grey, settings.max_features, settings.peak_threshold, doubled=settings.doubled
    )
    column, row = np.floor(seen).astype(np.int64).T
    scale = np.array((lens.width, lens.height)) / (grey.shape[1], grey.shape[0])
    return seen * scale, found.astype(np.uint8), colour[row, column]


def _match_photo(
    shared: tuple[SfmSettings, list[Lens], _Features], item: tuple[int, list[int]]
) -> list[TwoViews]:
    """Match a photo with others, and keep what one motion of the camera explains."""
    settings, lenses, features = shared
    first, seconds = item
    here = features.rows(first)
    found = []
    for second in seconds:
        there = features.rows(second)
        a, b = (features.descriptors[rows].astype(np.float32) for rows in (here, there))
        matches = np.stack(mutual_nearest(a, b, settings.ratio), axis=1)
        places = features.places[here], features.places[there]
        two = _verify((lenses[first], lenses[second]), places, matches, settings)
        if len(two[1]):
            found.append(TwoViews(first, second, *two))
    return found


def _verify(
    lenses: tuple[Lens, Lens], places: tuple[Floats, Floats], matches: Ints, settings: SfmSettings
) -> tuple[int, Ints]:
    if len(matches) < settings.least_inliers:
        return 0, np.zeros((0, 2), np.int64)
    pycolmap = load_pycolmap()
    options = pycolmap.TwoViewGeometryOptions(min_num_inliers=settings.least_inliers)
    options.ransac.max_error = _max_error_px(lenses, settings)
    options.ransac.random_seed = settings.seed
    options.ransac.num_threads = 1
    pycolmap.set_random_seed(settings.seed)
    first, second = (_camera(pycolmap, lens, 1) for lens in lenses)
    found = pycolmap.estimate_two_view_geometry(
        first, places[0], second, places[1], matches.astype(np.uint32), options
    )
    return int(found.config), np.asarray(found.inlier_matches, np.int64).reshape(-1, 2)


def _max_error_px(lenses: Iterable[Lens], settings: SfmSettings) -> float:
    """Return the largest reprojection error in pixels at full size."""
    longest = max(max(lens.width, lens.height) for lens in lenses)
    return settings.max_error_px * max(1.0, longest / settings.long_side_px)


# --- pycolmap ---


def _lenses_of(cameras: Cameras) -> list[Lens]:
    """Return cameras as COLMAP has them, with all coefficients of the lens."""
    rows = np.hstack((cameras.focal, cameras.principal_point, cameras.distortion))
    return [
        # k1 k2 p1 p2 k3, and a denominator of 1.
        Lens(int(w), int(h), (*map(float, row), 0.0, 0.0, 0.0))
        for w, h, row in zip(cameras.width, cameras.height, rows, strict=True)
    ]


def _camera(pycolmap: Any, lens: Lens, number: int) -> Any:
    camera = pycolmap.Camera(
        camera_id=number,
        model="FULL_OPENCV",
        width=lens.width,
        height=lens.height,
        params=list(lens.params),
    )
    camera.has_prior_focal_length = True
    return camera


def _map_photos(
    lenses: list[Lens],
    features: _Features,
    pairs: Iterable[TwoViews],
    folder: Path,
    settings: SfmSettings,
) -> Model:
    """Reconstruct incrementally, and return the model with the most photos."""
    pycolmap = load_pycolmap()
    database = folder / "database.db"
    _write_database(pycolmap, database, lenses, features, pairs)
    options = _mapper_options(pycolmap, _max_error_px(lenses, settings), settings)
    pycolmap.set_random_seed(settings.seed)
    models = pycolmap.incremental_mapping(database, folder, folder, options)
    if not models:
        none = Poses(rotation=np.zeros((0, 3, 3)), centres=np.zeros((0, 3)))
        return Model(np.zeros(0, np.int64), none, np.zeros((0, 3)), np.zeros((0, 3), np.uint8))
    best = max(
        sorted(models), key=lambda key: (models[key].num_reg_images(), models[key].num_points3D())
    )
    return _read_model(models[best], features)


def _write_database(
    pycolmap: Any,
    path: Path,
    lenses: list[Lens],
    features: _Features,
    pairs: Iterable[TwoViews],
) -> None:
    # Photos of one lens share its camera. Image n + 1 is photo n.
    numbers = {lens: n for n, lens in enumerate(dict.fromkeys(lenses), start=1)}
    with pycolmap.Database.open(path) as database:
        for lens, number in numbers.items():
            database.write_camera(_camera(pycolmap, lens, number), use_camera_id=True)
            rig = pycolmap.Rig(rig_id=number)
            rig.add_ref_sensor(pycolmap.sensor_t(pycolmap.SensorType.CAMERA, number))
            database.write_rig(rig, use_rig_id=True)
        for photo, lens in enumerate(lenses):
            row, number = photo + 1, numbers[lens]
            image = pycolmap.Image(name=f"{row}", camera_id=number, image_id=row)
            database.write_image(image, use_image_id=True)
            frame = pycolmap.Frame(frame_id=row, rig_id=number)
            frame.add_data_id(image.data_id)
            database.write_frame(frame, use_frame_id=True)
            database.write_keypoints(row, features.places[features.rows(photo)].astype(np.float32))
        for first, second, config, found in pairs:
            matches = found.astype(np.uint32)
            geometry = pycolmap.TwoViewGeometry(
                config=pycolmap.TwoViewGeometryConfiguration(config), inlier_matches=matches
            )
            database.write_matches(first + 1, second + 1, matches)
            database.write_two_view_geometry(first + 1, second + 1, geometry)


def _mapper_options(pycolmap: Any, max_error_px: float, settings: SfmSettings) -> Any:
    options = pycolmap.IncrementalPipelineOptions(
        min_num_matches=settings.least_inliers,
        min_model_size=_LEAST_PHOTOS,
        extract_colors=False,
        num_threads=1,
        random_seed=settings.seed,
    )
    options.mapper.num_threads = 1
    options.mapper.random_seed = options.triangulation.random_seed = settings.seed
    options.mapper.init_max_error = options.mapper.filter_max_reproj_error = max_error_px
    options.triangulation.merge_max_reproj_error = max_error_px
    options.triangulation.complete_max_reproj_error = max_error_px
    options.ba_refine_focal_length = options.ba_refine_extra_params = False
    options.mapper.abs_pose_refine_focal_length = False
    options.mapper.abs_pose_refine_extra_params = False
    return options


def _read_model(model: Any, features: _Features) -> Model:
    images = [model.images[key] for key in sorted(model.images) if model.images[key].has_pose]
    poses = [image.cam_from_world() for image in images]
    points = [model.points3D[key] for key in sorted(model.points3D)]
    return Model(
        rows=np.array([image.image_id - 1 for image in images], np.int64),
        poses=Poses.from_translations(
            np.array([pose.rotation.matrix() for pose in poses]),
            np.array([pose.translation for pose in poses]),
        ),
        points=np.array([point.xyz for point in points]).reshape(-1, 3),
        colours=_mean_colours(points, features),
    )


def _mean_colours(points: Sequence[Any], features: _Features) -> NDArray[np.uint8]:
    elements = [(e.image_id - 1, e.point2D_idx) for p in points for e in p.track.elements]
    if not elements:
        return np.zeros((0, 3), np.uint8)
    photo, feature = np.array(elements, np.int64).T
    seen = features.colours[features.starts[photo] + feature].astype(np.int64)
    lengths = np.array([point.track.length() for point in points])
    sums = np.add.reduceat(seen, np.cumsum(lengths) - lengths, axis=0)
    mean: NDArray[np.uint8] = np.round(sums / lengths[:, None]).astype(np.uint8)
    return mean
