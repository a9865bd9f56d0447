"""Who is best, and who cannot be told from the best: decided here once for all views of a part."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from airzoo_bench.report.chart import tints
from airzoo_bench.report.packing import Blobs
from airzoo_bench.report.sections import Section
from airzoo_bench.results.comparison import AgainstBest, Pair, against_best, compare
from airzoo_bench.results.result import ScoreColumn
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.statistics.significance import LEVEL, holm
from airzoo_bench.tables.comparison import LEAST_P, sentence, verdict
from airzoo_bench.tables.intervals import score_cell, score_texts, score_title
from airzoo_bench.tables.marks import best_texts
from airzoo_bench.tables.method_table import as_shown, score_column, shared_references
from airzoo_bench.tables.model import Cell, share_to_percent, show_number

__all__ = [
    "BEST",
    "TIED",
    "compared_pairs",
    "marks_of",
    "references",
    "standings",
    "test_plan",
]

BEST, TIED = "best", "tied"

_RESAMPLES = 10_000
_WORK = 2.5e9  # resampled values: some seconds
_FINEST = 40  # resamples a comparison, so that a corrected p can still be a finding

_Row = Sequence[float | None]


@dataclass(frozen=True)
class _Tests:
    """Tests against the best: by scope and score; without any, the reason."""

    overall: Mapping[str, AgainstBest]
    scenes: Mapping[str, Mapping[str, AgainstBest]]
    note: str


def standings(section: Section) -> dict[str, Any]:
    """Return every score by method, over scenes, pooled and by scene: value, text and mark."""
    found, tests = _averages(section), _tests(section)
    by_scene = np.array(found["perScene"], np.float64)
    by_score = [tints(score, by_scene[..., n]) for n, score in enumerate(section.scores)]
    return {
        "overall": _scope(section, found["overall"], tests.overall),
        "pooled": _scope(section, found["pooled"], {}),
        "perScene": [
            _scope(section, values, tests.scenes.get(scene, {}))
            for scene, values in zip(section.first.scenes, found["perScene"], strict=True)
        ],
        "tints": np.stack(by_score, axis=-1),
        "note": tests.note,
    }


def test_plan(section: Section, comparisons: int) -> ResamplingConfig | None:
    """Return a plan whose resamples suffice for so many comparisons of a score."""
    count = len(section.methods)
    resamples = max(_RESAMPLES, _FINEST * count * (count - 1) // 2)
    values = comparisons * len(section.headline) * len(section.methods[0].records)
    return ResamplingConfig(resamples) if values * resamples <= _WORK else None


def _tests(section: Section) -> _Tests:
    if len(section.methods) < 2:
        return _Tests({}, {}, "")
    plan = test_plan(section, 2 * len(section.methods))
    if plan is None:
        return _Tests({}, {}, "no tests against the best: there are too many queries and methods")
    methods, scores = section.methods, section.headline
    scenes = section.first.scenes if section.by_query else ()
    return _Tests(
        against_best(methods, scores, plan),
        {scene: against_best(methods, scores, plan, scene) for scene in scenes},
        f"≈ marks what a paired test does not tell from the best (p above "
        f"{share_to_percent(LEVEL):g} % after Holm's correction for all pairs of methods, "
        f"{plan.resamples} resamples, seed {plan.seed}), of the paper's scores; pooled values are "
        "not tested" + ("" if section.by_query else ", nor are single scenes"),
    )


def _averages(section: Section) -> dict[str, Any]:
    """Return every score by method: over scenes, over all queries, and of each scene."""
    keys = [score.key for score in section.scores]
    results = [method.result for method in section.methods]
    return {
        "overall": [[result.overall[key] for key in keys] for result in results],
        "pooled": [[result.pooled[key] for key in keys] for result in results],
        "perScene": [
            [[result.scenes[scene][key] for key in keys] for result in results]
            for scene in section.first.scenes
        ],
    }


def _scope(
    section: Section, values: Sequence[Sequence[float]], tests: Mapping[str, AgainstBest]
) -> dict[str, Any]:
    columns = [
        marks_of(score, [row[place] for row in values], tests.get(score.key))
        for place, score in enumerate(section.scores)
    ]
    return {
        "values": values,
        "texts": _texts(section, values),
        "marks": [list(row) for row in zip(*columns, strict=True)],
        "tested": bool(tests),
    }


def _texts(section: Section, rows: Sequence[_Row]) -> list[list[str]]:
    columns = [
        score_texts(score, [row[place] for row in rows])
        for place, score in enumerate(section.scores)
    ]
    return [list(row) for row in zip(*columns, strict=True)]


def marks_of(score: ScoreColumn, values: _Row, tests: AgainstBest | None = None) -> list[str]:
    """Mark a score's values by method: the best ones by the digits shown, and who ties with them.

    One method by itself has no mark.
    """
    column = score_column(score)
    cells = [score_cell(score, value) for value in values]
    best = best_texts(column, cells)[:1]
    if not best or len(values) < 2:
        return [""] * len(values)
    tied = tests.tied if tests else [False] * len(values)
    texts = [cell.text(column.decimals) for cell in cells]
    return [
        BEST if text == best[0] else TIED if is_tied else ""
        for text, is_tied in zip(texts, tied, strict=True)
    ]


def references(section: Section) -> list[dict[str, Any]]:
    """Return what scores without a method, in the scopes of `standings`, without marks."""
    found, _ = shared_references([method.result for method in section.methods])

    def scope(part: Mapping[str, float]) -> dict[str, Any]:
        values = [part.get(score.key) for score in section.scores]
        return {"values": values, "texts": _texts(section, [values])[0]}

    return [
        {
            "name": name,
            "meaning": reference.meaning,
            "overall": scope(reference.overall),
            "pooled": scope(reference.pooled),
            "perScene": [scope(reference.scenes[scene]) for scene in section.first.scenes],
        }
        for name, reference in found.items()
    ]


def compared_pairs(section: Section, blobs: Blobs) -> dict[str, Any] | None:
    """Pack the paired tests of every two methods by the paper's scores; None with one method."""
    count = len(section.methods)
    while count > 1 and test_plan(section, count * count) is None:
        count -= 1
    plan = test_plan(section, count * count)
    if count < 2 or plan is None:
        return None
    found = [_later(section, count, place, plan) for place in range(count - 1)]
    return {
        "count": count,
        "resamples": plan.resamples,
        "pairs": blobs.json(_corrected(found, plan, len(section.methods))),
    }


