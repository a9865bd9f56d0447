"""Reading prediction files of the matching track."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, agreeing, counted
from airzoo_bench.evaluation.queries import Fields, read_fields
from airzoo_bench.formats.arrays import Arrays, check_length, numbers, open_arrays, wrong_type
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.geometry.poses import FARTHEST, Poses, check_rotations
from airzoo_bench.geometry.precision import COARSEST_M, centre_errors_m, narrow_type, pose_errors_m
from airzoo_bench.matching.pose_list import NO_POSE, read_pose_list, refused_in
from airzoo_bench.matching.predictions import Correspondences, GivenPoses, MatchingPredictions

__all__ = ["read_matching"]

_EXPECTED = (
    "query_ids with offsets, query_xy and map_xy (and map_frame), or offsets, query_xy and "
    "points3d, or poses, or rotations and centres"
)
_WIDEST = 8


def read_matching(path: Path, limit_bytes: int) -> MatchingPredictions:
    """Read a prediction file of the matching track."""
    if path.suffix == ".txt":
        return read_pose_list(path, limit_bytes)
    return read_fields(open_arrays(path, limit_bytes), _FORMS, _EXPECTED)


def _read_correspondences(
    arrays: Arrays, query_ids: NDArray[np.str_]
) -> Correspondences | GivenPoses:
    n_queries = len(query_ids)
    offsets = _integers(arrays, "offsets", (None,))
    if len(offsets) != n_queries + 1:
        raise PredictionError(
            f"field 'offsets' has {counted(len(offsets), 'entry')} "
            f"for {counted(n_queries, 'query')}",
            where=arrays.path,
            expected=f"{n_queries + 1:,}, one more than there are queries",
            fix="np.concatenate([[0], np.cumsum(number of matches of each query)])",
        )
    query_xy = _pixels(arrays, "query_xy")
    map_xy = points = None
    if "map_xy" in arrays.names():
        map_xy = _pixels(arrays, "map_xy")
    else:
        points = _precise(arrays, "points3d", (None, 3))
    for name, values in (("map_xy", map_xy), ("points3d", points)):
        if values is not None and len(values) != len(query_xy):
            raise PredictionError(
                f"field '{name}' has {counted(len(values), 'row')}, "
                f"'query_xy' has {len(query_xy):,}",
                where=arrays.path,
                expected="a row a match in both",
                fix="write the two together",
            )
    size = None
    if "image_size" in arrays.names():
        size = _integers(arrays, "image_size", (None, 2))
        check_length(arrays, "image_size", size, n_queries)
    return Correspondences(offsets, query_xy, map_xy, _map_frame(arrays), points, size)


def _pixels(arrays: Arrays, name: str) -> Floats:
    """Read pixels, whole ones of any width among them."""
    values = arrays.read(name)
    if values.dtype.kind not in "iu" or values.shape[1:] != (2,):
        return numbers(arrays, name, (None, 2)).astype(np.float64)
    arrays.budget.hold(arrays.path, f"field '{name}' in double precision", values.size * 8)
    return values.astype(np.float64)


def _map_frame(arrays: Arrays) -> Literal["map", "crop"] | None:
    if "map_frame" not in arrays.names():
        return None
    value = arrays.read("map_frame")
    frame = str(value.reshape(-1)[0]) if value.dtype.kind == "U" and value.size == 1 else ""
    if frame == "crop":
        return "crop"
    if frame == "map":
        return "map"
    raise PredictionError(
        f"field 'map_frame' is {frame[:80]!r}" if frame else "field 'map_frame' is not one text",
        where=arrays.path,
        expected="'map' (pixels of the whole map) or 'crop' (of the query's crop)",
    )


def _read_poses(arrays: Arrays, query_ids: NDArray[np.str_]) -> Correspondences | GivenPoses:
    values = numbers(arrays, "poses", (None, 3, 4)).astype(np.float64)
    check_length(arrays, "poses", values, len(query_ids))
    found = _found(arrays, "poses", values)
    given = values[found]
    where = f"{arrays.path}, field 'poses'"
    rotation = np.tile(np.eye(3), (len(values), 1, 1))
    rotation[found] = _rotations(where, given[:, :, :3], query_ids[found])
    translation = np.where(found[:, None], values[:, :, 3], 0.0)
    with refused_in(where, NO_POSE):
        poses = Poses.from_translations(rotation, translation, query_ids.tolist())
    errors = np.zeros(len(values))
    errors[found] = pose_errors_m(given[:, :, :3], given[:, :, 3], None)
    return GivenPoses(found, poses, errors)


def _read_centres(arrays: Arrays, query_ids: NDArray[np.str_]) -> Correspondences | GivenPoses:
    """Read rotations and centres; what a rotation has lost does not move its camera."""
    rotations = numbers(arrays, "rotations", (None, 3, 3)).astype(np.float64)
    centres = _precise(arrays, "centres", (None, 3))
    for name, values in (("rotations", rotations), ("centres", centres)):
        check_length(arrays, name, values, len(query_ids))
    rows = np.concatenate([rotations, centres[:, :, None]], axis=2)
    found = _found(arrays, "rotations' and 'centres", rows)
    rotation = np.tile(np.eye(3), (len(rows), 1, 1))
    where = f"{arrays.path}, field 'rotations'"
    rotation[found] = _rotations(where, rotations[found], query_ids[found])
    poses = Poses(rotation=rotation, centres=np.where(found[:, None], centres, 0.0))
    errors = np.zeros(len(rows))
    near = found & (np.abs(centres) <= FARTHEST).all(axis=1)
    errors[near] = centre_errors_m(centres[near])
    return GivenPoses(found, poses, errors, centred=True)


def _found(arrays: Arrays, name: str, values: Floats) -> Bools:
    found: Bools = np.asarray(np.isfinite(values).all(axis=(1, 2)))
    half = int((~found & np.isfinite(values).any(axis=(1, 2))).sum())
    if half:
        raise PredictionError(
            f"{counted(half, 'pose')} {agreeing(half, 'is', 'are')} NaN or infinite in part",
            where=f"{arrays.path}, field '{name}'",
            expected="a whole pose, or NaN in all of it where there is none",
        )
    return found


def _rotations(where: str, matrices: Floats, names: NDArray[np.str_]) -> Floats:
    with refused_in(where, "write the rotation matrix R, world-to-camera"):
        return check_rotations(matrices, names.tolist())


def _precise(arrays: Arrays, name: str, shape: tuple[int | None, ...]) -> Floats:
    """Read coordinates of the scene, which are millions of metres: float32 rounds them to 0.25 m.

    Only X and Y show whether they were rounded: heights of a surface model fit float32 exactly.
    """
    given = numbers(arrays, name, shape)
    values = given.astype(np.float64)
    finite = values[np.isfinite(values).all(axis=1)]
    is_narrow = given.dtype.itemsize < _WIDEST
    narrow = given.dtype.type if is_narrow else narrow_type(finite[:, :2])
    largest = float(np.abs(finite).max(initial=0.0))
    step = 0.0 if narrow is None else float(np.spacing(narrow(largest)))
    if step > COARSEST_M:
        raise PredictionError(
            f"field '{name}' {'is' if is_narrow else 'went through'} {np.dtype(narrow)}, which "
            f"keeps coordinates such as {largest:.0f} to {step:.2g} m only",
            where=arrays.path,
            expected="float64",
            fix=f"compute and write {name} as float64",
        )
    return values


def _integers(arrays: Arrays, name: str, shape: tuple[int | None, ...]) -> Ints:
    values: NDArray[Any] = arrays.read(name)
    fits = values.ndim == len(shape) and values.shape[1:] == shape[1:]
    if values.dtype.kind not in "iu" or not fits:
        sides = ", ".join("any" if want is None else str(want) for want in shape)
        raise wrong_type(
            arrays.path,
            name,
            values,
            expected=f"integers of shape ({sides})",
            fix=f"np.asarray({name}, dtype=np.int64)",
        )
    return values.astype(np.int64)


_FORMS = (
    Fields(
        "map_xy",
        ("offsets", "query_xy", "map_xy"),
        ("map_frame", "image_size"),
        _read_correspondences,
    ),
    Fields("points3d", ("offsets", "query_xy", "points3d"), ("image_size",), _read_correspondences),
    Fields("poses", ("poses",), (), _read_poses),
    Fields("centres", ("rotations", "centres"), (), _read_centres),
)
