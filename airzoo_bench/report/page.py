"""The report: one page that holds everything it shows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from airzoo_bench.core.errors import UserError, counted
from airzoo_bench.core.files import canonical_json
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.core.version import __version__
from airzoo_bench.report import packing
from airzoo_bench.report.draw import condition, errors, recall, threshold_scores, thresholds
from airzoo_bench.report.figures import (
    Sheet,
    axis_label,
    error_label,
    error_palette,
    figure_bytes,
)
from airzoo_bench.report.numbers import (
    TIED,
    breakdown_panes,
    counts_table,
    find,
    meaning,
    notes_by_method,
    pair_panes,
    plan_of,
    scene_panes,
    summary_panes,
)
from airzoo_bench.report.queries import hardest, pack_maps, pack_queries
from airzoo_bench.report.reconstruction import pack_clouds
from airzoo_bench.report.sections import Place, Section, find_places, read_sections
from airzoo_bench.tables.breakdown import condition_title
from airzoo_bench.tables.layouts import score_column, shared_references

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_SCRIPTS = ("core.js", "tables.js", "queries.js", "map.js", "clouds.js", "main.js")
_STYLES = ("style.css", "pictures.css", "report.css")
_SHEET = Sheet(5.0)  # letters can be read on a phone and beside another picture


def make_report(
    paths: Sequence[Path],
    *,
    data: Path,
    data_was_named: bool = False,
    pictures: int = 12,
    progress: Progress = silent,
) -> tuple[str, list[str]]:
    """Make the report of results: a page that needs no other file, and what was left out."""
    sections, parts = read_sections(paths), []
    blobs, notes, faults = packing.Blobs(), list[str](), list[Exception]()
    places: list[list[Place]] = []
    for section in sections:
        try:
            places.append(find_places(section, data))
        except (UserError, OSError) as error:
            places.append([])
            faults.append(error)
            notes.append(f"no maps and pictures for {section.first.protocol.name}: {error}")
    if data_was_named and faults and not any(places):
        raise faults[0]
    together = enumerate(zip(sections, places, strict=True), 1)
    for number, (section, found) in progress(together, "sections of the report", len(sections)):
        parts.append(_part(f"part{number}", section, found, pictures, blobs, notes))
    return _render(parts, blobs), notes


def _part(
    key: str,
    section: Section,
    places: Sequence[Place],
    pictures: int,
    blobs: packing.Blobs,
    notes: list[str],
) -> dict[str, Any]:
    """Return what the template shows of a section, and in ``data`` what the script reads."""
    found, first, main = find(section), section.first, section.headline[0]
    references = shared_references([method.result for method in section.methods])
    summary = summary_panes(section, found)
    facts = [counted(len(section.methods), "method"), counted(len(first.scenes), "scene")]
    facts += [counted(len(section.methods[0].records), "query")] if section.by_query else []
    headings = {score.key: score_column(score).heading for score in section.scores}
    data = {
        "id": key,
        "methods": section.names,
        "scenes": [*first.truth.scene_titles.values()],
        "queries": pack_queries(section, blobs) if section.by_query else None,
        "maps": pack_maps(section, places, blobs, notes),
        "clouds": pack_clouds(section, places, blobs),
    }
    return {
        "id": key,
        "section": section,
        "track": section.track.capitalize(),
        "facts": [*facts, f"truth {first.truth.fingerprint[:12]}"],
        "headline": 1 + [*headings].index(main.key),
        "summary": summary,
        "hints": {headings[s.key]: meaning(section.track, s) for s in section.scores},
        "more": [headings[score.key] for score in section.scores if not score.headline],
        "notes": [
            *found.notes,
            *(f"{name}: {one.meaning}" for name, one in references.items()),
            *notes_by_method(section),
        ],
        "figures": [_image(*figure) for figure in _figures(section)],
        "pairs": pair_panes(section),
        "scenes": scene_panes(section, summary),
        "conditions": breakdown_panes(section),
        "condition_titles": [(by, condition_title(by)) for by in section.conditions],
        "condition_figures": [
            (by, *_image(f"{axis_label(main)} by {condition_title(by)}", figure))
            for by in section.conditions
            for figure in [condition(section.methods, main, by, None, _SHEET, plan_of(section))]
        ],
        "hardest": hardest(section, places, pictures) if section.by_query else [],
        "counts": counts_table(section),
        "settings": {
            f"{key}.{name}".rstrip("."): canonical_json(value).strip('"')
            for key, part in first.protocol.settings.items()
            for name, value in (part.items() if isinstance(part, dict) else [("", part)])
        },
        "data": data,
    }


def _figures(section: Section) -> Iterator[tuple[str, Figure]]:
    """Yield titles and pictures, as the section's track has them."""
    methods = section.methods
    if "first_hit_rank" in methods[0].records:
        yield "Recall over the number of tiles looked at", recall(methods, sheet=_SHEET)
    measured = [score for score in section.query_scores if score.unit != "share"]
    for score in measured[:2] if section.by_query else ():
        title = f"Share of queries below a value of {error_label(score)}"
        yield title, errors(methods, score, _SHEET)
    if threshold_scores(section.first.columns)["f1"]:
        yield "Precision, recall and F1 over the distance d", thresholds(methods, _SHEET)


def _image(title: str, figure: Figure) -> tuple[str, str]:
    return title, packing.data_uri(figure_bytes(figure, "svg", clear=True), "image/svg+xml")


def _render(parts: list[dict[str, Any]], blobs: packing.Blobs) -> str:
    style = "\n".join(map(packing.read_part, _STYLES))
    code = "\n".join(map(packing.read_part, _SCRIPTS))
    script = f'(function () {{\n"use strict";\n{code}}})();\n'
    data = {"parts": [part["data"] for part in parts], "pictures": [*blobs.pictures]}
    values = {"parts": parts, "blobs": blobs.texts, "tied": TIED, "version": __version__}
    values |= {"style": style, "script": script, "policy": packing.content_policy(script, style)}
    values |= {"data": packing.page_json(data | {"palette": error_palette()})}
    return packing.TEMPLATES.get_template("report.html").render(values)
