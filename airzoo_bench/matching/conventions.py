"""Poses that are written in another convention, by what the photos' own metadata say."""

from __future__ import annotations

import itertools

import numpy as np

from airzoo_bench.core.errors import PredictionError
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.poses import Poses
from airzoo_bench.geometry.rotations import (
    matrix_to_quaternion,
    quaternion_to_matrix,
    rotation_angle_deg,
)

__all__ = ["refuse_other_conventions", "suspect_inverted", "suspect_turned"]

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
# From camera axes x right, y down, z forward to x right, y up, z backward, or back.
_OPENGL = np.diag((1.0, -1.0, -1.0))


def refuse_other_conventions(given: Poses, priors: Poses, *, quaternions: bool = False) -> None:
    """Refuse poses that agree with the photos' own GPS and gimbal only when read in another way.

    Parameters
    ----------
    given, priors : Poses
        Of the same N queries; N may be 0.
    quaternions : bool
        Whether the rotations were written as quaternions, and not as matrices.

    Raises
    ------
    PredictionError
        It names the convention, and how near each reading comes to the priors.
    """
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
    """Return a note where rotations of cameras that look down fit the gimbal better inverted.

    This is no error: a gimbal's signs can be wrong in the metadata, too.

    Parameters
    ----------
    given, priors : Poses
        Of the same N queries; N may be 0.
    """
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
    """Return a note where cameras that are in place are turned by 90 or 180 degrees, all alike.

    This is no error: priors can have axes of their own, too.

    Parameters
    ----------
    given, priors : Poses
        Of the same N queries; N may be 0.
    """
    if len(given) < _LEAST_PHOTOS:
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
