"""Matches, 2D-3D pairs and poses as predictions, and the files that hold them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import (
    CameraError,
    PredictionError,
    UnreadableError,
    counted,
    first_of,
)
from airzoo_bench.core.files import read_text
from airzoo_bench.core.ids import PHOTO_SUFFIXES
from airzoo_bench.evaluation.queries import Fields, QueryPredictions, read_fields
from airzoo_bench.formats.arrays import Arrays, check_length, numbers, open_arrays, wrong_type
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.geometry.poses import FARTHEST, Poses, check_rotations, quaternion_to_matrix
from airzoo_bench.geometry.precision import COARSEST_M, centre_errors_m, narrow_type, pose_errors_m

NO_POSE = "write NaN in all of a pose that was not found"
_EXPECTED = (
    "query_ids with offsets, query_xy and map_xy (and map_frame), or offsets, query_xy and "
    "points3d, or poses, or rotations and centres"
)
_TEXT_BYTES = 1 << 27


@dataclass(frozen=True, eq=False)
class Correspondences:
    """Matches or 2D-3D pairs of Q queries; query q has the rows ``offsets[q]:offsets[q + 1]``."""

    offsets: Ints
    query_xy: Floats  # (M, 2), pixels of the query at its full size; the image's corner is (0, 0)
    map_xy: Floats | None  # (M, 2), pixels of the map or of the query's crop
    map_frame: str | None  # "map" or "crop", where the file states it
    points3d: Floats | None  # (M, 3) in the scene's CRS, instead of `map_xy`
    image_size: Ints | None  # (Q, 2), width and height that pixels belong to, where it is stated

    @property
    def kind(self) -> str:
        """The name of this kind of prediction in results."""
        return "matches" if self.points3d is None else "pairs"

    @cached_property
    def query(self) -> Ints:
        """The query (M,) of each match."""
        return np.repeat(np.arange(len(self.offsets) - 1), np.diff(self.offsets))

    def parts(self) -> list[slice]:
        """Return the rows of each query."""
        return [slice(start, stop) for start, stop in pairwise(self.offsets.tolist())]

    def take(self, rows: Ints) -> Correspondences:
        """Return the matches of some queries, in this order; a row of -1 has none."""
        counts = np.where(rows >= 0, np.diff(self.offsets)[rows], 0)
        offsets = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        chosen = np.repeat(self.offsets[rows] - offsets[:-1], counts) + np.arange(offsets[-1])
        map_xy = None if self.map_xy is None else self.map_xy[chosen]
        points = None if self.points3d is None else self.points3d[chosen]
        size = None if self.image_size is None else self.image_size[rows]
        return Correspondences(offsets, self.query_xy[chosen], map_xy, self.map_frame, points, size)


@dataclass(frozen=True, eq=False)
class GivenPoses:
    """World-to-camera poses of Q queries, in the scene's CRS, that the method computed itself."""

    found: Bools  # (Q,), whether there is a pose; the others are meaningless
    poses: Poses
    errors_m: Floats  # (Q,), how far rounding in the file may have moved the cameras
    quaternions: bool = False  # the file has rotations as quaternions, and not as matrices
    centred: bool = False  # the file has centres, and not translations

    @property
    def kind(self) -> str:
        """The name of this kind of prediction in results."""
        return "poses"

    def take(self, rows: Ints) -> GivenPoses:
        """Return the poses of some queries, NaN where there is none; a row of -1 has none."""
        found = (rows >= 0) & self.found[rows]
        rotation = np.where(found[:, None, None], self.poses.rotation[rows], np.nan)
        centres = np.where(found[:, None], self.poses.centres[rows], np.nan)
        poses = Poses(rotation=rotation, centres=centres)
        return replace(self, found=found, poses=poses, errors_m=self.errors_m[rows] * found)


MatchingPredictions = QueryPredictions[Correspondences | GivenPoses]
"""A prediction file of the matching track, as read."""


@dataclass(frozen=True, eq=False)
class ScenePredictions:
    """The predictions for the Q queries of a scene, in their order, in pixels of the whole map."""

    answered: Bools  # (Q,), which queries the file has
    content: Correspondences | GivenPoses
    notes: tuple[str, ...] = ()  # on what looks wrong


