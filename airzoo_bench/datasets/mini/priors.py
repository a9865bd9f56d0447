"""Noisy GPS and gimbal readings of known poses."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import numpy as np

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.poses import Poses, angles_to_rotations, rotations_to_angles

# Standard deviations of a consumer drone's metadata: GPS without RTK (east, north, up); compass
# and gimbal (yaw, pitch, roll).
_GPS_M = (2.0, 2.0, 3.0)
_ANGLES_DEG = (2.0, 0.7, 0.5)
_UNIFORMS = 12  # whose sum has the variance 1 and is normal to all purposes
_BITS = 16


def noisy_priors(names: Sequence[str], poses: Poses, seed: int) -> Poses:
    """Return what GPS and gimbal would have said of true poses, the same on every machine."""
    unit = np.array([_normal_numbers(name, seed) for name in names]).reshape(-1, 6)
    centres = poses.centres + unit[:, :3] * np.array(_GPS_M)
    turns = unit[:, 3:] * np.array(_ANGLES_DEG)
    yaw, pitch, roll = (rotations_to_angles(poses.rotation, convergence_deg=0.0) + turns).T
    return Poses.from_centres(angles_to_rotations(yaw, pitch, roll, convergence_deg=0.0), centres)


def _normal_numbers(name: str, seed: int) -> Floats:
    """Return six numbers of unit variance: sums of uniform ones, in whole numbers till the end."""
    blocks = (f"{seed}/{name}/{block}".encode() for block in range(5))
    digest = b"".join(hashlib.sha256(block).digest() for block in blocks)
    words = np.frombuffer(digest, dtype=">u2")[: 6 * _UNIFORMS].reshape(6, _UNIFORMS)
    total = words.astype(np.int64).sum(axis=1) * 2 + _UNIFORMS - (_UNIFORMS << _BITS)
    return np.asarray(total / (2 << _BITS), dtype=np.float64)
