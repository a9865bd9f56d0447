"""The report: one page that holds everything it shows."""

from __future__ import annotations

import html
import re
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from airzoo_bench.core.errors import BenchmarkError, UserError
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.core.version import __version__
from airzoo_bench.report.packing import Blobs, page_json
from airzoo_bench.report.parts import make_part
from airzoo_bench.report.places import Place, find_places
from airzoo_bench.report.policy import content_policy
from airzoo_bench.report.sections import Section, read_sections
from airzoo_bench.results.result import Result
from airzoo_bench.tables.layouts import methods_table
from airzoo_bench.tables.render import render

__all__ = ["Report", "make_report"]

_SCRIPTS = (
    *("core.js", "links.js", "views.js", "chart.js", "hardest.js", "queries.js", "tiles.js"),
    *("marks.js", "moves.js", "map.js", "pairs.js", "overview.js", "main.js"),
)
_TITLE = "Results"


@dataclass(frozen=True)
class Report:
    """A page, and notes for the user.

    Attributes
    ----------
    page : str
        HTML that needs no other file and no network.
    notes : list of str
        What was left out, and why.
    """

    page: str
    notes: list[str]


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
    """Make the report of results."""
    sections = read_sections(paths, jobs)
    blobs, notes, faults = Blobs(), list[str](), list[UserError]()
    places = [_places(section, data, notes, faults) for section in sections]
    if data_was_named and faults and not any(places):
        raise faults[0]
    parts = [
        make_part(number, section, found, pictures, blobs, notes)
        for number, (section, found) in progress(
            enumerate(zip(sections, places, strict=True)), "sections", len(sections)
        )
    ]
    results = [[method.result for method in section.methods] for section in sections]
    return Report(_page(title, parts, results, blobs), notes)


def _places(section: Section, data: Path, notes: list[str], faults: list[UserError]) -> list[Place]:
    try:
        try:
            return find_places(section, data)
        except OSError as error:  # nobody said that it is there, or that it can be read
            raise BenchmarkError(
                f"cannot be read: {error.strerror or error}", where=error.filename or data
            ) from error
    except UserError as error:
        notes.append(f"no maps and pictures for {section.first.protocol.name}: {error}")
        faults.append(error)
        return []


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
        "policy": content_policy(script, read["style.css"]),
        "version": html.escape(__version__),
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
