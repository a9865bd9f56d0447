"""The front page: the benchmarks with their leading methods, and what came last."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from airzoo_bench.core.errors import counted
from airzoo_bench.leaderboard.site.page_views import (
    UNITS,
    Json,
    RowView,
    cell_view,
    rank_text,
    row_view,
)
from airzoo_bench.leaderboard.site.strangers import shown

__all__ = ["front_view"]

_LEADING, _RECENT = 5, 10


def front_view(board: Json, tables: Mapping[str, Json]) -> dict[str, Any]:
    """Return what the front page shows."""
    benchmarks = [
        {
            "title": benchmark["title"],
            "fronts": [
                _front(benchmark, link, tables[link["id"]])
                for link in benchmark["tables"]
                if link["current"]
            ],
            "apart": [
                {"title": link["title"], "apart": link["apart"], "href": _href(link["id"])}
                for link in benchmark["tables"]
                if not link["current"]
            ],
        }
        for benchmark in board["benchmarks"]
    ]
    return {"benchmarks": benchmarks, "recent": _recent(tables)}


def _href(table: str) -> str:
    return f"tables/{table}/index.html"


def _front(benchmark: Json, link: Json, table: Json) -> dict[str, Any]:
    lead = next((c for c in table["scores"] if c["headline"]), table["scores"][0])
    key = lead["key"]
    rows = [row for row in table["rows"] if row["kind"] != "floor" and key in row["scores"]]
    ranked = sorted((row for row in rows if _ranks(row, key)), key=lambda row: _ranks(row, key)[0])
    shown_rows = (ranked or rows)[:_LEADING]
    first = sum(_ranks(row, key)[0] == 1 for row in ranked)
    title = shown(lead["title"])
    return {
        "title": _short(table),
        "href": _href(table["id"]),
        "sealed": table["sealed"],
        "counts": _counts(table, link["updated"]),
        "caption": f"{shown(benchmark['title'])}: {_short(table)}: leading methods by {title}",
        "score": title,
        "unit": f"{UNITS[lead['unit']]} {'↑' if lead['higher_is_better'] else '↓'}",
        "rows": [_row(row, key, table, len(ranked)) for row in shown_rows],
        "more": f"{first} methods cannot be told from the best." if first > _LEADING else "",
    }


def _short(table: Json) -> str:
    """Return a table's title without its benchmark's, below which it stands."""
    title, benchmark = shown(table["title"]), shown(table["benchmark_title"])
    rest = title.removeprefix(f"{benchmark}, ")
    return title if rest == title else rest[:1].upper() + rest[1:]


def _row(row: Json, key: str, table: Json, count: int) -> RowView:
    up = f"tables/{table['id']}/"
    ranks = _ranks(row, key) or None
    return row_view(row, [cell_view(row["scores"][key])], up=up, ranks=ranks, count=count)


def _ranks(row: Json, key: str) -> list[int]:
    return row["scores"].get(key, {}).get("rank") or []


def _counts(table: Json, updated: str | None) -> str:
    kinds = [row["kind"] for row in table["rows"]]
    scored = sum(kind in ("re-scored", "sealed") for kind in kinds)
    parts = [f"{scored} scored here"]
    if reported := kinds.count("reported"):
        parts.append(f"{reported} reported")
    parts.append(counted(len(table["scenes"]), "scene"))
    return ", ".join(parts) + (f"; last entry {updated}" if updated else "")


def _recent(tables: Mapping[str, Json]) -> list[dict[str, str]]:
    found = [
        (row["rescored"] or row["date"] or "", table, row)
        for table in tables.values()
        for row in table["rows"]
        if row["kind"] in ("re-scored", "sealed")
    ]
    found = [entry for entry in found if entry[0]]
    found.sort(key=lambda entry: (entry[0], entry[2]["date"] or ""), reverse=True)
    return [_entry(date, table, row) for date, table, row in found[:_RECENT]]


def _entry(date: str, table: Json, row: Json) -> dict[str, str]:
    lead = next((c for c in table["scores"] if c["headline"]), table["scores"][0])
    score = row["scores"].get(lead["key"])
    said = f"{shown(lead['title'])} {score['text']} {UNITS[lead['unit']]}" if score else "no score"
    ranks = rank_text(_ranks(row, lead["key"]) or None)
    return {
        "date": date,
        "href": f"tables/{table['id']}/methods/{row['id']}.html",
        "name": shown(row["method"]),
        "team": shown(row["team"]) if row["team"] else "",
        "table": shown(table["title"]),
        "said": f"{said}, rank {ranks}" if ranks else said,
    }
