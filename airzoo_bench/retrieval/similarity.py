"""Similarity of descriptors: in float64 to rank by, in float32 with a bound to search with.

Larger is more similar. The value is q.g for `inner_product`, the same of normalised vectors for
`cosine`, and -|q - g|^2 / 2 for `l2`; the search leaves out what is the same for all tiles, and
so takes q.g - |g|^2 / 2.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import PredictionError, first_of
from airzoo_bench.geometry.arrays import Bools, Floats, Ints
from airzoo_bench.retrieval.descriptor_rows import Rows, as_float32

__all__ = [
    "Metric",
    "Names",
    "Queries",
    "check_norms",
    "finite_rows",
    "normalised",
    "norms_of",
    "point_one_way",
    "refuse_unusable",
    "roundoff",
    "similarity",
    "unusable",
]

Metric = Literal["l2", "cosine", "inner_product"]
Names = Sequence[object] | NDArray[Any]

_UNIT = 2.0**-24  # roundoff of float32
_UNIT_64 = 2.0**-53
_TINY = 2.0**-126  # smallest normal float32
_LEAST = 1 / float(np.finfo(np.float32).max)  # norms whose reciprocal float32 still holds
_LAMBDA = 10.0
_PIECE = 4096  # BLAS splits a longer dot product over threads, which changes its last digits
_MIN_SQUARE = 1e-25  # below, squares summed in float32 have lost digits to underflow
_FEW = 256  # queries at a time in float64
_MAX_NORM = 1e18  # beyond, products overflow in float32


def similarity(queries: Floats, gallery: Floats, metric: Metric) -> Floats:
    """Similarity of pairs, (n, D) and (n, D), summed in an order that depends on D alone."""
    if metric == "l2":
        apart = queries - gallery
        return -_dot(apart, apart) / 2
    if metric == "cosine":
        queries, gallery = normalised(queries), normalised(gallery)
    return _dot(queries, gallery)


def roundoff(queries: Floats, gallery: Floats, similarities: Floats, metric: Metric) -> Floats:
    """Bound the error of `similarity`, by pair."""
    gamma = _gamma(queries.shape[1], _UNIT_64)
    if metric == "l2":
        return gamma * np.abs(similarities)
    if metric == "cosine":
        return np.full(len(similarities), 2 * gamma)
    return gamma * np.sqrt(_dot(queries, queries) * _dot(gallery, gallery))


def _gamma(n: int, unit: float) -> float:
    """Relative error of a sum of n products, and of a few roundings before and after."""
    grown = _LAMBDA * np.sqrt(n) * unit + n * unit**2 / (1 - unit)
    return float(np.expm1(grown)) + 8 * unit


def _dot(a: Floats, b: Floats) -> Floats:
    total = np.zeros(len(a))
    for start in range(0, a.shape[1], _PIECE):
        total += np.vecdot(a[:, start : start + _PIECE], b[:, start : start + _PIECE])
    return total


def _scaled(rows: NDArray[Any]) -> tuple[Floats, Ints]:
    """Divide rows by powers of two, which is exact, so that their squares do not underflow."""
    with np.errstate(invalid="ignore", over="ignore"):  # what is not finite is refused elsewhere
        double = rows.astype(np.float64)
        _, exponents = np.frexp(np.abs(double).max(axis=1, initial=0.0))
        return np.ldexp(double, -exponents[:, None]), exponents


def _euclidean(rows: NDArray[Any]) -> Floats:
    scaled, exponents = _scaled(rows)
    with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is refused elsewhere
        return np.asarray(np.ldexp(np.sqrt(_dot(scaled, scaled)), exponents))


def normalised(rows: NDArray[Any]) -> Floats:
    """Divide rows by their norms."""
    scaled, _ = _scaled(rows)
    return np.asarray(scaled / np.sqrt(_dot(scaled, scaled))[:, None])


@dataclass(frozen=True)
class Queries:
    """Query descriptors, ready for the search in float32.

    Parameters
    ----------
    rows : (Q, D) array
        As given, to be compared by `metric`.
    single : (Q, D) float32 array
        What the gallery is multiplied with; normalised for `cosine`.
    norms : (Q,) array
        Euclidean norms, 1 for `cosine`.
    """

    rows: NDArray[Any]
    metric: Metric
    single: NDArray[np.float32]
    norms: Floats

    @classmethod
    def of(cls, rows: NDArray[Any], metric: Metric, names: Names | None = None) -> Queries:
        """Check and prepare query descriptors."""
        norms = np.empty(len(rows))
        for start in range(0, len(rows), _FEW):
            norms[start : start + _FEW] = _euclidean(rows[start : start + _FEW])
        check_norms(
            norms,
            partial(finite_rows, rows),
            "query_descriptors",
            metric,
            names,
        )
        if metric != "cosine":
            return cls(rows, metric, as_float32(rows), norms)
        single = np.empty(rows.shape, np.float32)
        for start in range(0, len(rows), _FEW):
            part = slice(start, start + _FEW)
            single[part] = normalised(rows[part])
        return cls(rows, metric, single, np.ones(len(rows)))

    def __len__(self) -> int:
        return len(self.norms)

    def part(self, some: slice | Ints) -> Queries:
        """Return some of them."""
        rows, norms = self.rows[some], self.norms[some]
        single = rows if self.rows is self.single else self.single[some]
        return Queries(rows, self.metric, single, norms)

    def similarities(
        self, part: slice | Ints, gallery: NDArray[np.float32], norms: Floats
    ) -> NDArray[np.float32]:
        """Search values (rows of the gallery, queries of the part), in float32."""
        values: NDArray[np.float32] = gallery @ self.single[part].T
        if self.metric == "l2":
            values -= (norms**2 / 2).astype(np.float32)[:, None]
        if self.metric == "cosine":
            # Where float32 cannot hold the reciprocal, the bound excludes nothing anyway.
            values *= (1 / np.maximum(norms, _LEAST)).astype(np.float32)[:, None]
        return values

    def searched(self, query: Ints, exact: Floats) -> Floats:
        """Search value that corresponds to a similarity."""
        return exact + self.norms[query] ** 2 / 2 if self.metric == "l2" else exact

    def bounds(self, least: float, most: float) -> Floats:
        """Bound the error of every query's search values."""
        n = self.single.shape[1]
        gamma = _gamma(n, _UNIT)
        if self.metric == "cosine":
            # Twice: once for q.g, and at most once for the norm of g.
            return np.full(len(self.norms), 2 * gamma + n * _TINY * (1 + 1 / max(least, _LEAST)))
        bound: Floats = gamma * self.norms * most + n * _TINY * (1 + self.norms + most)
        return bound + gamma * most**2 / 2 if self.metric == "l2" else bound


