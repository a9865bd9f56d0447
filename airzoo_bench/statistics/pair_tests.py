"""Paired tests of every two of many variables, from one set of draws that all pairs share.

They are the tests of `significance.paired_tests`. Of means: a change of places turns the sign of a
unit's difference, and the sum of differences under given signs is the difference of two sums, one
of each variable; so the sums of N variables hold the draws of all N (N - 1) / 2 pairs. Of medians:
the resamples of a difference are the differences of two medians' resamples.

Corrected for many pairs, p must be resolved far below one draw. Where fewer than `_RESOLVED` draws
are as extreme as what was observed, p of a mean is the normal tail with the exact variance of the
signed sum, which sums of random signs hardly exceed (Pinelis 1994); that of a median, where no
resample lies beyond 0, is the normal tail with the resamples' spread.

References
----------
I. Pinelis, Extremal probabilistic problems and Hotelling's T2 test under a symmetry condition,
Annals of Statistics 22 (1994).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.statistics.bootstrap_limits import percentile_p_values
from airzoo_bench.statistics.intervals import FEWEST
from airzoo_bench.statistics.resampling import (
    blocks,
    exact_products,
    resample_counts,
    sign_flips,
    stream_key,
    unit_products,
    weighted_averages,
)
from airzoo_bench.statistics.samples import ResamplingConfig, Sample, difference, paired_difference
from airzoo_bench.statistics.significance import mcnemar, p_floor, paired_permutation

__all__ = [
    "Places",
    "hubs",
    "mean_draws",
    "pair_draws",
    "pair_p_values",
    "resamples_for",
    "wanted_pairs",
]

_RESOLVED = 25
_SURE = 6.0  # standard deviations; Hoeffding: less than one of 10**7 draws is as extreme
_SLACK = 1e-9
_CANCELLED = 1e-3  # of two squares: what is left of their difference has few digits
_WORK = 2.5e8
_FEW, _MANY = 2_000, 10_000
_CELLS = 1 << 22
_TIE = 1e-9

Places = NDArray[np.intp]


def resamples_for(count: int) -> int:
    """Return how many draws all pairs of so many variables can share in seconds.

    Parameters
    ----------
    count : int
        Of variables.

    Returns
    -------
    int
        10,000, as everywhere else, up to 224 variables; 2,000 of more.
    """
    return _MANY if count * (count - 1) // 2 * _MANY <= _WORK else _FEW


def pair_draws(sample: Sample, resampling: ResamplingConfig) -> Floats:
    """Draw what the tests of all pairs share.

    Parameters
    ----------
    sample : Sample
        V variables of one kind: all averaged by the median, or none. Values are finite or +inf.
    resampling : ResamplingConfig
        Number of draws, seed.

    Returns
    -------
    (V, B) array
        Of means, sums under random signs; of medians, their resamples. A variable's row is the
        same to the last bit whatever the others are.
    """
    if sample.medians.any():
        return mean_draws(sample, resampling)
    draws = np.zeros((len(sample.medians), resampling.resamples))
    for group, part in zip(sample.groups, sample.values, strict=True):
        units, key = part.shape[1], stream_key(resampling.seed, "permutation", group)
        values = np.where(np.isinf(part), 0.0, part)
        whole = exact_products(values, np.ones((units, 1)), units)
        for first, size in blocks(units, resampling.resamples):
            kept = sign_flips(units, first, size, key).astype(np.float64)
            sums = 2 * exact_products(values, kept, units) - whole
            draws[:, first : first + size] += sums / units
    return draws


def pair_p_values(
    sample: Sample,
    resampling: ResamplingConfig,
    draws: Floats | None = None,
    chosen: Places | None = None,
) -> Floats:
    """Test every two variables of a sample.

    Parameters
    ----------
    sample : Sample
        V variables of one kind: all averaged by the median, or none. Values are finite or +inf.
    resampling : ResamplingConfig
        Number of draws, seed.
    draws : (V, B) array, optional
        From `pair_draws` of the same sample, where they were made before.
    chosen : (C,) array of int, optional
        Test the pairs that have one of these variables; all where left out.

    Returns
    -------
    (V, V) array
        Two-sided p, symmetric; 1 on the diagonal, NaN for pairs that were not tested. That of a
        pair is the same to the last bit whatever the other variables are.
    """
    count = len(sample.medians)
    found = np.where(np.eye(count, dtype=bool), 1.0, np.nan)
    wanted = wanted_pairs(count, chosen)
    if wanted.any():
        draws = pair_draws(sample, resampling) if draws is None else draws
        tests = _of_medians if sample.medians.any() else _of_means
        for one, others, p_values in tests(sample, resampling, draws, wanted):
            found[one, others] = found[others, one] = p_values
    return found


def wanted_pairs(count: int, chosen: Places | None) -> NDArray[np.bool_]:
    """Return which pairs have a chosen variable.

    Parameters
    ----------
    count : int
        Of variables.
    chosen : (C,) array of int or None
        None: all.

    Returns
    -------
    (V, V) bool
        True above the diagonal alone.
    """
    wanted = np.ones((count, count), np.bool_)
    if chosen is not None:
        wanted[:] = False
        wanted[chosen], wanted[:, chosen] = True, True
    return np.triu(wanted, 1)


_Tested = Iterator[tuple[int, Places, Floats]]
_Wanted = NDArray[np.bool_]


def _rows(wanted: _Wanted) -> Iterator[tuple[int, Places]]:
    for one in np.flatnonzero(wanted.any(axis=1)).tolist():
        yield one, np.flatnonzero(wanted[one])


def _of_means(
    sample: Sample, resampling: ResamplingConfig, draws: Floats, wanted: _Wanted
) -> _Tested:
    failing = np.any([np.isinf(part).any(axis=1) for part in sample.values], axis=0)
    either = failing | failing[:, None]
    for one, others in _rows(wanted & either):
        for first, size in blocks(2 * resampling.resamples, len(others)):
            part = others[first : first + size]
            tests = paired_permutation(sample, resampling, [(one, int(other)) for other in part])
            yield one, part, np.array([test.p_value for test in tests])
    finite = wanted & ~either
    if finite.any():
        yield from _SignedSums.of(sample, draws, finite).tests(finite)


@dataclass(frozen=True)
class _SignedSums:
    """What pairs of means share.

    Attributes
    ----------
    values : (V, N) array
        Each unit divided by the size of its group, so that sums are sums of the groups' means.
    codes : (V, N) array
        Equal where two variables tie on a unit.
    sums : (V,) array
        Of the values as they are.
    squares : (V, V) array
        Products of the variables, unit by unit, summed.
    draws : (V, B) array
        Sums under random signs.
    """

    values: Floats
    codes: NDArray[Any]
    sums: Floats
    squares: Floats
    draws: Floats

    @classmethod
    def of(cls, sample: Sample, draws: Floats, wanted: _Wanted) -> _SignedSums:
        parts = [np.where(np.isinf(part), 0.0, part) for part in sample.values]
        values = np.concatenate([part / part.shape[1] for part in parts], axis=1)
        squares = unit_products(values, hubs(wanted))
        return cls(
            values, _codes(np.concatenate(parts, axis=1)), values.sum(axis=1), squares, draws
        )

    def tests(self, wanted: _Wanted) -> _Tested:
        """Test pairs; exactly where all patterns of signs are no more than the draws."""
        resamples = self.draws.shape[1]
        most = int(np.log2(resamples))
        few: list[tuple[int, Places, NDArray[np.int64]]] = []
        for one, others in _rows(wanted):
            spread = self._spread(one, others)
            observed = np.abs(self.sums[others] - self.sums[one])
            scores = np.divide(observed, spread, out=np.zeros(len(others)), where=spread > 0)
            p_values = _normal_tail(scores)
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
        own, theirs = self.squares[one, one], self.squares[others, others]
        squares = own + theirs - 2 * self.squares[one, others]
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
        step = max(1, (_CELLS >> 3) // self.codes.shape[1])
        for start in range(0, len(others), step):
            some = slice(start, start + step)
            counts[some] = np.count_nonzero(self.codes[others[some]] != self.codes[one], axis=1)
        return counts

    def _exact(self, few: list[tuple[int, Places, NDArray[np.int64]]]) -> _Tested:
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
        step = max(1, _CELLS // max(self.codes.shape[1], signs.shape[1]))
        for start in range(0, len(others), step):
            some = others[start : start + step]
            _, units = np.nonzero(self.codes[some] != self.codes[one])
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


def hubs(wanted: NDArray[np.bool_]) -> Places:
    """Return variables of which every wanted pair has one: few where few were chosen.

    Parameters
    ----------
    wanted : (V, V) bool
        From `wanted_pairs`.

    Returns
    -------
    (C,) array of int
        Ascending.
    """
    both = wanted | wanted.T
    count = both.sum(axis=1)
    most = np.flatnonzero(count == count.max())
    rest = both.copy()
    rest[most], rest[:, most] = False, False
    return np.flatnonzero(both.any(axis=1)) if rest.any() else most


def _codes(values: Floats) -> NDArray[Any]:
    """Round values to 30 binary digits, those of 1 where they are smaller: what is alike, ties."""
    if values.max(initial=0.0) <= 1.5:
        return np.asarray(np.rint(np.ldexp(values, 30)), np.int32)
    known = np.where(np.isinf(values), 0.0, np.abs(values))
    sizes = np.frexp(np.maximum(1.0, known))[1]
    return np.asarray(np.ldexp(np.rint(np.ldexp(values, 31 - sizes)), sizes - 31))


def _normal_tail(scores: Floats) -> Floats:
    from scipy.special import ndtr

    return np.asarray(np.maximum(2 * ndtr(-scores), np.finfo(np.float64).tiny))


def _resolved(extreme: NDArray[np.int64], draws: int, tail: Floats) -> Floats:
    counted = (extreme + 1) / (draws + 1)
    bound = (_RESOLVED + 1) / (draws + 1)
    return np.asarray(np.where(extreme >= _RESOLVED, counted, np.minimum(tail, bound)))


def _of_medians(
    sample: Sample, resampling: ResamplingConfig, draws: Floats, wanted: _Wanted
) -> _Tested:
    if not draws.shape[1]:  # too few units: no interval, and so no finding
        yield from ((one, others, np.ones(len(others))) for one, others in _rows(wanted))
        return
    codes = [_codes(part) for part in sample.values]
    floors = np.array([p_floor(k) for k in range(sum(part.shape[1] for part in codes) + 1)])
    step = max(1, (_CELLS >> 2) // resampling.resamples)
    for one, others in _rows(wanted):
        for start in range(0, len(others), step):
            some = others[start : start + step]
            unlike = np.zeros(len(some), np.int64)
            for part in codes:
                unlike += np.count_nonzero(part[some] != part[one], axis=1)
            p_values = _median_p_values(sample, draws, one, some)
            yield one, some, np.maximum(p_values, floors[unlike])


def mean_draws(sample: Sample, resampling: ResamplingConfig) -> Floats:
    """Average resamples of all variables, those of `intervals.bootstrap`.

    Parameters
    ----------
    sample : Sample
        Values are finite or +inf.
    resampling : ResamplingConfig
        Number of resamples, seed.

    Returns
    -------
    (V, B) array
        The mean over groups in each resample; no resamples where a group has fewer units than
        `FEWEST`.
    """
    if min(part.shape[1] for part in sample.values) < FEWEST:
        return np.empty((len(sample.medians), 0))
    total = np.zeros((len(sample.medians), resampling.resamples))
    for group, values in zip(sample.groups, sample.values, strict=True):
        units = values.shape[1]
        key = stream_key(resampling.seed, "bootstrap", group)
        for first, size in blocks(units, resampling.resamples):
            counts = resample_counts(units, first, size, key)
            total[:, first : first + size] += weighted_averages(values, sample.medians, counts)
    return total / len(sample.groups)


def _median_p_values(sample: Sample, draws: Floats, one: int, others: Places) -> Floats:
    found = difference(draws[others], draws[one])
    least = 2 / (found.shape[1] + 1)
    p_values = np.full(len(others), least)
    low, high = found.min(axis=1), found.max(axis=1)
    least_size = np.minimum(np.abs(low), np.abs(high))
    near = _TIE * np.maximum(1.0, np.where(np.isinf(least_size), 0.0, least_size))
    mixed = (low <= near) & (high >= -near)
    p_values[mixed] = percentile_p_values(paired_difference(draws[others[mixed]], draws[one]))
    p_values[~mixed] = np.minimum(least, _beyond(sample, found[~mixed], one, others[~mixed]))
    return p_values


def _beyond(sample: Sample, draws: Floats, one: int, others: Places) -> Floats:
    """Return p where all resamples lie on one side of 0.

    By wins and losses where resamples are infinite, which have no spread.
    """
    usual = np.asarray(np.isfinite(draws).all(axis=1))
    known = draws[usual]
    spread = known.std(axis=1)
    varied = spread > 0
    p_values = np.empty(len(draws))
    usual[usual] = varied
    p_values[usual] = _normal_tail(np.abs(known[varied].mean(axis=1)) / spread[varied])
    p_values[~usual] = _by_wins(sample, one, others[~usual])
    return p_values


def _by_wins(sample: Sample, one: int, others: Places) -> Floats:
    wins, losses = np.zeros((2, len(others)), np.int64)
    for part in sample.values:
        wins += np.count_nonzero(part[others] < part[one], axis=1)
        losses += np.count_nonzero(part[others] > part[one], axis=1)
    return mcnemar(wins, losses)
