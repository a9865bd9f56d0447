"""Which methods cannot be told from the best, score by score."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.statistics.comparison import make_sample
from airzoo_bench.statistics.corrections import LEVEL, holm
from airzoo_bench.statistics.paired_tests import paired_tests
from airzoo_bench.statistics.reference import best_place
from airzoo_bench.statistics.samples import ResamplingConfig

__all__ = ["AgainstBest", "against_best"]


@dataclass(frozen=True)
class AgainstBest:
    """Every method against the best by a score.

    Attributes
    ----------
    best : int
        The place of the best method, the first of equals.
    p_values : tuple of float
        Of each method, paired, two-sided, after Holm's correction for all pairs of methods, since
        the best was chosen for its value; 1 of the best itself.
    """

    best: int
    p_values: tuple[float, ...]

    @property
    def tied(self) -> tuple[bool, ...]:
        """Which methods cannot be told from the best at a level of 5 %; the best is one of them."""
        return tuple(p_value > LEVEL for p_value in self.p_values)


def against_best(
    methods: Sequence[Scored],
    scores: Sequence[ScoreColumn],
    plan: ResamplingConfig,
    scene: str | None = None,
) -> dict[str, AgainstBest]:
    """Test every method against the best by each score, as `compare` with the best of it does.

    Parameters
    ----------
    methods : sequence of Scored
        On the same queries; see `check_comparable`.
    scores : sequence of ScoreColumn
        Of the results; see `choose_scores`.
    plan : ResamplingConfig
        How intervals and tests are made.
    scene : str, optional
        Id of the scene to compare on, instead of the average over all.

    Returns
    -------
    dict of str to AgainstBest
        By the scores' keys.
    """
    count = len(methods)
    best = [best_place(methods, score, scene) for score in scores]
    places = [
        (number * count + other, number * count + place)
        for number, place in enumerate(best)
        for other in range(count)
        if other != place
    ]
    _, tests = paired_tests(make_sample(methods, scores, scene), plan, places)
    found = np.array([test.p_value for test in tests]).reshape(len(scores), count - 1)
    return {
        score.key: AgainstBest(place, tuple(np.insert(_corrected(row), place, 1.0).tolist()))
        for score, place, row in zip(scores, best, found, strict=True)
    }


def _corrected(p_values: Floats) -> Floats:
    return holm(p_values, len(p_values) * (len(p_values) + 1) // 2)
