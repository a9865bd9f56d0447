"""What pictures call scores and results: titles with units, and the small print."""

from __future__ import annotations

from collections.abc import Sequence

from airzoo_bench.core.errors import first_of
from airzoo_bench.core.plurals import counted
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.report.figures import name_text
from airzoo_bench.results.records import Scored
from airzoo_bench.results.result import ScoreColumn

__all__ = [
    "UNITS",
    "arrow",
    "axis_label",
    "error_label",
    "over_scenes",
    "shown_value",
    "small_print",
    "spans_decades",
    "who",
]

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
    """Point to where a score is better."""
    return "↑" if score.higher_is_better else "↓"


def shown_value(score: ScoreColumn, values: Floats) -> Floats:
    """Turn shares into percent; other values stay."""
    scaled: Floats = values * (100.0 if score.unit == "share" else 1.0)
    return scaled


def spans_decades(score: ScoreColumn, finite: Floats) -> bool:
    """Whether an axis of these errors goes by powers of ten; shares never do."""
    if score.unit == "share" or not len(finite):
        return False
    return bool(0 < finite.min() < finite.max() / _DECADES)


def over_scenes(methods: Sequence[Scored]) -> str:
    """Say that values are means over scenes, where there are several."""
    return ", mean over scenes" if len(methods[0].result.scenes) > 1 else ""


def small_print(methods: Sequence[Scored]) -> str:
    """Say what a picture is of, wherever it is found: benchmark, protocol, queries, scenes."""
    result = methods[0].result
    truth, protocol = result.truth, result.protocol
    titles = list(truth.scene_titles.values())
    scenes = f"scene {titles[0]}" if len(titles) == 1 else counted(len(titles), "scene")
    measured = scenes
    if result.track != "reconstruction":
        measured = f"{counted(len(methods[0].records), 'query')} in {scenes}"
    used = f"protocol {protocol.name}, version {protocol.version}"
    return f"benchmark {truth.benchmark}, version {truth.version}; {used}: {measured}"


def who(names: Sequence[str]) -> str:
    """List names, of many the first few."""
    names = [name_text(name) for name in names]
    return ", ".join(names) if len(names) <= _NAMED else first_of(names)
