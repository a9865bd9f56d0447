"""Methods compared on the same queries: samples, references, the best, differences and tests."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.validation import nearest
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.results.comparable import check_same_queries, find_scene, version_notes
from airzoo_bench.results.result import Reference, Result, ScoreColumn
from airzoo_bench.statistics.intervals import FEWEST, Interval, SampleIntervals, sample_intervals
from airzoo_bench.statistics.samples import TIE, ResamplingConfig, Sample, paired_difference
from airzoo_bench.statistics.shares import Rates, limits_of_rates
from airzoo_bench.statistics.significance import (
    LEVEL,
    PairedTest,
    holm,
    mcnemar,
    p_floor,
    paired_tests,
)

if TYPE_CHECKING:  # records need pandas, which tables of results do without
    from airzoo_bench.results.records import Scored

FLOOR_MARK = "‡"
"""What stands behind the name of a method that is no better than a reference."""

_BEST = "best"
_CONFIDENCE = 0.95
# How the columns of scores begin that say of a query whether it is answered well enough.
_HITS = {"retrieval": ("recall@", "distance<", "ma@"), "matching": ("within_",)}


def is_hit(track: str, score: ScoreColumn) -> bool:
    """Whether a score is 0 or 1 for each query by its definition, whatever its values are."""
    return score.unit == "share" and score.key.startswith(_HITS.get(track, ()))


def is_share(score: ScoreColumn) -> bool:
    """Whether a score is a mean of shares from 0 to 1."""
    return score.unit == "share" and score.average == "mean"


def make_sample(
    methods: Sequence[Scored], scores: Sequence[ScoreColumn], scene: str | None = None
) -> Sample:
    """Gather variables, score by score and in each method by method."""
    whole = pooled_sample(methods, scores)
    [values], of_unit = whole.values, methods[0].records["scene"].to_numpy(str)
    if whole.unit == "scene":
        return whole if scene is None else replace(whole, values=(values[:, of_unit == scene],))
    scenes = tuple(name for name in methods[0].result.scenes if scene in (None, name))
    parts = tuple(np.ascontiguousarray(values[:, of_unit == name]) for name in scenes)
    return replace(whole, groups=scenes, values=parts)


def pooled_sample(methods: Sequence[Scored], scores: Sequence[ScoreColumn]) -> Sample:
    """Gather variables as `make_sample` does, of all records as one group, in their order."""
    unit = methods[0].result.unit
    variables = [(score, method) for score in scores for method in methods]
    values = np.array([m.records[s.key].to_numpy(np.float64) for s, m in variables])
    # One record a scene: their mean over scenes, whatever the average within a scene.
    medians = [unit == "query" and score.average == "median" for score, _ in variables]
    shares = np.array([is_share(score) for score, _ in variables], np.bool_)
    values = values.reshape(len(variables), -1)
    return Sample(unit, ("",), (values,), np.array(medians, np.bool_), shares)


def score_intervals(
    method: Scored,
    scores: Sequence[ScoreColumn],
    resampling: ResamplingConfig,
    scene: str | None = None,
) -> SampleIntervals:
    """Take the interval of every score, of each scene and of the mean over scenes."""
    sample = make_sample([method], scores, scene)
    found = sample_intervals(sample, resampling)
    return found if sample.unit == "query" else replace(found, groups={})


def notes_of(result: Result) -> tuple[str, ...]:
    """Return the notes of a result and `floor_note`, where there is one."""
    return (*result.notes, *filter(None, [floor_note(result)]))


def floor_note(result: Result) -> str:
    """Name the headline scores that do not beat a reference, such as chance."""
    parts = []
    for name, reference in result.references.items():
        columns = [c for c in result.columns if c.headline and c.key in reference.overall]
        titles = [c.title for c in columns if _is_no_better(result, reference, c)]
        if titles:
            parts.append(f"no better than {name} on {', '.join(titles)}")
    if not parts:
        return ""
    why = ": its 95 % interval reaches that" if result.track == "retrieval" else ""
    return f"{FLOOR_MARK} {'; '.join(parts)}{why}"


def _is_no_better(result: Result, reference: Reference, column: ScoreColumn) -> bool:
    value, floor = result.overall[column.key], reference.overall[column.key]
    if result.track != "retrieval":
        return value <= floor if column.higher_is_better else value >= floor
    counts = [float(part["queries"]) for part in result.counts.values()]
    if not is_hit(result.track, column) or min(counts) < FEWEST:
        return False
    rates = [
        Rates(np.array([scores[column.key]]), np.array([count]))
        for scores, count in zip(result.scenes.values(), counts, strict=True)
    ]
    return bool(limits_of_rates(rates, _CONFIDENCE)[0, 0] <= floor)


def value_of(method: Scored, score: ScoreColumn, scene: str | None = None) -> float:
    """Return a method's value on a scene, or the unweighted mean over scenes."""
    values = method.result.overall if scene is None else method.result.scenes[scene]
    return values[score.key]


def _best_place(methods: Sequence[Scored], score: ScoreColumn, scene: str | None) -> int:
    """Return the place of the best method by a score, the first of equals."""
    sign = 1 if score.higher_is_better else -1
    return int(np.argmax([sign * value_of(method, score, scene) for method in methods]))


