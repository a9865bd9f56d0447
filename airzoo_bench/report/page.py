"""The report: one page that holds everything it shows."""

from __future__ import annotations

import base64
import hashlib
import html
import re
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import airzoo_bench
from airzoo_bench.errors import UserError
from airzoo_bench.files import canonical_json
from airzoo_bench.geometry.arrays import Floats
from airzoo_bench.progress import Progress, silent
from airzoo_bench.report import draw
from airzoo_bench.report.curves import axis_label, threshold_scores
from airzoo_bench.report.figures import figure_bytes
from airzoo_bench.report.hardest import hardest, order_said
from airzoo_bench.report.labels import error_label
from airzoo_bench.report.maps import maps
from airzoo_bench.report.numbers import Intervals, averages, breakdowns, intervals, queries
from airzoo_bench.report.overview import draw_intervals
from airzoo_bench.report.packing import Blobs, data_uri, page_json
from airzoo_bench.report.places import Place, find_places
from airzoo_bench.report.sections import Section, read_sections
from airzoo_bench.result import Result, ScoreColumn
from airzoo_bench.tables.build import methods_table
from airzoo_bench.tables.render import render

if TYPE_CHECKING:
    from collections.abc import Iterator

    from matplotlib.figure import Figure

__all__ = ["Report", "make_report"]

_SCRIPTS = (
    *("core.js", "links.js", "views.js", "chart.js", "hardest.js", "queries.js", "tiles.js"),
    *("map.js", "main.js"),
)
_TITLE = "Results"
_MOST_ERRORS = 2


class Report:
    """A page and what its maker should be told.

    Attributes
    ----------
    page : str
        HTML that needs no other file and no network.
    notes : list of str
        What was left out, and why.
    """

    def __init__(self, page: str, notes: list[str]) -> None:
        self.page = page
        self.notes = notes


def make_report(
    paths: Sequence[Path],
    *,
    data: Path,
    data_was_named: bool = False,
    title: str = _TITLE,
    pictures: int = 12,
    jobs: int = 1,
    progress: Progress = silent,
) -> Report:
    """Make the report of results.

    Parameters
    ----------
    paths : sequence of Path
        Of result files; results that measure the same share a section.
    data : Path
        Where benchmark folders are found, for maps and pictures.
    data_was_named : bool
        Whether a missing benchmark folder is an error; otherwise maps and pictures are left out.
    title : str
    pictures : int
        How many of the hardest queries each section shows.
    jobs : int
        Processes that read large records.
    progress : Progress

    Raises
    ------
    ResultError
        See `airzoo_bench.report.sections.read_sections`.
    BenchmarkError
        The folder that was named is not that of any of the results.
    """
    sections = read_sections(paths, jobs)
    blobs, notes = Blobs(), list[str]()
    places = [_places(section, data, notes) for section in sections]
    if data_was_named and notes and not any(places):
        find_places(sections[0], data)
    parts = [
        _section(number, section, found, pictures, blobs, notes)
        for number, (section, found) in progress(
            enumerate(zip(sections, places, strict=True)), "sections", len(sections)
        )
    ]
    results = [[method.result for method in section.methods] for section in sections]
    return Report(_page(title, parts, results, blobs), notes)


def _places(section: Section, data: Path, notes: list[str]) -> list[Place]:
    try:
        return find_places(section, data)
    except UserError as error:
        notes.append(f"no maps and pictures for {section.first.protocol.name}: {error}")
        return []


def _section(
    number: int,
    section: Section,
    places: Sequence[Place],
    pictures: int,
    blobs: Blobs,
    notes: list[str],
) -> dict[str, Any]:
    first, found = section.first, intervals(section)
    shown = {score.key for score in section.query_scores}
    return {
        "id": f"part{number + 1}",
        "track": section.track,
        "byQuery": section.by_query,
        "protocol": {
            "name": first.protocol.name,
            "version": first.protocol.version,
            "fingerprint": first.protocol.fingerprint,
        },
        "truth": {
            "name": first.truth.benchmark,
            "version": first.truth.version,
            "fingerprint": first.truth.fingerprint,
        },
        "scenes": [
            {"id": scene, "title": title, "queries": first.counts[scene]["queries"]}
            for scene, title in first.truth.scene_titles.items()
        ],
        "scores": [
            {
                "key": score.key,
                "title": score.title,
                "unit": score.unit,
                "higher": score.higher_is_better,
                "headline": score.headline,
                "ofOne": error_label(score),
                "ofQueries": score.key in shown,
            }
            for score in section.scores
        ],
        "methods": [_method(method.name, method.result) for method in section.methods],
        "notes": _notes(section),
        "settings": list(_flat(first.protocol.settings)),
        "averages": averages(section),
        "intervals": {"overall": found.overall, "scenes": found.scenes, "note": found.note},
        "breakdowns": breakdowns(section, blobs),
        "queries": queries(section, blobs),
        "figures": [
            {"title": title, "src": data_uri(figure_bytes(figure, "svg"), "image/svg+xml")}
            for title, figure in _figures(section, found)
        ],
        "maps": maps(section, places, blobs, notes),
        "hardest": hardest(section, places, pictures, notes),
        "hardestOrder": order_said(section) if section.by_query else "",
        "tilesLeftOut": section.left_out if places else "",
    }