def read_matching(path: Path, limit_bytes: int) -> MatchingPredictions:
    """Read a prediction file of the matching track."""
    if path.suffix == ".txt":
        return _read_pose_list(path)
    return read_fields(open_arrays(path, limit_bytes), _FORMS, _EXPECTED)


def _read_correspondences(arrays: Arrays, query_ids: NDArray[np.str_]) -> Correspondences:
    offsets = _integers(arrays, "offsets", 1)
    query_xy, map_xy, points, size = _pixels(arrays, "query_xy"), None, None, None
    if "map_xy" in arrays.names():
        name, other = "map_xy", (map_xy := _pixels(arrays, "map_xy"))
    else:
        name, other = "points3d", (points := _precise(arrays, "points3d", (None, 3)))
    if len(other) != len(query_xy):
        raise PredictionError(
            f"field '{name}' has {counted(len(other), 'row')}, 'query_xy' has {len(query_xy):,}",
            where=arrays.path,
            expected="a row a match in both",
            fix="write the two together",
        )
    if "image_size" in arrays.names():
        size = _integers(arrays, "image_size", 2)
        check_length(arrays, "image_size", size, len(query_ids))
    return Correspondences(offsets, query_xy, map_xy, _map_frame(arrays), points, size)


def _pixels(arrays: Arrays, name: str) -> Floats:
    """Read pixels, whole ones of any width among them."""
    values = arrays.read(name)
    if values.dtype.kind in "iu" and values.shape[1:] == (2,):
        return values.astype(np.float64)
    return numbers(arrays, name, (None, 2)).astype(np.float64)


def _map_frame(arrays: Arrays) -> str | None:
    if "map_frame" not in arrays.names():
        return None
    value = arrays.read("map_frame")
    if value.dtype.kind == "U" and value.size == 1 and value.item() in ("map", "crop"):
        return str(value.item())
    raise PredictionError(
        f"field 'map_frame' is {str(value)[:80]!r}",
        where=arrays.path,
        expected="'map' (pixels of the whole map) or 'crop' (of the query's crop)",
    )


def _integers(arrays: Arrays, name: str, ndim: int) -> Ints:
    """Read integers, one a row, or two a row where `ndim` is 2."""
    values = arrays.read(name)
    if values.dtype.kind in "iu" and values.ndim == ndim and values.shape[1:] in ((), (2,)):
        return values.astype(np.int64)
    raise wrong_type(
        arrays.path,
        name,
        values,
        expected=f"integers of shape ({'any' if ndim == 1 else 'any, 2'})",
        fix=f"np.asarray({name}, dtype=np.int64)",
    )


def _precise(arrays: Arrays, name: str, shape: tuple[int | None, ...]) -> Floats:
    """Read coordinates of the scene, which are millions of metres: float32 rounds them to 0.25 m.

    Only X and Y show whether they were rounded: heights of a surface model fit float32 exactly.
    """
    given = numbers(arrays, name, shape)
    values = given.astype(np.float64)
    finite = values[np.isfinite(values).all(axis=1)]
    is_narrow = given.dtype.itemsize < 8
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


def _read_poses(arrays: Arrays, query_ids: NDArray[np.str_]) -> GivenPoses:
    values = numbers(arrays, "poses", (None, 3, 4)).astype(np.float64)
    check_length(arrays, "poses", values, len(query_ids))
    where = f"{arrays.path}, field 'poses'"
    return given_poses(where, query_ids, values[:, :, :3], values[:, :, 3])


def _read_centres(arrays: Arrays, query_ids: NDArray[np.str_]) -> GivenPoses:
    rotations = numbers(arrays, "rotations", (None, 3, 3)).astype(np.float64)
    centres = _precise(arrays, "centres", (None, 3))
    for name, values in (("rotations", rotations), ("centres", centres)):
        check_length(arrays, name, values, len(query_ids))
    where = f"{arrays.path}, field 'rotations'"
    return given_poses(where, query_ids, rotations, centres, centred=True)


