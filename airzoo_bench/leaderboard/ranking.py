"""Rank ranges of methods, which cannot be told from the best, and any two compared."""

from __future__ import annotations

import base64
import hashlib
import zlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.version import __version__
from airzoo_bench.geometry.arrays import Bools, Floats
from airzoo_bench.leaderboard.measured import Entry, Measured, load_arrays, store_arrays
from airzoo_bench.results.comparison import is_share
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
from airzoo_bench.statistics.samples import ResamplingConfig, Sample
from airzoo_bench.statistics.significance import LEVEL

__all__ = ["Ranked", "alike", "headline_first", "rank"]


def alike(entries: Sequence[Entry]) -> tuple[list[Entry], list[tuple[Entry, str]]]:
    """Return the entries that measure the same as most, and the others with the reason."""
    times = Counter(one.measured.queries for one in entries if one.measured)
    known: dict[str, Any] = {}
    found, odd = [], []
    for entry in entries:
        assert entry.measured is not None
        given = {
            c["key"]: {k: v for k, v in c.items() if k != "headline"}
            for c in entry.measured.columns
        }
        other = [key for key, column in given.items() if known.get(key, column) != column]
        if entry.measured.queries != times.most_common(1)[0][0]:
            odd.append((entry, "scored on other queries than most methods of this table"))
        elif other:
            odd.append((entry, f"means another thing by the score {other[0]}"))
        else:
            known |= given
            found.append(entry)
    return found, odd


def headline_first(measured: Sequence[Measured]) -> list[ScoreColumn]:
    """Return the scores that any result has, the headline ones that all have first."""
    columns = {column.key: column for one in measured for column in one.score_columns}
    of_all = [{c.key for c in one.score_columns if c.headline} for one in measured]
    headline = set.intersection(*of_all) if of_all else set()
    marked = [c.model_copy(update={"headline": c.key in headline}) for c in columns.values()]
    return sorted(marked, key=lambda column: not column.headline)


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
    found = [one.overall(column.key) for one in methods]
    values, pairs = np.array([number[0] for number in found], np.float64), None
    if methods[0].sealed:
        errors = np.array([np.nan if number[3] is None else number[3] for number in found])
        p_values = unpaired_p_values(values, errors)
        corrected = correct_pairs(p_values)
    elif cache is None:
        resampling = ResamplingConfig(resamples_for(len(methods)))
        p_values = pair_p_values(_sample_of(methods, column), resampling)
        corrected = correct_pairs(p_values)
    else:
        resampling = ResamplingConfig(resamples_for(len(methods)))
        low, high, p_values = _compare_pairs(methods, column, resampling, cache)
        corrected = correct_pairs(p_values)
        if len(methods) > 1:
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


def _sample_of(methods: Sequence[Measured], column: ScoreColumn) -> Sample:
    """Put one headline score of many methods into a sample, as `make_sample` would."""
    first, rows = methods[0], [one.values_of(column.key) for one in methods]
    ends = np.cumsum([0, *(units for _, units in first.groups)]).tolist()
    by_median = first.unit == "query" and column.average == "median"
    return Sample(
        first.unit,
        tuple(name for name, _ in first.groups),
        tuple(np.stack([row[start:end] for row in rows]) for start, end in pairwise(ends)),
        np.full(len(rows), by_median),
        np.full(len(rows), is_share(column)),
    )


def _compare_pairs(
    methods: Sequence[Measured], column: ScoreColumn, resampling: ResamplingConfig, cache: Path
) -> Floats:
    """Return low, high and p of every two methods (3, V, V), and store them for the next build."""
    measures = (*methods[0].measures, column.key, resampling.resamples, __version__)
    path = cache / f"pairs-{hashlib.sha256(repr(measures).encode()).hexdigest()}.npz"
    names = [one.key for one in methods]
    before = load_arrays(path) or {"names": np.array([]), "pairs": np.zeros((3, 0, 0))}
    places = {name: place for place, name in enumerate(before["names"].tolist())}
    known = np.array([n for n, name in enumerate(names) if name in places], np.intp)
    then = np.array([places[names[n]] for n in known], np.intp)
    wanted = np.ones((len(names),) * 2, np.bool_)
    # A pair that has changed places is compared anew: its interval would be turned around.
    wanted[np.ix_(known, known)] = then[:, None] >= then
    found, stored = np.ones((3, *wanted.shape)), np.triu(~wanted, 1)
    if np.triu(wanted, 1).any():
        sample = _sample_of(methods, column)
        found[:2] = pair_limits(sample, resampling, wanted)
        found[2] = pair_p_values(sample, resampling, wanted)
    if len(known):
        spread = np.zeros_like(found)
        spread[:, known[:, None], known] = before["pairs"][:, then[:, None], then]
        found[:, stored] = spread[:, stored]
        found[2] = np.where(stored.T, found[2].T, found[2])
    store_arrays(path, {"names": np.array(names), "pairs": found})
    return found


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
