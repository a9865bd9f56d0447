"""Predictions of the matching track, matches, 2D-3D pairs or poses, and their validation.

The checks here need no truth; ``airzoo-bench check`` runs them, and ``eval`` runs them first.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, counted, first_of
from airzoo_bench.core.ids import check_ids
from airzoo_bench.evaluation.queries import QueryPredictions, errors_of
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.precision import COARSEST_M, centre_errors_m

__all__ = [
    "Correspondences",
    "GivenPoses",
    "MatchingPredictions",
    "check_digits",
    "lattice_m",
    "validation_errors",
]


# Of the finest threshold: whole metres lose 0.5 m, which passes beside 1 m; six digits lose 2.9 m
# of a northing, which does not beside 5 m.
_MATTERS = 0.55


@dataclass(frozen=True, eq=False)
class Correspondences:
    """Matches or 2D-3D pairs of Q queries, by offsets.

    Attributes
    ----------
    offsets : (Q + 1,) int64
        Query q has the rows ``offsets[q]:offsets[q + 1]``.
    query_xy : (M, 2) float64
        Pixels of the query at its full size; the image's corner is (0, 0).
    map_xy : (M, 2) float64 or None
        Pixels of the map or of the query's crop.
    map_frame : {"map", "crop"} or None
        Which of the two; the map where the file does not say.
    points3d : (M, 3) float64 or None
        Instead of `map_xy`: points in the scene's CRS.
    image_size : (Q, 2) int64 or None
        Width and height that the pixels of each query belong to, where the file says so.
    rounded : bool
        Whether pixels are known to have gone through float16, and the result says so.
    """

    offsets: Ints
    query_xy: Floats
    map_xy: Floats | None
    map_frame: Literal["map", "crop"] | None
    points3d: Floats | None
    image_size: Ints | None
    rounded: bool = False

    @property
    def kind(self) -> str:
        """What they are, for results."""
        return "matches" if self.points3d is None else "pairs"


@dataclass(frozen=True, eq=False)
class GivenPoses:
    """Poses that the method computed itself.

    Attributes
    ----------
    found : (Q,) bool
        Whether there is a pose.
    poses : Poses
        World-to-camera, in the scene's CRS; meaningless where there is none.
    errors_m : (Q,) float64
        How far rounding in the file may have moved the cameras; see `pose_errors_m`.
    quaternions : bool
        Whether the file has rotations as quaternions, and not as matrices.
    centred : bool
        Whether the file has centres, and not translations.
    """

    kind: ClassVar[str] = "poses"

    found: Bools
    poses: Poses
    errors_m: Floats
    quaternions: bool = False
    centred: bool = False


MatchingPredictions = QueryPredictions[Correspondences | GivenPoses]
"""A prediction file of the matching track, as read."""


def validation_errors(predictions: MatchingPredictions) -> Iterator[PredictionError]:
    """Yield the errors of predictions that can be found without truth."""
    content = predictions.content
    checks = [partial(check_ids, predictions.query_ids, f"{predictions.path}, field 'query_ids'")]
    if isinstance(content, Correspondences):
        checks += [
            partial(check, predictions, content) for check in (_check_offsets, _check_finite)
        ]
    yield from errors_of(checks)


def check_digits(
    given: GivenPoses,
    query_ids: NDArray[np.str_],
    finest_m: float,
    true_centres: Floats | None = None,
) -> None:
    """Refuse poses whose rounding may have moved their cameras by more than a centimetre."""
    limit = COARSEST_M
    if given.centred:
        limit = max(limit, _MATTERS * finest_m, lattice_m(true_centres))
    coarse = np.flatnonzero(given.errors_m > limit)
    if coarse.size:
        error = float(np.sqrt((given.errors_m[coarse] ** 2).mean()))
        why = "" if given.centred else ", since its centre is -R^T t"
        fix = "compute in float64 and write all digits"
        translated = (
            " (%.17g in text), or write an .npz with rotations and centres, which lose nothing"
        )
        raise PredictionError(
            f"too few digits in the {'centres' if given.centred else 'poses'} of "
            f"{_queries(query_ids[coarse], query_ids)}: what they leave out moves a camera by "
            f"{error:.2g} m on average{why}",
            where="field 'centres'" if given.centred else "the poses",
            expected=f"digits that fix camera centres to {limit:g} m",
            fix=fix if given.centred else fix + translated,
        )


def lattice_m(centres: Floats | None) -> float:
    """Return how far centres may lie from what was meant if they were rounded, 0 for none."""
    return 0.0 if centres is None else float(centre_errors_m(centres).max(initial=0.0))


def _check_offsets(predictions: MatchingPredictions, matches: Correspondences) -> None:
    offsets, rows = matches.offsets, len(matches.query_xy)
    sound = len(offsets) and offsets[0] == 0 and offsets[-1] == rows
    # Compared, not subtracted: the difference of two large integers may wrap around.
    falling = np.flatnonzero(offsets[1:] < offsets[:-1])
    if not sound or falling.size:
        first = (
            f", falling first at query {predictions.query_ids[falling[0]]}" if falling.size else ""
        )
        ends = f"from {offsets[0]} to {offsets[-1]}" if len(offsets) else "empty"
        raise PredictionError(
            f"the offsets do not add up: {ends}{first}",
            where=f"{predictions.path}, field 'offsets'",
            expected=f"rising from 0 to {rows}, the number of rows of query_xy",
            fix="np.concatenate([[0], np.cumsum(number of matches of each query)])",
        )


def _check_finite(predictions: MatchingPredictions, matches: Correspondences) -> None:
    for name in ("query_xy", "map_xy", "points3d"):
        values = getattr(matches, name)
        if values is None:
            continue
        bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
        if bad.size:
            queries = np.unique(np.searchsorted(matches.offsets, bad, side="right") - 1)
            # Offsets that do not add up, an error of its own, may point beyond the ids.
            known = (queries >= 0) & (queries < len(predictions.query_ids))
            named = _queries(predictions.query_ids[queries[known]], predictions.query_ids)
            rows = counted(len(bad), "row is", "rows are")
            raise PredictionError(
                f"{rows} NaN or infinite, in {named}",
                where=f"{predictions.path}, field '{name}'",
                expected="finite coordinates",
                fix="leave out what was not matched",
            )


def _queries(some: NDArray[np.str_], every: NDArray[np.str_]) -> str:
    return first_of(some, len(every), noun="query")
