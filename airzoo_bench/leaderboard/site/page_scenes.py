"""The pages of a table by scene and by condition."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from airzoo_bench.leaderboard.site.page_parts import (
    Page,
    Tab,
    TableView,
    caption_of,
    finding_notes,
    headline,
    method_rows,
)
from airzoo_bench.leaderboard.site.page_views import (
    UNITS,
    CellView,
    ColumnView,
    Json,
    Note,
    Notes,
    RowView,
    column_cells,
    column_views,
    row_view,
)
from airzoo_bench.leaderboard.site.strangers import shown

__all__ = ["condition_pages", "scene_pages"]


def scene_pages(table: Json, scenes: Json) -> list[Page]:
    """Return a page a headline score with all scenes, and a page a scene with all of these."""
    by_score = [
        Tab(_numbered("scenes", n), shown(c["title"])) for n, c in enumerate(headline(table))
    ]
    by_scene = [Tab(f"scene-{n}.html", shown(s["title"])) for n, s in enumerate(table["scenes"], 1)]
    parts = (("Score, all scenes", by_score), ("One scene", by_scene))
    cells = {
        scene["id"]: {
            c["key"]: column_cells(
                c, scenes.get(scene["id"], {}).get(c["key"], {}), len(table["rows"])
            )
            for c in headline(table)
        }
        for scene in table["scenes"]
    }
    pages = [
        _scene_matrix(table, cells, column, tab.href, parts)
        for column, tab in zip(headline(table), by_score, strict=True)
    ]
    return pages + [
        _one_scene(table, cells[scene["id"]], scene, tab.href, parts)
        for scene, tab in zip(table["scenes"], by_scene, strict=True)
    ]


def _with_notes(cell: CellView, notes: Sequence[Note]) -> CellView:
    return replace(cell, notes=notes) if notes else cell


def _scene_matrix(
    table: Json,
    cells: Mapping[str, Mapping[str, Sequence[CellView]]],
    column: Json,
    href: str,
    parts: Sequence[tuple[str, Sequence[Tab]]],
) -> Page:
    notes, key = Notes(), column["key"]

    def made(place: int, row: Json) -> RowView:
        own = []
        for scene in table["scenes"]:
            marks = finding_notes(row, scene["id"], table, notes)
            own.append(_with_notes(cells[scene["id"]][key][place], marks.get(key, ())))
        return row_view(row, own)

    heads = [
        ColumnView(shown(scene["title"]), _queries(scene), _way(column))
        for scene in table["scenes"]
    ]
    rows, floors = method_rows(table, made)
    title = f"{shown(column['title'])} {_unit(column)} in each scene"
    view = TableView("results", caption_of(table, title), heads, rows, floors)
    return Page(
        href, "scenes.html", f"{shown(column['title'])} by scene", [view], notes.all(), parts
    )


def _one_scene(
    table: Json,
    cells: Mapping[str, Sequence[CellView]],
    scene: Json,
    href: str,
    parts: Sequence[tuple[str, Sequence[Tab]]],
) -> Page:
    notes, columns = Notes(), headline(table)

    def made(place: int, row: Json) -> RowView:
        marks = finding_notes(row, scene["id"], table, notes)
        own = [_with_notes(cells[c["key"]][place], marks.get(c["key"], ())) for c in columns]
        return row_view(row, own)

    rows, floors = method_rows(table, made)
    title = shown(scene["title"])
    caption = caption_of(table, f"Scene {title}, {_queries(scene)}" if scene["queries"] else title)
    view = TableView("results", caption, column_views(columns), rows, floors)
    return Page(href, "scenes.html", f"Scene {title}", [view], notes.all(), parts)


def condition_pages(table: Json, broken: Sequence[Json]) -> list[Page]:
    """Return a page a headline score, with a table a condition."""
    columns = headline(table)
    tabs = [Tab(_numbered("conditions", n), shown(c["title"])) for n, c in enumerate(columns)]
    parts = (("Score", tabs),)
    return [
        Page(
            tab.href,
            "conditions.html",
            f"{shown(column['title'])} by condition",
            [
                _by_condition(table, condition, found["groups"], column, number)
                for number, (condition, found) in enumerate(
                    zip(table["conditions"], broken, strict=True), 1
                )
            ],
            [],
            parts,
        )
        for column, tab in zip(columns, tabs, strict=True)
    ]


def _by_condition(
    table: Json, condition: Json, groups: Sequence[Json], column: Json, number: int
) -> TableView:
    parts = [group.get(column["key"], {}) for group in groups]
    cells = [column_cells(column, part, len(table["rows"])) for part in parts]

    def made(place: int, row: Json) -> RowView:
        return row_view(row, [of_group[place] for of_group in cells])

    heads = [
        ColumnView(shown(label), f"{count} queries", _way(column))
        for label, count in zip(condition["labels"], condition["counts"], strict=True)
    ]
    rows, _ = method_rows(table, made)
    rows = [row for row in rows if any(cell.text for cell in row.cells)]
    title = shown(condition["title"])
    caption = f"{shown(column['title'])} {_unit(column)} by {title}, over the queries of all scenes"
    return TableView(f"by-{number}", caption, heads, rows, heading=title[:1].upper() + title[1:])


def _unit(column: Json) -> str:
    return f"in {UNITS[column['unit']]}"


def _way(column: Json) -> str:
    return "descending" if column["higher_is_better"] else "ascending"


def _queries(scene: Json) -> str:
    return f"{scene['queries']} queries" if scene["queries"] else ""


def _numbered(name: str, place: int) -> str:
    return f"{name}.html" if place == 0 else f"{name}-{place + 1}.html"
