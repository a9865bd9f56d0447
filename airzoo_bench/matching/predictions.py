"""Matches, 2D-3D pairs and poses as predictions, and the files that hold them."""

from __future__ import annotations

import re
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
from airzoo_bench.core.ids import PHOTO_SUFFIXES, check_ids
from airzoo_bench.evaluation.queries import Fields, QueryPredictions, read_fields
from airzoo_bench.formats.arrays import Arrays, check_length, numbers, open_arrays, wrong_type
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.geometry.poses import Poses, quaternion_to_matrix
from airzoo_bench.geometry.precision import COARSEST_M, centre_errors_m, narrow_type, pose_errors_m

_EXPECTED = (
    "query_ids with offsets, query_xy and map_xy (and map_frame), or offsets, query_xy and "
    "points3d, or poses, or rotations and centres"
)
_TEXT_BYTES = 1 << 27
_NUMBER = re.compile(r"\s[-+]?\.?\d[-+\d.eE]*(\s|$)")


@dataclass(frozen=True, eq=False)
class Correspondences:
    """Matches or 2D-3D pairs of Q queries; query q has the rows ``offsets[q]:offsets[q + 1]``."""

    offsets: Ints
    query_xy: Floats  # (M, 2), pixels of the query at its full size; the image's corner is (0, 0)
    map_xy: Floats | None = None  # (M, 2), pixels of the map or of the query's crop
    map_frame: str | None = None  # "map" or "crop", where the file states it
    points3d: Floats | None = None  # (M, 3) in the scene's CRS, instead of `map_xy`
    image_size: Ints | None = None  # (Q, 2), width and height that pixels belong to, if stated

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
        return Correspondences(
            offsets,
            self.query_xy[chosen],
            None if self.map_xy is None else self.map_xy[chosen],
            self.map_frame,
            None if self.points3d is None else self.points3d[chosen],
            None if self.image_size is None else self.image_size[rows],
        )


@dataclass(frozen=True, eq=False)
class GivenPoses:
    """World-to-camera poses of Q queries, in the scene's CRS, that the method computed itself."""

    poses: Poses  # NaN where there is none
    errors_m: Floats  # (Q,), how far rounding in the file may have moved the cameras; else NaN
    centred: bool  # the file has centres, and not translations
    kind = "poses"

    @property
    def has_pose(self) -> Bools:
        """A mask (Q,) of the queries with a pose."""
        return np.asarray(np.isfinite(self.poses.centres).all(axis=1))

    def take(self, rows: Ints) -> GivenPoses:
        """Return the poses of some queries, in this order; a row of -1 has none."""
        there = rows >= 0
        rotation = np.where(there[:, None, None], self.poses.rotation[rows], np.nan)
        poses = Poses(
            rotation=rotation, centres=np.where(there[:, None], self.poses.centres[rows], np.nan)
        )
        return replace(self, poses=poses, errors_m=np.where(there, self.errors_m[rows], np.nan))


MatchingPredictions = QueryPredictions[Correspondences | GivenPoses]
"""A prediction file of the matching track, as read."""


@dataclass(frozen=True, eq=False)
class ScenePart:
    """The predictions for the Q queries of a scene, in their order, in pixels of the whole map."""

    answered: Bools  # (Q,), which queries the file has
    content: Correspondences | GivenPoses
    notes: tuple[str, ...]  # on what looks wrong


def read_matching(path: Path, limit_bytes: int) -> MatchingPredictions:
    """Read a prediction file of the matching track."""
    if path.suffix == ".txt":
        found = _read_pose_list(path)
    else:
        found = read_fields(open_arrays(path, limit_bytes), _FORMS, _EXPECTED)
    check_ids(found.query_ids, f"{path}, field 'query_ids'")
    if isinstance(found.content, Correspondences):
        _check_offsets(path, found.content, found.query_ids)
        _check_finite(path, found.content, found.query_ids)
    return found


