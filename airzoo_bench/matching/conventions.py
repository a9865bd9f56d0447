"""Poses that are written in another convention, by what the photos' own metadata say."""

from __future__ import annotations

import itertools

import numpy as np

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.geometry.arrays import Floats, Ints
from airzoo_bench.geometry.cameras import project
from airzoo_bench.geometry.poses import (
    Poses,
    matrix_to_quaternion,
    quaternion_to_matrix,
    rotation_angle_deg,
    world_to_camera,
)
from airzoo_bench.matching.lifting import lift
from airzoo_bench.matching.truth import MatchingTruth

__all__ = [
    "refuse_other_conventions",
    "suspect_heights",
    "suspect_inverted",
    "suspect_points",
    "suspect_turned",
]

# Poses count as inverted where that brings most of them this many times nearer to the priors.
_TIMES_NEARER = 10.0
# Rotations count as written in another convention where they are at least this far from the IMU's,
# read in that convention they are nearer than that, and nearer by this factor: if cameras look
# down, a rotation and its inverse differ by little more than the tilt. Yaw may be wrong by 180
# degrees in a few photos, which does not move medians.
_FAR_DEG, _TIMES_NEARER_DEG = 20.0, 3.0
# Where cameras look straight down, the inverse of a rotation is tilted to the opposite side. It is
# suspected from this many photos, this mean gain, and this many standard errors of the gain on.
_LEAST_PHOTOS, _LEAST_GAIN_DEG, _STANDARD_ERRORS = 5, 0.5, 3.0
# One turn of the camera's axes is suspected where it brings most photos this near to their priors,
# and nearly all this near to them or to their opposite yaw, of which gimbals are wrong in a third
# of the photos at Brighton; and half of the centres lie this near. What fails does not fail alike.
_MOST, _NEARLY_ALL, _ALIKE_DEG, _NEAR_M = 0.6, 0.9, 8.0, 50.0
_OPPOSITE_YAW = np.diag((-1.0, -1.0, 1.0))
# Another reading is suspected where it explains the first share of a misfit, and refused from the
# second on, if the misfit is clear: in metres, or as a share of a photo's diagonal.
_SUGGESTS, _EXPLAINS, _CLEARLY_OFF_M, _CLEARLY_OFF = 0.5, 0.9, 20.0, 0.05
_SAMPLED_QUERIES, _SAMPLED = 10, 40
_FOOT_M = 0.3048
# From camera axes x right, y down, z forward to x right, y up, z backward, or back.
_OPENGL = np.diag((1.0, -1.0, -1.0))


def refuse_other_conventions(given: Poses, priors: Poses, *, quaternions: bool = False) -> None:
    """Refuse poses that agree with the photos' own GPS and gimbal only when read in another way."""
    if not len(given):
        return
    with np.errstate(over="ignore"):
        as_given = np.linalg.norm(given.centres - priors.centres, axis=1)
        inverted = np.linalg.norm(given.translation - priors.centres, axis=1)
    if np.mean(inverted * _TIMES_NEARER < as_given) > 0.5:
        raise PredictionError(
            f"the poses look camera-to-world: taken so, cameras lie {np.median(inverted):.1f} m "
            f"from their GPS positions; as world-to-camera, {np.median(as_given):.1f} m",
            where="field 'poses'",
            expected="world-to-camera, x_cam = R X + t, in the scene's CRS",
            fix=_way_back(given, priors),
        )
    _refuse_turned(given.rotation, priors.rotation, quaternions=quaternions)


def suspect_inverted(given: Poses, priors: Poses) -> str | None:
    """Return a note where rotations of cameras that look down fit the gimbal better inverted."""
    if len(given) < _LEAST_PHOTOS:
        return None
    gimbal = priors.rotation[:, 2]
    as_given = _degrees_between(given.rotation[:, 2], gimbal)
    inverted = _degrees_between(given.rotation[:, :, 2], gimbal)
    gain = as_given - inverted
    error = float(gain.std(ddof=1)) / len(gain) ** 0.5
    if gain.mean() < max(_LEAST_GAIN_DEG, _STANDARD_ERRORS * error):
        return None
    return (
        "are the rotations camera-to-world? Read so, cameras look "
        f"{inverted.mean():.1f} degrees from where the gimbal says, as they stand "
        f"{as_given.mean():.1f} (means)"
    )


