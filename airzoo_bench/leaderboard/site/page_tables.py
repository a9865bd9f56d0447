"""The pages of a table: its averages, rank ranges, all scores, scenes and conditions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from airzoo_bench.leaderboard.site.drawings import Scale, rank_picture
from airzoo_bench.leaderboard.site.page_compare import pair_files
from airzoo_bench.leaderboard.site.page_parts import (
    Page,
    Tab,
    TableView,
    caption_of,
    finding_notes,
    headline,
    lead_score,
    method_rows,
    score_of,
)
from airzoo_bench.leaderboard.site.page_scenes import condition_pages, scene_pages
from airzoo_bench.leaderboard.site.page_views import (
    UNITS,
    CellView,
    ColumnView,
    Json,
    Note,
    Notes,
    RowView,
    cell_view,
    column_views,
    numbers_text,
    rank_text,
    row_view,
    scale_of_scores,
)
from airzoo_bench.leaderboard.site.strangers import shown

__all__ = ["page_tabs", "table_pages"]


def page_tabs(table: Json, files: Mapping[str, Any]) -> list[Tab]:
    """Return the pages of a table, the plain results first."""
    base = f"tables/{table['id']}"
    tabs = [Tab("index.html", "Results")]
    if not table["rows"]:
        return tabs
    if _ranked_count(table):
        tabs.append(Tab("ranks.html", "Rank ranges"))
    if any(not column["headline"] for column in table["scores"]):
        tabs.append(Tab("scores.html", "All scores"))
    if f"{base}/scenes.json" in files and table["scenes"]:
        tabs.append(Tab("scenes.html", "Scenes"))
    if f"{base}/conditions.json" in files and table["conditions"]:
        tabs.append(Tab("conditions.html", "Conditions"))
    if pair_files(table, files):
        tabs.append(Tab("compare.html", "Compare"))
    return tabs


def _ranked_count(table: Json) -> int:
    """Return how many rows have a rank range by the score that the table stands by."""
    lead = lead_score(table)["key"]
    return sum(score_of(row, lead).get("rank") is not None for row in table["rows"])


def table_pages(table: Json, files: Mapping[str, Any]) -> list[Page]:
    """Return all pages of a table but the comparison and its methods'."""
    base = f"tables/{table['id']}"
    make = {
        "index.html": lambda: [_results(table, files)],
        "ranks.html": lambda: [_ranks(table)],
        "scores.html": lambda: [_all_scores(table)],
        "scenes.html": lambda: scene_pages(table, files[f"{base}/scenes.json"]["scenes"]),
        "conditions.html": lambda: condition_pages(
            table, files[f"{base}/conditions.json"]["conditions"]
        ),
    }
    tabs = [tab.href for tab in page_tabs(table, files)]
    return [page for href in tabs if href in make for page in make[href]()]


def _results(table: Json, files: Mapping[str, Any]) -> Page:
    lead, notes = lead_score(table), Notes()
    columns = headline(table)
    scale = scale_of_scores([score_of(row, lead["key"]) for row in table["rows"]])
    chosen = _comparable(table, files)
    count = _ranked_count(table)

    def made(place: int, row: Json) -> RowView:
        marks = finding_notes(row, "", table, notes)
        cells = [_cell(row, column, lead, marks) for column in columns]
        return row_view(
            row,
            cells,
            place=place,
            ranks=score_of(row, lead["key"]).get("rank"),
            count=count,
            lead=score_of(row, lead["key"]) or None,
            scale=scale,
            comparable=row["id"] in chosen,
            notes=[notes.mark(shown(note, 1000)) for note in row["notes"]],
        )

    rows, floors = method_rows(table, made)
    view = TableView(
        "results",
        caption_of(table, "Averages over scenes" if len(table["scenes"]) > 1 else "Averages"),
        column_views(columns, lead["key"]),
        rows,
        floors,
        ranked=count > 0,
        pictured=_pictured(table, lead) if scale and scale.low < scale.high else "",
        scale=_scale_text(lead, scale),
        facts=any(row.pipeline or row.training is not None or row.date for row in rows),
        costs=any(row.cost.text for row in rows),
        choose=len(chosen) > 1,
    )
    return Page("index.html", "index.html", "", [view], notes.all())


def _cell(row: Json, column: Json, lead: Json, marks: Mapping[str, list[Note]]) -> CellView:
    key = column["key"]
    return cell_view(score_of(row, key), lead=column is lead, notes=marks.get(key, ()))


def _ranks(table: Json) -> Page:
    columns = [column for column in headline(table) if column["pairs"] or column["headline"]]
    counts = {
        c["key"]: sum(score_of(row, c["key"]).get("rank") is not None for row in table["rows"])
        for c in columns
    }

    def made(place: int, row: Json) -> RowView:
        return row_view(row, [_rank_cell(row, c["key"], counts[c["key"]]) for c in columns])

    ranked = [
        row for row in table["rows"] if any(score_of(row, c["key"]).get("rank") for c in columns)
    ]
    heads = [
        ColumnView(shown(c["title"]), "rank", "ascending", _ascending(c, columns)) for c in columns
    ]
    caption = f"Rank ranges among {max(counts.values(), default=0)} methods that were scored here"
    view = TableView("results", caption, heads, [made(n, row) for n, row in enumerate(ranked)])
    return Page("ranks.html", "ranks.html", "Rank ranges", [view], [])


def _ascending(column: Json, columns: Sequence[Json]) -> str:
    return "ascending" if column is columns[0] else ""


def _rank_cell(row: Json, key: str, count: int) -> CellView:
    ranks = score_of(row, key).get("rank")
    if ranks is None:
        return CellView()
    sort = f"{ranks[0] + ranks[1] / 1e6:.6f}"
    return CellView(rank_text(ranks), sort, picture=rank_picture(ranks[0], ranks[1], count))


def _all_scores(table: Json) -> Page:
    lead, columns, notes = lead_score(table), table["scores"], Notes()

    def made(place: int, row: Json) -> RowView:
        marks = finding_notes(row, "", table, notes)
        return row_view(row, [_cell(row, column, lead, marks) for column in columns])

    rows, floors = method_rows(table, made)
    caption = caption_of(table, "All scores, averages over scenes")
    view = TableView("results", caption, column_views(columns, lead["key"]), rows, floors)
    return Page("scores.html", "scores.html", "All scores", [view], notes.all())


def _comparable(table: Json, files: Mapping[str, Any]) -> set[str]:
    return {name for _, pairs in pair_files(table, files) for name in pairs["ids"]}


def _pictured(table: Json, lead: Json) -> str:
    title = shown(lead["title"])
    any_interval = any(score_of(row, lead["key"])["low"] is not None for row in table["rows"])
    return f"{title} and interval" if any_interval else title


def _scale_text(column: Json, scale: Scale | None) -> str:
    if scale is None:
        return ""
    low, high = numbers_text(column["unit"], scale.low, scale.high)
    return f"{low} to {high} {UNITS[column['unit']]}"
