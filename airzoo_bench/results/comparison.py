"""Methods compared: on the same queries, by samples, with references, the best, and by tests."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from airzoo_bench.core.errors import ResultError, UsageError, counted, first_of
from airzoo_bench.core.validation import nearest
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.results.result import Reference, Result, ScoreColumn
from airzoo_bench.statistics.intervals import (
    FEWEST,
    Interval,
    Rates,
    SampleIntervals,
    limits_of_rates,
    sample_intervals,
)
from airzoo_bench.statistics.samples import TIE, ResamplingConfig, Sample, paired_difference
from airzoo_bench.statistics.significance import (
    LEVEL,
    PairedTest,
    holm,
    mcnemar,
    p_floor,
    paired_tests,
)

if TYPE_CHECKING:  # records need pandas, which tables of results do without
    from airzoo_bench.results.records import Method

FLOOR_MARK = "‡"  # behind the name of a method that is no better than chance or its prior
_NO_BETTER = "no better than {}, which has {}"
_UNSURE = f"{_NO_BETTER}: the method's 95 % interval reaches that"
GUESS = ": weak, or reversed ranks (distances as similarities)?"  # for the author, not for papers
_WORSE = "worse than {}, which has {}" + GUESS
_BEST = "best"
_SAME_FOLDER = "score all predictions again with the same benchmark folder"
# How the columns of scores begin that say of a query whether it is answered well enough.
_HITS = {"retrieval": ("recall@", "distance<", "ma@"), "matching": ("within_",)}


def is_hit(track: str, score: ScoreColumn) -> bool:
    """Whether a score is 0 or 1 for each query by its definition, whatever its values are."""
    return score.unit == "share" and score.key.startswith(_HITS.get(track, ()))


def is_share(score: ScoreColumn) -> bool:
    """Whether a score is a mean of shares from 0 to 1."""
    return score.unit == "share" and score.average == "mean"


# --- scenes and scores by name, and whether results measure the same ---


def find_scene(titles: Mapping[str, str], wanted: str) -> str:
    """Return the id of a scene that is named by id or title; an id goes before a title."""
    found = [wanted] if wanted in titles else [s for s, title in titles.items() if title == wanted]
    if len(found) == 1:
        return found[0]
    near = nearest(wanted, list(dict.fromkeys([*titles, *titles.values()])))
    none = f"there is no scene {wanted!r} in the results{near}"
    what = f"{len(found)} scenes have the title {wanted!r}" if found else none
    raise ResultError(what, expected="one of " + ", ".join(found or titles))


def scores_by_name(scores: Iterable[ScoreColumn]) -> dict[str, ScoreColumn]:
    """Return scores by key and by title, as people name them."""
    listed = list(scores)
    return {score.key: score for score in listed} | {score.title: score for score in listed}


def check_score(name: str, scores: Sequence[ScoreColumn], option: str) -> None:
    """Refuse the name of a score that is none of these."""
    known = scores_by_name(scores)
    if name not in known:
        # Titles hold commas, such as @1m,1°.
        titles = "; ".join(dict.fromkeys(score.title for score in scores))
        what = f"no score of all results is called {name[:80]!r}{nearest(name[:80], list(known))}"
        raise UsageError(what, where=option, expected=f"one of: {titles}")


def choose_scores(
    methods: Sequence[Method], wanted: Sequence[str], *, every: bool = False
) -> list[ScoreColumn]:
    """Find scores by key or title; where none is wanted, the headline ones that all have."""
    shared = [c for c in methods[0].result.columns if all(c in m.result.columns for m in methods)]
    if not wanted:
        found = [column for column in shared if every or column.headline]
        if not found:
            fix = "score all predictions again with the same version and protocol"
            raise ResultError("the results have no score in common", fix=fix)
        return found
    for name in wanted:
        check_score(name, shared, "--score")
    return list(dict.fromkeys(scores_by_name(shared)[name] for name in wanted))


def score_keys(result: Result, wanted: Sequence[str], *, every: bool = False) -> set[str]:
    """Return the keys of the scores that `choose_scores` can choose, before records are read."""
    return {
        column.key
        for column in result.columns
        if every or {column.key, column.title} & set(wanted) or (not wanted and column.headline)
    }


def check_comparable(names: Sequence[str], results: Sequence[Result]) -> None:
    """Refuse results of different protocols or truths."""
    first = results[0]
    for name, other in zip(names[1:], results[1:], strict=True):
        both, one, two = f"{names[0]} and {name}", first.protocol, other.protocol
        if two.fingerprint != one.fingerprint:
            said = f"{one.name} v{one.version} against {two.name} v{two.version}"
            said += f"; {other_settings(one.settings, two.settings)}" * (one.name == two.name)
            what = f"{both} were made with different protocols: {said}"
            fix = "score all predictions with the same --protocol, or name results of one only"
            raise ResultError(what, fix=fix)
        if other.truth.fingerprint != first.truth.fingerprint:
            prints = f"{first.truth.fingerprint[:12]} and {other.truth.fingerprint[:12]}"
            what = f"{both} were compared with different truths ({prints})"
            raise ResultError(f"{what} of {first.truth.benchmark}", fix=_SAME_FOLDER)


def other_settings(one: Mapping[str, Any], two: Mapping[str, Any]) -> str:
    """List the first settings in which two protocols differ."""

    def flatten(settings: Mapping[str, Any], section: str = "") -> Iterator[tuple[str, str]]:
        for key, value in settings.items():
            if isinstance(value, Mapping):
                yield from flatten(value, f"{section}{key}.")
            else:
                yield f"{section}{key}", str(value)[:60]

    first, second = dict(flatten(one)), dict(flatten(two))
    sides = {key: (first.get(key, "absent"), second.get(key, "absent")) for key in first | second}
    unlike = [f"{key} is {one} against {two}" for key, (one, two) in sides.items() if one != two]
    more = f" and {len(unlike) - 3} more" if len(unlike) > 3 else ""
    return "; ".join(unlike[:3]) + more


def check_same_queries(methods: Sequence[Method]) -> None:
    """Refuse results of different protocols, truths or queries."""
    check_comparable([m.name for m in methods], [m.result for m in methods])
    first = methods[0]
    for other in methods[1:]:
        one, two = ({*m.records["query"]} for m in (first, other))
        if one != two:
            both = f"{first.name} and {other.name} are not on the same queries"
            lonely = first_of(sorted(one ^ two), len(one | two))
            raise ResultError(f"{both}; not in both: {lonely}", fix=_SAME_FOLDER)


def same_in_all(methods: Sequence[Method], column: str) -> bool:
    """Whether all methods, on the same queries, have the same values in a column."""
    own = methods[0].records[column]
    return all(column in m.records and own.equals(m.records[column]) for m in methods)


def check_same_column(methods: Sequence[Method], by: str) -> None:
    """Refuse to put all methods' queries into groups that one of them made."""
    if by in methods[0].records and not same_in_all(methods, by):
        what = f"--by {by}: the results have other values of it"
        raise UsageError(what, expected="a condition of the queries", fix="name one result")


