"""Products of variables, unit by unit, summed: the same bits whatever order they are added in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Floats

__all__ = ["UnitProducts"]

_EXACT_BITS = 52
_ROWS = 32


@dataclass(frozen=True, eq=False)
class UnitProducts:
    """Products of some variables with all V, unit by unit, summed.

    Attributes
    ----------
    rows : (R,) array of int
        These variables, ascending.
    products : (R, V) array
    squares : (V,) array
        Of each variable with itself.
    """

    rows: NDArray[np.intp]
    products: Floats
    squares: Floats

    @classmethod
    def of(cls, values: Floats, rows: NDArray[np.intp]) -> UnitProducts:
        """Multiply variables, with values rounded to some 20 binary digits.

        A product is the same to the last bit whatever the number of threads and the other
        variables.

        Parameters
        ----------
        values : (V, N) array
            Finite.
        rows : (R,) array of int
            Of which variables products are wanted, ascending.

        Returns
        -------
        UnitProducts
        """
        largest = np.maximum(values.max(axis=1, initial=0.0), -values.min(axis=1, initial=0.0))
        sizes = np.frexp(np.maximum(largest, np.finfo(np.float64).tiny))[1].astype(np.int64)
        digits = (_EXACT_BITS - int(values.shape[1]).bit_length()) // 2
        whole = np.empty_like(values)
        for first in range(0, len(values), _ROWS):
            some = slice(first, first + _ROWS)  # so few that they stay near the processor
            np.ldexp(values[some], (digits - sizes[some])[:, None], out=whole[some])
            np.rint(whole[some], out=whole[some])
        return cls(
            rows,
            np.ldexp(whole[rows] @ whole.T, sizes[rows, None] + sizes - 2 * digits),
            np.ldexp(np.einsum("vn,vn->v", whole, whole), 2 * (sizes - digits)),
        )

    def at(self, one: int, others: NDArray[np.intp]) -> Floats:
        """Return products of one variable with others.

        Parameters
        ----------
        one : int
            One of `rows`.
        others : (C,) array of int
            Any variables.

        Returns
        -------
        (C,) array
            Sums over units.
        """
        return np.asarray(self.products[np.searchsorted(self.rows, one), others])
