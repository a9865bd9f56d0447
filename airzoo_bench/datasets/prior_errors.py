"""How far priors are from poses, and which mistake of convention would explain it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.geometry.poses import Poses, rotation_angle_deg
from airzoo_bench.geometry.rotations import angles_to_rotations, rotations_to_angles

__all__ = ["PriorErrors", "Turned", "prior_errors", "turned_priors"]

# No gimbal is so far off; a mistake of convention is. What it leaves is below the second.
_WRONG_DEG, _EXPLAINED_DEG = 45.0, 20.0


@dataclass(frozen=True, eq=False)
class PriorErrors:
    """Errors of N priors against the poses.

    Attributes
    ----------
    position_m : (N,) array
        In space.
    yaw_deg, pitch_deg, rotation_deg : (N,) array
        Not negative: about the vertical; of the optical axis against the horizon; in space.
    """

    position_m: Floats
    yaw_deg: Floats
    pitch_deg: Floats
    rotation_deg: Floats


@dataclass(frozen=True, eq=False)
class Turned:
    """Priors that one mistake explains.

    Attributes
    ----------
    what : str
        What is wrong with them, such as ``"yaw is 180 degrees off"``.
    rows : (N,) bool array
    """

    what: str
    rows: Bools


def prior_errors(priors: Poses, poses: Poses) -> PriorErrors:
    """Compare N priors with the poses.

    The error of yaw is the twist about the vertical of the rotation between the two, which is also
    defined for cameras that look straight down.
    """
    # Rows of a rotation are the camera's axes in the world: this takes the pose's to the prior's.
    between = np.einsum("nki,nkj->nij", priors.rotation, poses.rotation)
    sine, cosine = between[:, 1, 0] - between[:, 0, 1], between[:, 0, 0] + between[:, 1, 1]
    down = [np.degrees(np.arcsin(np.clip(p.rotation[:, 2, 2], -1, 1))) for p in (priors, poses)]
    return PriorErrors(
        np.sqrt(((priors.centres - poses.centres) ** 2).sum(axis=-1)),
        np.abs(np.degrees(np.arctan2(sine, cosine))),
        np.abs(down[0] - down[1]),
        rotation_angle_deg(priors.rotation, poses.rotation),
    )


def turned_priors(priors: Poses, poses: Poses) -> list[Turned]:
    """Find mistakes of convention that explain priors turned by more than 45 degrees.

    Of the mistakes that leave less than 20 degrees, the one that explains the most priors comes
    first, then the one that explains the most of the others, and so on; one that explains less
    than a third may do so by chance, and explains nothing.
    """
    wrong = rotation_angle_deg(priors.rotation, poses.rotation) > _WRONG_DEG
    explained = {
        what: wrong & (rotation_angle_deg(corrected, poses.rotation) < _EXPLAINED_DEG)
        for what, corrected in _corrected(priors).items()
    }
    least, found = wrong.sum() / 3, []
    while wrong.any():
        what = max(explained, key=lambda name: int((explained[name] & wrong).sum()))
        rows = explained[what] & wrong
        if rows.sum() < least:
            found.append(Turned("rotation is more than 45 degrees off", wrong))
            break
        found.append(Turned(what, rows))
        wrong = wrong & ~rows
    return found


def _corrected(priors: Poses) -> dict[str, Floats]:
    """Rotations of the priors without each mistake, by what the mistake is."""
    yaw, pitch, roll = rotations_to_angles(priors.rotation, convergence_deg=0.0).T
    angles = {
        "yaw is 180 degrees off": (yaw + 180.0, pitch, roll),
        "yaw is 90 degrees too large": (yaw - 90.0, pitch, roll),
        "yaw is 90 degrees too small": (yaw + 90.0, pitch, roll),
        "yaw has the wrong sign": (-yaw, pitch, roll),
        "pitch has the wrong sign": (yaw, -pitch, roll),
        "yaw and pitch have the wrong sign": (-yaw, -pitch, roll),
        "pitch is counted from nadir": (yaw, pitch - 90.0, roll),
        "roll is 180 degrees off": (yaw, pitch, roll + 180.0),
    }
    return {
        what: angles_to_rotations(*values, convergence_deg=0.0) for what, values in angles.items()
    }
