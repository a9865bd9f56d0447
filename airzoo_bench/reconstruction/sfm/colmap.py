"""What pycolmap does for the baseline: two views and many, with seeds and one thread.

With more than one thread bundle adjustment sums in another order on every run.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.optional_imports import load_pycolmap
from airzoo_bench.geometry.arrays import Floats, Ints
from airzoo_bench.geometry.cameras import Cameras
from airzoo_bench.geometry.poses import Poses

__all__ = ["Colours", "Lens", "Model", "TwoViews", "lenses_of", "map_photos", "verify"]

Colours = NDArray[np.uint8]

_LEAST_MODEL = 3


class Lens(NamedTuple):
    """A known camera, with COLMAP's parameters of the model FULL_OPENCV."""

    width: int
    height: int
    params: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Model:
    """A sparse reconstruction, in COLMAP's frame.

    Attributes
    ----------
    rows : (R,) int64 array
        Of the photos that have a pose, ascending.
    poses : Poses
        Of these.
    points : (P, 3) array
    colours : (P, 3) uint8 array
        Mean over the features that a point was made from.
    """

    rows: Ints
    poses: Poses
    points: Floats
    colours: Colours


class TwoViews(NamedTuple):
    """Matches of a pair that one motion of the camera explains.

    Attributes
    ----------
    first, second : int
        Rows of the photos.
    config : int
        COLMAP's kind of geometry; 0 and 1 stand for none.
    matches : (M, 2) array
        Rows of the features.
    """

    first: int
    second: int
    config: int
    matches: Ints


def lenses_of(cameras: Cameras) -> list[Lens]:
    """Return cameras as COLMAP has them, with all coefficients of the lens."""
    rows = np.hstack((cameras.focal, cameras.principal_point, cameras.distortion))
    return [
        # k1 k2 p1 p2 k3, and a denominator of 1.
        Lens(int(w), int(h), (*map(float, row), 0.0, 0.0, 0.0))
        for w, h, row in zip(cameras.width, cameras.height, rows, strict=True)
    ]


def verify(
    lenses: tuple[Lens, Lens],
    places: tuple[Floats, Floats],
    matches: Ints,
    *,
    max_error_px: float,
    least_inliers: int,
    seed: int,
) -> tuple[int, Ints]:
    """Keep the matches (M, 2) that one motion of the camera, or one plane, explains."""
    pycolmap = load_pycolmap()

    if len(matches) < least_inliers:
        return 0, np.zeros((0, 2), np.int64)
    options = pycolmap.TwoViewGeometryOptions(min_num_inliers=least_inliers)
    options.ransac.max_error = max_error_px
    options.ransac.random_seed = seed
    options.ransac.num_threads = 1
    pycolmap.set_random_seed(seed)
    first, second = (_camera(pycolmap, lens, 1) for lens in lenses)
    found = pycolmap.estimate_two_view_geometry(
        first, places[0], second, places[1], matches.astype(np.uint32), options
    )
    kept = np.asarray(found.inlier_matches, np.int64).reshape(-1, 2)
    return int(found.config), kept


def map_photos(
    lenses: Sequence[Lens],
    places: Sequence[Floats],
    colours: Sequence[Colours],
    pairs: Iterable[TwoViews],
    folder: Path,
    *,
    max_error_px: float,
    least_inliers: int,
    seed: int,
) -> Model:
    """Reconstruct incrementally (Schönberger and Frahm, CVPR 2016)."""
    pycolmap = load_pycolmap()

    database = folder / "database.db"
    _write_database(pycolmap, database, lenses, places, pairs)
    options = _options(pycolmap, max_error_px, least_inliers, seed)
    pycolmap.set_random_seed(seed)
    models = pycolmap.incremental_mapping(database, folder, folder, options)
    if not models:
        none = Poses(rotation=np.zeros((0, 3, 3)), centres=np.zeros((0, 3)))
        return Model(np.zeros(0, np.int64), none, np.zeros((0, 3)), np.zeros((0, 3), np.uint8))
    best = max(
        sorted(models), key=lambda key: (models[key].num_reg_images(), models[key].num_points3D())
    )
    return _read(models[best], colours)


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


