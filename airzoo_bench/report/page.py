"""The report: one page that holds everything it shows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jinja2
import numpy as np

from airzoo_bench.core.errors import UsageError, UserError, counted
from airzoo_bench.core.files import canonical_json
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.core.version import __version__
from airzoo_bench.report.figures import Sheet, axis_label, error_label, error_palette, figure_bytes
from airzoo_bench.report.numbers import (
    OVERALL,
    Datum,
    Findings,
    Grid,
    Head,
    Line,
    breakdown_panes,
    find,
    meaning,
    notes_by_method,
    pair_panes,
    plan_groups,
    scene_panes,
    summary_panes,
)
from airzoo_bench.report.packing import Blobs, content_policy, data_uri, page_json
from airzoo_bench.report.places import Place, find_places
from airzoo_bench.report.plots import (
    condition,
    draw_intervals,
    errors,
    over_what,
    ranks_in_records,
    recall,
    scenes,
    threshold_scores,
    thresholds,
)
from airzoo_bench.report.queries import hardest, order_said, pack_maps, pack_queries
from airzoo_bench.report.reconstruction import error_bar, pack_clouds
from airzoo_bench.report.sections import Section, read_sections
from airzoo_bench.tables.breakdown import condition_title
from airzoo_bench.tables.method_table import shared_references

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_TRACKS = {
    "retrieval": "Aerial image retrieval",
    "matching": "Cross-view matching",
    "reconstruction": "Multi-view reconstruction",
}
_SCRIPTS = ("core.js", "tables.js", "queries.js", "map.js", "clouds.js", "main.js")
_STYLES = ("style.css", "report.css")
_MOST_ERRORS = 2


@dataclass(frozen=True)
class Report:
    """A page that needs no other file and no network, and notes on what was left out."""

    page: str
    notes: list[str]


def make_report(
    paths: Sequence[Path],
    *,
    data: Path,
    data_was_named: bool = False,
    pictures: int = 12,
    progress: Progress = silent,
) -> Report:
    """Make the report of results."""
    sections = read_sections(paths)
    blobs, notes, faults = Blobs(), list[str](), list[UserError]()
    places = [_places(section, data, notes, faults) for section in sections]
    if data_was_named and faults and not any(places):
        raise faults[0]
    together = zip(sections, places, _names(sections), strict=True)
    parts = [
        _part(f"part{number}", name, section, found, pictures, blobs, notes)
        for number, (section, found, name) in progress(
            enumerate(together, 1), "sections", len(sections)
        )
    ]
    return Report(_render(parts, blobs), notes)


def _places(section: Section, data: Path, notes: list[str], faults: list[UserError]) -> list[Place]:
    """Find the places of a section, or note why there are none."""
    try:
        return find_places(section, data)
    except (UserError, OSError) as error:
        notes.append(f"no maps and pictures for {section.first.protocol.name}: {error}")
        if section.by_query and isinstance(error, UserError):
            faults.append(error)
        return []


def _names(sections: Sequence[Section]) -> list[str]:
    """Name parts by benchmark and track; several of both get protocol and fingerprints too."""
    plain = [f"{section.first.truth.benchmark}, {section.track}" for section in sections]
    prints = [(one.first.protocol, one.first.truth.fingerprint[:6]) for one in sections]
    return [
        name
        + f" ({used.name} v{used.version}, {used.fingerprint[:6]}, truth {truth})"
        * (plain.count(name) > 1)
        for name, (used, truth) in zip(plain, prints, strict=True)
    ]


def _part(
    key: str,
    name: str,
    section: Section,
    places: Sequence[Place],
    pictures: int,
    blobs: Blobs,
    notes: list[str],
) -> dict[str, Any]:
    """Return what the template shows of a section, and in ``data`` what the script reads."""
    found, first = find(section), section.first
    references, _ = shared_references([method.result for method in section.methods])
    summary, conditions = summary_panes(section, found), breakdown_panes(section)
    queries = pack_queries(section, blobs)
    clouds = pack_clouds(section, places, blobs)
    maps = pack_maps(section, places, blobs, notes)
    return {
        "id": key,
        "name": name,
        "title": f"{_TRACKS.get(section.track, section.track)}: "
        f"{first.protocol.name} v{first.protocol.version}",
        "facts": _facts(section),
        "best": _best(section, summary[0].grids[0]),
        "summary": summary,
        "meanings": [(s.title, meaning(section.track, s)) for s in section.scores],
        "notes": [*found.notes, *(f"{n}: {one.meaning}" for n, one in references.items())],
        "notes_on_methods": notes_by_method(section),
        "figures": [_image(*figure) for figure in _figures(section, found, notes)],
        "pairs": pair_panes(section),
        "methods": [method.name for method in section.methods],
        "scenes": scene_panes(section, found) if len(first.scenes) > 1 else [],
        "conditions": conditions,
        "condition_titles": [(by, condition_title(by)) for by in section.conditions],
        "query_scores": section.query_scores,
        "condition_figures": [
            (by, *_image(f"{axis_label(section.headline[0])} by {condition_title(by)}", figure))
            for by, figure in _condition_figures(section)
        ],
        "by_query": section.by_query,
        "maps": maps,
        "hardest": hardest(section, places, pictures, notes) if section.by_query else [],
        "hardest_order": order_said(section) if section.by_query else "",
        "clouds": clouds,
        "counts": _counts(section),
        "settings": [
            (f"{key}.{name}".rstrip("."), canonical_json(value).strip('"'))
            for key, part in first.protocol.settings.items()
            for name, value in (part.items() if isinstance(part, dict) else [("", part)])
        ],
        "first": first,
        "results": [(method.name, method.result) for method in section.methods],
        "data": {
            "id": key,
            "methods": [method.name for method in section.methods],
            "scenes": [*first.truth.scene_titles.values()],
            "queries": queries,
            "maps": maps,
            "clouds": clouds,
        },
    }


def _facts(section: Section) -> list[str]:
    first = section.first
    facts = [counted(len(section.methods), "method"), counted(len(first.scenes), "scene")]
    if section.by_query:
        facts.append(counted(len(section.methods[0].records), "query"))
    prints = {"protocol": first.protocol.fingerprint, "truth": first.truth.fingerprint}
    return facts + [f"{name} {text[:12]}" for name, text in prints.items()]


def _best(section: Section, grid: Grid) -> dict[str, Any]:
    """Return the best value of the first headline score, who has it, and who ties with it."""
    place = 1 + [score.key for score in section.scores].index(section.headline[0].key)
    cells = [line.cells[place] for line in grid.rows if not line.floor]
    marks = [cell.mark for cell in cells]
    first, best, tied = (
        marks.index("best") if "best" in marks else 0,
        *map(marks.count, ("best", "tied")),
    )
    who = section.methods[first].name + f" and {best - 1} more" * (best > 1)
    who += f"; {counted(tied, 'other', 'others')} cannot be told from it" * bool(tied)
    return {"head": grid.heads[place], "cell": cells[first], "who": who}


def _figures(section: Section, found: Findings, notes: list[str]) -> Iterator[tuple[str, Figure]]:
    """Yield titles and pictures, as the section's track has them."""
    methods, main = section.methods, section.headline[0]
    ends = found.limits.get(OVERALL, {}).get(main.key, [None] * len(methods))
    limits = np.array([end or [np.nan, np.nan] for end in ends], np.float64)
    shown = over_what(methods) + " with its 95 % interval" * bool(np.isfinite(limits).any())
    yield f"{axis_label(main)}, {shown}", draw_intervals(methods, main, limits, Sheet())
    if len(section.first.scenes) > 1:
        yield f"{axis_label(main)} by scene", scenes(methods, main)
    if section.track == "retrieval":
        try:
            ranks_in_records(methods[0])
            yield "Recall over the number of tiles looked at", recall(methods)
        except UsageError as error:
            notes.append(f"no picture of recall over K for {section.first.protocol.name}: {error}")
    measured = [score for score in section.query_scores if score.unit != "share"]
    for score in measured[:_MOST_ERRORS] if section.by_query else ():
        yield f"Share of queries below a value of {error_label(score)}", errors(methods, score)
    if threshold_scores(section.first.columns)["f1"]:
        yield "Precision, recall and F1 over the distance d", thresholds(methods)