# --- one method ---


def make_sample(
    methods: Sequence[Method], scores: Sequence[ScoreColumn], scene: str | None = None
) -> Sample:
    """Gather variables, score by score and in each method by method."""
    whole = pooled_sample(methods, scores)
    [values], of_unit = whole.values, methods[0].records["scene"].to_numpy(str)
    if whole.unit == "scene":
        return whole if scene is None else replace(whole, values=(values[:, of_unit == scene],))
    scenes = tuple(name for name in methods[0].result.scenes if scene in (None, name))
    parts = tuple(np.ascontiguousarray(values[:, of_unit == name]) for name in scenes)
    return replace(whole, groups=scenes, values=parts)


def pooled_sample(methods: Sequence[Method], scores: Sequence[ScoreColumn]) -> Sample:
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
    method: Method,
    scores: Sequence[ScoreColumn],
    resampling: ResamplingConfig,
    scene: str | None = None,
) -> SampleIntervals:
    """Take the interval of every score, of each scene and of the mean over scenes."""
    sample = make_sample([method], scores, scene)
    found = sample_intervals(sample, resampling)
    return found if sample.unit == "query" else replace(found, groups={})


def value_of(method: Method, score: ScoreColumn, scene: str | None = None) -> float:
    """Return a method's value on a scene, or the unweighted mean over scenes."""
    return (method.result.overall if scene is None else method.result.scenes[scene])[score.key]


