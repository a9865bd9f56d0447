"""The pages of a table: its averages, rank ranges, all scores, scenes and conditions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from airzoo_bench.leaderboard.site.drawings import Scale, rank_picture
from airzoo_bench.leaderboard.site.page_compare import pair_files
from airzoo_bench.leaderboard.site.page_views import (
    KINDS,
    UNITS,
    CellView,
    ColumnView,
    Json,
    Notes,
    RowView,
    cell_view,
    column_views,
    numbers_text,
    rank_text,
    row_view,
    scale_of_scores,
    score_at,
)
from airzoo_bench.leaderboard.site.strangers import shown

__all__ = ["Tab", "TableView", "filter_choices", "page_tabs", "ranked_count", "table_pages"]

Score = dict[str, Any] | Json | None


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
    notes: Sequence[Json]
    parts: Sequence[tuple[str, Sequence[Tab]]] = ()


def page_tabs(table: Json, files: Mapping[str, Any]) -> list[Tab]:
    """Return the pages of a table, the plain results first."""
    base = f"tables/{table['id']}"
    tabs = [Tab("index.html", "Results")]
    if ranked_count(table):
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


def ranked_count(table: Json) -> int:
    """Return how many rows have a rank range by the score that the table stands by."""
    lead = _lead(table)["key"]
    return sum(_score(row, lead).get("rank") is not None for row in table["rows"])


def table_pages(table: Json, files: Mapping[str, Any]) -> list[Page]:
    """Return all pages of a table but the comparison and its methods'."""
    base = f"tables/{table['id']}"
    make = {
        "index.html": lambda: [_results(table, files)],
        "ranks.html": lambda: [_ranks(table)],
        "scores.html": lambda: [_all_scores(table)],
        "scenes.html": lambda: _scenes(table, files[f"{base}/scenes.json"]["scenes"]),
        "conditions.html": lambda: _conditions(
            table, files[f"{base}/conditions.json"]["conditions"]
        ),
    }
    tabs = [tab.href for tab in page_tabs(table, files)]
    return [page for href in tabs if href in make for page in make[href]()]


def _results(table: Json, files: Mapping[str, Any]) -> Page:
    lead, notes = _lead(table), Notes()
    columns = _headline(table)
    scale = scale_of_scores([_score(row, lead["key"]) for row in table["rows"]])
    chosen = _comparable(table, files)
    count = ranked_count(table)

    def made(place: int, row: Json) -> RowView:
        marks = _findings(row, "", table, notes)
        cells = [_cell(row, column, lead, marks) for column in columns]
        return row_view(
            row,
            cells,
            place=place,
            ranks=_score(row, lead["key"]).get("rank"),
            count=count,
            lead=_score(row, lead["key"]) or None,
            scale=scale,
            comparable=row["id"] in chosen,
            notes=[notes.mark(shown(note, 1000)) for note in row["notes"]],
        )

    rows, floors = _rows(table, made)
    view = TableView(
        "results",
        _caption(table, "Averages over scenes" if len(table["scenes"]) > 1 else "Averages"),
        column_views(columns, lead["key"]),
        rows,
        floors,
        ranked=count > 0,
        pictured=f"{shown(lead['title'])} and interval" if scale else "",
        scale=_scale_text(lead, scale),
        facts=True,
        costs=any(row.cost.text for row in rows),
        choose=len(chosen) > 1,
    )
    return Page("index.html", "index.html", "", [view], notes.all())


def _cell(row: Json, column: Json, lead: Json, marks: Mapping[str, list[Json]]) -> CellView:
    key = column["key"]
    return cell_view(_score(row, key), lead=column is lead, notes=marks.get(key, ()))


def _ranks(table: Json) -> Page:
    columns = [column for column in _headline(table) if column["pairs"] or column["headline"]]
    counts = {
        c["key"]: sum(_score(row, c["key"]).get("rank") is not None for row in table["rows"])
        for c in columns
    }

    def made(place: int, row: Json) -> RowView:
        return row_view(row, [_rank_cell(row, c["key"], counts[c["key"]]) for c in columns])

    ranked = [row for row in table["rows"] if any(_score(row, c["key"]).get("rank") for c in columns)]
    heads = [ColumnView(shown(c["title"]), "rank", "ascending", _ascending(c, columns)) for c in columns]
    caption = f"Rank ranges among {max(counts.values(), default=0)} methods that were scored here"
    view = TableView("results", caption, heads, [made(n, row) for n, row in enumerate(ranked)])
    return Page("ranks.html", "ranks.html", "Rank ranges", [view], [])


def _ascending(column: Json, columns: Sequence[Json]) -> str:
    return "ascending" if column is columns[0] else ""


def _rank_cell(row: Json, key: str, count: int) -> CellView:
    ranks = _score(row, key).get("rank")
    if ranks is None:
        return CellView()
    sort = f"{ranks[0] + ranks[1] / 1e6:.6f}"
    return CellView(rank_text(ranks), sort, picture=rank_picture(ranks[0], ranks[1], count))


def _all_scores(table: Json) -> Page:
    lead, columns, notes = _lead(table), table["scores"], Notes()

    def made(place: int, row: Json) -> RowView:
        marks = _findings(row, "", table, notes)
        return row_view(row, [_cell(row, column, lead, marks) for column in columns])

    rows, floors = _rows(table, made)
    caption = _caption(table, "All scores, averages over scenes")
    view = TableView("results", caption, column_views(columns, lead["key"]), rows, floors)
    return Page("scores.html", "scores.html", "All scores", [view], notes.all())


