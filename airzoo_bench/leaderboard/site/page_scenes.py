"""The pages of a table by scene and by condition."""

from __future__ import annotations

from collections.abc import Sequence

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
    ColumnView,
    Json,
    Notes,
    RowView,
    cell_view,
    column_views,
    row_view,
    score_at,
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
    pages = [
        _scene_matrix(table, scenes, column, tab.href, parts)
        for column, tab in zip(headline(table), by_score, strict=True)
    ]
    return pages + [
        _one_scene(table, scenes, scene, tab.href, parts)
        for scene, tab in zip(table["scenes"], by_scene, strict=True)
    ]


def _scene_matrix(
    table: Json, scenes: Json, column: Json, href: str, parts: Sequence[tuple[str, Sequence[Tab]]]
) -> Page:
    notes = Notes()

    def made(place: int, row: Json) -> RowView:
        cells = []
        for scene in table["scenes"]:
            marks = finding_notes(row, scene["id"], table, notes)
            part = scenes.get(scene["id"], {}).get(column["key"], {})
            found = score_at(column, part, place)
            cells.append(cell_view(found, notes=marks.get(column["key"], ())))
        return row_view(row, cells)

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
    table: Json, scenes: Json, scene: Json, href: str, parts: Sequence[tuple[str, Sequence[Tab]]]
) -> Page:
    notes, columns = Notes(), headline(table)
    own = scenes.get(scene["id"], {})

    def made(place: int, row: Json) -> RowView:
        marks = finding_notes(row, scene["id"], table, notes)
        cells = [
            cell_view(score_at(c, own.get(c["key"], {}), place), notes=marks.get(c["key"], ()))
            for c in columns
        ]
        return row_view(row, cells)

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
    def made(place: int, row: Json) -> RowView:
        parts = [group.get(column["key"], {}) for group in groups]
        return row_view(row, [cell_view(score_at(column, part, place)) for part in parts])

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