def notes_of(result: Result, wanted: Sequence[str] = ()) -> tuple[str, ...]:
    """Return the notes of a result and `floor_note`, where there is one."""
    return (*result.notes, *filter(None, [floor_note(result, wanted)]))


def floor_note(result: Result, wanted: Sequence[str] = ()) -> str:
    """Name the headline scores, if any are `wanted` of these, that do not beat the references."""
    parts: dict[tuple[str, str], list[str]] = {}
    for name, reference in result.references.items():
        for column in result.columns:
            best = float(column.higher_is_better)  # all hits or no error, which nothing beats
            floor = reference.overall.get(column.key, best)
            is_asked = not wanted or {column.key, column.title} & set(wanted)
            if column.headline and is_asked and abs(floor - best) > TIE:
                said = _compare_with_floor(result, reference, column)
                floor *= 100 if column.unit == "share" else 1
                parts.setdefault((said, name), []).append(f"{column.title} {floor:.2f}")
    notes = [said.format(name, ", ".join(found)) for (said, name), found in parts.items() if said]
    return f"{FLOOR_MARK} {'; '.join(notes)}" if notes else ""


def _compare_with_floor(result: Result, reference: Reference, column: ScoreColumn) -> str:
    value, floor = result.overall[column.key], reference.overall[column.key]
    if result.track != "retrieval":
        return _NO_BETTER * (value == floor or (value < floor) == column.higher_is_better)
    counts = [float(part["queries"]) for part in result.counts.values()]
    if not is_hit(result.track, column) or min(counts) < FEWEST:
        return ""
    rates = [
        Rates(np.array([scores[column.key]]), np.array([count]))
        for scores, count in zip(result.scenes.values(), counts, strict=True)
    ]
    low, high = limits_of_rates(rates, 0.95)[0]
    return _WORSE if high < floor else _UNSURE * bool(low <= floor)


# --- several methods ---


