"""Parts that the pages of a table share: their tables, rows, notes and captions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from airzoo_bench.leaderboard.site.page_views import KINDS, ColumnView, Json, Note, Notes, RowView
from airzoo_bench.leaderboard.site.strangers import shown

__all__ = [
    "Page",
    "Tab",
    "TableView",
    "caption_of",
    "filter_choices",
    "finding_notes",
    "finding_text",
    "headline",
    "lead_score",
    "method_rows",
    "score_of",
]


@dataclass(frozen=True)
class Tab:
    """A page of a table, as its row of pages names it."""

    href: str
    text: str


@dataclass(frozen=True)
class TableView:
    """One table of a page.

    Attributes
    ----------
    id : str
        Of the element; other pages of the same table may have the same.
    heading : str
        Above the table, where a page has several.
    pictured, scale : str
        The title of the column of pictures and what its edges stand for; empty for no such column.
    facts : bool
        Whether what is known of the methods stands beside their numbers.
    """

    id: str
    caption: str
    columns: Sequence[ColumnView]
    rows: Sequence[RowView]
    floors: Sequence[RowView] = ()
    heading: str = ""
    ranked: bool = False
    pictured: str = ""
    scale: str = ""
    facts: bool = False
    costs: bool = False
    choose: bool = False


@dataclass(frozen=True)
class Page:
    """A page of a table.

    Attributes
    ----------
    tab : str
        The tab that it belongs to.
    parts : sequence of tuple of str and sequence of Tab
        Other views of the same kind, such as by another score, under a title.
    """

    href: str
    tab: str
    heading: str
    tables: Sequence[TableView]
    notes: Sequence[Note]
    parts: Sequence[tuple[str, Sequence[Tab]]] = ()


def method_rows(
    table: Json, made: Callable[[int, Json], RowView]
) -> tuple[list[RowView], list[RowView]]:
    """Make the rows of methods, and apart from them those that are of none."""
    rows = [made(place, row) for place, row in enumerate(table["rows"])]
    return [r for r in rows if r.kind != "floor"], [r for r in rows if r.kind == "floor"]


def finding_text(finding: Json) -> str:
    """Say what the audit finds of a printed number, and where that stands."""
    source = f"; {shown(finding['source'])}" if finding["source"] else ""
    why, grade = shown(finding["why"], 1000), shown(finding["grade"])
    return f"{shown(finding['printed'])}{source}: {why} (audit: {grade})"


def finding_notes(row: Json, scene: str, table: Json, notes: Notes) -> dict[str, list[Note]]:
    """Return by score what the audit says of a row's printed numbers."""
    found: dict[str, list[Note]] = {}
    if not row["findings"]:
        return found
    titles = {column["key"]: shown(column["title"]) for column in table["scores"]}
    for finding in row["findings"]:
        if finding["scene"] == scene:
            score = titles.get(finding["score"], shown(finding["score"]))
            text = f"{shown(row['method'])}, {score}, printed {finding_text(finding)}"
            found.setdefault(finding["score"], []).append(notes.mark(text))
    return found


def score_of(row: Json, key: str) -> Json:
    """Return a row's average of a score; without a value where it has none."""
    found: Json = row["scores"].get(key) or {"value": None, "low": None, "high": None}
    return found


def headline(table: Json) -> list[Json]:
    """Return the scores that tables show without being asked."""
    return [column for column in table["scores"] if column["headline"]] or table["scores"][:1]


def lead_score(table: Json) -> Json:
    """Return the score that the table stands by."""
    return headline(table)[0]


def caption_of(table: Json, what: str) -> str:
    """Return a caption: what is shown, and of how many methods."""
    kinds = [row["kind"] for row in table["rows"]]
    scored = sum(kind in ("re-scored", "sealed") for kind in kinds)
    said = f"{what}. {scored} scored here"
    reported = kinds.count("reported")
    return f"{said}, {reported} {KINDS['reported']}." if reported else f"{said}."


def filter_choices(tables: Sequence[TableView]) -> dict[str, Any]:
    """Return what filters can ask of the rows of a page."""
    rows = [row for table in tables for row in table.rows]
    return {
        "count": max((len(table.rows) for table in tables), default=0),
        "sources": [(k, KINDS.get(k, k)) for k in dict.fromkeys(row.kind for row in rows)],
        "pipelines": sorted({row.pipeline for row in rows if row.pipeline}),
        "training": sorted({name for row in rows for name in row.training or ()}),
        "stated": any(row.date for row in rows),
    }
