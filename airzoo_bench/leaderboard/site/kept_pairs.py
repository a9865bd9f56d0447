"""Tests of every two methods, kept from build to build: a pair has the same among all others."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from airzoo_bench.core.files import atomic_write, write_npz
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.leaderboard.site.kept_files import kept_arrays
from airzoo_bench.statistics.pair_intervals import pair_limits
from airzoo_bench.statistics.pair_tests import pair_draws, pair_p_values
from airzoo_bench.statistics.pairs import Places, wanted_pairs
from airzoo_bench.statistics.samples import ResamplingConfig, Sample

__all__ = ["ScoreOfAll", "tested_pairs"]

_FEW = 16


@dataclass(frozen=True)
class ScoreOfAll:
    """One score of V methods.

    Attributes
    ----------
    unit, groups : str, tuple of str
        As in `Sample`.
    medians : bool
        Whether it is averaged by medians.
    sample : callable
        Gives the sample of some of the methods, one variable each, in the order asked.
    """

    unit: str
    groups: tuple[str, ...]
    medians: bool
    sample: Callable[[Places], Sample]

    def file(self, what: str, resampling: ResamplingConfig) -> str:
        """Return the name under which something of it is kept."""
        text = f"{what} {resampling.resamples} {resampling.seed} {self.unit} {self.groups}"
        return f"{hashlib.sha256(text.encode()).hexdigest()}.npz"


def tested_pairs(
    scores: Mapping[str, ScoreOfAll],
    stems: NDArray[np.str_],
    resampling: ResamplingConfig,
    cache: Path,
    *,
    of: str,
) -> dict[str, Floats]:
    """Test every two methods by each of some scores.

    What was known before is kept, and only the rest is tested. Pairs are taken in the order of
    their hashes. A pair then has the same to the last bit whatever the other methods are and
    wherever they stand, so that known ones and new ones fit together.

    Parameters
    ----------
    scores : mapping of str to ScoreOfAll
        By key. Where all pairs are known, no sample is asked for; else of one score at a time.
    stems : (V,) array of str
        Hashes of the methods' numbers.
    resampling : ResamplingConfig
    cache : Path
        A folder; what is missing in it is made again.
    of : str
        What the methods measure: each table keeps its own pairs.

    Returns
    -------
    dict of str to (3, V, V) array
        By score p, low and high of row minus column.
    """
    order = np.argsort(stems)
    place = np.argsort(order)
    files = {
        key: cache / score.file(f"pairs {of} {key}", resampling) for key, score in scores.items()
    }
    known = {key: _known(file, stems[order]) for key, file in files.items()}
    changed = {
        key: replace(scores[key], sample=_in_order(scores[key].sample, order))
        for key, (_, new) in known.items()
        if len(new)
    }
    draws = _draws(changed, stems[order], resampling, cache, of)
    for key, score in changed.items():
        found, new = known[key]
        sample = score.sample(np.arange(len(stems)))
        p_values = pair_p_values(sample, resampling, draws.pop(key), new)
        fresh = np.stack([np.triu(p_values, 1), *pair_limits(sample, resampling, new)])
        found = np.where(wanted_pairs(len(stems), new), fresh, found)
        known[key] = found, new
        with atomic_write(files[key]) as stream:
            write_npz(stream, {"stems": stems[order], "pairs": found})
    return {key: _both_ways(found)[:, place[:, None], place] for key, (found, _) in known.items()}


def _in_order(sample: Callable[[Places], Sample], order: Places) -> Callable[[Places], Sample]:
    return lambda places: sample(order[places])


def _both_ways(found: Floats) -> Floats:
    """Return what is known above the diagonal for both orders of each pair."""
    p_values, low, high = found
    count = len(p_values)
    low, high = (np.where(np.tri(count, k=-1) > 0, -b.T, a) for a, b in ((low, high), (high, low)))
    p_values = np.triu(p_values, 1) + np.triu(p_values, 1).T + np.eye(count)
    return np.stack([p_values, low, high])


def _known(file: Path, stems: NDArray[np.str_]) -> tuple[Floats, Places]:
    """Return what an earlier build found of pairs, and which methods it did not have."""
    found = np.full((3, len(stems), len(stems)), np.nan)
    kept = kept_arrays(file, "stems", "pairs")
    if not kept:
        return found, np.arange(len(stems))
    _, here, there = np.intersect1d(stems, kept["stems"], return_indices=True)
    found[:, here[:, None], here] = kept["pairs"][:, there[:, None], there]
    return found, np.setdiff1d(np.arange(len(stems)), here)


def _draws(
    scores: Mapping[str, ScoreOfAll],
    stems: NDArray[np.str_],
    resampling: ResamplingConfig,
    cache: Path,
    of: str,
) -> dict[str, Floats]:
    """Return the draws of all methods by score, in the order of their hashes.

    Only those that no earlier build has made are made now.
    """
    files = {
        key: cache / score.file(f"draws {of} {key}", resampling) for key, score in scores.items()
    }
    kept = {key: _kept_draws(file, stems) for key, file in files.items()}
    new = {key: np.flatnonzero(~known) for key, (_, known) in kept.items() if not known.all()}
    found = {key: old for key, (old, _) in kept.items()}
    for keys in _together(scores, new):
        parts = [scores[key].sample(new[key]) for key in keys]
        for key, own in zip(keys, _drawn(parts, resampling), strict=True):
            old, known = kept[key]
            draws = np.empty((len(stems), own.shape[1]))
            draws[new[key]] = own
            if known.any():
                draws[known] = old
            found[key] = draws
            with atomic_write(files[key]) as stream:
                write_npz(stream, {"stems": stems, "draws": draws})
    return found


def _together(
    scores: Mapping[str, ScoreOfAll], new: Mapping[str, Places]
) -> Iterator[Sequence[str]]:
    """Yield scores to draw at once: all that are averaged alike, where few methods are new.

    It is the signs that take time of a few methods, and the values that take memory of many.
    """
    few = [key for key, rows in new.items() if len(rows) <= _FEW]
    yield from ([key] for key in new if key not in few)
    for medians in (False, True):
        alike = [key for key in few if scores[key].medians == medians]
        yield from [alike] * bool(alike)


def _kept_draws(file: Path, stems: NDArray[np.str_]) -> tuple[Floats, NDArray[np.bool_]]:
    """Return the draws of an earlier build, and whose they are."""
    known = np.zeros(len(stems), np.bool_)
    kept = kept_arrays(file, "stems", "draws")
    if not kept:
        return np.empty((0, 0)), known
    _, here, there = np.intersect1d(stems, kept["stems"], return_indices=True)
    known[here] = True
    return kept["draws"][there], known


def _drawn(parts: Sequence[Sample], resampling: ResamplingConfig) -> list[Floats]:
    """Draw for scores of the same units at once."""
    values = tuple(
        np.concatenate(groups) for groups in zip(*(p.values for p in parts), strict=True)
    )
    medians = np.concatenate([part.medians for part in parts])
    draws = pair_draws(replace(parts[0], values=values, medians=medians, shares=None), resampling)
    return np.split(draws, np.cumsum([len(part.medians) for part in parts])[:-1])