def _notes(section: Section) -> list[dict[str, Any]]:
    """Return what results note, once where several say the same, and which methods do."""
    said: dict[str, list[str]] = {}
    for method in section.methods:
        for note in method.result.notes:
            said.setdefault(note, []).append(method.name)
    return [{"text": text, "methods": names} for text, names in said.items()]


def _method(name: str, result: Result) -> dict[str, Any]:
    used = result.predictions
    return {
        "name": name,
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


def _figures(section: Section, found: Intervals) -> Iterator[tuple[str, Figure]]:
    methods, main = section.methods, section.headline[0]
    limits = _limits(section, found, main)
    interval = " with its 95 % interval" if np.isfinite(limits).any() else ""
    title = f"average over scenes{interval}"
    values = np.array([method.result.overall[main.key] for method in methods])
    names = [method.name for method in methods]
    yield f"{axis_label(main)}, {title}", draw_intervals(names, values, limits, main, title)
    if len(section.first.scenes) > 1:
        yield f"{axis_label(main)} by scene", draw.scenes(methods, main)
    if section.track == "retrieval":
        yield "Recall over the number of tiles looked at", draw.recall(methods)
    for score in _errors(section):
        title = f"Share of queries below a value of {error_label(score)}"
        yield title, draw.errors(methods, score)
    if threshold_scores(section.first.columns)["f1"]:
        yield "Precision, recall and F1 over the distance d", draw.thresholds(methods)


def _limits(section: Section, found: Intervals, score: ScoreColumn) -> Floats:
    """Return the limits (M, 2) of a score's intervals, NaN where there are none."""
    none = [None] * len(section.methods)
    limits = [limit or [np.nan, np.nan] for limit in found.overall.get(score.key, none)]
    return np.array(limits, np.float64)


def _errors(section: Section) -> list[ScoreColumn]:
    errors = [score for score in section.query_scores if score.unit != "share"]
    return errors[:_MOST_ERRORS] if section.by_query else []


def _page(
    title: str, parts: list[dict[str, Any]], results: Sequence[Sequence[Result]], blobs: Blobs
) -> str:
    folder = resources.files("airzoo_bench.report") / "html"
    read = {
        name: (folder / name).read_text(encoding="utf-8")
        for name in ("page.html", "style.css", *_SCRIPTS)
    }
    script = (
        '(function () {\n"use strict";\n' + "\n".join(read[name] for name in _SCRIPTS) + "})();\n"
    )
    values = {
        "policy": _policy(script, read["style.css"]),
        "version": html.escape(airzoo_bench.__version__),
        "title": html.escape(title),
        "style": read["style.css"],
        "tables": "\n".join(render(methods_table(these), "html") for these in results),
        "data": page_json({"sections": parts}),
        "blobs": "\n".join(
            f'<script type="text/plain" id="blob-{number}">{text}</script>'
            for number, text in enumerate(blobs.texts)
        ),
        "script": script,
    }
    # One pass: what is filled in is never searched for places to fill.
    return re.sub(r"\{\{(\w+)\}\}", lambda place: values[place[1]], read["page.html"])


def _policy(script: str, style: str) -> str:
    """Return the policy that lets a browser run this script and no other, and load nothing."""
    return (
        f"default-src 'none'; img-src data:; style-src {_hash(style)}; script-src {_hash(script)}; "
        "base-uri 'none'; form-action 'none'"
    )


def _hash(text: str) -> str:
    digest = hashlib.sha256(text.encode()).digest()
    return f"'sha256-{base64.b64encode(digest).decode()}'"