def _find_one(
    methods: Sequence[Scored],
    option: str,
    wanted: str | None,
    score: ScoreColumn,
    scene: str | None,
) -> int:
    """Return the place of the method that all others are compared with."""
    names = [one.name for one in methods]
    if wanted is None or wanted in names:
        return 0 if wanted is None else names.index(wanted)
    if wanted == _BEST:
        return _best_place(methods, score, scene)
    raise UsageError(
        f"{option} {wanted[:80]!r} is no method of these results{nearest(wanted[:80], names)}",
        expected=f"{_BEST}, or one of " + ", ".join(names),
    )


def family_of(names: Sequence[str], reference: str | None) -> int:
    """Count the comparisons of one score for which p is to be corrected."""
    others = len(names) - 1
    is_chosen_by_value = reference == _BEST and _BEST not in names
    return len(names) * others // 2 if is_chosen_by_value else others


def _test_others(
    sample: Sample, places: Sequence[int], family: int, resampling: ResamplingConfig, of_one: bool
) -> Iterator[tuple[int, int, tuple[Interval, PairedTest, float]]]:
    """Test all methods against the one at a place for each score; with Holm's p of a score."""
    count = len(sample.medians) // len(places)
    pairs = [(s * count + m, s * count + p) for s, p in enumerate(places) for m in range(count)]
    pairs = [pair[::-1] if of_one else pair for pair in pairs if pair[0] != pair[1]]
    intervals, tests = paired_tests(sample, resampling, pairs)
    p_values = np.array([test.p_value for test in tests]).reshape(len(places), -1)
    adjusted = [p for row in p_values for p in holm(row, family).tolist()]
    found = zip(intervals, tests, adjusted, strict=True)
    yield from ((*pair, numbers) for pair, numbers in zip(pairs, found, strict=True))


def tied_with_best(
    methods: Sequence[Scored],
    scores: Sequence[ScoreColumn],
    resampling: ResamplingConfig,
    scene: str | None = None,
) -> dict[str, list[bool]]:
    """Say by each score which methods cannot be told from the best, which is one of them.

    p is corrected for all pairs of methods, since the best was chosen for its value.
    """
    count = len(methods)
    best = [_best_place(methods, score, scene) for score in scores]
    tied = np.ones((len(scores), count), np.bool_)
    sample, family = make_sample(methods, scores, scene), count * (count - 1) // 2
    for row, _, (_, _, p_holm) in _test_others(sample, best, family, resampling, of_one=False):
        tied.flat[row] = p_holm > LEVEL
    return {score.key: row.tolist() for score, row in zip(scores, tied, strict=True)}


@dataclass(frozen=True)
class Pair:
    """A method and the reference, by one score.

    Values are of the scene, or the unweighted mean over scenes; the difference, the method's minus
    the reference's, is None where both are infinite. `p_holm` is adjusted for `Comparison.family`;
    `p_mcnemar` is over all queries, and None where the score is no hit. Wins, ties and losses count
    the queries, or scenes, on which the method is better, as good, worse.
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
        """The least p that any values of these units could have; 0 of Student's t."""
        return (
            0.0
            if self.test.kind == "student"
            else float(p_floor(np.array(self.wins + self.losses)))
        )


@dataclass(frozen=True)
class Comparison:
    """All methods against one, score by score, in each the methods in their order.

    The reference is that of every pair, or where `of_one` the `method` of every pair; `unit` is
    what was resampled, "query" or "scene". p was adjusted for `family` comparisons of a score:
    those with the reference, or where it was chosen for being the best, all pairs of methods. The
    methods of `no_better` are no better than chance or the prior; see `floor_note`.
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
        """Return the other method of a pair."""
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
    if method is not None and reference is not None:
        expected = "--method: what NAME is against each other, --reference: they against NAME"
        raise UsageError("--method and --reference exclude each other", expected=expected)
    check_same_queries(methods)
    if scene is not None:
        scene = find_scene(methods[0].result.truth.scene_titles, scene)
    option, wanted = ("--reference", reference) if method is None else ("--method", method)
    base = _find_one(methods, option, wanted, scores[0], scene)
    sample, count = make_sample(methods, scores, scene), len(methods)
    family, of_one = family_of([m.name for m in methods], wanted), method is not None
    pairs = []
    for one, other, found in _test_others(sample, [base] * len(scores), family, resampling, of_one):
        values = [np.concatenate([part[row] for part in sample.values]) for row in (one, other)]
        sides = methods[one % count], methods[other % count]
        pairs.append(_pair(scores[one // count], sides, values, scene, *found))
    names, results = [m.name for m in methods], [m.result for m in methods]
    notes = [f"{method.name}: {note}" for method in methods for note in notes_of(method.result)]
    by_file: dict[str, list[str]] = {}
    for name, result in zip(names, results, strict=True):
        by_file.setdefault(result.predictions.sha256, []).append(name)
    same = [f"{', '.join(who)}: the same predictions file" for who in by_file.values() if who[1:]]
    return Comparison(
        reference=methods[base].name,
        unit=sample.unit,
        units=sum(values.shape[1] for values in sample.values),
        scene=scene,
        pairs=pairs,
        family=family,
        resampling=resampling,
        notes=(*same, *notes, *version_notes(names, results)),
        of_one=of_one,
        no_better=frozenset(m.name for m in methods if floor_note(m.result)),
    )


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