def _later(section: Section, count: int, place: int, plan: ResamplingConfig) -> list[list[Pair]]:
    """Compare a method with each one behind it: by score, then by method."""
    methods = section.methods[place:count]
    made = compare(methods, section.headline, reference=methods[0].name, resampling=plan)
    step = len(methods) - 1
    return [made.pairs[at : at + step] for at in range(0, len(made.pairs), step)]


def _corrected(
    found: Sequence[list[list[Pair]]], plan: ResamplingConfig, methods: int
) -> list[Any]:
    """Correct each pair among those of its better method, as `compare` does for the best."""
    family = methods * (methods - 1) // 2
    shown: list[Any] = [[[] for _ in rows[0]] for rows in found]
    for score in range(len(found[0])):
        p_values = np.ones((len(found) + 1, len(found) + 1))
        for one, rows in enumerate(found):
            for step, pair in enumerate(rows[score], one + 1):
                p_values[one, step] = p_values[step, one] = pair.test.p_value
        for one, rows in enumerate(found):
            for step, pair in enumerate(rows[score], one + 1):
                better, other = (step, one) if pair.is_better else (one, step)
                row = holm(np.delete(p_values[better], better), family)
                p_holm = float(row[other - (other > better)])
                shown[one][step - one - 1].append(_pair_values(replace(pair, p_holm=p_holm), plan))
    return shown


def _pair_values(pair: Pair, plan: ResamplingConfig) -> dict[str, Any]:
    score = pair.score
    difference, low, high = pair.difference, pair.interval.low, pair.interval.high
    limits = [] if low is None or high is None else [as_shown(score, low), as_shown(score, high)]
    return {
        "score": score_title(score),
        "values": [
            score_cell(score, value).text(2) for value in (pair.reference_value, pair.value)
        ],
        "difference": "–"
        if difference is None
        else show_number(as_shown(score, difference), 2, "+"),
        "interval": " to ".join(show_number(limit, 2, "+") for limit in limits)
        or f"none: {pair.interval.reason}",
        "p": Cell(pair.test.p_value, least=LEAST_P).text(4),
        "pHolm": Cell(pair.p_holm, least=LEAST_P).text(4),
        "verdict": verdict(pair),
        "sentence": sentence(pair, plan),
    }
