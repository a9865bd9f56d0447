"""What GPS and gimbal would have said: true poses with noise, the same on every machine."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.attitude import angles_to_rotations, rotations_to_angles
from airzoo_bench.geometry.poses import Poses

__all__ = ["PriorNoise", "noisy_priors"]

_UNIFORMS = 12  # whose sum has the variance 1 and is normal to all purposes
_BITS = 16


@dataclass(frozen=True)
class PriorNoise:
    """Standard deviations of a consumer drone's metadata.

    Attributes
    ----------
    horizontal_m, vertical_m : float
        Of GPS without RTK, each axis.
    yaw_deg, pitch_deg, roll_deg : float
        Of compass and gimbal.
    """

    horizontal_m: float = 2.0
    vertical_m: float = 3.0
    yaw_deg: float = 2.0
    pitch_deg: float = 0.7
    roll_deg: float = 0.5


def noisy_priors(names: Sequence[str], poses: Poses, noise: PriorNoise, seed: int) -> Poses:
    """Return poses as metadata would give them.

    Parameters
    ----------
    names : sequence of N str
        Each photo's noise depends on its name and the seed alone, not on the other photos.
    poses : Poses
        The true ones; yaw is counted from the grid's north.
    noise : PriorNoise
    seed : int
    """
    unit = np.array([_normal_numbers(name, seed) for name in names]).reshape(-1, 6)
    spread = (noise.horizontal_m, noise.horizontal_m, noise.vertical_m)
    centres = poses.centres + unit[:, :3] * np.array(spread)
    turns = unit[:, 3:] * np.array((noise.yaw_deg, noise.pitch_deg, noise.roll_deg))
    yaw, pitch, roll = (rotations_to_angles(poses.rotation, convergence_deg=0.0) + turns).T
    return Poses.from_centres(angles_to_rotations(yaw, pitch, roll, convergence_deg=0.0), centres)


def _normal_numbers(name: str, seed: int) -> Floats:
    """Return six numbers of unit variance: sums of uniform ones, in whole numbers till the end."""
    digest = b"".join(
        hashlib.sha256(f"{seed}/{name}/{block}".encode()).digest() for block in range(5)
    )
    words = np.frombuffer(digest, dtype=">u2")[: 6 * _UNIFORMS].reshape(6, _UNIFORMS)
    total = words.astype(np.int64).sum(axis=1) * 2 + _UNIFORMS - (_UNIFORMS << _BITS)
    return np.asarray(total / (2 << _BITS), dtype=np.float64)
