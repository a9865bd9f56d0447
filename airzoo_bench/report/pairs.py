"""Every two methods of a part, compared in pairs: for a reader to pick two."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from airzoo_bench.report.packing import Blobs
from airzoo_bench.report.sections import Section
from airzoo_bench.report.standings import test_plan
from airzoo_bench.results.comparison import Pair, compare
from airzoo_bench.statistics.samples import ResamplingConfig
from airzoo_bench.statistics.significance import holm
from airzoo_bench.tables.method_table import as_shown
from airzoo_bench.tables.model import Cell, show_number
from airzoo_bench.tables.verdicts import LEAST_P, sentence, verdict
from airzoo_bench.tables.wording import score_cell, score_title

__all__ = ["compared_pairs"]


def compared_pairs(section: Section, blobs: Blobs) -> dict[str, Any] | None:
    """Pack the paired tests of every two methods by the paper's scores; None with one method.

    With very many methods and queries only the first ones, which are the best, are compared.

    Returns
    -------
    dict or None
        ``count``, so many of the first methods are compared; and the blob ``pairs``: of each
        method a list of the later ones, of each of these a list of scores.
    """
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
                shown[one][step - one - 1].append(_shown(replace(pair, p_holm=p_holm), plan))
    return shown


def _shown(pair: Pair, plan: ResamplingConfig) -> dict[str, Any]:
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
