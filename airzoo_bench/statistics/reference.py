"""The method that others are compared with, and what it costs to choose it by its value."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.validation import nearest
from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import ScoreColumn

__all__ = ["best_place", "family_of", "find_one", "find_reference", "value_of"]

_BEST = "best"


def find_reference(
    methods: Sequence[Scored],
    wanted: str | None,
    score: ScoreColumn,
    scene: str | None = None,
    *,
    option: str = "--reference",
) -> int:
    """Return the place of the method that the others are compared with.

    Parameters
    ----------
    methods : sequence of Scored
        Results of one protocol.
    wanted : str, optional
        A method's name, or "best" for the best by `score`; by default the first.
    score : ScoreColumn
        By which "best" is found.
    scene : str, optional
        Id of the scene on which it is the best, instead of on average.
    option : str
        What asked for it, for messages.

    Returns
    -------
    int
        Its index in `methods`.

    Raises
    ------
    UsageError
        No method has that name.
    """
    names = [method.name for method in methods]
    if wanted is None:
        return 0
    if wanted in names:
        return names.index(wanted)
    if wanted == _BEST:
        return best_place(methods, score, scene)
    raise UsageError(
        f"{option} {wanted[:80]!r} is no method of these results{nearest(wanted[:80], names)}",
        expected=f"{_BEST}, or one of " + ", ".join(names),
    )


def best_place(methods: Sequence[Scored], score: ScoreColumn, scene: str | None = None) -> int:
    """Return the place of the best method by a score, the first of equals; see `value_of`.

    Parameters
    ----------
    methods : sequence of Scored
        Of one protocol.
    score : ScoreColumn
        Which says whether lower is better.
    scene : str, optional
        On this scene, instead of on average.

    Returns
    -------
    int
        Its index in `methods`.
    """
    sign = 1 if score.higher_is_better else -1
    return int(np.argmax([sign * value_of(method, score, scene) for method in methods]))


def find_one(
    methods: Sequence[Scored],
    reference: str | None,
    method: str | None,
    score: ScoreColumn,
    scene: str | None = None,
) -> int:
    """Return the place of the reference, or of the method that is held against all others.

    Parameters
    ----------
    methods : sequence of Scored
        Results of one protocol.
    reference : str or None
        See `find_reference`.
    method : str or None
        Instead of a reference: the name of the method whose differences are wanted.
    score : ScoreColumn
        By which "best" is found.
    scene : str, optional
        On which "best" is found, instead of on average.

    Returns
    -------
    int
        Its index in `methods`.

    Raises
    ------
    UsageError
        No method has that name, or both are named.
    """
    if method is None:
        return find_reference(methods, reference, score, scene)
    if reference is not None:
        raise UsageError(
            "--method and --reference exclude each other",
            expected="--method for what NAME is against each other, --reference for what they "
            "are against NAME",
            fix="leave one of them out",
        )
    return find_reference(methods, method, score, scene, option="--method")


def value_of(method: Scored, score: ScoreColumn, scene: str | None = None) -> float:
    """Return a method's value on a scene, or the unweighted mean over scenes.

    Parameters
    ----------
    method : Scored
        A result with its records.
    score : ScoreColumn
        One of its scores.
    scene : str, optional
        Id of a scene.

    Returns
    -------
    float
        As the result has it; shares are 0 to 1.
    """
    values = method.result.overall if scene is None else method.result.scenes[scene]
    return values[score.key]


def family_of(names: Sequence[str], reference: str | None) -> int:
    """Count the comparisons of one score for which p is to be corrected.

    Who takes the best of M equal methods as the reference has looked at all M (M - 1) / 2 pairs:
    corrected for the M - 1 others alone, 7 % of comparisons of 6 methods find a difference that
    is none, and 13 % of those of 15.

    Parameters
    ----------
    names : sequence of str
        Of the methods that are compared.
    reference : str or None
        What they are compared with: a name, "best", or None for the first.

    Returns
    -------
    int
        The size of the family for `holm`.
    """
    chosen_by_value = reference == _BEST and _BEST not in names
    others = len(names) - 1
    return len(names) * others // 2 if chosen_by_value else others
