"""Names of scores with units, what they mean, and the small print of pictures."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from importlib import resources

from airzoo_bench.core.errors import counted, first_of
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.report.figures import Sheet, name_text
from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import ScoreColumn

UNITS = {"share": "%", "m": "m", "deg": "°"}
# Tables have room for a word; a picture found alone must say what was measured.
_ERRORS = {
    "error_m": "translation error",
    "horizontal_m": "horizontal error",
    "vertical_m": "vertical error",
    "rotation_deg": "rotation error",
    "distance_m": "distance of the first tile",
    "chamfer_m": "Chamfer distance",
    "accuracy_m": "accuracy",
    "completeness_m": "completeness",
}
_NAMED = 6
_DECADES = 100.0


def error_label(score: ScoreColumn) -> str:
    """Name what one query or scene has, with its unit: ``translation error [m]``."""
    return f"{_ERRORS.get(score.key, score.title)} [{UNITS[score.unit]}]"


def axis_label(score: ScoreColumn) -> str:
    """Name a score with its unit: ``R@1 [%]``, ``median translation error [m]``."""
    is_median = score.average == "median" and score.key in _ERRORS
    return f"median {error_label(score)}" if is_median else error_label(score)


def arrow(score: ScoreColumn) -> str:
    """Return the arrow that says which direction is better."""
    return "↑" if score.higher_is_better else "↓"


def heading(score: ScoreColumn) -> str:
    """Head a column of a score: title, unit, and which direction is better."""
    return f"{score.title} [{UNITS[score.unit]}] {arrow(score)}"


def shown_value(score: ScoreColumn, values: Floats) -> Floats:
    """Return shares as percent; other values unchanged."""
    scaled: Floats = values * (100.0 if score.unit == "share" else 1.0)
    return scaled


def spans_decades(score: ScoreColumn, finite: Floats) -> bool:
    """Return whether the values are errors that span decades, and need a logarithmic axis."""
    if score.unit == "share" or not len(finite):
        return False
    return bool(0 < finite.min() < finite.max() / _DECADES)


def over_scenes(methods: Sequence[Scored]) -> str:
    """Return what labels add if values are means over several scenes."""
    return ", mean over scenes" if len(methods[0].result.scenes) > 1 else ""


def noted(methods: Sequence[Scored], sheet: Sheet | None) -> Sheet:
    """Return the sheet, or a new one; its small print begins with where the numbers come from."""
    given = sheet or Sheet()
    return replace(given, notes=(_small_print(methods), *given.notes))


def _small_print(methods: Sequence[Scored]) -> str:
    """Say where a picture's numbers come from: benchmark, protocol, queries, scenes."""
    result = methods[0].result
    truth, protocol = result.truth, result.protocol
    titles = list(truth.scene_titles.values())
    scenes = f"scene {titles[0]}" if len(titles) == 1 else counted(len(titles), "scene")
    measured = scenes
    if result.unit == "query":
        measured = f"{counted(len(methods[0].records), 'query')} in {scenes}"
    used = f"protocol {protocol.name}, version {protocol.version}"
    return f"benchmark {truth.benchmark}, version {truth.version}; {used}: {measured}"


def who(names: Sequence[str], between: str = ", ") -> str:
    """List names; only the first few of many."""
    names = [name_text(name) for name in names]
    return between.join(names) if len(names) <= _NAMED else first_of(names)


@cache
def _meanings() -> dict[str, dict[str, str]]:
    text = resources.files("airzoo_bench.report").joinpath("meanings.toml").read_text("utf-8")
    return tomllib.loads(text)


def meaning(track: str, score: ScoreColumn) -> str:
    """Explain a score in a few words; empty for a score that is not known here."""
    for pattern, words in _meanings().get(track, {}).items():
        if found := re.fullmatch(pattern, score.key):
            return words.format(*found.groups())
    return ""
