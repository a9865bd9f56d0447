"""The method that others are compared with, and which cannot be told from the best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.validation import nearest
from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.results.sampling import make_sample
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.statistics.significance import LEVEL, holm, paired_tests

__all__ = ["AgainstBest", "against_best", "best_place", "family_of", "find_one", "value_of"]

_BEST = "best"


def value_of(method: Scored, score: ScoreColumn, scene: str | None = None) -> float:
    """Return a method's value on a scene, or the unweighted mean over scenes."""
    values = method.result.overall if scene is None else method.result.scenes[scene]
    return values[score.key]


def best_place(methods: Sequence[Scored], score: ScoreColumn, scene: str | None = None) -> int:
    """Return the place of the best method by a score, the first of equals; see `value_of`."""
    sign = 1 if score.higher_is_better else -1
    return int(np.argmax([sign * value_of(method, score, scene) for method in methods]))


def find_one(
    methods: Sequence[Scored],
    reference: str | None,
    method: str | None,
    score: ScoreColumn,
    scene: str | None = None,
) -> int:
    """Return the place of the reference, or of the method that all others are compared with."""
    if method is not None and reference is not None:
        raise UsageError(
            "--method and --reference exclude each other",
            expected="--method for what NAME is against each other, --reference for what they "
            "are against NAME",
            fix="leave one of them out",
        )
    wanted = reference if method is None else method
    names = [one.name for one in methods]
    if wanted is None:
        return 0
    if wanted in names:
        return names.index(wanted)
    if wanted == _BEST:
        return best_place(methods, score, scene)
    option = "--reference" if method is None else "--method"
    raise UsageError(
        f"{option} {wanted[:80]!r} is no method of these results{nearest(wanted[:80], names)}",
        expected=f"{_BEST}, or one of " + ", ".join(names),
    )


def family_of(names: Sequence[str], reference: str | None) -> int:
    """Count the comparisons of one score for which p is to be corrected."""
    others = len(names) - 1
    is_chosen_by_value = reference == _BEST and _BEST not in names
    return len(names) * others // 2 if is_chosen_by_value else others


@dataclass(frozen=True)
class AgainstBest:
    """Every method against the best by a score, the first of equals, which stands at `best`.

    p is paired, two-sided, after Holm's correction for all pairs of methods, since the best was
    chosen for its value; that of the best itself is 1.
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
    resampling: ResamplingConfig,
    scene: str | None = None,
) -> dict[str, AgainstBest]:
    """Test every method against the best by each score, as `compare` with the best of it does."""
    count = len(methods)
    best = [best_place(methods, score, scene) for score in scores]
    places = [
        (number * count + other, number * count + place)
        for number, place in enumerate(best)
        for other in range(count)
        if other != place
    ]
    _, tests = paired_tests(make_sample(methods, scores, scene), resampling, places)
    found = np.array([test.p_value for test in tests]).reshape(len(scores), count - 1)
    corrected = [holm(row, count * (count - 1) // 2) for row in found]
    return {
        score.key: AgainstBest(place, tuple(np.insert(row, place, 1.0).tolist()))
        for score, place, row in zip(scores, best, corrected, strict=True)
    }
