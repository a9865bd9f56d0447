"""Matches, 2D-3D pairs and poses as predictions, and the files that hold them."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import CameraError, PredictionError, UnreadableError, first_of
from airzoo_bench.core.files import read_text
from airzoo_bench.evaluation.predictions import Fields, QueryPredictions, read_fields
from airzoo_bench.formats.arrays import Arrays, check_ids, check_length, numbers, open_arrays
from airzoo_bench.formats.photos import PHOTO_SUFFIXES
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.geometry.poses import Poses, quaternion_to_matrix
from airzoo_bench.geometry.precision import COARSEST_M, centre_errors_m, narrow_type, pose_errors_m

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
    map_xy: Floats | None = None  # (M, 2), pixels of the map or of the query's crop
    map_frame: str | None = None  # "map" or "crop", where the file states it
    points3d: Floats | None = None  # (M, 3) in the scene's CRS, instead of `map_xy`
    image_size: Floats | None = None  # (Q, 2), width and height that pixels belong to, if stated

    @property
    def kind(self) -> str:
        """The name of this kind of prediction in results."""
        return "matches" if self.points3d is None else "pairs"

    @cached_property
    def query(self) -> Ints:
        """The query (M,) of each match."""
        return np.repeat(np.arange(len(self.offsets) - 1), np.diff(self.offsets))

    def row_slices(self) -> list[slice]:
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

    def on_map(self, crops: Ints) -> Correspondences:
        """Return the matches in pixels of the whole map, by the windows (Q, 4) of crops in it."""
        if self.map_xy is None or self.map_frame != "crop":
            return self
        return replace(self, map_xy=self.map_xy + crops[self.query, :2])


@dataclass(frozen=True, eq=False)
class PredictedPoses:
    """World-to-camera poses of Q queries, in the scene's CRS, that the method computed itself."""

    poses: Poses  # NaN where there is none
    errors_m: Floats  # (Q,), how far rounding in the file may have moved the cameras; else NaN
    centred: bool  # the file has centres, and not translations
    kind = "poses"

    @property
    def has_pose(self) -> Bools:
        """A mask (Q,) of the queries with a pose."""
        return np.asarray(np.isfinite(self.poses.centres).all(axis=1))

    def take(self, rows: Ints) -> PredictedPoses:
        """Return the poses of some queries, in this order; a row of -1 has none."""
        poses, errors_m = self.poses.take(rows), self.errors_m[rows]
        for values in (poses.rotation, poses.centres, errors_m):
            values[rows < 0] = np.nan
        return replace(self, poses=poses, errors_m=errors_m)


MatchingPredictions = QueryPredictions[Correspondences | PredictedPoses]
"""A prediction file of the matching track, as read."""


def read_matching(path: Path, limit_bytes: int) -> MatchingPredictions:
    """Read a prediction file of the matching track."""
    if path.suffix == ".txt":
        predictions = _read_pose_list(path)
    else:
        predictions = read_fields(open_arrays(path, limit_bytes), _FORMS, _EXPECTED)
    check_ids(predictions.query_ids, f"{path}, field 'query_ids'")
    return predictions


def _read_correspondences(arrays: Arrays, ids: NDArray[np.str_]) -> Correspondences:
    names = arrays.names()
    pixels = [name for name in ("query_xy", "map_xy", "image_size") if name in names]
    fields = {str(name): numbers(arrays, name, (None, 2)).astype(np.float64) for name in pixels}
    if "points3d" in names:
        fields["points3d"] = _read_coordinates(arrays, "points3d")
    frame = str(arrays.read("map_frame")) if "map_frame" in names else None
    if frame not in (None, "map", "crop"):
        what, expected = f"is {frame[:80]!r}", "'map' (pixels of the whole map) or 'crop'"
        raise _fault(arrays, "map_frame", what, expected)
    offsets, rows = numbers(arrays, "offsets", (None,)), len(fields["query_xy"])
    falling = np.flatnonzero(~(offsets[1:] >= offsets[:-1]) | (offsets[1:] % 1 > 0))
    if len(offsets) != len(ids) + 1 or falling.size or offsets[0] != 0 or offsets[-1] != rows:
        example = "".join(f" at query {one}" for one in ids[falling[falling < len(ids)]][:1])
        what = f"does not add up{example}: it has {len(offsets):,} numbers for {len(ids):,} queries"
        expected = f"{len(ids) + 1:,} whole numbers that rise from 0 to {rows}, as of np.cumsum"
        raise _fault(arrays, "offsets", what, expected)
    matches = Correspondences(offsets.astype(np.int64), map_frame=frame, **fields)
    for name, values in fields.items():
        if name == "image_size":
            check_length(arrays, name, values, len(ids))
            continue
        if len(values) != rows:
            what = f"has {len(values):,} rows, 'query_xy' has {rows:,}"
            raise _fault(arrays, name, what, "a row a match in both")
        bad = np.logical_not(np.isfinite(values).all(axis=1))
        if bad.any():
            whose = first_of(ids[np.unique(matches.query[bad])], len(ids), noun="query")
            what = f"is NaN or infinite in {whose}"
            raise _fault(arrays, name, what, "finite coordinates of each match")
    return matches