def _scenes(table: Json, scenes: Json) -> list[Page]:
    by_score = [Tab(_numbered("scenes", n), shown(c["title"])) for n, c in enumerate(_headline(table))]
    by_scene = [Tab(f"scene-{n}.html", shown(s["title"])) for n, s in enumerate(table["scenes"], 1)]
    parts = (("Score, all scenes", by_score), ("One scene", by_scene))
    pages = [
        _scene_matrix(table, scenes, column, tab.href, parts)
        for column, tab in zip(_headline(table), by_score, strict=True)
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
            marks = _findings(row, scene["id"], table, notes)
            part = scenes.get(scene["id"], {}).get(column["key"], {})
            found = score_at(column, part, place)
            cells.append(cell_view(found, notes=marks.get(column["key"], ())))
        return row_view(row, cells)

    heads = [
        ColumnView(shown(scene["title"]), _queries(scene), _way(column))
        for scene in table["scenes"]
    ]
    rows, floors = _rows(table, made)
    title = f"{shown(column['title'])} {_unit(column)} in each scene"
    view = TableView("results", _caption(table, title), heads, rows, floors)
    return Page(href, "scenes.html", f"{shown(column['title'])} by scene", [view], notes.all(), parts)


def _one_scene(
    table: Json, scenes: Json, scene: Json, href: str, parts: Sequence[tuple[str, Sequence[Tab]]]
) -> Page:
    notes, columns = Notes(), _headline(table)
    own = scenes.get(scene["id"], {})

    def made(place: int, row: Json) -> RowView:
        marks = _findings(row, scene["id"], table, notes)
        cells = [
            cell_view(score_at(c, own.get(c["key"], {}), place), notes=marks.get(c["key"], ()))
            for c in columns
        ]
        return row_view(row, cells)

    rows, floors = _rows(table, made)
    title = shown(scene["title"])
    caption = _caption(table, f"Scene {title}, {_queries(scene)}" if scene["queries"] else title)
    view = TableView("results", caption, column_views(columns), rows, floors)
    return Page(href, "scenes.html", f"Scene {title}", [view], notes.all(), parts)


def _conditions(table: Json, broken: Sequence[Json]) -> list[Page]:
    columns = _headline(table)
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
    rows, _ = _rows(table, made)
    rows = [row for row in rows if any(cell.text for cell in row.cells)]
    title = shown(condition["title"])
    caption = f"{shown(column['title'])} {_unit(column)} by {title}, over the queries of all scenes"
    return TableView(f"by-{number}", caption, heads, rows, heading=title[:1].upper() + title[1:])


def _rows(
    table: Json, made: Callable[[int, Json], RowView]
) -> tuple[list[RowView], list[RowView]]:
    """Make the rows of methods, and apart from them those that are of none."""
    rows = [made(place, row) for place, row in enumerate(table["rows"])]
    return [r for r in rows if r.kind != "floor"], [r for r in rows if r.kind == "floor"]


def _findings(row: Json, scene: str, table: Json, notes: Notes) -> dict[str, list[Json]]:
    """Return by score what the audit says of a row's printed numbers."""
    titles = {column["key"]: shown(column["title"]) for column in table["scores"]}
    found: dict[str, list[Json]] = {}
    for finding in row["findings"]:
        if finding["scene"] == scene:
            text = (
                f"{shown(row['method'])}, {titles.get(finding['score'], finding['score'])}, printed "
                f"{shown(finding['printed'])}: {shown(finding['why'], 1000)} "
                f"(audit: {shown(finding['grade'])})"
            )
            found.setdefault(finding["score"], []).append(notes.mark(text))
    return found


def _comparable(table: Json, files: Mapping[str, Any]) -> set[str]:
    return {name for _, pairs in pair_files(table, files) for name in pairs["ids"]}


def _score(row: Json, key: str) -> Json:
    found: Json = row["scores"].get(key) or {"value": None, "low": None, "high": None}
    return found


def _headline(table: Json) -> list[Json]:
    return [column for column in table["scores"] if column["headline"]] or table["scores"][:1]


def _lead(table: Json) -> Json:
    return _headline(table)[0]


def _caption(table: Json, what: str) -> str:
    kinds = [row["kind"] for row in table["rows"]]
    scored = sum(kind in ("re-scored", "sealed") for kind in kinds)
    said = f"{what}. {scored} scored here"
    reported = kinds.count("reported")
    return f"{said}, {reported} {KINDS['reported']}." if reported else f"{said}."


def _scale_text(column: Json, scale: Scale | None) -> str:
    if scale is None:
        return ""
    low, high = numbers_text(column["unit"], scale.low, scale.high)
    return f"{low} to {high} {UNITS[column['unit']]}"


def _unit(column: Json) -> str:
    return f"in {UNITS[column['unit']]}"


def _way(column: Json) -> str:
    return "descending" if column["higher_is_better"] else "ascending"


def _queries(scene: Json) -> str:
    return f"{scene['queries']} queries" if scene["queries"] else ""


def _numbered(name: str, place: int) -> str:
    return f"{name}.html" if place == 0 else f"{name}-{place + 1}.html"


def filter_choices(tables: Sequence[TableView]) -> dict[str, Sequence[Any]]:
    """Return what filters can ask of the rows of a page."""
    rows = [row for table in tables for row in table.rows]
    return {
        "sources": [(k, KINDS.get(k, k)) for k in dict.fromkeys(row.kind for row in rows)],
        "pipelines": sorted({row.pipeline for row in rows if row.pipeline}),
        "training": sorted({name for row in rows for name in row.training or ()}),
        "stated": any(row.date for row in rows),
    }
