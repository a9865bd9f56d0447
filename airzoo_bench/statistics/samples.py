"""Samples: values of units within groups, and averages of many random draws of them.

Draw b is the same whatever was drawn before it: only raw bits of Philox are used, a stream that
NumPy never changes. Sums must not depend on the order in which a matrix product adds, so values are
put on a grid of binary fractions that is coarse enough for every sum to be exact in float64.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.geometry.arrays import Bools, Floats

TIE = 1e-9
"""Closer values of a unit, as a share of their size above 1, may differ by the processor alone."""

_EXACT_BITS = 52
_CELLS = 1 << 22
_WORDS_A_STEP = 4  # Philox-4x64 makes four words of 64 bits a step of its counter
_LOW_BITS, _HALF_WORD = np.uint64(0xFFFFFFFF), np.uint64(32)


@dataclass(frozen=True)
class ResamplingConfig:
    """How intervals and tests are made: number and seed of draws, confidence of intervals.

    `resamples` is also the number of patterns of a permutation test that cannot try all of them.
    """

    resamples: int = 10_000
    seed: int = 0
    confidence: float = 0.95

    @property
    def tails(self) -> Floats:
        """Levels of the two limits (2,)."""
        return np.array([(1 - self.confidence) / 2, (1 + self.confidence) / 2])


@dataclass(frozen=True)
class Sample:
    """Variables measured on the same independent units, which are queries or scenes.

    Each group, such as a scene, has values (V, N) of V variables and its N units; its draws depend
    on its name. Variables are averaged by the median within a group where `medians` (V,) says so,
    else by the mean, and over groups without weights; `shares` (V,) are means of shares.
    """

    unit: str
    groups: tuple[str, ...]
    values: tuple[Floats, ...]
    medians: Bools
    shares: Bools | None = None

    @property
    def are_shares(self) -> Bools:
        """Which variables are shares (V,)."""
        return np.zeros(len(self.medians), np.bool_) if self.shares is None else self.shares

    def take(self, variables: Bools) -> Sample:
        """Return the sample of some of the variables."""
        values, shares = tuple(part[variables] for part in self.values), self.are_shares[variables]
        return replace(self, values=values, medians=self.medians[variables], shares=shares)

    def differences(self, first: Any, second: Any) -> list[Floats]:
        """Subtract variables unit by unit, as `paired_difference` does: for each group (C, N)."""
        return [paired_difference(part[first], part[second]) for part in self.values]


def difference(first: Floats, second: Floats) -> Floats:
    """Subtract arrays that broadcast; two infinite values, which are failures both, differ by 0."""
    both = np.isinf(first) & (first == second)
    return np.subtract(first, second, out=np.zeros(np.broadcast(first, second).shape), where=~both)


def paired_difference(first: Floats, second: Floats) -> Floats:
    """Subtract what two methods have on the same units; 0 where it is at most 1e-9 of their size.

    Sizes count as at least 1. Scores agree between processors to some 12 digits, and what is a tie
    on one of them must be a tie on the other, since wins, signs and patterns are counted.
    """
    with np.errstate(invalid="ignore"):
        found = first - second
    apart = np.abs(found)
    if apart.size and apart.min() > TIE * (max(1.0, np.abs(first).max()) + apart.max()):
        return found  # the most common: no two are near each other, nor infinite
    sizes = np.maximum(1.0, np.maximum(np.abs(first), np.abs(second)))
    return np.where(apart > TIE * np.where(np.isinf(sizes), 1.0, sizes), found, 0.0)


def stream_key(seed: int, purpose: str, group: str) -> int:
    """Return the 128-bit key of a random stream, the same for a group whatever others there are."""
    text = f"{seed}\n{purpose}\n{group}"
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:16], "big")


def _blocks(units: int, draws: int) -> Iterator[tuple[int, int]]:
    """Cut draws into blocks of bounded memory: yield the first of each, and how many."""
    size = max(1, _CELLS // max(units, 1))
    yield from ((first, min(size, draws - first)) for first in range(0, draws, size))


def resample_counts(units: int, first: int, count: int, key: int) -> NDArray[np.int64]:
    """Count how often each unit is drawn, with replacement, in `count` resamples from `first` on.

    The chance of a unit is 1 / units to within 2**-32.
    """
    words = _random_words(-(-units // 2), first, count, key)
    draws = np.concatenate((words & _LOW_BITS, words >> _HALF_WORD), axis=1)[:, :units]
    picked = ((draws * np.uint64(units)) >> _HALF_WORD).astype(np.int64)
    cells = picked * count + np.arange(count)[:, None]
    return np.bincount(cells.ravel(), minlength=units * count).reshape(units, count)


def sign_flips(units: int, first: int, count: int, key: int) -> NDArray[np.uint8]:
    """Toss a fair coin for each unit, (units, count): 1 keeps its sign, 0 turns it."""
    words = _random_words(-(-units // 64), first, count, key).astype("<u8")
    bits = np.unpackbits(words.view(np.uint8), axis=1, count=units, bitorder="little")
    return np.ascontiguousarray(bits.T)


def _random_words(needed: int, first: int, count: int, key: int) -> NDArray[np.uint64]:
    """Return raw bits, (count, at least `needed`); every draw begins on its own step."""
    steps = -(-needed // _WORDS_A_STEP)
    source = np.random.Philox(key=key, counter=first * steps)
    return source.random_raw(count * steps * _WORDS_A_STEP).reshape(count, -1)


def resampled_averages(
    values: Floats, medians: Bools, group: str, resampling: ResamplingConfig
) -> Floats:
    """Average resamples of a group's units, (V, B), all variables by the same draws."""
    units, key = values.shape[1], stream_key(resampling.seed, "bootstrap", group)
    found = np.empty((len(values), resampling.resamples))
    for first, count in _blocks(units, resampling.resamples):
        counts = resample_counts(units, first, count, key)
        found[:, first : first + count] = weighted_averages(values, medians, counts)
    return found


