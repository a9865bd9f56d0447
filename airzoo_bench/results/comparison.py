"""Comparison of methods on the same queries: differences, intervals, tests."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.results.best import family_of, find_one, value_of
from airzoo_bench.results.comparable import check_same_queries, version_notes
from airzoo_bench.results.floors import floor_note, notes_of
from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.results.sampling import is_hit, make_sample
from airzoo_bench.results.selection import find_scene
from airzoo_bench.statistics.intervals import Interval
from airzoo_bench.statistics.samples import TIE, ResamplingConfig, paired_difference
from airzoo_bench.statistics.significance import PairedTest, holm, mcnemar, p_floor, paired_tests

__all__ = ["Comparison", "Pair", "compare"]


@dataclass(frozen=True)
class Pair:
    """A method and the reference, by one score.

    Values are of the scene, or the unweighted mean over scenes. The difference is the method's
    value minus the reference's, and None where both are infinite. `p_holm` is adjusted for
    `Comparison.family`; `p_mcnemar` is over all queries, whatever their scene, and None where the
    score is no hit. Wins, ties and losses count the queries, or scenes, on which the method is
    better, as good, worse.
    """

    score: ScoreColumn
    method: str
    reference: str
    value: float
    reference_value: float
    difference: float | None
    interval: Interval
    test: PairedTest
    p_holm: float
    p_mcnemar: float | None
    wins: int
    ties: int
    losses: int

    @property
    def is_better(self) -> bool:
        """Whether the method's value is the better one, however sure that is."""
        return self.difference is not None and (
            self.difference > 0 if self.score.higher_is_better else self.difference < 0
        )

    @property
    def p_floor(self) -> float:
        """The least p that any values could have, on as many units as differ here; 0 of a t."""
        return 0.0 if self.test.kind == "student" else p_floor(self.wins + self.losses)


@dataclass(frozen=True)
class Comparison:
    """All methods against one, score by score, in each the methods in their order.

    Attributes
    ----------
    reference : str
        The one: the `reference` of every pair, or where `of_one` the `method` of every pair.
    unit : str
        What was resampled: "query" or "scene".
    scene : str or None
        None for all scenes.
    family : int
        So many comparisons of a score p was adjusted for: those with the reference, or where the
        reference was chosen for being the best, those of every method with every other.
    notes : tuple of str
        What a reader of the numbers must know, in sentences.
    of_one : bool
        Whether differences, verdicts and wins are those of the one, instead of the others'.
    no_better : frozenset of str
        The methods that are no better than chance or the prior; see `floor_note`.
    """

    reference: str
    unit: str
    units: int
    scene: str | None
    pairs: list[Pair]
    family: int
    resampling: ResamplingConfig
    notes: tuple[str, ...]
    of_one: bool = False
    no_better: frozenset[str] = frozenset()

    def other(self, pair: Pair) -> str:
        """Return who stands in a pair next to the one."""
        return pair.reference if self.of_one else pair.method


def compare(
    methods: Sequence[Scored],
    scores: Sequence[ScoreColumn],
    *,
    reference: str | None = None,
    method: str | None = None,
    scene: str | None = None,
    resampling: ResamplingConfig,
) -> Comparison:
    """Compare methods with one of them, or one of them with the others."""
    check_same_queries(methods)
    if scene is not None:
        scene = find_scene(methods[0].result.truth.scene_titles, scene)
    base, count = find_one(methods, reference, method, scores[0], scene), len(methods)
    sample = make_sample(methods, scores, scene)
    others = [place for place in range(count) if place != base]
    places = [(s * count + other, s * count + base) for s in range(len(scores)) for other in others]
    if method is not None:
        places = [(one, other) for other, one in places]
    intervals, tests = paired_tests(sample, resampling, places)
    family = family_of([m.name for m in methods], reference if method is None else method)
    p_values = np.array([test.p_value for test in tests]).reshape(-1, len(others))
    adjusted = np.array([holm(row, family) for row in p_values]).ravel().tolist()
    pairs = []
    for (one, other), interval, test, p_holm in zip(
        places, intervals, tests, adjusted, strict=True
    ):
        sides = (methods[one % count], methods[other % count])
        values = [np.concatenate([part[row] for part in sample.values]) for row in (one, other)]
        pairs.append(_pair(scores[one // count], sides, values, scene, interval, test, p_holm))
    return Comparison(
        reference=methods[base].name,
        unit=sample.unit,
        units=sum(values.shape[1] for values in sample.values),
        scene=scene,
        pairs=pairs,
        family=family,
        resampling=resampling,
        notes=_notes(methods),
        of_one=method is not None,
        no_better=frozenset(m.name for m in methods if floor_note(m.result)),
    )


def _notes(methods: Sequence[Scored]) -> tuple[str, ...]:
    """Repeat each method's notes, tell of different versions, and of what is no other method."""
    names, results = [m.name for m in methods], [m.result for m in methods]
    notes = [f"{method.name}: {note}" for method in methods for note in notes_of(method.result)]
    by_file: dict[str, list[str]] = {}
    for name, result in zip(names, results, strict=True):
        by_file.setdefault(result.predictions.sha256, []).append(name)
    same = [f"{', '.join(who)}: the same predictions file" for who in by_file.values() if who[1:]]
    return (*same, *notes, *version_notes(names, results))


def _pair(
    score: ScoreColumn,
    sides: tuple[Scored, Scored],
    values: Sequence[Floats],
    scene: str | None,
    interval: Interval,
    test: PairedTest,
    p_holm: float,
) -> Pair:
    """Put together what is known of two methods by a score, with their values unit by unit."""
    method, base = sides
    value, base_value = (value_of(side, score, scene) for side in sides)
    both_infinite = math.isinf(value) and value == base_value
    # What equal numbers differ by after averaging in another order is nothing.
    equal = math.isclose(value, base_value, rel_tol=TIE)
    ahead = paired_difference(*values) * (1 if score.higher_is_better else -1)
    wins, losses = int((ahead > 0).sum()), int((ahead < 0).sum())
    hits = is_hit(method.result.track, score)
    return Pair(
        score=score,
        method=method.name,
        reference=base.name,
        value=value,
        reference_value=base_value,
        difference=None if both_infinite else 0.0 if equal else value - base_value,
        interval=Interval(None, None, "", "both are infinite") if both_infinite else interval,
        test=test,
        p_holm=p_holm,
        p_mcnemar=float(mcnemar(np.array(wins), np.array(losses))) if hits else None,
        wins=wins,
        ties=len(ahead) - wins - losses,
        losses=losses,
    )
