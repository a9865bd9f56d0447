"""Rank ranges of methods, which cannot be told from the best, and any two compared."""

from __future__ import annotations

import base64
import hashlib
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.files import atomic_write, write_npz
from airzoo_bench.core.version import __version__
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.leaderboard.measured import OVERALL, Measured, sample_of
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.statistics.pair_tests import (
    correct_pairs,
    pair_limits,
    pair_p_values,
    rank_ranges,
    resamples_for,
    told_apart,
    unpaired_p_values,
)
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.statistics.significance import LEVEL

__all__ = ["Ranked", "rank"]


@dataclass(frozen=True)
class Ranked:
    """One score of methods, in their order.

    `ranges` are rank ranges (V, 2), `apart` which two differ after the correction for all pairs
    (V, V), `near_best` which cannot be told from the best by a test of these two alone (V,).
    `pairs` is for the file of the board; a sealed table, and one method, have none.
    """

    ranges: NDArray[np.int64]
    apart: Bools
    near_best: Bools
    pairs: dict[str, Any] | None


def rank(methods: Sequence[Measured], column: ScoreColumn, cache: Path | None = None) -> Ranked:
    """Rank methods of one protocol and truth by a headline score.

    With a cache, pairs are made for the file of the board; those that the last build has compared
    are taken from there.
    """
    found = [one.scores[OVERALL].get(column.key, (np.inf, None, None, None)) for one in methods]
    values = np.array([number[0] for number in found])
    pairs = None
    if methods[0].sealed:
        errors = np.array([np.nan if number[3] is None else number[3] for number in found])
        p_values = unpaired_p_values(values, errors)
        corrected = correct_pairs(p_values)
    else:
        resampling = ResamplingConfig(resamples_for(len(found)))
        if cache is None:
            p_values = pair_p_values(sample_of(methods, column), resampling)
        else:
            low, high, p_values = _compared(methods, column, resampling, cache)
        corrected = correct_pairs(p_values)
        if cache is not None and len(methods) > 1:
            upper = np.triu_indices(len(methods), 1)
            named = {"low": low, "high": high, "p": p_values, "p_holm": corrected}
            pairs = {name: _packed(matrix[upper]) for name, matrix in named.items()}
            pairs["about"] = _about(methods[0], column, resampling)
    higher = column.higher_is_better
    best = int(np.argmax(values if higher else -values))
    near = (p_values[best] > LEVEL) | (values == values[best])
    return Ranked(
        rank_ranges(values, corrected, higher_is_better=higher),
        told_apart(values, corrected),
        near & np.isfinite(values),
        pairs,
    )


def _compared(
    methods: Sequence[Measured], column: ScoreColumn, resampling: ResamplingConfig, cache: Path
) -> Floats:
    """Return low, high and p of every two methods (3, V, V), and keep them for the next build."""
    measures = (*methods[0].measures, column.key, resampling.resamples, __version__)
    kept = cache / f"pairs-{hashlib.sha256(repr(measures).encode()).hexdigest()}.npz"
    names = [one.kept for one in methods]
    before, old = _load_pairs(kept)
    places = {name: place for place, name in enumerate(before)}
    known = np.array([n for n, name in enumerate(names) if name in places], np.intp)
    then = np.array([places[names[n]] for n in known], np.intp)
    wanted = np.ones((len(names),) * 2, np.bool_)
    # A pair that has changed places is compared anew: its interval would be turned around.
    wanted[np.ix_(known, known)] = then[:, None] >= then
    found, taken = np.ones((3, *wanted.shape)), np.triu(~wanted, 1)
    if np.triu(wanted, 1).any():
        sample = sample_of(methods, column)
        found[:2] = pair_limits(sample, resampling, wanted)
        found[2] = pair_p_values(sample, resampling, wanted)
    if len(known):
        spread = np.zeros_like(found)
        spread[:, known[:, None], known] = old[:, then[:, None], then]
        found[:, taken] = spread[:, taken]
        found[2] = np.where(taken.T, found[2].T, found[2])
    with atomic_write(kept) as stream:
        write_npz(stream, {"names": np.array(names), "pairs": found})
    return found


def _load_pairs(kept: Path) -> tuple[list[str], Floats]:
    try:
        with np.load(kept, allow_pickle=False) as arrays:
            return arrays["names"].tolist(), arrays["pairs"]
    except (OSError, EOFError, ValueError, KeyError, BadZipFile):  # missing or damaged
        return [], np.zeros((3, 0, 0))


def _packed(values: Floats) -> str:
    """Deflate numbers as float32, little endian, and write them in base64."""
    content = (values + 0.0).astype("<f4").tobytes()  # no -0.0
    return base64.b64encode(zlib.compress(content, 6)).decode()


def _about(method: Measured, column: ScoreColumn, resampling: ResamplingConfig) -> str:
    number = f"{resampling.resamples:,}"
    if method.unit == "query" and column.average == "median":
        test = f"bootstrap of the difference of medians, {number} resamples"
    elif method.unit == "scene":
        test = "Student's t of paired differences, by permutation where there is no t"
    else:
        test = f"paired permutation test, exact where {number} patterns are all there are"
    units = "scenes" if method.unit == "scene" else "queries within scenes"
    return f"{test}, over {units}; p for these two alone, and by Holm for all pairs of the column"
