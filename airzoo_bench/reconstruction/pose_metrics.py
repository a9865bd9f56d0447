"""Errors of camera poses: relative, over all pairs; absolute and between neighbours, once aligned.

A camera that the prediction lacks has no pose (NaN), and each of its errors is infinite.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.geometry.poses import Poses, rotation_angle_deg
from airzoo_bench.reconstruction.motions import (
    angle_deg,
    lengths,
    motions_to_next,
    relative_poses,
    world_motions,
)

__all__ = [
    "PairErrors",
    "auc_of_depth_anything_3",
    "centre_errors",
    "pair_errors",
    "pose_auc",
    "rms_of_placed",
    "step_errors",
]

_BLOCK_PAIRS = 1 << 17
# A predicted baseline below this share of the largest coordinate is rounding, and has no direction.
_NO_BASELINE = 1e-12


@dataclass(frozen=True, eq=False)
class PairErrors:
    """Errors of the relative poses of P ordered pairs of cameras, infinite for failures.

    Attributes
    ----------
    rotation_deg : (P,) array
        Angle between the relative rotations, 0 to 180.
    direction_deg : (P,) array
        Angle between the directions of the relative translations, 0 to 180; 0 where the true
        cameras share a place, which has no direction.
    """

    rotation_deg: Floats
    direction_deg: Floats

    @property
    def worse_deg(self) -> Floats:
        """The larger of the two, pair by pair."""
        return np.maximum(self.rotation_deg, self.direction_deg)


def pair_errors(predicted: Poses, truth: Poses, *, least_baseline: float) -> PairErrors:
    """Compare the relative poses of all pairs of cameras.

    Pairs are ordered, (i, j) and (j, i): the direction of j as seen by i and that of i as seen by
    j err differently once rotations do, and with one of the two the score would depend on the
    order of the images. No camera is a reference, and a similarity of either world changes
    nothing. A direction opposite to the true one is 180 degrees off; it is not folded to 0.

    Parameters
    ----------
    predicted, truth : Poses
        N partners, row by row; NaN where the prediction has none.
    least_baseline : float
        Pairs whose true centres are at most so far apart, in units of the truth, count by their
        rotation only. A prediction without a baseline where the truth has one has failed.

    Returns
    -------
    PairErrors
        Of P = N (N - 1) pairs, by first camera, then second: 16 P bytes.

    Raises
    ------
    ValueError
        Not as many predicted cameras as true ones, fewer than 2, or a truth that is not finite.
    """
    count = len(truth)
    _check(predicted, truth)
    pairs = count * (count - 1)
    errors = PairErrors(np.empty(pairs), np.empty(pairs))
    rows = max(1, _BLOCK_PAIRS // count)
    for start in range(0, count, rows):
        block = slice(start, min(start + rows, count))
        rotation, direction = _pair_block(predicted, truth, block, least_baseline)
        other = np.arange(count) != np.arange(block.start, block.stop)[:, None]
        place = slice(block.start * (count - 1), block.stop * (count - 1))
        errors.rotation_deg[place] = rotation[other]
        errors.direction_deg[place] = direction[other]
    return errors


def pose_auc(errors: PairErrors, limit_deg: float) -> float:
    r"""Area under the curve of pairs that are right, up to a limit, as a share of the best.

    A pair is right below an angle where both its rotation and its direction are:
    :math:`\frac{1}{P} \sum_p \max(0, 1 - e_p / L)` with e the larger of both. Exact for the
    curve, which is a step function; evaluations that fill a histogram by whole degrees differ by
    up to half a degree over L.

    Parameters
    ----------
    errors : PairErrors
        From `pair_errors`.
    limit_deg : float
        L, above 0.

    Returns
    -------
    float
        0 to 1.

    Raises
    ------
    ValueError
        The limit is not above 0, or infinite.

    References
    ----------
    Wang, Karaev, Rupprecht, Novotny, PoseDiffusion, ICCV 2023, section 4, for the measure.
    """
    if not 0.0 < limit_deg < np.inf:
        raise ValueError(f"limit is {limit_deg}, expected above 0 and finite")
    shares = 1.0 - np.minimum(errors.worse_deg, limit_deg) / limit_deg
    return float(shares.mean())


def auc_of_depth_anything_3(predicted: Poses, truth: Poses, limits_deg: list[int]) -> list[float]:
    """Area under the curve of pairs that are right, as Depth Anything 3's benchmark computes it.

    Unlike `pose_auc` it takes a pair once, not both ways; compares the motions of the world that
    take one camera to another, in the frame of the first camera, so that the order of the images
    matters; folds opposite directions to 0 degrees, gives 90 to those of cameras that share a
    place; and counts by whole degrees.

    Parameters
    ----------
    predicted, truth : Poses
        See `pair_errors`. The first camera is the first that has a pose.
    limits_deg : list of int
        Whole degrees.

    Returns
    -------
    list of float
        The area up to each limit, 0 to 1.

    References
    ----------
    Lin et al., Depth Anything 3, 2025; ``compute_pose`` of its ``bench/utils.py``.
    """
    count = len(truth)
    _check(predicted, truth)
    there = np.flatnonzero(~_failed(predicted))
    right = np.zeros(max(limits_deg) + 1)
    last = dict.fromkeys(limits_deg, 0)
    for row in range(len(there) - 1):
        pairs = there[row], there[row + 1 :]
        turn, move = world_motions(predicted, there[0], *pairs)
        true_turn, true_move = world_motions(truth, there[0], *pairs)
        direction = angle_deg(move, true_move)
        direction = np.minimum(direction, 180.0 - direction)
        direction[(lengths(move) == 0.0) | (lengths(true_move) == 0.0)] = 90.0
        worse = np.maximum(rotation_angle_deg(turn, true_turn), direction)
        right += (worse[:, None] < np.arange(len(right))).sum(axis=0)
        # The last degree of a histogram has both its borders.
        last = {limit: last[limit] + int((worse == limit).sum()) for limit in limits_deg}
    pairs_of_all = count * (count - 1) / 2
    return [
        float((right[1 : limit + 1].sum() + last[limit]) / limit / pairs_of_all)
        for limit in limits_deg
    ]


def centre_errors(aligned: Poses, truth: Poses) -> Floats:
    """Distances (N,) of aligned camera centres from the true ones, infinite for failures.

    Their root mean square is the absolute trajectory error (ATE).

    Parameters
    ----------
    aligned, truth : Poses
        N partners; the aligned ones NaN where there is no pose.

    Returns
    -------
    (N,) array
        In the units of the truth.

    References
    ----------
    Sturm, Engelhard, Endres, Burgard, Cremers, A benchmark for the evaluation of RGB-D SLAM
    systems, IROS 2012, section IV.
    """
    return _infinite(lengths(aligned.centres - truth.centres), _failed(aligned))


def step_errors(aligned: Poses, truth: Poses) -> tuple[Floats, Floats]:
    """Compare the motions from each camera to the next, in the order given.

    The relative pose error (RPE) over steps of one: of the motion that is left once the true
    motion is undone, length and angle.

    Parameters
    ----------
    aligned, truth : Poses
        N partners; the predicted ones with the scale of the truth.

    Returns
    -------
    translation, rotation_deg : (N - 1,) array
        In the units of the truth, and 0 to 180 degrees; infinite where either camera has no pose.

    References
    ----------
    Sturm et al., see `centre_errors`.
    """
    # E = (true motion)^-1 (motion), each from camera i to camera i + 1, camera-to-world.
    turn, move = motions_to_next(aligned)
    true_turn, true_move = motions_to_next(truth)
    failed = _failed(aligned)
    lost = failed[:-1] | failed[1:]
    return (
        _infinite(lengths(move - true_move), lost),
        _infinite(rotation_angle_deg(turn, true_turn), lost),
    )


def rms_of_placed(errors: Floats) -> float:
    """Root mean square of the finite errors, infinite where there are none.

    What ATE and RPE mean in the literature; say next to it how many cameras were placed, and use
    the median of all errors where methods that place different cameras are compared.

    Parameters
    ----------
    errors : (N,) array
        Infinite for failures.

    Returns
    -------
    float
        In their units.
    """
    placed = errors[np.isfinite(errors)]
    return float(np.sqrt((placed * placed).mean())) if len(placed) else np.inf


def _pair_block(
    predicted: Poses, truth: Poses, block: slice, least_baseline: float
) -> tuple[Floats, Floats]:
    first, second = np.arange(len(truth))[block, None], np.arange(len(truth))[None]
    turn, move = relative_poses(predicted, first, second)
    true_turn, true_move = relative_poses(truth, first, second)
    failed = _failed(predicted)
    lost = failed[block, None] | failed[None, :]
    length, true_length = lengths(move), lengths(true_move)
    direction = angle_deg(move, true_move)
    rounding = _NO_BASELINE * np.abs(predicted.centres[~failed]).max(initial=0.0)
    direction = np.where(length <= rounding, np.inf, direction)
    direction = np.where(true_length <= least_baseline, 0.0, direction)
    rotation = rotation_angle_deg(turn, true_turn)
    return _infinite(rotation, lost), _infinite(direction, lost)


def _failed(poses: Poses) -> Bools:
    entries = np.concatenate((poses.rotation.reshape(-1, 9), poses.centres), axis=1)
    return np.logical_not(np.isfinite(entries).all(axis=1))


def _infinite(errors: Floats, failed: Bools) -> Floats:
    return np.where(failed, np.inf, errors)


def _check(predicted: Poses, truth: Poses) -> None:
    if len(predicted) != len(truth) or len(truth) < 2:
        raise ValueError(f"{len(predicted)} predicted cameras, {len(truth)} true ones")
    if _failed(truth).any():
        raise ValueError("the true poses hold NaN or infinity")