def suspect_turned(given: Poses, priors: Poses) -> str | None:
    """Return a note where cameras that are in place are turned by 90 or 180 degrees, all alike."""
    if len(given) < _LEAST_PHOTOS or _are_quarter_turns(given.rotation):
        return None
    with np.errstate(over="ignore"):
        away = float(np.median(np.linalg.norm(given.centres - priors.centres, axis=1)))
    if away > _NEAR_M:
        return None
    off = np.median(rotation_angle_deg(given.rotation, priors.rotation))
    for axis, degrees in itertools.product(range(3), (90.0, 180.0, -90.0)):
        turned = _turn(axis, degrees) @ priors.rotation
        alike = rotation_angle_deg(given.rotation, turned) < _ALIKE_DEG
        other = rotation_angle_deg(given.rotation, turned @ _OPPOSITE_YAW) < _ALIKE_DEG
        if alike.mean() >= _MOST and (alike | other).mean() >= _NEARLY_ALL:
            return (
                f"are the rotations those of a camera turned by {degrees:g} degrees about its "
                f"{'xyz'[axis]} axis? They differ from the gimbal's by {off:.0f} degrees (median); "
                f"turned back, {alike.sum()} of {len(given)} by less than {_ALIKE_DEG:g}, and "
                f"centres lie {away:.1f} m from GPS"
            )
    return None


def suspect_heights(given: Poses, truth: Poses) -> str | None:
    """Say where heights in feet explain half of what centres are off; refuse nine tenths."""
    if len(given) < _LEAST_PHOTOS:
        return None
    with np.errstate(over="ignore"):
        off, left = (
            float(np.median(np.linalg.norm(given.centres * (1, 1, unit) - truth.centres, axis=1)))
            for unit in (1.0, _FOOT_M)
        )
    return _judged("heights in feet", "the poses", (off, left), _CLEARLY_OFF_M, "m")


