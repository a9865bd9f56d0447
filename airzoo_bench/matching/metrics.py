"""Errors of Q poses, infinite for failures, which stay in every share and median; their scores."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.poses import Poses, rotation_angle_deg
from airzoo_bench.matching.protocol import MatchingScores
from airzoo_bench.results.result import ScoreColumn


@dataclass(frozen=True, eq=False)
class PoseErrors:
    """Errors of Q estimated poses, infinite for failures.

    Attributes
    ----------
    translation_m : (Q,) array
        Distance of the camera centres in space.
    horizontal_m, vertical_m : (Q,) array
        The same over x and y, and the absolute difference in z.
    rotation_deg : (Q,) array or None
        Geodesic angle of the rotations, 0 to 180; None where the truth has no orientation.
    """

    translation_m: Floats
    horizontal_m: Floats
    vertical_m: Floats
    rotation_deg: Floats | None

    def __repr__(self) -> str:
        return repr(pd.DataFrame(vars(self)))


def pose_errors(
    rotation: Floats, centres: Floats, true_rotation: Floats | None, true_centres: Floats
) -> PoseErrors:
    """Compare poses (Q, 3, 3) and (Q, 3), world-to-camera, z up in metres, with finite true ones.

    A query with any entry not finite has failed. True rotations are None where the orientation is
    not trusted (RTK positions only). Angles are geodesic: Hartley, Trumpf, Dai, Li, Rotation
    averaging, IJCV 103, 2013.
    """
    entries = np.concatenate((rotation.reshape(-1, 9), centres), axis=1)
    failed = np.logical_not(np.isfinite(entries).all(axis=1))
    with np.errstate(over="ignore", invalid="ignore"):
        x, y, z = (centres - true_centres).T
        horizontal = np.hypot(x, y)
        angle = None if true_rotation is None else rotation_angle_deg(rotation, true_rotation)
    metres = np.where(failed, np.inf, (np.hypot(horizontal, z), horizontal, np.abs(z)))
    degrees = None if angle is None else np.where(failed, np.inf, angle)
    return PoseErrors(metres[0], metres[1], metres[2], degrees)


def count_near(poses: Poses, priors: Poses, metres: float, degrees: float) -> int:
    """Count the poses, NaN where there is none, that lie as near to their priors as that."""
    errors = pose_errors(poses.rotation, poses.centres, priors.rotation, priors.centres)
    return int(within(errors.translation_m, errors.rotation_deg, metres, degrees).sum())


def within(
    translation_m: Floats, rotation_deg: Floats | None, limit_m: float, limit_deg: float = np.inf
) -> Floats:
    """Return 1 where the errors are below their limits, strictly, else 0; None is no rotation."""
    near = translation_m < limit_m
    if rotation_deg is not None:
        near &= rotation_deg < limit_deg
    return near.astype(np.float64)


def area_share(errors: Floats, limit: float) -> Floats:
    r"""Return the share of [0, limit] that lies beyond each error: :math:`\max(0, 1 - e / L)`.

    Its mean over Q queries is the area under the recall curve up to the limit L, as a share of the
    best possible: that of SuperGlue (Sarlin, DeTone, Malisiewicz, Rabinovich, CVPR 2020, section
    5.2), exact for the curve as it is, which is a step function. SuperGlue's ``pose_auc`` joins the
    steps' upper ends by straight lines, which gives up to 1 / (2 Q) more.
    """
    return 1.0 - np.minimum(errors, limit) / limit


def pose_columns(errors: PoseErrors, settings: MatchingScores) -> dict[str, Floats]:
    """Return the columns of the records that errors of Q poses give: the errors, then scores."""
    metres, degrees = errors.translation_m, errors.rotation_deg
    columns = {"error_m": metres, "horizontal_m": errors.horizontal_m}
    columns["vertical_m"] = errors.vertical_m
    if degrees is not None:
        worst = settings.failed_rotation_deg
        failed = np.inf if worst == "infinite" else worst
        columns["rotation_deg"] = np.where(np.isfinite(degrees), degrees, failed)
    for m in settings.translation_below_m:
        columns[f"within_{m:g}m"] = within(metres, None, m)
    for m, deg in settings.pose_below_m_deg if settings.orientation_is_trusted else ():
        columns[f"within_{m:g}m_{deg:g}deg"] = within(metres, degrees, m, deg)
    return columns | {f"auc_{m:g}m": area_share(metres, m) for m in settings.auc_up_to_m}


def matching_scores(settings: MatchingScores) -> list[ScoreColumn]:
    """Return the scores that a protocol asks for."""
    share, error = ScoreColumn.share, ScoreColumn.error
    scores, turns = [error("error_m", "Median", "m", "median", headline=True)], []
    for m in settings.translation_below_m:
        scores.append(share(f"within_{m:g}m", f"@{m:g}m", headline=True))
    if settings.orientation_is_trusted:
        for m, deg in settings.pose_below_m_deg:
            key = f"within_{m:g}m_{deg:g}deg"
            scores.append(share(key, f"@{m:g}m,{deg:g}°", headline=True))
        turns.append(error("rotation_deg", "Rotation", "deg", "median"))
    scores.append(error("horizontal_m", "Horizontal", "m", "median"))
    scores += [error("vertical_m", "Vertical", "m", "median"), *turns]
    return scores + [share(f"auc_{m:g}m", f"AUC@{m:g}m") for m in settings.auc_up_to_m]