def _fault(arrays: Arrays, name: str, what: str, expected: str) -> PredictionError:
    return PredictionError(f"field '{name}' {what}", where=arrays.path, expected=expected)


def _read_coordinates(arrays: Arrays, name: str) -> Floats:
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
        what = f"is {np.dtype(narrow)} or was once, which keeps {largest:.0f} to {step:.2g} m only"
        raise _fault(arrays, name, what, "numbers computed and written as float64")
    return values


def _read_poses(arrays: Arrays, ids: NDArray[np.str_]) -> PredictedPoses:
    """Read ``poses``, or ``rotations`` with ``centres``."""
    centred = "centres" in arrays.names()
    name, columns = ("rotations", 3) if centred else ("poses", 4)
    matrices = numbers(arrays, name, (None, 3, columns)).astype(np.float64)
    check_length(arrays, name, matrices, len(ids))
    places = _read_coordinates(arrays, "centres") if centred else matrices[:, :, 3]
    check_length(arrays, "centres", places, len(ids))
    where = f"{arrays.path}, field '{name}'"
    return make_poses(where, ids, matrices[:, :, :3], places, centred=centred)


def make_poses(
    where: object,
    names: Sequence[str] | NDArray[np.str_],
    rotation: Floats,
    places: Floats,
    *,
    centred: bool = False,
) -> PredictedPoses:
    """Make poses of quaternions (Q, 4) or matrices (Q, 3, 3), and translations or centres (Q, 3).

    A row is NaN where there is no pose.
    """
    missing = np.isnan(rotation).all(axis=tuple(range(1, rotation.ndim)))
    missing = np.asarray(missing & np.isnan(places).all(axis=1))
    listed, there, places = np.array(names)[~missing].tolist(), rotation[~missing], places[~missing]
    quaternions = there if rotation.ndim == 2 else None
    make = Poses.from_centres if centred else Poses.from_translations
    try:
        matrices = there if quaternions is None else quaternion_to_matrix(quaternions, listed)
        known = make(matrices, places, listed)
    except CameraError as error:
        stated = error.expected or "world-to-camera poses, NaN in all of a missing one"
        raise PredictionError(error.what, where=where, expected=stated, fix=error.fix) from error
    # Beside a centre, what the rotation has lost does not move the camera.
    moved = centre_errors_m(places) if centred else pose_errors_m(matrices, places, quaternions)
    count = len(missing)
    poses = Poses(rotation=np.full((count, 3, 3), np.nan), centres=np.full((count, 3), np.nan))
    errors_m = np.full(count, np.nan)
    poses.rotation[~missing], poses.centres[~missing] = known.rotation, known.centres
    errors_m[~missing] = moved
    return PredictedPoses(poses, errors_m, centred)


def _read_pose_list(path: Path) -> MatchingPredictions:
    """Read ``name qw qx qy qz tx ty tz``, as hloc and AerialExtreMatch write poses."""
    text = read_text(path, UnreadableError, "pose file", _TEXT_BYTES)
    lines = [line.strip() for line in text.splitlines()]
    names, rows = [], []
    for number, line in enumerate([one for one in lines if one and one[0] != "#"] or [""], 1):
        name, *columns = line.rsplit(None, 7) or [""]  # a name may have spaces
        with suppress(ValueError):
            rows.append([float(word) for word in columns])
        if len(rows) < number or len(columns) < 7 or not name.isprintable():
            what, expected = "is no name and seven numbers", "name qw qx qy qz tx ty tz"
            fix = "trajectories are read with --reader tum or kitti, and --names"
            what = f"row {number}, {name[:80]!r}, {what}"
            raise PredictionError(what, where=path, expected=expected, fix=fix)
        ending = Path(name).suffix
        names.append(name.removesuffix(ending) if ending.lower() in PHOTO_SUFFIXES else name)
    values = np.array(rows, dtype=np.float64)
    # As AerialExtreMatch writes that there is none.
    values[(values == (1, 0, 0, 0, 0, 0, 0)).all(axis=1)] = np.nan
    given = make_poses(path, names, values[:, :4], values[:, 4:])
    return QueryPredictions(path, None, np.array(names, dtype=str), given)


_MATCHES, _PAIRS = ("offsets", "query_xy", "map_xy"), ("offsets", "query_xy", "points3d")
_FORMS: tuple[Fields[Correspondences | PredictedPoses], ...] = (
    Fields("map_xy", _MATCHES, ("map_frame", "image_size"), _read_correspondences),
    Fields("points3d", _PAIRS, ("image_size",), _read_correspondences),
    Fields("poses", ("poses",), (), _read_poses),
    Fields("centres", ("rotations", "centres"), (), _read_poses),
)