@dataclass(frozen=True)
class Pair:
    """A method and the one that it is compared with, its `reference`, by one score.

    The difference, the method's minus the reference's, is None where both are infinite. `p_holm` is
    adjusted for `MethodComparison.family`; `p_mcnemar` is over all queries, None where the score
    is no hit. Wins, ties and losses count queries, or scenes; `untested` is why there is no test.
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
    untested: str = ""


@dataclass(frozen=True)
class MethodComparison:
    """All methods against one, the `reference`, by score and in each in the order of methods.

    `unit` is what was resampled, "query" or "scene"; p was adjusted for `family` comparisons of a
    score. The methods of `no_better` are no better than chance or the prior; see `floor_note`.
    """

    reference: str
    unit: str
    units: int
    scene: str | None
    pairs: list[Pair]
    family: int
    resampling: ResamplingConfig
    notes: tuple[str, ...]
    no_better: frozenset[str] = frozenset()


def compare(
    methods: Sequence[Method],
    scores: Sequence[ScoreColumn],
    *,
    reference: str | None = None,
    scene: str | None = None,
    resampling: ResamplingConfig,
) -> MethodComparison:
    """Compare methods with a `reference` among them: a name, "best", or None for the first."""
    check_same_queries(methods)
    if scene is not None:
        scene = find_scene(methods[0].result.truth.scene_titles, scene)
    names, count, base = [m.name for m in methods], len(methods), 0
    if reference in names:
        base = names.index(reference)
    elif reference == _BEST:
        base = _best_of(methods, scores[0], scene)
    elif reference is not None:
        what = f"--reference {reference[:80]!r} is no method here{nearest(reference[:80], names)}"
        raise UsageError(what, expected=f"{_BEST}, or one of " + ", ".join(names))
    sample, pairs, family = make_sample(methods, scores, scene), [], count - 1
    wanted = [score.key for score in scores]
    if reference == _BEST and _BEST not in names:  # all pairs were looked at
        family = count * (count - 1) // 2
    for one, other, found in _test_others(sample, [base] * len(scores), family, resampling):
        values = [np.concatenate([part[row] for part in sample.values]) for row in (one, other)]
        sides = methods[one % count], methods[other % count]
        pairs.append(_pair(scores[one // count], sides, values, scene, *found))
    return MethodComparison(
        reference=names[base],
        unit=sample.unit,
        units=sum(values.shape[1] for values in sample.values),
        scene=scene,
        pairs=pairs,
        family=family,
        resampling=resampling,
        notes=tuple(f"{m.name}: {note}" for m in methods for note in notes_of(m.result, wanted)),
        no_better=frozenset(m.name for m in methods if floor_note(m.result, wanted)),
    )


def why_untested(test: PairedTest, unit: str, units: int) -> str:
    """Say why a test of this number of units finds nothing; empty where it could."""
    if test.kind == "student" or (test.patterns and p_floor(units) <= LEVEL):
        return ""
    if not test.patterns:
        return f"no test is possible where a scene has fewer than {FEWEST} queries"
    needed = FEWEST + (unit == "query" or units >= FEWEST)  # Student's t needs the fewest
    return f"{counted(units, unit)}: no test is possible ({needed} are needed)"


def tied_with_best(
    methods: Sequence[Method],
    scores: Sequence[ScoreColumn],
    resampling: ResamplingConfig,
    scene: str | None = None,
) -> dict[str, list[bool]]:
    """Say by score which methods a test of the two alone, as on boards, finds like the best."""
    best = [_best_of(methods, score, scene) for score in scores]
    tied = np.ones((len(scores), len(methods)), np.bool_)
    sample = make_sample(methods, scores, scene)
    units = sum(part.shape[1] for part in sample.values)
    for row, _, (_, test, _) in _test_others(sample, best, 0, resampling):
        tied.flat[row] = test.p_value > LEVEL and not why_untested(test, sample.unit, units)
    return {score.key: row.tolist() for score, row in zip(scores, tied, strict=True)}


def _best_of(methods: Sequence[Method], score: ScoreColumn, scene: str | None) -> int:
    """Return the number of the best method by a score, the first of equals."""
    sign = 1 if score.higher_is_better else -1
    return int(np.argmax([sign * value_of(method, score, scene) for method in methods]))


def _test_others(
    sample: Sample, bases: Sequence[int], family: int, resampling: ResamplingConfig
) -> Iterator[tuple[int, int, tuple[Interval, PairedTest, float]]]:
    """Test for each score all methods against the one of a number; with Holm's p of a score."""
    count = len(sample.medians) // len(bases)
    numbered = [(number * count, base) for number, base in enumerate(bases)]
    pairs = [(first + m, first + base) for first, base in numbered for m in range(count)]
    pairs = [pair for pair in pairs if pair[0] != pair[1]]
    intervals, tests = paired_tests(sample, resampling, pairs)
    p_values = np.array([test.p_value for test in tests]).reshape(len(bases), -1)
    adjusted = [p for row in p_values for p in holm(row, family).tolist()]
    found = zip(intervals, tests, adjusted, strict=True)
    yield from ((*pair, numbers) for pair, numbers in zip(pairs, found, strict=True))


def _pair(
    score: ScoreColumn,
    sides: tuple[Method, Method],
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
    return Pair(
        score=score,
        method=method.name,
        reference=base.name,
        value=value,
        reference_value=base_value,
        difference=None if both_infinite else 0.0 if equal else value - base_value,
        interval=Interval(reason="both are infinite") if both_infinite else interval,
        test=test,
        p_holm=p_holm,
        p_mcnemar=float(mcnemar(wins, losses)) if is_hit(method.result.track, score) else None,
        wins=wins,
        ties=len(ahead) - wins - losses,
        losses=losses,
        untested=why_untested(test, method.result.unit, len(ahead)),
    )
