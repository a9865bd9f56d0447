"""Files of 4 x 4 numbers that take one frame to another."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.datasets.native_text import read_native_text
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.geometry.poses import check_rotations
from airzoo_bench.reconstruction.alignment.similarity import Similarity

__all__ = ["read_matrix", "similarity_of"]

_TOLERANCE = 1e-4
_LAST = (0.0, 0.0, 0.0, 1.0)


def read_matrix(path: Path) -> Floats | None:
    """Read four lines of four numbers, the last of them 0 0 0 1; None where a text holds others."""
    text = read_native_text(path)
    lines = [line.split("#")[0].replace(",", " ").split() for line in text.splitlines()]
    rows = [line for line in lines if line]
    if [len(row) for row in rows] != [4] * 4:
        return None
    try:
        matrix = np.array(rows, dtype=np.float64)
    except ValueError:
        return None
    return matrix if np.array_equal(matrix[3], _LAST) and np.isfinite(matrix).all() else None


def similarity_of(matrix: Floats, path: Path) -> Similarity:
    """Return a matrix (4, 4) as a turn, a scale and a shift."""
    linear = matrix[:3, :3]
    squared = np.trace(linear @ linear.T) / 3.0
    sheared = np.abs(linear @ linear.T - squared * np.eye(3)).max() > _TOLERANCE * squared
    scale = float(np.cbrt(np.linalg.det(linear)))
    if sheared or not scale > 0.0:
        raise BenchmarkError(
            "shears or mirrors" if sheared else "mirrors or flattens",
            where=path,
            expected="a similarity: a turn, one scale and a shift",
            fix="register with a similarity, without shear",
        )
    turn = check_rotations([linear / scale], ["the matrix"], where=path)[0]
    return Similarity(scale, turn, matrix[:3, 3])
