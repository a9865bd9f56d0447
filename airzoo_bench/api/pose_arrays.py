"""World-to-camera poses as people hold them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from airzoo_bench.api.arrays import as_array, floats, refused
from airzoo_bench.core.errors import ArgumentError, first_of
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.geometry.poses import FARTHEST, Poses, check_rotations
from airzoo_bench.geometry.precision import COARSEST_M, pose_errors_m

__all__ = ["are_centres", "pose_rows"]

_LAST_ROW = (0.0, 0.0, 0.0, 1.0)
_ROW_TOLERANCE = 1e-6


def are_centres(name: str, values: Any) -> bool:
    """Tell camera centres (N, 3) from poses."""
    return as_array(name, values, "poses (N, 3, 4) or (N, 4, 4), or centres (N, 3)").ndim == 2


def pose_rows(name: str, values: Any, *, missing: bool) -> tuple[Bools, Poses]:
    """Return which of N world-to-camera poses there are, and all of them, NaN where there is none.

    Parameters
    ----------
    name : str
    values : (N, 3, 4) or (N, 4, 4) array-like
        [R | t], above 0 0 0 1 where there are four rows.
    missing : bool
        Whether a pose may be NaN in all of it.

    Raises
    ------
    ArgumentError
        Another shape; matrices that are no poses; too few digits to place a camera to a
        centimetre.
    """
    expected = "poses of shape (N, 3, 4) or (N, 4, 4)"
    rows = 4 if as_array(name, values, expected).shape[1:2] == (4,) else 3
    matrices = floats(name, values, (None, rows, 4))
    found = _found(name, matrices, missing=missing)
    given = matrices[found]
    names = [f"row {row}" for row in np.flatnonzero(found).tolist()]
    _check_last_row(name, given, names)
    with refused(name):
        exact = check_rotations(given[:, :3, :3], names)
        made = Poses.from_translations(exact, given[:, :3, 3], names)
    _refuse_coarse(name, given, names)
    rotation, centres = np.full((len(matrices), 3, 3), np.nan), np.full((len(matrices), 3), np.nan)
    rotation[found], centres[found] = made.rotation, made.centres
    return found, Poses(rotation=rotation, centres=centres)


def _found(name: str, matrices: Floats, *, missing: bool) -> Bools:
    found = np.asarray(np.isfinite(matrices).all(axis=(1, 2)))
    # The rest may be NaN above a last row of 0 0 0 1.
    empty = np.isnan(matrices[:, :3]).all(axis=(1, 2)) & missing
    bad = np.flatnonzero(~found & ~empty)
    if bad.size:
        raise ArgumentError(
            f"holds NaN or infinity in {first_of(bad.tolist(), len(matrices), noun='pose')}",
            where=name,
            expected="whole poses" + (", or NaN in all of a pose that is missing" * missing),
        )
    return found


def _check_last_row(name: str, matrices: Floats, names: Sequence[str]) -> None:
    if matrices.shape[1] != 4:
        return
    wrong = np.flatnonzero(~(np.abs(matrices[:, 3] - _LAST_ROW) <= _ROW_TOLERANCE).all(axis=1))
    if wrong.size:
        named = first_of([names[row] for row in wrong.tolist()], len(names))
        raise ArgumentError(
            f"a last row other than 0 0 0 1: {named}",
            where=name,
            expected="[R | t] above 0 0 0 1",
            fix="transpose the matrices, if their last row holds t",
        )


def _refuse_coarse(name: str, matrices: Floats, names: Sequence[str]) -> None:
    errors = pose_errors_m(matrices[:, :3, :3], matrices[:, :3, 3], None)
    coarse = np.flatnonzero(errors > COARSEST_M)
    if coarse.size:
        raise ArgumentError(
            f"too few digits in {first_of([names[row] for row in coarse.tolist()], len(names))}: "
            f"rounding alone moves cameras by {errors[coarse].max():.2g} m",
            where=name,
            expected=f"digits that place a camera to {COARSEST_M} m",
            fix=f"compute poses in float64; nothing within {FARTHEST:g} m is too far for it",
        )
