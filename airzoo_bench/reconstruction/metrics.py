"""Scores of a predicted cloud against the true one, and of predicted camera poses.

Scores of clouds are the same, to the last bit, for any order of the points: counts are integers,
sums are exact before they are rounded once, and order statistics are distances that occur.

Errors of poses are relative, over all pairs, or absolute and between neighbours, once aligned. A
camera that the prediction lacks has no pose (NaN), and each of its errors is infinite.

References
----------
Precision, recall and F1: Knapitsch, Park, Zhou, Koltun, Tanks and Temples, ACM TOG 36(4), 2017.
Accuracy and completeness: Seitz, Curless, Diebel, Scharstein, Szeliski, A comparison and evaluation
of multi-view stereo reconstruction algorithms, CVPR 2006; the Chamfer distance is the mean of their
two means, not the sum, and not of squares. Area under the curve: Wang, Karaev, Rupprecht, Novotny,
PoseDiffusion, ICCV 2023, section 4. Absolute (ATE) and relative (RPE) errors: Sturm, Engelhard,
Endres, Burgard, Cremers, A benchmark for the evaluation of RGB-D SLAM systems, IROS 2012.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from airzoo_bench.geometry.arrays import Bools, Floats, Ints, apply_matrix
from airzoo_bench.geometry.poses import Poses, rotation_angle_deg

_CHUNK = 1 << 18
# A predicted baseline below this share of the largest coordinate is rounding, and has no direction.
_NO_BASELINE = 1e-12


# --- clouds ---


@dataclass(frozen=True, eq=False)
class Curve:
    """Shares of points, 0 to 1, nearer than each of K increasing thresholds; all (K,) float64."""

    thresholds: Floats
    precision: Floats
    recall: Floats
    f1: Floats


def mean_distances(
    to_truth: Floats, to_prediction: Floats, max_distance: float | None
) -> dict[str, float]:
    """Average the distances of P predicted points to the truth, and of T true ones to them.

    Distances above `max_distance` count as it in all but medians; without points all are infinite.
    """
    limit = math.inf if max_distance is None or len(to_truth) == 0 else max_distance
    accuracy, completeness = exact_mean(to_truth, limit), exact_mean(to_prediction, limit)
    return {
        "chamfer": (accuracy + completeness) / 2.0,
        "accuracy": accuracy,
        "completeness": completeness,
        "accuracy_median": float(np.median(to_truth)) if len(to_truth) else math.inf,
        "completeness_median": float(np.median(to_prediction)),
    }


def curve(to_truth: Floats, to_prediction: Floats, thresholds: Floats) -> Curve:
    """Return precision, recall and F1 at each threshold; 0 where nothing is predicted."""
    precision = counts_below(to_truth, thresholds) / max(len(to_truth), 1)
    recall = counts_below(to_prediction, thresholds) / len(to_prediction)
    total = precision + recall
    f1 = 2.0 * precision * recall / np.where(total > 0.0, total, 1.0)
    return Curve(thresholds, precision, recall, f1)


def counts_below(distances: Floats, thresholds: Floats) -> Ints:
    """Count the distances (N,) strictly below each of finite, increasing thresholds (K,)."""
    histogram = np.zeros(len(thresholds) + 1, dtype=np.int64)
    for start in range(0, len(distances), _CHUNK):
        # A distance equal to a threshold falls behind it, and so is not below it.
        behind = np.searchsorted(thresholds, distances[start : start + _CHUNK], side="right")
        histogram += np.bincount(behind, minlength=len(histogram))
    return np.cumsum(histogram[:-1])


def exact_mean(distances: Floats, limit: float = math.inf) -> float:
    """Return the exact sum of distances, each at most `limit`, rounded once, over their number."""
    if len(distances) == 0:
        return math.inf
    starts = range(0, len(distances), _CHUNK)
    chunks = (np.minimum(distances[start : start + _CHUNK], limit).tolist() for start in starts)
    return math.fsum(itertools.chain.from_iterable(chunks)) / len(distances)


# --- camera poses ---


def pair_errors(predicted: Poses, truth: Poses, *, least_baseline: float) -> tuple[Floats, Floats]:
    """Compare the relative poses of all ordered pairs of N cameras, by first camera, then second.

    Returns degrees (P,) between the relative rotations, and between the directions of the relative
    translations, infinite for failures. Pairs are ordered, so that neither the order of the images
    nor a similarity of either world changes anything. An opposite direction is 180 degrees off.
    Pairs whose true centres are at most `least_baseline` apart count by their rotation only. A
    prediction without a baseline where the truth has one has failed.
    """
    count = len(truth)
    failed, cameras = _failed(predicted), np.arange(count)
    rounding = _NO_BASELINE * np.abs(predicted.centres[~failed]).max(initial=0.0)
    rotation, direction = np.empty((2, count, count - 1))
    for row in range(count):
        pairs = np.array([row]), cameras[cameras != row]
        turn, move = relative_poses(predicted, *pairs)
        true_turn, true_move = relative_poses(truth, *pairs)
        angles = np.where(_lengths(move) <= rounding, np.inf, angle_deg(move, true_move))
        angles[_lengths(true_move) <= least_baseline] = 0.0
        lost = failed[row] | failed[pairs[1]]
        direction[row] = np.where(lost, np.inf, angles)
        rotation[row] = np.where(lost, np.inf, rotation_angle_deg(turn, true_turn))
    return rotation.ravel(), direction.ravel()


def pose_auc(rotation_deg: Floats, direction_deg: Floats, limit_deg: float) -> float:
    r"""Return the area under the curve of pairs that are right, up to a limit, 0 to 1.

    A pair is right below an angle where both its rotation and its direction are:
    :math:`\frac{1}{P} \sum_p \max(0, 1 - e_p / L)` with e the larger of both, exactly; histograms
    by whole degrees differ by up to half a degree over L.
    """
    worse = np.maximum(rotation_deg, direction_deg)
    return float((1.0 - np.minimum(worse, limit_deg) / limit_deg).mean())


def auc_of_depth_anything_3(predicted: Poses, truth: Poses, limits_deg: list[int]) -> list[float]:
    """Return the areas up to each limit in whole degrees as Depth Anything 3's benchmark has them.

    Unlike `pose_auc` it takes a pair once, not both ways; compares the motions of the world that
    take one camera to another, in the frame of the first camera that has a pose; folds opposite
    directions to 0 degrees, gives 90 to those of cameras that share a place; and counts by whole
    degrees. See ``compute_pose`` of its ``bench/utils.py`` (Lin et al., Depth Anything 3, 2025).
    """
    count = len(truth)
    there = np.flatnonzero(~_failed(predicted))
    right = np.zeros(max(limits_deg) + 1)
    last = dict.fromkeys(limits_deg, 0)
    for row in range(len(there) - 1):
        pairs = there[row], there[row + 1 :]
        turn, move = _world_motions(predicted, there[0], *pairs)
        true_turn, true_move = _world_motions(truth, there[0], *pairs)
        direction = angle_deg(move, true_move)
        direction = np.minimum(direction, 180.0 - direction)
        direction[(_lengths(move) == 0.0) | (_lengths(true_move) == 0.0)] = 90.0
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
    """Return distances (N,) of aligned camera centres from the true ones, infinite for failures."""
    return np.where(_failed(aligned), np.inf, _lengths(aligned.centres - truth.centres))


def step_errors(aligned: Poses, truth: Poses) -> tuple[Floats, Floats]:
    """Compare the motions from each camera to the next: lengths and degrees (N - 1,).

    The relative pose error (RPE) over steps of one: of the motion that is left once the true
    motion is undone. The predicted poses have the scale of the truth.
    """
    steps = np.arange(len(truth) - 1), np.arange(1, len(truth))
    turn, move = relative_poses(aligned, *steps)
    true_turn, true_move = relative_poses(truth, *steps)
    failed = _failed(aligned)
    lost = failed[:-1] | failed[1:]
    angles = rotation_angle_deg(turn, true_turn)
    return np.where(lost, np.inf, _lengths(move - true_move)), np.where(lost, np.inf, angles)


def rms_of_placed(errors: Floats) -> float:
    """Return the root mean square of the finite errors, infinite where there are none."""
    placed = errors[np.isfinite(errors)]
    return float(np.sqrt((placed * placed).mean())) if len(placed) else np.inf


def relative_poses(poses: Poses, first: Ints, second: Ints) -> tuple[Floats, Floats]:
    """Return rotations R_j R_i^T (..., 3, 3) and centres (..., 3) of cameras j as seen by i.

    `first` (i) and `second` (j) are rows, which broadcast.
    """
    rotation = poses.rotation[first]
    turn: Floats = poses.rotation[second] @ np.swapaxes(rotation, -1, -2)
    return turn, apply_matrix(rotation, poses.centres[second] - poses.centres[first])


def _world_motions(poses: Poses, first: int, row: int, others: Ints) -> tuple[Floats, Floats]:
    """Return E_i^-1 E_j for a row i and others j, cameras E being from the frame of the first."""
    rotation = poses.rotation @ poses.rotation[first].T
    centres = apply_matrix(poses.rotation[first], poses.centres - poses.centres[first])
    moved = -apply_matrix(rotation, centres)
    back = rotation[row].T
    return back @ rotation[others], apply_matrix(back, moved[others] - moved[row])


def angle_deg(a: Floats, b: Floats) -> Floats:
    """Return degrees between vectors; atan2 keeps all digits near 0 and 180 degrees."""
    sine = _lengths(np.cross(a, b))
    return np.asarray(np.degrees(np.arctan2(sine, (a * b).sum(axis=-1))))


def _failed(poses: Poses) -> Bools:
    entries = np.concatenate((poses.rotation.reshape(-1, 9), poses.centres), axis=1)
    return np.logical_not(np.isfinite(entries).all(axis=1))


def _lengths(vectors: Floats) -> Floats:
    return np.asarray(np.sqrt((vectors * vectors).sum(axis=-1)))
