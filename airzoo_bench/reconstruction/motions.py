"""Motions from one camera to another, the lengths of vectors and the angles between them."""

from __future__ import annotations

import numpy as np

from airzoo_bench.geometry.arrays import Floats, Ints, apply_matrix
from airzoo_bench.geometry.poses import Poses

__all__ = ["angle_deg", "lengths", "motions_to_next", "relative_poses", "world_motions"]


def relative_poses(poses: Poses, first: Ints, second: Ints) -> tuple[Floats, Floats]:
    """Return the poses of second cameras as first ones see them.

    Parameters
    ----------
    poses : Poses
        Of all cameras.
    first, second : (...) int array
        Rows of `poses`; they broadcast.

    Returns
    -------
    rotation : (..., 3, 3) array
        From the first camera to the second, R_j R_i^T.
    direction : (..., 3) array
        Of the second camera's centre, as long as the baseline.
    """
    rotation = poses.rotation[first]
    turn: Floats = poses.rotation[second] @ np.swapaxes(rotation, -1, -2)
    return turn, apply_matrix(rotation, poses.centres[second] - poses.centres[first])


def motions_to_next(poses: Poses) -> tuple[Floats, Floats]:
    """Return the motions from each camera to the next, in the order given.

    Parameters
    ----------
    poses : Poses
        Of N cameras.

    Returns
    -------
    rotation : (N - 1, 3, 3) array
        Camera-to-world, in the frame of the earlier camera.
    translation : (N - 1, 3) array
        From centre to centre, in the same frame.
    """
    rotation = poses.rotation
    turn = rotation[:-1] @ np.swapaxes(rotation[1:], -1, -2)
    return turn, apply_matrix(rotation[:-1], np.diff(poses.centres, axis=0))


def world_motions(poses: Poses, first: int, row: int, others: Ints) -> tuple[Floats, Floats]:
    """Return the motions of the world that take one camera to others.

    E_i^-1 E_j, the cameras E being from the frame of the first one.

    Parameters
    ----------
    poses : Poses
        Of all cameras.
    first : int
        Row of the camera in whose frame the world is.
    row : int
        Row of camera i.
    others : (N,) int array
        Rows of cameras j.

    Returns
    -------
    rotation : (N, 3, 3) array
        Of the world.
    translation : (N, 3) array
        In its units.
    """
    rotation = poses.rotation @ poses.rotation[first].T
    centres = apply_matrix(poses.rotation[first], poses.centres - poses.centres[first])
    moved = -apply_matrix(rotation, centres)
    back = rotation[row].T
    return back @ rotation[others], apply_matrix(back, moved[others] - moved[row])


def angle_deg(a: Floats, b: Floats) -> Floats:
    """Angles between vectors; atan2 of sine and cosine keeps all digits near 0 and 180 degrees.

    Parameters
    ----------
    a, b : (..., 3) array
        Of any lengths; they broadcast.

    Returns
    -------
    (...) array
        0 to 180 degrees; 0 where a vector has length 0.
    """
    sine = lengths(np.cross(a, b))
    return np.asarray(np.degrees(np.arctan2(sine, (a * b).sum(axis=-1))))


def lengths(vectors: Floats) -> Floats:
    """Lengths of vectors.

    Parameters
    ----------
    vectors : (..., 3) array
        In any units.

    Returns
    -------
    (...) array
        In the same.
    """
    squared: Floats = (vectors * vectors).sum(axis=-1)
    return np.sqrt(squared)