def norms_of(rows: NDArray[Any], single: NDArray[np.float32]) -> Floats:
    """Norms of descriptors; infinite or NaN where an element is, or where float32 overflows."""
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        squares = np.vecdot(single, single).astype(np.float64)
    norms: Floats = np.sqrt(squares)
    small = np.flatnonzero(squares < _MIN_SQUARE)
    norms[small] = _euclidean(rows[small])
    return norms


def unusable(norms: Floats, finite: Callable[[Ints], Bools], metric: Metric) -> dict[str, Ints]:
    """Find the rows that cannot be ranked; parameters as of :func:`check_norms`."""
    wild = np.flatnonzero(~(norms <= _MAX_NORM))
    zero = np.flatnonzero(norms == 0) if metric == "cosine" else wild[:0]
    broken = wild[~finite(wild)] if len(wild) else wild
    return {"wild": wild, "broken": broken, "zero": zero}


def finite_rows(rows: NDArray[Any], some: Ints) -> Bools:
    """Tell whether all numbers of each of some rows are finite."""
    finite: Bools = np.isfinite(rows[some]).all(axis=1)
    return finite


def refuse_unusable(
    found: Mapping[str, Ints], total: int, which: str, names: Names | None = None
) -> None:
    """Refuse rows that :func:`unusable` found, of `total`; see :func:`check_norms`."""
    for fault, what, expected in (
        ("broken", "NaN or infinite descriptors", "finite numbers"),
        ("wild", "descriptors too large to rank", "norms up to 1e18"),
        ("zero", "descriptors of zero", "a direction, to take its cosine"),
    ):
        if len(found[fault]):
            named = [f"row {row}" if names is None else names[row] for row in found[fault]]
            raise PredictionError(
                f"{what}: {first_of(named, total)}",
                where=f"field '{which}'",
                expected=expected,
                fix="export these descriptors again, and look for a division by zero or half "
                "precision",
            )


def check_norms(
    norms: Floats,
    finite: Callable[[Ints], Bools],
    which: str,
    metric: Metric,
    names: Names | None = None,
) -> None:
    """Refuse descriptors that cannot be ranked."""
    refuse_unusable(unusable(norms, finite, metric), len(norms), which, names)


def point_one_way(rows: Rows, metric: Metric, step: int) -> bool:
    """Tell whether all rows are one, or under cosine multiples of one as far as stored.

    No ranking of such a gallery means anything.
    """
    if len(rows) < 2 or not rows.shape[1]:
        return False
    first = _deciding(rows.read(0, 1), metric)
    for _, some in rows.blocks(step):
        found = unusable(norms_of(some, as_float32(some)), np.isfinite, metric)
        if len(found["wild"]) or len(found["zero"]):
            return False
        near = _storage_error(some, first) if metric == "cosine" else 0.0
        if not (np.abs(_deciding(some, metric) - first) <= near).all():
            return False
    return True


def _deciding(rows: NDArray[Any], metric: Metric) -> Floats:
    """Return what of rows decides their order: their direction under cosine, else the rows."""
    if metric != "cosine":
        return rows.astype(np.float64)
    with np.errstate(all="ignore"):  # what is not finite is near nothing, and refused elsewhere
        return normalised(rows)


def _storage_error(rows: NDArray[Any], direction: Floats) -> Floats:
    """Bound how far storage may have turned rows (n, D) away from a direction (1, D)."""
    stored = np.finfo(rows.dtype)
    lost = float(stored.smallest_subnormal) / np.abs(rows).max(axis=1, keepdims=True)
    return np.asarray(4 * float(stored.eps) * np.abs(direction) + 2 * lost.astype(np.float64))