def signed_sums(
    groups: Sequence[str], parts: Sequence[Floats], resampling: ResamplingConfig
) -> Floats:
    """Sum the groups' means of finite values (V, N) under random signs of the units, (V, B)."""
    sums = np.zeros((len(parts[0]), resampling.resamples))
    for group, part in zip(groups, parts, strict=True):
        units, key = part.shape[1], stream_key(resampling.seed, "permutation", group)
        whole, exponents = _on_grid(part, units)
        for first, count in _blocks(max(units, 4 * len(part)), resampling.resamples):
            signs = 2.0 * sign_flips(units, first, count, key) - 1.0
            sums[:, first : first + count] += whole @ signs * np.ldexp(1.0, -exponents) / units
    return sums


def weighted_averages(values: Floats, medians: Bools, counts: NDArray[np.integer]) -> Floats:
    """Average values (V, N) by how often resamples hold each (N, B), to the last bit: (V, B)."""
    units, factors = int(counts[:, 0].sum()), counts.astype(np.float64)
    averages = np.empty((len(values), counts.shape[1]))
    infinite = np.isinf(values[~medians])
    whole, exponents = _on_grid(np.where(infinite, 0.0, values[~medians]), units)
    means, failing = np.ldexp(whole @ factors, -exponents) / units, infinite.any(axis=1)
    drawn = infinite[failing].astype(np.float64) @ factors
    means[failing] = np.where(drawn > 0, np.inf, means[failing])
    averages[~medians] = means
    averages[medians] = _weighted_medians(values[medians], factors, units)
    return averages


def _on_grid(values: Floats, units: int) -> tuple[Floats, NDArray[np.intp]]:
    """Return whole numbers with exact sums, and the exponents (V, 1) of 2 that they bear."""
    largest = np.maximum(np.abs(values).max(axis=1, initial=0.0), np.finfo(np.float64).tiny)
    bits = _EXACT_BITS - np.ceil(np.log2(largest)) - np.ceil(np.log2(units))
    exponents = bits.astype(np.intp)[:, None]
    return np.rint(np.ldexp(values, exponents)), exponents


def _weighted_medians(values: Floats, factors: Floats, units: int) -> Floats:
    """Return the median of each resample; only units near the middle are looked at one by one."""
    order, small = np.argsort(values, axis=1, kind="stable"), np.min_scalar_type(-units - 1)
    low, high, reach = (units - 1) // 2, units // 2, int(2.5 * units**0.5) + 2
    first = max(0, high - reach)  # 5 standard deviations of the draws of a half
    below = (np.argsort(order, axis=1) < first).astype(np.float64)
    counts, bases = factors.astype(small), (below @ factors).astype(small)
    found = np.empty((len(values), factors.shape[1]))
    for row, (places, base) in enumerate(zip(order, bases, strict=True)):
        for near, passed in ((places[first : high + reach], base), (places, 0 * base)):
            (sums := counts[near])[0] += passed
            for before, after in pairwise(sums):  # several times faster than `cumsum`
                np.add(before, after, out=after)
            if (passed <= low).all() and (sums[-1] > high).all():
                break
        one, other = (near[(sums <= n).view(np.int8).sum(axis=0, dtype=small)] for n in (low, high))
        found[row] = (values[row, one] + values[row, other]) / 2.0
    return found


def leave_one_out(values: Floats, medians: Bools) -> Floats:
    """Average all units but one, for each one of at least 2: the jackknife, (V, N)."""
    units, averages, failing = values.shape[1], np.empty_like(values), np.isinf(values[~medians])
    finite = np.where(failing, 0.0, values[~medians])
    rest = (finite.sum(axis=1, keepdims=True) - finite) / (units - 1)
    others_fail = failing.sum(axis=1, keepdims=True) - failing > 0
    averages[~medians] = np.where(others_fail, np.inf, rest)
    order = np.argsort(values[medians], axis=1, kind="stable")
    ranked = np.take_along_axis(values[medians], order, axis=1)
    middle = [(units - 2) // 2, (units - 1) // 2]
    low, high = (rank + (rank >= np.arange(units)) for rank in middle)
    without = np.empty_like(ranked)
    np.put_along_axis(without, order, (ranked[:, low] + ranked[:, high]) / 2.0, axis=1)
    averages[medians] = without
    return averages
