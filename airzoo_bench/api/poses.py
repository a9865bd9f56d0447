"""Errors and scores of camera poses."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from airzoo_bench.api.arrays import coordinates, floats, listed, positive
from airzoo_bench.api.labels import same_index
from airzoo_bench.api.pose_arrays import are_centres, pose_rows
from airzoo_bench.api.scores import QueryScores
from airzoo_bench.core.errors import ArgumentError, first_of
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.matching import metrics
from airzoo_bench.matching.metrics import (
    PoseErrors,
    matching_scores,
    pose_columns,
    translation_column,
)
from airzoo_bench.matching.settings import MatchingScores
from airzoo_bench.results.scores import summarise

__all__ = ["pose_errors", "pose_scores"]

_MOST_THRESHOLDS = 16


def pose_errors(predicted: ArrayLike, true: ArrayLike) -> PoseErrors:
    """Compare camera poses with the true ones: metres and degrees.

    Parameters
    ----------
    predicted : (N, 3, 4) or (N, 4, 4) array-like
        World-to-camera poses [R | t], x_cam = R X + t, in metres; OpenCV axes (x right, y down, z
        forward). NaN in all of a pose says that there is none: its errors are infinite.
    true : (N, 3, 4), (N, 4, 4) or (N, 3) array-like
        The same, of the same N queries; or camera centres, where orientations are not known.

    Returns
    -------
    PoseErrors
        ``translation_m``, the distance of the camera centres -R^T t; ``horizontal_m`` and
        ``vertical_m``, its parts (z is up); ``rotation_deg``, the geodesic angle of the rotations,
        or None where `true` has none. Each is (N,).

    Raises
    ------
    ArgumentError
        Arrays of other shapes or of different lengths; matrices that are no poses; poses that are
        NaN in part, or not known for the truth; too few digits to place a camera to a centimetre,
        as float32 has for projected coordinates.

    References
    ----------
    Hartley, Trumpf, Dai, Li, Rotation averaging, IJCV 103, 2013, for the geodesic angle.

    Examples
    --------
    A camera 3 m too far east, and one without a pose:

    >>> import numpy as np
    >>> true = np.tile(np.eye(4), (2, 1, 1))
    >>> predicted = true.copy()
    >>> predicted[0, 0, 3], predicted[1] = -3.0, np.nan
    >>> errors = pose_errors(predicted, true)
    >>> errors.translation_m.tolist(), errors.rotation_deg.tolist()
    ([3.0, inf], [0.0, inf])
    """
    _, given = pose_rows("predicted", predicted, missing=True)
    rotation: Floats | None = None
    if are_centres("true", true):
        centres = coordinates("true", true)
    else:
        _, known = pose_rows("true", true, missing=False)
        rotation, centres = known.rotation, known.centres
    if len(given) != len(centres):
        raise ArgumentError(
            f"have {len(given)} and {len(centres)} poses",
            where="predicted, true",
            expected="the same queries in the same order, NaN where there is no pose",
        )
    return metrics.pose_errors(given.rotation, given.centres, rotation, centres)


def pose_scores(
    errors: PoseErrors | tuple[ArrayLike, ArrayLike | None],
    thresholds: Iterable[tuple[float, float]] = ((5, 1), (10, 1), (20, 2)),
) -> QueryScores:
    """Score pose errors: recall, medians and areas under the error curve.

    Errors count as right below a threshold, strictly. A failure is an infinite error, and stays in
    every share and median.

    Parameters
    ----------
    errors : PoseErrors, or (translation, rotation)
        From `pose_errors`; or (N,) array-likes in metres and degrees, infinite for failures, the
        second None where the truth has no orientation.
    thresholds : iterable of (metres, degrees)
        Of pose recall; translation recall and area are at the same metres.

    Returns
    -------
    QueryScores
        ``error_m`` and ``rotation_deg``, the medians; ``within_5m_1deg``, pose recall;
        ``within_5m``, translation recall; ``auc_5m``, the area under the recall curve from 0 to 5
        m as a share of the best possible, exact for the steps. Without orientations no angles.

    Raises
    ------
    ArgumentError
        Errors that are NaN, negative or of different lengths, no query; thresholds that are not
        above 0, more than 16, or none.

    References
    ----------
    Sarlin, DeTone, Malisiewicz, Rabinovich, SuperGlue, CVPR 2020, for the area, whose code joins
    the steps by lines, which gives up to 1 / (2 N) more.

    Examples
    --------
    >>> pose_scores(([0.5, 4.0, float("inf")], [0.2, 1.5, float("inf")]), [(5, 1), (5, 2)])
    QueryScores
      queries         3
      failures        1
      error_m         4.0000
      within_5m       0.6667
      within_5m_1deg  0.3333
      within_5m_2deg  0.6667
      rotation_deg    1.5000
      auc_5m          0.3667
    """
    import pandas as pd

    found = errors if isinstance(errors, PoseErrors) else _errors(errors)
    pairs = _thresholds(thresholds)
    metres = tuple(sorted({limit for limit, _ in pairs}))
    if len({translation_column(limit) for limit in metres}) < len(metres):
        raise ArgumentError(
            "are so near that their names are the same", where="thresholds", expected="6 digits"
        )
    settings = MatchingScores(
        orientation_is_trusted=found.rotation_deg is not None,
        failed_rotation_deg="infinite",
        translation_below_m=metres,
        pose_below_m_deg=pairs,
        auc_up_to_m=metres,
    )
    if len(found.translation_m) == 0:
        raise ArgumentError("hold no query", where="errors", expected="at least one")
    # Of a pair of errors there are no parts.
    columns = {
        name: values
        for name, values in pose_columns(found, settings).items()
        if not np.isnan(values).any()
    }
    records = pd.DataFrame({"scene": "", **columns})
    asked = [score for score in matching_scores(settings) if score.column in columns]
    failures = int(np.isinf(found.translation_m).sum())
    return QueryScores(
        summarise(records, asked, [""]).overall,
        records.drop(columns="scene"),
        {"queries": len(records), "failures": failures},
    )


def _errors(errors: tuple[ArrayLike, ArrayLike | None]) -> PoseErrors:
    if not isinstance(errors, Sequence) or len(errors) != 2:
        raise ArgumentError(
            f"is {type(errors).__name__}",
            where="errors",
            expected="what pose_errors returns, or a pair: metres, and degrees or None",
        )
    translation, rotation = errors
    same_index({"errors[0]": translation, "errors[1]": rotation})
    metres = _error_row("errors[0]", translation)
    degrees = None if rotation is None else _error_row("errors[1]", rotation)
    if degrees is not None and (np.isfinite(degrees) & (degrees > 180.0)).any():
        raise ArgumentError(
            "holds angles beyond 180",
            where="errors[1]",
            expected="the angle between two rotations, 0 to 180 degrees, or infinite",
        )
    if degrees is not None and len(degrees) != len(metres):
        raise ArgumentError(
            f"have {len(metres)} and {len(degrees)} numbers",
            where="errors",
            expected="an error in metres and one in degrees for each query",
        )
    unknown = np.full(len(metres), np.nan)
    return PoseErrors(metres, unknown, unknown, degrees)


def _error_row(name: str, values: ArrayLike) -> Floats:
    errors = floats(name, values, (None,))
    bad = np.flatnonzero(~(errors >= 0.0))
    if bad.size:
        raise ArgumentError(
            f"is NaN or negative for queries {first_of(bad.tolist(), len(errors))}",
            where=name,
            expected="0 or more; infinite for a failure",
        )
    return errors


def _thresholds(thresholds: Iterable[Any]) -> tuple[tuple[float, float], ...]:
    rows = floats("thresholds", listed("thresholds", thresholds), (None, 2)).tolist()
    if not 0 < len(rows) <= _MOST_THRESHOLDS:
        raise ArgumentError(
            f"has {len(rows)} pairs",
            where="thresholds",
            expected=f"1 to {_MOST_THRESHOLDS} pairs of metres and degrees, such as (5, 1)",
        )
    pairs = {(positive("thresholds", m), positive("thresholds", deg)) for m, deg in rows}
    return tuple(sorted(pairs))
