"""A part of the report: what its page shows of results that measure the same."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.files import canonical_json
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.report import draw
from airzoo_bench.report.chart import marker
from airzoo_bench.report.curves import kept_ranks
from airzoo_bench.report.figures import figure_bytes
from airzoo_bench.report.hardest import hardest, order_said
from airzoo_bench.report.labels import UNITS, arrow, axis_label, error_label, meaning
from airzoo_bench.report.maps import maps
from airzoo_bench.report.numbers import Intervals, breakdowns, intervals, queries
from airzoo_bench.report.overview import draw_intervals
from airzoo_bench.report.packing import Blobs, data_uri
from airzoo_bench.report.places import Place
from airzoo_bench.report.sections import Section
from airzoo_bench.report.standings import compared_pairs, references, standings
from airzoo_bench.results.comparison import FLOOR_MARK, floor_note, is_hit, notes_of
from airzoo_bench.results.result import Result, ScoreColumn
from airzoo_bench.tables.breakdown import condition_title

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["make_part", "part_figures"]


def make_part(
    number: int,
    section: Section,
    places: Sequence[Place],
    pictures: int,
    blobs: Blobs,
    notes: list[str],
) -> dict[str, Any]:
    """Return what the page's script reads of a section."""
    found = intervals(section)
    figures = part_figures(section, found, notes)
    return {
        "id": f"part{number + 1}",
        "byQuery": section.by_query,
        **_names(section),
        "scores": _scores(section),
        "methods": [
            _method(method.name, method.result) | {"marker": marker(number)}
            for number, method in enumerate(section.methods)
        ],
        "notes": _notes(section),
        "settings": list(_flat(section.first.protocol.settings)),
        "standings": standings(section),
        "references": references(section),
        "pairs": compared_pairs(section, blobs),
        "intervals": found.texts(section.headline),
        "breakdowns": breakdowns(section, blobs),
        "queries": queries(section, blobs),
        "figures": [
            {"title": title, "src": data_uri(figure_bytes(figure, "svg"), "image/svg+xml")}
            for title, figure in figures
        ],
        "maps": maps(section, places, blobs, notes),
        "hardest": hardest(section, places, pictures, notes),
        "hardestOrder": order_said(section) if section.by_query else "",
        "tilesLeftOut": section.left_out if places else "",
    }


def _names(section: Section) -> dict[str, Any]:
    first = section.first
    used, truth = first.protocol, first.truth
    return {
        "track": section.track,
        "protocol": {"name": used.name, "version": used.version, "fingerprint": used.fingerprint},
        "truth": {
            "name": truth.benchmark,
            "version": truth.version,
            "fingerprint": truth.fingerprint,
        },
        "scenes": [
            {"id": scene, "title": title, "queries": first.counts[scene]["queries"]}
            for scene, title in truth.scene_titles.items()
        ],
    }


def _scores(section: Section) -> list[dict[str, Any]]:
    shown = {score.key for score in section.query_scores}
    return [
        {
            "key": score.key,
            "title": score.title,
            "heading": f"{score.title} [{UNITS[score.unit]}] {arrow(score)}",
            "headingOfOne": f"{error_label(score)} {arrow(score)}",
            "higher": score.higher_is_better,
            "headline": score.headline,
            "meaning": meaning(section.track, score),
            "ofQueries": score.key in shown,
            "isHit": is_hit(section.track, score),
        }
        for score in section.scores
    ]


def _notes(section: Section) -> list[dict[str, Any]]:
    """Return the notes of all results, each once, with the methods that have it."""
    said: dict[str, list[str]] = {}
    for method in section.methods:
        for note in notes_of(method.result):
            said.setdefault(note, []).append(method.name)
    for name in section.conditions_apart:
        text = f"no scores by {condition_title(name)}: the results have other values of it"
        said[text] = [method.name for method in section.methods]
    return [{"text": text, "methods": names} for text, names in said.items()]


def _method(name: str, result: Result) -> dict[str, Any]:
    used = result.predictions
    return {
        "name": name,
        "mark": f" {FLOOR_MARK}" if floor_note(result) else "",
        "file": used.file,
        "kind": used.kind,
        "sha256": used.sha256,
        "versions": ", ".join(f"{name} {version}" for name, version in result.versions.items()),
        "counts": result.counts,
    }


def _flat(value: Any, key: str = "") -> Iterator[tuple[str, str]]:
    """Yield settings as pairs of a dotted key and a text."""
    if isinstance(value, dict) and value:
        for name, inner in value.items():
            yield from _flat(inner, f"{key}.{name}" if key else str(name))
    else:
        yield key, value if isinstance(value, str) else canonical_json(value)


_MOST_ERRORS = 2


def part_figures(
    section: Section, found: Intervals, notes: list[str]
) -> Iterator[tuple[str, Figure]]:
    """Yield titles and pictures, as the section's track has them."""
    methods, main = section.methods, section.headline[0]
    yield _averages(section, found, main)
    if len(section.first.scenes) > 1:
        yield f"{axis_label(main)} by scene", draw.scenes(methods, main)
    if section.track == "retrieval":
        yield from _recall(section, notes)
    for score in _errors(section):
        title = f"Share of queries below a value of {error_label(score)}"
        yield title, draw.errors(methods, score)
    if draw.threshold_scores(section.first.columns)["f1"]:
        yield "Precision, recall and F1 over the distance d", draw.thresholds(methods)


def _averages(section: Section, found: Intervals, score: ScoreColumn) -> tuple[str, Figure]:
    methods = section.methods
    limits = _limits(section, found, score)
    said = draw.over_what(methods)
    if np.isfinite(limits).any():
        said += " with its 95 % interval"
    values = np.array([method.result.overall[score.key] for method in methods])
    figure = draw_intervals([method.name for method in methods], values, limits, score, said)
    return f"{axis_label(score)}, {said}", figure


def _limits(section: Section, found: Intervals, score: ScoreColumn) -> Floats:
    """Return the limits (M, 2) of a score's intervals, NaN where there are none."""
    none = [None] * len(section.methods)
    limits = [limit or [np.nan, np.nan] for limit in found.overall.get(score.key, none)]
    return np.array(limits, np.float64)


def _recall(section: Section, notes: list[str]) -> Iterator[tuple[str, Figure]]:
    try:
        kept_ranks(section.methods[0])
    except UsageError as error:
        notes.append(f"no picture of recall over K for {section.first.protocol.name}: {error}")
        return
    yield "Recall over the number of tiles looked at", draw.recall(section.methods)


def _errors(section: Section) -> list[ScoreColumn]:
    errors = [score for score in section.query_scores if score.unit != "share"]
    return errors[:_MOST_ERRORS] if section.by_query else []