def _read_correspondences(arrays: Arrays, query_ids: NDArray[np.str_]) -> Correspondences:
    there, name = arrays.names(), "map_xy"
    offsets, query_xy = _integers(arrays, "offsets", ()), _pixels(arrays, "query_xy")
    map_xy = _pixels(arrays, name) if name in there else None
    points = None if name in there else _coordinates(arrays, "points3d")
    name, other = ("points3d", points) if map_xy is None else (name, map_xy)
    if other is not None and len(other) != len(query_xy):
        raise PredictionError(
            f"field '{name}' has {counted(len(other), 'row')}, 'query_xy' has {len(query_xy):,}",
            where=arrays.path,
            expected="a row a match in both",
        )
    frame = str(arrays.read("map_frame")) if "map_frame" in there else None
    if frame not in (None, "map", "crop"):
        raise PredictionError(
            f"field 'map_frame' is {str(frame)[:80]!r}",
            where=arrays.path,
            expected="'map' (pixels of the whole map) or 'crop' (of the query's crop)",
        )
    size = None
    if "image_size" in there:
        size = _integers(arrays, "image_size", (2,))
        check_length(arrays, "image_size", size, len(query_ids))
    return Correspondences(offsets, query_xy, map_xy, frame, points, size)


def _check_offsets(path: Path, content: Correspondences, ids: NDArray[np.str_]) -> None:
    offsets, rows = content.offsets, len(content.query_xy)
    # Compared, not subtracted: the difference of two large integers may wrap around.
    falling = np.flatnonzero(offsets[1:] < offsets[:-1])
    if len(offsets) != len(ids) + 1 or falling.size or offsets[0] != 0 or offsets[-1] != rows:
        said = f"they are {len(offsets):,} for {counted(len(ids), 'query')}"
        if len(offsets) == len(ids) + 1:
            said = f"from {offsets[0]} to {offsets[-1]}"
            said += f", falling first at query {ids[falling[0]]}" if falling.size else ""
        raise PredictionError(
            f"the offsets do not add up: {said}",
            where=f"{path}, field 'offsets'",
            expected=f"{len(ids) + 1:,} numbers that rise from 0 to {rows}, the rows of query_xy",
            fix="np.concatenate([[0], np.cumsum(number of matches of each query)])",
        )


def _check_finite(path: Path, content: Correspondences, ids: NDArray[np.str_]) -> None:
    for name in ("query_xy", "map_xy", "points3d"):
        values = getattr(content, name)
        bad = np.zeros(0) if values is None else ~np.isfinite(values).all(axis=1)
        if bad.any():
            rows = counted(int(bad.sum()), "row is", "rows are")
            whose = first_of(ids[np.unique(content.query[bad])], len(ids), noun="query")
            what, where = f"{rows} NaN or infinite, in {whose}", f"{path}, field '{name}'"
            raise PredictionError(what, where=where, expected="finite coordinates of each match")


def _pixels(arrays: Arrays, name: str) -> Floats:
    return numbers(arrays, name, (None, 2)).astype(np.float64)


def _integers(arrays: Arrays, name: str, shape: tuple[int, ...]) -> Ints:
    """Read integers of this shape for each row."""
    values = arrays.read(name)
    if values.dtype.kind in "iu" and values.ndim == len(shape) + 1 and values.shape[1:] == shape:
        return values.astype(np.int64)
    expected = f"integers of shape ({', '.join(map(str, ('any', *shape)))})"
    fix = f"np.asarray({name}, dtype=np.int64)"
    raise wrong_type(arrays.path, name, values, expected=expected, fix=fix)


def _coordinates(arrays: Arrays, name: str) -> Floats:
    """Read coordinates of the scene, which are millions of metres: float32 rounds them to 0.25 m.

    Only X and Y show whether they were rounded: heights of a surface model fit float32 exactly.
    """
    given = numbers(arrays, name, (None, 3))
    values = given.astype(np.float64)
    finite = values[np.isfinite(values).all(axis=1)]
    narrow = given.dtype.type if given.dtype.itemsize < 8 else narrow_type(finite[:, :2])
    largest = float(np.abs(finite).max(initial=0.0))
    step = 0.0 if narrow is None else float(np.spacing(narrow(largest)))
    if step > COARSEST_M:
        raise PredictionError(
            f"field '{name}' is {np.dtype(narrow)} or was once, which keeps coordinates such as "
            f"{largest:.0f} to {step:.2g} m only",
            where=arrays.path,
            expected="float64",
            fix=f"compute and write {name} as float64",
        )
    return values