def _write_database(
    pycolmap: Any,
    path: Path,
    lenses: Sequence[Lens],
    places: Sequence[Floats],
    pairs: Iterable[TwoViews],
) -> None:
    # Photos of one lens share its camera. Image i + 1 is photo i.
    numbers = {lens: n for n, lens in enumerate(dict.fromkeys(lenses), start=1)}
    with pycolmap.Database.open(path) as database:
        for lens, number in numbers.items():
            database.write_camera(_camera(pycolmap, lens, number), use_camera_id=True)
            rig = pycolmap.Rig(rig_id=number)
            rig.add_ref_sensor(pycolmap.sensor_t(pycolmap.SensorType.CAMERA, number))
            database.write_rig(rig, use_rig_id=True)
        for row, (lens, xy) in enumerate(zip(lenses, places, strict=True), start=1):
            _write_image(pycolmap, database, row, numbers[lens], xy)
        for pair in pairs:
            _write_pair(pycolmap, database, pair)


def _write_image(pycolmap: Any, database: Any, row: int, camera: int, xy: Floats) -> None:
    image = pycolmap.Image(name=f"{row}", camera_id=camera, image_id=row)
    database.write_image(image, use_image_id=True)
    frame = pycolmap.Frame(frame_id=row, rig_id=camera)
    frame.add_data_id(image.data_id)
    database.write_frame(frame, use_frame_id=True)
    database.write_keypoints(row, xy.astype(np.float32))


def _write_pair(pycolmap: Any, database: Any, pair: TwoViews) -> None:
    matches = pair.matches.astype(np.uint32)
    geometry = pycolmap.TwoViewGeometry(
        config=pycolmap.TwoViewGeometryConfiguration(pair.config), inlier_matches=matches
    )
    database.write_matches(pair.first + 1, pair.second + 1, matches)
    database.write_two_view_geometry(pair.first + 1, pair.second + 1, geometry)


def _options(pycolmap: Any, max_error_px: float, least_inliers: int, seed: int) -> Any:
    options = pycolmap.IncrementalPipelineOptions(
        min_num_matches=least_inliers,
        min_model_size=_LEAST_MODEL,
        extract_colors=False,
        num_threads=1,
        random_seed=seed,
    )
    options.mapper.num_threads = 1
    options.mapper.random_seed = seed
    options.mapper.init_max_error = max_error_px
    options.mapper.filter_max_reproj_error = max_error_px
    options.triangulation.random_seed = seed
    options.triangulation.merge_max_reproj_error = max_error_px
    options.triangulation.complete_max_reproj_error = max_error_px
    options.ba_refine_focal_length = options.ba_refine_extra_params = False
    options.mapper.abs_pose_refine_focal_length = False
    options.mapper.abs_pose_refine_extra_params = False
    return options


def _read(model: Any, colours: Sequence[Colours]) -> Model:
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
        colours=_mean_colours(points, colours),
    )


def _mean_colours(points: Sequence[Any], colours: Sequence[Colours]) -> Colours:
    elements = [(e.image_id - 1, e.point2D_idx) for p in points for e in p.track.elements]
    if not elements:
        return np.zeros((0, 3), np.uint8)
    photo, feature = np.array(elements, np.int64).T
    before = np.cumsum([0, *map(len, colours)])
    seen = np.concatenate(list(colours))[before[photo] + feature].astype(np.int64)
    lengths = np.array([point.track.length() for point in points])
    starts = np.concatenate(([0], np.cumsum(lengths)[:-1]))
    sums = np.add.reduceat(seen, starts, axis=0)
    mean: Colours = np.round(sums / lengths[:, None]).astype(np.uint8)
    return mean
