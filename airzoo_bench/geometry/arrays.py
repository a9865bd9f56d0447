"""Array types of the package, products without BLAS, and the refusal of faulty cameras."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import CameraError, first_of

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


def apply_matrix(matrix: Floats, vectors: Floats) -> Floats:
    """Multiply vectors (..., 3) by matrices (..., 3, 3); leading dimensions broadcast.

    A BLAS kernel may round differently with the number of rows that it is given.
    """
    x, y, z = (vectors[..., axis, None] for axis in range(3))
    return np.asarray(matrix[..., 0] * x + matrix[..., 1] * y + matrix[..., 2] * z)


def multiply(a: Floats, b: Floats) -> Floats:
    """Multiply matrices (..., 3, 3) without BLAS; leading dimensions broadcast."""
    return transpose(apply_matrix(a[..., None, :, :], transpose(b)))


def transpose(matrices: Floats) -> Floats:
    """Return a view of matrices (..., M, N) as (..., N, M)."""
    return np.swapaxes(matrices, -1, -2)


def are_on_a_line(points: Floats) -> bool:
    """Whether points (N, 3) leave the turn about a line to rounding, a millionth of its length."""
    away = points - points[0]
    axis = away[np.argmax(np.abs(away).max(axis=1))]
    return bool(np.abs(np.cross(away, axis)).max() <= 1e-6 * (axis @ axis))


def refuse_cameras(
    bad: NDArray[np.bool_] | np.bool_,
    what: str,
    names: Sequence[object] | None = None,
    details: Sequence[str] | None = None,
    **about: Any,
) -> None:
    """Raise a CameraError that names the first bad cameras, each with its own of the `details`."""
    rows = np.flatnonzero(bad).tolist()
    labels = [f"camera {row}" if names is None else str(names[row]) for row in rows]
    if details is not None:
        labels = [f"{label} ({details[row]})" for label, row in zip(labels, rows, strict=True)]
    if rows:
        raise CameraError(f"{what} in {first_of(labels, total=bad.size)}", **about)
