"""Paired tests of means under random signs: many pairs share their sums; see `pair_tests`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.statistics.pairs import Places, Wanted, rows_of
from airzoo_bench.statistics.samples import Sample
from airzoo_bench.statistics.unit_products import UnitProducts

__all__ = ["SignedSums", "Tested", "codes_of", "normal_tail"]

_RESOLVED = 25
_SURE = 6.0  # standard deviations; Hoeffding: less than one of 10**7 draws is as extreme
_SLACK = 1e-9
_CANCELLED = 1e-3  # of two squares: what is left of their difference has few digits
_CELLS = 1 << 22
_LARGEST = 1.5  # so that 30 binary digits of it fit into an integer of 32

Tested = Iterator[tuple[int, Places, Floats]]
"""A variable, those that it is paired with, and p of each."""


class Codes:
    """What is alike where two variables tie on a unit; made of those that are asked for.

    Parameters
    ----------
    parts : sequence of (V, N) arrays
        Values of the units of each group.
    """

    def __init__(self, parts: Sequence[Floats]) -> None:
        self._parts = parts
        self._small = all(map(_is_small, parts))
        count, units = len(parts[0]), sum(part.shape[1] for part in parts)
        self._codes = np.empty((count, units), np.int32 if self._small else np.float64)
        self._made = np.zeros(count, np.bool_)

    def unlike(self, one: int, others: Places) -> NDArray[np.bool_]:
        """Return on which units one variable and others do not tie, (C, N)."""
        asked = np.append(others, one)
        new = asked[~self._made[asked]]
        if len(new):
            values = np.concatenate([part[new] for part in self._parts], axis=1)
            self._codes[new] = _codes(values, small=self._small)
            self._made[new] = True
        return np.asarray(self._codes[others] != self._codes[one])


@dataclass(frozen=True)
class SignedSums:
    """What pairs of means share.

    Attributes
    ----------
    values : (V, N) array
        Each unit divided by the size of its group, so that sums are sums of the groups' means.
    codes : Codes
        Of the values as they are.
    sums : (V,) array
        Of the values as they are.
    products : UnitProducts
    draws : (V, B) array
        Sums under random signs.
    """

    values: Floats
    codes: Codes
    sums: Floats
    products: UnitProducts
    draws: Floats

    @classmethod
    def of(cls, sample: Sample, draws: Floats, wanted: Wanted) -> SignedSums:
        """Take what the tests of some pairs need.

        Parameters
        ----------
        sample : Sample
            V variables that are averaged by the mean.
        draws : (V, B) array
            From `pair_draws`.
        wanted : (V, V) bool
            True above the diagonal alone.

        Returns
        -------
        SignedSums
            Infinite values count as 0.
        """
        parts = [
            np.where(np.isinf(part), 0.0, part) if np.isinf(part.max(initial=0.0)) else part
            for part in sample.values
        ]
        ends = np.cumsum([part.shape[1] for part in parts])
        values = np.empty((len(parts[0]), ends[-1]))
        for part, end in zip(parts, ends.tolist(), strict=True):
            units = part.shape[1]
            np.divide(part, units, out=values[:, end - units : end])
        products = UnitProducts.of(values, np.flatnonzero(wanted.any(axis=1)))
        return cls(values, Codes(parts), values.sum(axis=1), products, draws)

    def tests(self, wanted: Wanted) -> Tested:
        """Test pairs; exactly where all patterns of signs are no more than the draws.

        Parameters
        ----------
        wanted : (V, V) bool
            No pair has an infinite value.

        Yields
        ------
        tuple of int, (C,) array of int and (C,) array
            A variable, those that it is paired with, and p of each. What comes later stands.
        """
        resamples = self.draws.shape[1]
        most = int(np.log2(resamples))
        few: list[tuple[int, Places, NDArray[np.int64]]] = []
        for one, others in rows_of(wanted):
            spread = self._spread(one, others)
            observed = np.abs(self.sums[others] - self.sums[one])
            scores = np.divide(observed, spread, out=np.zeros(len(others)), where=spread > 0)
            p_values = normal_tail(scores)
            near = scores < _SURE
            extreme = self._extreme(one, others[near], (observed - _SLACK * spread)[near])
            p_values[near] = _resolved(extreme, resamples, p_values[near])
            yield one, others, p_values
            # Of k differences the score is at most the root of k.
            close = others[scores**2 <= most + 1]
            unlike = self._unlike(one, close)
            few.append((one, close[unlike <= most], unlike[unlike <= most]))
        yield from self._exact(few)

    def _spread(self, one: int, others: Places) -> Floats:
        """Return the standard deviation of the signed sum of differences."""
        own, theirs = self.products.squares[one], self.products.squares[others]
        squares = own + theirs - 2 * self.products.at(one, others)
        for place in np.flatnonzero(squares < _CANCELLED * (own + theirs)):
            squares[place] = ((self.values[one] - self.values[others[place]]) ** 2).sum()
        rounding = squares <= _SLACK**2 * (own + theirs)
        return np.sqrt(np.where(rounding, 0.0, squares))

    def _extreme(self, one: int, others: Places, least: Floats) -> NDArray[np.int64]:
        counts = np.zeros(len(others), np.int64)
        step = max(1, (_CELLS >> 5) // self.draws.shape[1])
        for start in range(0, len(others), step):
            some = slice(start, start + step)
            sums = np.abs(self.draws[others[some]] - self.draws[one])
            counts[some] = np.count_nonzero(sums >= least[some, None], axis=1)
        return counts

    def _unlike(self, one: int, others: Places) -> NDArray[np.int64]:
        counts = np.zeros(len(others), np.int64)
        step = max(1, (_CELLS >> 3) // self.values.shape[1])
        for start in range(0, len(others), step):
            some = slice(start, start + step)
            counts[some] = np.count_nonzero(self.codes.unlike(one, others[some]), axis=1)
        return counts

    def _exact(self, few: list[tuple[int, Places, NDArray[np.int64]]]) -> Tested:
        signs = {0: np.ones((0, 1))}
        for one, others, unlike in few:
            for number in np.unique(unlike).tolist():
                if number not in signs:
                    signs[number] = _every_sign(number)
                part = others[unlike == number]
                yield one, part, self._every(one, part, number, signs[number])

    def _every(self, one: int, others: Places, number: int, signs: Floats) -> Floats:
        if number == 0:
            return np.ones(len(others))
        p_values = np.empty(len(others))
        step = max(1, _CELLS // max(self.values.shape[1], signs.shape[1]))
        for start in range(0, len(others), step):
            some = others[start : start + step]
            _, units = np.nonzero(self.codes.unlike(one, some))
            places = units.reshape(len(some), number)
            values = self.values[some[:, None], places] - self.values[one, places]
            sums = np.abs(values @ signs)
            least = np.abs(values.sum(axis=1)) - _SLACK * np.abs(values).max(axis=1)
            p_values[start : start + step] = (sums >= least[:, None]).mean(axis=1)
        return p_values


def _every_sign(number: int) -> Floats:
    """Return all patterns of signs up to a turn of all, (K, 2**(K - 1)): the first sign stays."""
    digits = (np.arange(2 ** (number - 1)) >> np.arange(number)[:, None]) & 1
    return np.asarray(1.0 - 2.0 * digits, np.float64)


def codes_of(values: Floats) -> NDArray[Any]:
    """Round values to 30 binary digits, those of 1 where they are smaller: what is alike, ties.

    Parameters
    ----------
    values : array
        May be infinite.

    Returns
    -------
    array
        Of the same shape.
    """
    return _codes(values, small=_is_small(values))


def _is_small(values: Floats) -> bool:
    return bool(values.max(initial=0.0) <= _LARGEST)


def _codes(values: Floats, *, small: bool) -> NDArray[Any]:
    if small:
        return np.asarray(np.rint(np.ldexp(values, 30)), np.int32)
    known = np.where(np.isinf(values), 0.0, np.abs(values))
    sizes = np.frexp(np.maximum(1.0, known))[1]
    return np.asarray(np.ldexp(np.rint(np.ldexp(values, 31 - sizes)), sizes - 31))


def normal_tail(scores: Floats) -> Floats:
    """Return two-sided p of normal scores, never 0.

    Parameters
    ----------
    scores : (C,) array
        In standard deviations, at least 0.

    Returns
    -------
    (C,) array
        From the smallest positive number to 1.
    """
    from scipy.special import ndtr

    return np.asarray(np.maximum(2 * ndtr(-scores), np.finfo(np.float64).tiny))


def _resolved(extreme: NDArray[np.int64], draws: int, tail: Floats) -> Floats:
    counted = (extreme + 1) / (draws + 1)
    bound = (_RESOLVED + 1) / (draws + 1)
    return np.asarray(np.where(extreme >= _RESOLVED, counted, np.minimum(tail, bound)))