def _read_poses(arrays: Arrays, query_ids: NDArray[np.str_]) -> GivenPoses:
    """Read ``poses`` or, beside centres, ``rotations``."""
    centred = "centres" in arrays.names()
    name, columns = ("rotations", 3) if centred else ("poses", 4)
    matrices = numbers(arrays, name, (None, 3, columns)).astype(np.float64)
    place = _coordinates(arrays, "centres") if centred else matrices[:, :, 3]
    for field, values in ((name, matrices), ("centres", place)):
        check_length(arrays, field, values, len(query_ids))
    where = f"{arrays.path}, field '{name}'"
    return given_poses(where, query_ids, matrices[:, :, :3], place, centred=centred)


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
    found = np.asarray(np.isfinite(values).all(axis=1))
    half = np.array(names)[~found & ~np.isnan(values).all(axis=1)]
    if half.size:
        raise PredictionError(
            f"poses that are NaN or infinite in part: {first_of(half, len(names))}",
            where=where,
            expected="a whole pose, or NaN in all of it where there is none",
        )
    listed = np.array(names)[found].tolist()
    rotation, place = rotation[found], place[found]
    quaternions = rotation if rotation.ndim == 2 else None
    make = Poses.from_centres if centred else Poses.from_translations
    try:
        matrices = rotation if quaternions is None else quaternion_to_matrix(quaternions, listed)
        known = make(matrices, place, listed)
    except CameraError as error:
        fix = error.fix or "write world-to-camera rotations, and NaN in all of a missing pose"
        raise PredictionError(error.what, where=where, expected=error.expected, fix=fix) from error
    # Beside a centre, what the rotation has lost does not move the camera.
    moved = centre_errors_m(place) if centred else pose_errors_m(matrices, place, quaternions)

    def spread(of_found: Floats) -> Floats:
        every = np.full((len(found), *of_found.shape[1:]), np.nan)
        every[found] = of_found
        return every

    poses = Poses(rotation=spread(known.rotation), centres=spread(known.centres))
    return GivenPoses(poses, spread(moved), centred)


def _read_pose_list(path: Path) -> MatchingPredictions:
    """Read ``name qw qx qy qz tx ty tz``, as hloc and AerialExtreMatch write poses."""
    text = read_text(path, UnreadableError, "pose file", _TEXT_BYTES)
    lines = [line.strip() for line in text.splitlines()]
    lines = [line for line in lines if line and line[0] != "#"]
    rows = [_split_name(line) for line in lines]
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


def _split_name(line: str) -> tuple[str, list[float]] | None:
    """Split a line; a name may have spaces, and its later words are no numbers: DJI 0001.JPG."""
    name, *columns = line.rsplit(None, 7)
    try:
        pose = [float(word) for word in columns]
    except ValueError:
        return None
    # What does not print, or is long, is no id and no line of a message.
    if len(pose) < 7 or _NUMBER.search(name) or not name.isprintable() or len(name) > 256:
        return None
    ending = Path(name).suffix
    return name.removesuffix(ending) if ending.lower() in PHOTO_SUFFIXES else name, pose


_MATCHES, _PAIRS = ("offsets", "query_xy", "map_xy"), ("offsets", "query_xy", "points3d")
_FORMS: tuple[Fields[Correspondences | GivenPoses], ...] = (
    Fields("map_xy", _MATCHES, ("map_frame", "image_size"), _read_correspondences),
    Fields("points3d", _PAIRS, ("image_size",), _read_correspondences),
    Fields("poses", ("poses",), (), _read_poses),
    Fields("centres", ("rotations", "centres"), (), _read_poses),
)
