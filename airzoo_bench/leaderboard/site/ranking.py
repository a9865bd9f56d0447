"""Rank ranges of a table, and any two of its methods compared."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.errors import ResultError
from airzoo_bench.core.files import atomic_write, write_npz
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.leaderboard.site.api import API, Pairs
from airzoo_bench.leaderboard.site.measured import OVERALL, Measured, sample_of
from airzoo_bench.leaderboard.site.rows import Scored
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.statistics.pair_intervals import pair_limits
from airzoo_bench.statistics.pair_tests import (
    pair_draws,
    pair_p_values,
    resamples_for,
)
from airzoo_bench.statistics.pairs import wanted_pairs
from airzoo_bench.statistics.rank_ranges import (
    correct_pairs,
    rank_ranges,
    told_apart,
    unpaired_p_values,
)
from airzoo_bench.statistics.samples import ResamplingConfig, Sample

__all__ = ["Ranked", "check_alike", "headline_first", "rank", "rank_sealed"]


@dataclass(frozen=True)
class Ranked:
    """One score of a table's methods, in their order.

    Attributes
    ----------
    ranges : (V, 2) int64
    apart : (V, V) bool
        Which two methods are significantly different.
    pairs : Pairs or None
        None of a sealed table, and of one method.
    """

    ranges: NDArray[np.int64]
    apart: NDArray[np.bool_]
    pairs: Pairs | None


def check_alike(methods: Sequence[Scored]) -> None:
    """Refuse methods of one table that do not measure the same.

    Raises
    ------
    ResultError
        They are not on the same queries, or mean different things by one score.
    """
    known: dict[str, tuple[str, dict[str, Any]]] = {}
    for one in methods:
        if one.measured.queries != methods[0].measured.queries:
            raise ResultError(
                f"{methods[0].method} and {one.method} are not on the same queries",
                where=one.entry.file,
                fix="score the predictions again with the same benchmark folder",
            )
        for column in one.measured.columns:
            given = {key: value for key, value in column.items() if key != "headline"}
            whose, first = known.setdefault(column["key"], (one.method, given))
            if first != given:
                raise ResultError(
                    f"{whose} and {one.method} mean different things by the score {column['key']}",
                    where=one.entry.file,
                    fix="score all predictions again with the same version",
                )


def headline_first(
    methods: Sequence[Scored], otherwise: Sequence[ScoreColumn] = ()
) -> list[ScoreColumn]:
    """Return the scores that any method has, the headline ones that all have first.

    Parameters
    ----------
    methods : sequence of Scored
        In the order of the table's ids.
    otherwise : sequence of ScoreColumn
        The columns of a table without methods.
    """
    found = {c.key: c for one in methods for c in one.measured.score_columns}
    columns = list(found.values()) or list(otherwise)
    of_all = [{c.key for c in one.measured.score_columns if c.headline} for one in methods]
    headline = set.intersection(*of_all) if of_all else {c.key for c in columns if c.headline}
    marked = [c.model_copy(update={"headline": c.key in headline}) for c in columns]
    return sorted(marked, key=lambda column: not column.headline)


def rank(
    methods: Sequence[Scored],
    column: ScoreColumn,
    cache: Path,
) -> Ranked:
    """Rank methods by one headline score.

    Parameters
    ----------
    methods : sequence of Scored
        Of one protocol and truth, see `check_alike`.
    column : ScoreColumn
    cache : Path
        Keeps the methods' draws, and what is known of pairs.
    """
    ids, measured = [one.id for one in methods], [one.measured for one in methods]
    stems = np.array([one.array.stem for one in methods])
    resampling = ResamplingConfig(resamples_for(len(ids)))
    sample = sample_of(measured, [one.values for one in methods], column)
    p_values, *limits = _tested(sample, stems, column.key, resampling, cache)
    corrected = correct_pairs(p_values)
    values = np.array([one.values[OVERALL][column.key] for one in measured])
    ranges = rank_ranges(values, corrected, higher_is_better=column.higher_is_better)
    apart = told_apart(values, corrected)
    if len(ids) < 2:
        return Ranked(ranges, apart, None)
    upper = np.triu_indices(len(ids), 1)
    pairs = Pairs(
        API,
        column.key,
        tuple(ids),
        tuple(values.tolist()),
        _packed(limits[0][upper]),
        _packed(limits[1][upper]),
        _packed(p_values[upper]),
        _packed(corrected[upper]),
        len(upper[0]),
        resampling.resamples,
        _about(sample, resampling),
    )
    return Ranked(ranges, apart, pairs)


def _tested(
    sample: Sample, stems: NDArray[np.str_], key: str, resampling: ResamplingConfig, cache: Path
) -> Floats:
    """Return p, low and high of row minus column, (3, V, V): what was known before and the rest.

    Pairs are taken in the order of their hashes. A pair then has the same to the last bit whatever
    the other methods are and wherever they stand, so that known ones and new ones fit together.
    """
    order = np.argsort(stems)
    ordered = _part(sample, order)
    name = f"pairs {key} {resampling.resamples} {resampling.seed} {sample.unit} {sample.groups}"
    file = cache / f"{hashlib.sha256(name.encode()).hexdigest()}.npz"
    sums = cache / f"{hashlib.sha256(f'draws of {name}'.encode()).hexdigest()}.npz"
    found, new = _known(file, stems[order])
    if len(new):
        draws = _draws(ordered, stems[order], resampling, sums)
        p_values = pair_p_values(ordered, resampling, draws, new)
        limits = pair_limits(ordered, resampling, new)
        fresh = np.stack([np.triu(p_values, 1), *limits])
        found = np.where(wanted_pairs(len(stems), new), fresh, found)
        with atomic_write(file) as stream:
            write_npz(stream, {"stems": stems[order], "pairs": found})
    p_values, low, high = found
    low, high = (
        np.where(np.tri(len(stems), k=-1) > 0, -b.T, a) for a, b in ((low, high), (high, low))
    )
    p_values = np.triu(p_values, 1) + np.triu(p_values, 1).T + np.eye(len(stems))
    place = np.argsort(order)
    return np.stack([p_values, low, high])[:, place[:, None], place]


def _known(file: Path, stems: NDArray[np.str_]) -> tuple[Floats, NDArray[np.intp]]:
    """Return what an earlier build found of pairs, and which methods it did not have."""
    found = np.full((3, len(stems), len(stems)), np.nan)
    if not file.is_file():
        return found, np.arange(len(stems))
    with np.load(file, allow_pickle=False) as kept:
        _, here, there = np.intersect1d(stems, kept["stems"], return_indices=True)
        found[:, here[:, None], here] = kept["pairs"][:, there[:, None], there]
    return found, np.setdiff1d(np.arange(len(stems)), here)


def _draws(
    sample: Sample, stems: NDArray[np.str_], resampling: ResamplingConfig, file: Path
) -> Floats:
    """Return the draws of all methods, those that no earlier build has made made now."""
    kept, known = None, np.zeros(len(stems), np.bool_)
    if file.is_file():
        with np.load(file, allow_pickle=False) as archive:
            _, here, there = np.intersect1d(stems, archive["stems"], return_indices=True)
            kept, known[here] = np.asarray(archive["draws"], np.float64)[there], True
    if known.all() and kept is not None:
        return kept
    made = pair_draws(_part(sample, np.flatnonzero(~known)), resampling)
    draws = np.empty((len(stems), made.shape[1]))
    draws[~known] = made
    if kept is not None:
        draws[known] = kept  # both in the order of their hashes
    with atomic_write(file) as stream:
        write_npz(stream, {"stems": stems, "draws": draws})
    return draws


def _part(sample: Sample, rows: NDArray[np.intp]) -> Sample:
    values = tuple(part[rows] for part in sample.values)
    shares = None if sample.shares is None else sample.shares[rows]
    return replace(sample, values=values, medians=sample.medians[rows], shares=shares)


def _about(sample: Sample, resampling: ResamplingConfig) -> str:
    number = f"{resampling.resamples:,}"
    test = (
        f"bootstrap of the difference of medians, {number} resamples"
        if sample.medians.any()
        else f"paired permutation test, exact where {number} patterns are all there are"
    )
    units = "scenes" if sample.unit == "scene" else "queries within scenes"
    return f"{test}, over {units}; p for these two alone, and by Holm for all pairs of the column"


def _packed(values: Floats) -> str:
    return base64.b64encode((values + 0.0).astype("<f4").tobytes()).decode()  # no -0.0


def rank_sealed(measured: Sequence[Measured], column: ScoreColumn) -> Ranked:
    """Rank methods of which only rounded scores and standard errors are known.

    The errors of two methods are added, as if the methods erred in opposite ways: no range is
    narrower than it would be from the answers themselves, but for rounding.
    """
    values = np.array([one.values[OVERALL].get(column.key, np.inf) for one in measured])
    errors = np.array([one.errors[OVERALL].get(column.key, np.nan) for one in measured])
    corrected = correct_pairs(unpaired_p_values(values, errors))
    ranges = rank_ranges(values, corrected, higher_is_better=column.higher_is_better)
    return Ranked(ranges, told_apart(values, corrected), None)