def suspect_points(
    truth: MatchingTruth, parts: list[slice], query_xy: Floats, map_xy: Floats | None, xyz: Floats
) -> str | None:
    """Say so of matches: x and y exchanged within the crop, or points with heights in feet."""
    asked = [query for query, part in enumerate(parts) if part.stop - part.start]
    rows = {
        query: np.linspace(parts[query].start, parts[query].stop - 1, _SAMPLED).astype(int)
        for query in asked[:: -(-len(asked) // _SAMPLED_QUERIES) or 1]
    }
    cameras, poses = truth.cameras, truth.poses
    diagonal = float(np.hypot(cameras.width, cameras.height).max(initial=0.0))

    def off_px(*, otherwise: bool) -> float:
        off = [np.zeros(0)]
        for query, some in rows.items():
            points = _points_of(truth, query, map_xy, xyz, some, otherwise=otherwise)
            seen = world_to_camera(poses.take([query]), points[None])
            pixels = project(cameras.take([query]), seen)[0]
            off.append(np.linalg.norm(pixels - query_xy[some], axis=1))
        # What no camera sees is as far as can be.
        return float(np.median(np.fmin(np.concatenate(off), diagonal))) if rows else 0.0

    clear, off = _CLEARLY_OFF * diagonal, off_px(otherwise=False)
    both = (off, off_px(otherwise=True) if off > clear else off)
    points, pixels = (
        ("heights in feet", "field 'points3d'"),
        ("x and y exchanged", "field 'map_xy'"),
    )
    return _judged(*(points if map_xy is None else pixels), both, clear, "px")


def _points_of(
    truth: MatchingTruth,
    query: int,
    map_xy: Floats | None,
    xyz: Floats,
    rows: Ints,
    *,
    otherwise: bool,
) -> Floats:
    """Return the points of some matches of a query, as they stand or in the other reading."""
    if map_xy is None:
        return xyz[rows] * (1.0, 1.0, _FOOT_M if otherwise else 1.0)
    corner, reference = truth.crops[query, :2], truth.map_of(query)
    xy = corner + (map_xy[rows] - corner)[:, :: -1 if otherwise else 1]
    return lift(xy, reference.dom, reference.dsm, jobs=1).points


def _judged(
    what: str, where: str, misfits: tuple[float, float], clear: float, unit: str
) -> str | None:
    """Refuse a misfit of which another reading leaves a tenth, ask where it leaves a half."""
    off, left = misfits
    said = f"they are {off:.4g} {unit} off as they stand, {left:.4g} {unit} read so (medians)"
    if off > clear and left < (1.0 - _EXPLAINS) * off:
        raise PredictionError(
            f"looks like {what}: {said}",
            where=where,
            expected="metres, and pixels as x, the column, before y",
            fix="convert them before you write the file",
        )
    return f"{what}? {said}" if off > clear and left < (1.0 - _SUGGESTS) * off else None


def _are_quarter_turns(rotations: Floats) -> bool:
    """Tell rotations of a map's tile, north up or so, which are no reading of a camera's."""
    return bool(np.isin(np.abs(np.round(rotations, 12)), (0.0, 1.0)).all())


def _turn(axis: int, degrees: float) -> Floats:
    """Return the rotation about an axis of the camera by a multiple of 90 degrees."""
    quaternion = np.array([[np.cos(np.radians(degrees / 2)), 0.0, 0.0, 0.0]])
    quaternion[0, axis + 1] = np.sin(np.radians(degrees / 2))
    turn: Floats = quaternion_to_matrix(quaternion)[0]
    return turn


def _degrees_between(one: Floats, other: Floats) -> Floats:
    cosine = np.clip((one * other).sum(axis=1), -1.0, 1.0)
    degrees: Floats = np.degrees(np.arccos(cosine))
    return degrees


def _way_back(given: Poses, priors: Poses) -> str:
    off = np.median(rotation_angle_deg(given.rotation, priors.rotation))
    back = np.median(rotation_angle_deg(np.swapaxes(given.rotation, 1, 2), priors.rotation))
    if off < back:
        return "the rotations are right and the last column is the centre: t = -R @ centre"
    return "invert them: R.T and -R.T @ t"


def _refuse_turned(given: Floats, priors: Floats, *, quaternions: bool) -> None:
    """Refuse rotations that agree with the IMU only when they are read in another way."""
    if _are_quarter_turns(given):
        return
    back = np.swapaxes(given, 1, 2)
    reordered = quaternion_to_matrix(np.roll(matrix_to_quaternion(given), 1, axis=1))
    order = "quaternions in the order x y z w"
    readings = {
        "camera-to-world": back,
        "those of OpenGL's camera axes (x right, y up, z backward)": _OPENGL @ given,
        "camera-to-world with OpenGL's camera axes (x right, y up, z backward)": _OPENGL @ back,
        order if quaternions else f"matrices made of {order}": reordered,
    }
    if quaternions:  # of camera-to-world ones, as TUM has them and CUT3R has not
        first = np.roll(matrix_to_quaternion(back), -1, axis=1)
        readings["quaternions in the order w x y z"] = np.swapaxes(
            quaternion_to_matrix(first), 1, 2
        )
    off = float(np.median(rotation_angle_deg(given, priors)))
    errors = {
        name: float(np.median(rotation_angle_deg(rotation, priors)))
        for name, rotation in readings.items()
    }
    fitting = [
        name
        for name, error in errors.items()
        if error < _FAR_DEG < off and error * _TIMES_NEARER_DEG < off
    ]
    if not fitting:
        return
    # Of cameras that look down and north, OpenGL's matrices fit that order of quaternions too.
    likely = [name for name in fitting if quaternions or order not in name] or fitting
    best = min(likely, key=errors.__getitem__)
    convert = "convert them before you write the file"
    raise PredictionError(
        f"the rotations look like {best}: they differ from the IMU's by {off:.0f} degrees, "
        f"read so by {errors[best]:.0f}",
        where="the poses",
        expected="world-to-camera rotations, x_cam = R X + t, camera axes x right, y down, "
        "z forward, quaternions as w x y z",
        fix=f"{convert}; OpenGL's w2c becomes diag(1, -1, -1) @ R" if "OpenGL" in best else convert,
    )
