"""Intervals beside SciPy's bootstrap."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from harness import ROOT, Case, Figures, Work, main, no_input
from scipy.stats import bootstrap as scipy_bootstrap

from airzoo_bench.protocol.model import load_protocol, shipped_protocols
from airzoo_bench.results.comparison import make_sample
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.retrieval.track import list_scores
from airzoo_bench.statistics.intervals import sample_intervals
from airzoo_bench.statistics.samples import ResamplingConfig

sys.path.insert(0, str(ROOT))

from tests.statistics.support import random_methods

PROTOCOL = load_protocol(shipped_protocols()["uav-visloc-retrieval"])
SCENES = {scene.id: scene.queries or 0 for scene in PROTOCOL.scenes}
COLUMNS: tuple[ScoreColumn, ...] = tuple(list_scores(PROTOCOL.scores))


def resample_all(_: Path, methods: int, resamples: int) -> Work:
    """Return intervals of all methods, scores and scenes by this package."""
    sample = make_sample(random_methods(methods, SCENES, COLUMNS), COLUMNS)
    return lambda: sample_intervals(sample, ResamplingConfig(resamples=resamples)) and None


def resample_one(_: Path, methods: int, resamples: int) -> Work:
    """Return SciPy's interval of one score of one method in the first scene."""
    sample = make_sample(random_methods(1, SCENES, COLUMNS), COLUMNS[:1])
    values, random = sample.values[0][0], np.random.default_rng(0)
    options: dict[str, Any] = {"n_resamples": resamples, "batch": 1_000, "rng": random}

    def work() -> dict[str, int]:
        scipy_bootstrap((values,), np.mean, **options)
        queries = sum(part.shape[1] for part in sample.values)
        return {"times": queries * methods * len(COLUMNS) // len(values)}

    return work


def compare_intervals(figures: dict[str, Figures]) -> str:
    """Say how long SciPy would take for all, which it treats one by one."""
    ours, one = figures.values()
    seconds = one.processor * int(one.arrays["times"])
    return (
        f"SciPy for all of them: {seconds:.0f} s of processor, {seconds / ours.processor:.0f} times"
    )


CASES = {
    "intervals": Case(
        "intervals of {methods} methods, {resamples:,} resamples, 6,442 queries in 11 scenes",
        no_input,
        {"airzoo-bench": resample_all, "SciPy, one statistic": resample_one},
        {"methods": 10, "resamples": 10_000},
        {"methods": 4, "resamples": 1_000},
        compare_intervals,
    ),
}

if __name__ == "__main__":
    main(CASES)