def _condition_figures(section: Section) -> Iterator[tuple[str, Figure]]:
    """Yield a picture a condition."""
    plan = plan_groups(section)
    for by in section.conditions if section.by_query else ():
        yield by, condition(section.methods, section.headline[0], by, plan=plan)


def _image(title: str, figure: Figure) -> tuple[str, str]:
    return title, data_uri(figure_bytes(figure, "svg"), "image/svg+xml")


def _counts(section: Section) -> Grid:
    names = list(next(iter(section.first.counts.values())))
    rows = []
    for method in section.methods:
        for scene, title in section.first.truth.scene_titles.items():
            counts = method.result.counts[scene]
            numbers = [Datum(str(counts.get(name, "–")), counts.get(name)) for name in names]
            rows.append(Line([Datum(method.name), Datum(title), *numbers]))
    heads = [Head("Method", True), Head("Scene", True)]
    heads += [Head(name.replace("_", " "), best="descending") for name in names]
    return Grid("What was counted", heads, rows)


def _read(name: str) -> str:
    return (resources.files("airzoo_bench.report") / "html" / name).read_text(encoding="utf-8")


def _render(parts: list[dict[str, Any]], blobs: Blobs) -> str:
    style = "\n".join(map(_read, _STYLES))
    code = "\n".join(map(_read, _SCRIPTS))
    script = f'(function () {{\n"use strict";\n{code}}})();\n'
    env = jinja2.Environment(
        loader=jinja2.FunctionLoader(_read),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    env.filters |= {"zip": zip, "numbered": enumerate}
    data = {
        "parts": [part["data"] for part in parts],
        "pictures": blobs.pictures,
        "palette": error_palette(),
    }
    return env.get_template("report.html").render(
        version=__version__,
        policy=content_policy(script, style),
        style=style,
        script=script,
        parts=parts,
        data=page_json(data),
        blobs=blobs.texts,
        bar=error_bar(),
    )
