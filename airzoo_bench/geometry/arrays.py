"""Array types of the package, small products, and the refusal of faulty cameras."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import CameraError, first_of

__all__ = ["Bools", "Floats", "Ints", "apply_matrix", "multiply", "refuse_cameras", "transposed"]

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


def apply_matrix(matrix: Floats, vectors: Floats) -> Floats:
    """Multiply vectors by matrices of three columns, ``matrix @ vector``.

    Written as three products and two sums, not as a BLAS call: a BLAS kernel may round
    differently with the number of rows it is given, and the same vector must give the same
    bytes in every block.

    Parameters
    ----------
    matrix : (..., 3, 3) array
        What the vectors are multiplied by.
    vectors : (..., 3) array
        Leading dimensions broadcast against those of `matrix`.

    Returns
    -------
    (..., 3) array
        matrix @ vector, of the broadcast shape.
    """
    x, y, z = (vectors[..., axis, None] for axis in range(3))
    product: Floats = matrix[..., 0] * x + matrix[..., 1] * y + matrix[..., 2] * z
    return product


def multiply(a: Floats, b: Floats) -> Floats:
    """Multiply matrices (..., 3, 3), ``a @ b``, by `apply_matrix`: without BLAS.

    Parameters
    ----------
    a, b : (..., 3, 3) arrays
        Leading dimensions broadcast.

    Returns
    -------
    (..., 3, 3) array
        a @ b, of the broadcast shape.
    """
    columns = apply_matrix(a[..., None, :, :], np.swapaxes(b, -1, -2))
    return np.swapaxes(columns, -1, -2)


def transposed(matrices: Floats) -> Floats:
    """Transpose matrices, whatever their leading dimensions.

    Parameters
    ----------
    matrices : (..., 3, 3) array
        Not copied.

    Returns
    -------
    (..., 3, 3) array
        A view of them.
    """
    return np.swapaxes(matrices, -1, -2)


def refuse_cameras(
    bad: Bools | np.bool_,
    what: str,
    *,
    names: Sequence[object] | None = None,
    details: Sequence[str] | None = None,
    where: object = None,
    expected: str | None = None,
    fix: str | None = None,
) -> None:
    """Raise CameraError where any camera is bad: how many of how many, the first three by name.

    Parameters
    ----------
    bad : (N,) bool array
        Which cameras are bad; a scalar for one.
    what : str
        What is wrong, to be followed by the count.
    names : sequence of N, optional
        Names of the cameras; their indices where left out.
    details : sequence of N str, optional
        Put in brackets behind each name.
    where, expected, fix : optional
        See `UserError`.

    Raises
    ------
    CameraError
        When any of `bad` is true.
    """
    rows = np.flatnonzero(bad).tolist()
    if not rows:
        return
    labels = [f"camera {row}" if names is None else str(names[row]) for row in rows]
    if details is not None:
        labels = [f"{label} ({details[row]})" for label, row in zip(labels, rows, strict=True)]
    raise CameraError(
        f"{what} in {first_of(labels, total=bad.size)}", where=where, expected=expected, fix=fix
    )