def given_poses(
    where: object,
    names: Sequence[str] | NDArray[np.str_],
    rotation: Floats,
    place: Floats,
    *,
    centred: bool = False,
) -> GivenPoses:
    """Make poses of quaternions (Q, 4) or matrices (Q, 3, 3), and translations or centres (Q, 3).

    A row is NaN where there is no pose.
    """
    values = np.column_stack((rotation.reshape(len(place), -1), place))
    found: Bools = np.asarray(np.isfinite(values).all(axis=1))
    listed = [str(name) for name in names]
    half = np.flatnonzero(~found & ~np.isnan(values).all(axis=1))
    if half.size:
        raise PredictionError(
            "poses that are NaN or infinite in part: "
            f"{first_of([listed[row] for row in half.tolist()], len(listed))}",
            where=where,
            expected="a whole pose, or NaN in all of it where there is none",
        )
    quaternions = rotation.ndim == 2
    identity = np.array((1.0, 0.0, 0.0, 0.0)) if quaternions else np.eye(3)
    rotation = np.where(found.reshape(-1, *[1] * identity.ndim), rotation, identity)
    place = np.where(found[:, None], place, 0.0)
    try:
        matrices = (quaternion_to_matrix if quaternions else check_rotations)(rotation, listed)
        poses = Poses(rotation=matrices, centres=place)
        if not centred:
            poses = Poses.from_translations(matrices, place, listed)
    except CameraError as error:
        fix = error.fix or f"{NO_POSE}, and world-to-camera rotations elsewhere"
        raise PredictionError(error.what, where=where, expected=error.expected, fix=fix) from error
    errors = np.zeros(len(found))
    if centred:  # beside a centre, what the rotation has lost does not move the camera
        near = found & (np.abs(place) <= FARTHEST).all(axis=1)
        errors[near] = centre_errors_m(place[near])
    else:
        stored = matrices if quaternions else rotation
        quaternion = rotation[found] if quaternions else None
        errors[found] = pose_errors_m(stored[found], place[found], quaternion)
    return GivenPoses(found, poses, errors, quaternions, centred)


def _read_pose_list(path: Path) -> MatchingPredictions:
    """Read ``name qw qx qy qz tx ty tz``, as hloc and AerialExtreMatch write poses."""
    text = read_text(path, UnreadableError, "pose file", _TEXT_BYTES)
    lines = [line for line in text.splitlines() if line.strip() and line.lstrip()[0] != "#"]
    rows = [_name_and_pose(line) for line in lines]
    wrong = [f"row {n + 1}, {lines[n].split()[0][:80]!r}" for n, row in enumerate(rows) if not row]
    if wrong or not rows:
        raise PredictionError(
            f"rows that are no name and seven numbers: {first_of(wrong, len(rows))}",
            where=path,
            expected="name qw qx qy qz tx ty tz, world-to-camera",
            fix="trajectories of TUM and KITTI are read with --reader tum or kitti, and --names",
        )
    names = np.array([row[0] for row in rows if row], dtype=str)
    values = np.array([row[1] for row in rows if row], dtype=np.float64)
    # As AerialExtreMatch writes that there is none.
    values[(values == (1, 0, 0, 0, 0, 0, 0)).all(axis=1)] = np.nan
    given = given_poses(path, names, values[:, :4], values[:, 4:])
    return QueryPredictions(path, None, names, given)


def _name_and_pose(line: str) -> tuple[str, list[float]] | None:
    """Split a line; a name may have spaces, and its later words are no numbers: DJI 0001.JPG."""
    name, *columns = line.strip().rsplit(None, 7)
    pose = [number for number in map(_number, columns) if number is not None]
    if len(pose) < 7 or any(_number(word) is not None for word in name.split()[1:]):
        return None
    if not name.isprintable() or len(name) > 256:  # no id, and no line of a message
        return None
    stem, dot, ending = name.rpartition(".")
    is_photo = dot + ending.lower() in PHOTO_SUFFIXES
    return (stem if is_photo else name, pose)


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


_MATCHES, _PAIRS = ("offsets", "query_xy", "map_xy"), ("offsets", "query_xy", "points3d")
_FORMS: tuple[Fields[Correspondences | GivenPoses], ...] = (
    Fields("map_xy", _MATCHES, ("map_frame", "image_size"), _read_correspondences),
    Fields("points3d", _PAIRS, ("image_size",), _read_correspondences),
    Fields("poses", ("poses",), (), _read_poses),
    Fields("centres", ("rotations", "centres"), (), _read_centres),
)
