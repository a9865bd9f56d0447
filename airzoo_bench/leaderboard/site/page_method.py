"""The page of a method: its scores, scenes and history."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from airzoo_bench.leaderboard.site.drawings import Point
from airzoo_bench.leaderboard.site.page_parts import finding_text
from airzoo_bench.leaderboard.site.page_views import (
    KINDS,
    UNITS,
    CellView,
    ColumnView,
    Json,
    cell_view,
    column_views,
    number,
    pipeline_of,
    rank_text,
)
from airzoo_bench.leaderboard.site.strangers import safe_url, shown

__all__ = ["MethodView", "method_view"]

_MOST_VERSIONS = 12


@dataclass(frozen=True)
class Line:
    """A row of a small table: what heads it, and its cells."""

    head: str
    cells: Sequence[CellView]


@dataclass(frozen=True)
class VersionView:
    """A version of a submission."""

    number: int
    date: str
    rescored: str
    made_with: str
    changes: str
    files: str | None
    cells: Sequence[CellView]


@dataclass(frozen=True)
class MethodView:
    """What the page of a method shows.

    Attributes
    ----------
    facts : sequence of tuple of str and list of str
        What the method's authors say of it, by title.
    links : sequence of tuple of str
        Titles and addresses.
    points : sequence of Point
        The first score of each version, the oldest first.
    """

    name: str
    kind: str
    tag: str
    summary: str
    facts: Sequence[tuple[str, list[str]]]
    links: Sequence[tuple[str, str]]
    notes: Sequence[str]
    findings: Sequence[str]
    scores: Sequence[Line]
    columns: Sequence[ColumnView]
    scenes: Sequence[Line]
    history: Sequence[VersionView]
    points: Sequence[Point]
    score: str
    bibtex: str


def method_view(table: Json, row: Json, found: Json | None, data_url: str | None) -> MethodView:
    """Return what the page of a row shows."""
    headline = [c for c in table["scores"] if c["headline"]] or table["scores"][:1]
    history = found["history"] if found else []
    lead = headline[0]
    return MethodView(
        name=shown(row["method"]),
        kind=row["kind"],
        tag=KINDS.get(row["kind"], ""),
        summary=shown(row["summary"], 1000) if row["summary"] else "",
        facts=_facts(row),
        links=_links(row),
        notes=[shown(note, 1000) for note in row["notes"]],
        findings=[_finding(finding, table) for finding in row["findings"]],
        scores=[_score_line(c, row) for c in table["scores"] if c["key"] in row["scores"]],
        columns=column_views(headline),
        scenes=_scene_lines(table, headline, found),
        history=[_version(version, headline, data_url) for version in history],
        points=_points(history, lead["key"], table["id"]),
        score=f"{shown(lead['title'])} in {UNITS[lead['unit']]}",
        bibtex=_bibtex(found["bibtex"]) if found else "",
    )


def _links(row: Json) -> list[tuple[str, str]]:
    found = [(title, safe_url(row.get(title))) for title in ("code", "paper", "weights")]
    return [(title, url) for title, url in found if url]


def _facts(row: Json) -> list[tuple[str, list[str]]]:
    """Return titles and texts; those of a list stand apart, so that each keeps its direction."""
    training = row["training_data"]
    seconds = row["seconds_per_query"]
    cost = f"{seconds:.3g} s a query" if seconds is not None else ""
    if cost and row["hardware"]:
        cost += f" on {shown(row['hardware'])}"
    facts: list[tuple[str, str | list[str]]] = [
        ("Source", shown(row["source"], 1000) if row["source"] else ""),
        ("Team", shown(row["team"]) if row["team"] else ""),
        ("Authors", [*map(shown, row["authors"])]),
        ("Submitted", row["date"] or ""),
        ("Scored here", row["rescored"] or ""),
        ("Pipeline", pipeline_of(row)),
        ("Training data", "" if training is None else ", ".join(map(shown, training)) or "none"),
        ("Cost, as claimed", cost),
        ("Licence", shown(row["licence"]) if row["licence"] else ""),
    ]
    return [(title, [text] if isinstance(text, str) else text) for title, text in facts if text]


def _finding(finding: Json, table: Json) -> str:
    titles = {column["key"]: shown(column["title"]) for column in table["scores"]}
    scenes = {scene["id"]: shown(scene["title"]) for scene in table["scenes"]}
    where = scenes.get(finding["scene"], shown(finding["scene"])) if finding["scene"] else "average"
    score = titles.get(finding["score"], finding["score"])
    return f"{score}, {where}, printed {finding_text(finding)}"


def _score_line(column: Json, row: Json) -> Line:
    score = row["scores"][column["key"]]
    rank = CellView(rank_text(score.get("rank")))
    head = f"{shown(column['title'])} [{UNITS[column['unit']]}]"
    return Line(head, [cell_view(score), rank])


def _scene_lines(table: Json, columns: Sequence[Json], found: Json | None) -> list[Line]:
    by_scene = found["scenes"] if found else {}
    return [
        Line(
            shown(scene["title"]),
            [cell_view(by_scene[scene["id"]].get(column["key"])) for column in columns],
        )
        for scene in table["scenes"]
        if scene["id"] in by_scene
    ]


def _version(version: Json, columns: Sequence[Json], data_url: str | None) -> VersionView:
    files = None
    if data_url and version["files"]:
        files = safe_url(f"{data_url}/{version['files']}")
    return VersionView(
        version["number"],
        version["date"] or "",
        version["rescored"] or "",
        shown(version["made_with"]) if version["made_with"] else "",
        shown(version["changes"], 1000) if version["changes"] else "",
        files,
        [cell_view(version["scores"].get(column["key"])) for column in columns],
    )


def _points(history: Sequence[Json], key: str, table: str) -> list[Point]:
    """Return a score of the versions that may be compared with the newest, the oldest first."""
    history = [version for version in history if version["table"] == table]
    found = [(v["number"], v["scores"].get(key)) for v in reversed(history[:_MOST_VERSIONS])]
    return [
        Point(value, number(s["low"]), number(s["high"]), shown(s["text"]), f"version {version}")
        for version, s in found
        if s and (value := number(s["value"])) is not None
    ]


def _bibtex(text: str) -> str:
    lines = [line for line in text.splitlines() if line.strip()]
    return "\n".join(("  " if line[0].isspace() else "") + shown(line, 2000) for line in lines)
