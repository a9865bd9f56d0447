"""Comparison of methods on the same queries: differences, intervals, tests."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.results.best import family_of, find_one, value_of
from airzoo_bench.results.comparable import check_same_queries, version_notes
from airzoo_bench.results.floors import floor_note, notes_of
from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.results.sampling import is_hit, make_sample
from airzoo_bench.results.selection import find_scene
from airzoo_bench.statistics.corrections import holm
from airzoo_bench.statistics.intervals import Interval
from airzoo_bench.statistics.samples import ResamplingConfig, Sample, paired_difference
from airzoo_bench.statistics.significance import PairedTest, mcnemar, p_floor, paired_tests

__all__ = ["Comparison", "Pair", "compare"]

_ROUNDING = 1e-9  # what processors may differ by; see `paired_difference`


@dataclass(frozen=True)
class Pair:
    """A method and the reference, by one score.

    Attributes
    ----------
    value, reference_value : float
        Of the scene, or the unweighted mean over scenes.
    difference : float or None
        The method's value minus the reference's; None where both are infinite.
    interval : Interval
        Of the difference.
    p_holm : float
        p adjusted for the number of comparisons, `Comparison.family`.
    p_mcnemar : float or None
        Over all queries, whatever their scene; None where the score is no hit.
    wins, ties, losses : int
        Queries, or scenes, on which the method is better, as good, worse.
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
    """All methods against one.

    Attributes
    ----------
    reference : str
        The one: the `reference` of every pair, or where `of_one` the `method` of every pair.
    unit : str
        What was resampled: "query" or "scene".
    units : int
        How many there are.
    scene : str or None
        None for all scenes.
    pairs : list of Pair
        Score by score, in each the methods in their order.
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
    titles = methods[0].result.truth.scene_titles
    scene = None if scene is None else find_scene(titles, scene)
    base = find_one(methods, reference, method, scores[0], scene)
    sample = make_sample(methods, scores, scene)
    others = [place for place in range(len(methods)) if place != base]
    starts = range(0, len(scores) * len(methods), len(methods))
    places = [(start + other, start + base) for start in starts for other in others]
    if method is not None:
        places = [(one, other) for other, one in places]
    intervals, tests = paired_tests(sample, resampling, places)
    pairs = [
        _pair(sample, scores[place[0] // len(methods)], methods, place, scene, interval, test)
        for place, interval, test in zip(places, intervals, tests, strict=True)
    ]
    units = sum(values.shape[1] for values in sample.values)
    family = family_of([m.name for m in methods], reference if method is None else method)
    return Comparison(
        reference=methods[base].name,
        unit=sample.unit,
        units=units,
        scene=scene,
        pairs=_adjusted(pairs, len(others), family),
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
    sample: Sample,
    score: ScoreColumn,
    methods: Sequence[Scored],
    place: tuple[int, int],
    scene: str | None,
    interval: Interval,
    test: PairedTest,
) -> Pair:
    method, base = (methods[row % len(methods)] for row in place)
    one, other = (np.concatenate([part[row] for part in sample.values]) for row in place)
    value, base_value = value_of(method, score, scene), value_of(base, score, scene)
    both_infinite = math.isinf(value) and value == base_value
    wins, losses = _wins(score, one, other), _wins(score, other, one)
    hits = is_hit(method.result.track, score)
    return Pair(
        score=score,
        method=method.name,
        reference=base.name,
        value=value,
        reference_value=base_value,
        difference=None if both_infinite else _difference(value, base_value),
        interval=Interval(None, None, "", "both are infinite") if both_infinite else interval,
        test=test,
        p_holm=test.p_value,
        p_mcnemar=float(mcnemar(np.array(wins), np.array(losses))) if hits else None,
        wins=wins,
        ties=len(one) - wins - losses,
        losses=losses,
    )


def _difference(value: float, other: float) -> float:
    """Subtract; what equal numbers differ by after averaging in another order is nothing."""
    return 0.0 if math.isclose(value, other, rel_tol=_ROUNDING) else value - other


def _wins(score: ScoreColumn, one: Floats, other: Floats) -> int:
    ahead = (
        paired_difference(one, other) if score.higher_is_better else paired_difference(other, one)
    )
    return int((ahead > 0).sum())


def _adjusted(pairs: list[Pair], others: int, family: int) -> list[Pair]:
    """Correct over the methods of each score."""
    found = np.array([pair.test.p_value for pair in pairs]).reshape(-1, others)
    corrected = np.array([holm(row, family) for row in found]).ravel().tolist()
    return [replace(pair, p_holm=p) for pair, p in zip(pairs, corrected, strict=True)]
