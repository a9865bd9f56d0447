"""The pages of a board, made of board.json alone.

A page holds its style, its script and its data, so that it works from disk and loads nothing; its
policy allows these by their hashes. Whatever strangers wrote is shown on one line, without letters
that are not seen, and escaped; of their addresses only https links are kept.
"""

from __future__ import annotations

import math
import re
import unicodedata
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from importlib import resources
from typing import Any
from urllib.parse import urlsplit

import jinja2
from markupsafe import Markup

from airzoo_bench.leaderboard.drawings import Point, Scale, history, interval, rank_bar, timeline
from airzoo_bench.report.packing import page_json
from airzoo_bench.report.policy import content_policy
from airzoo_bench.tables.model import show_number

__all__ = ["render_pages", "safe_url", "shown"]

Json = Mapping[str, Any]

FEW = 20
"""Groups of fewer queries are greyed."""

_UNITS = {"share": "%", "m": "m", "deg": "°"}
_KINDS = {"reported": "reported, not re-scored", "sealed": "sealed", "floor": "no method"}
_KINDS |= {"re-scored": "scored here", "failed": "not scored"}
_SCORED = ("re-scored", "sealed")
_LEADING, _RECENT, _MOST_TRAINING, _MOST_VERSIONS = 3, 8, 4, 12
_MOST, _MARKS = 300, 3  # marks on one letter: a pile of them covers other lines
_HIDDEN = {"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"}
_BLANK = frozenset("\u115f\u1160\u17b4\u17b5\u2800\u3164\uffa0")  # letters, and nothing to see
_URL = re.compile(r"https://[^\s<>\"'`\\]+")


def render_pages(board: Json) -> dict[str, str]:
    """Return the HTML of every page by its path from the site's root."""
    env, found = _environment(board), {}

    def page(path: str, template: str, script: str = "", data: Any = None, **values: Any) -> None:
        code = f'(function () {{\n"use strict";\n{_read(script)}}})();\n' if script else ""
        found[path] = env.get_template(template).render(
            policy=content_policy(code, _style()),
            style=Markup(_style()),
            script=Markup(code),
            data=None if data is None else Markup(page_json(data)),
            root="../" * path.count("/"),
            here=path,
            **values,
        )

    tables = list(board["tables"].values())
    page("index.html", "front.html", recent=_recent(tables))
    page("about.html", "about.html", tables=tables)
    for table in tables:
        home = f"tables/{table['id']}"
        view = _table_view(table)
        compared = _compared(table)
        page(f"{home}/index.html", "table.html", "board.js", _view_data(table), **view)
        if compared:
            values = {"table": table, "about": table["pairs"]}
            page(f"{home}/compare.html", "compare.html", "compare.js", compared, **values)
        for row in table["rows"]:
            if row["kind"] != "floor":
                page(
                    f"{home}/{row['id']}.html", "method.html", "copy.js", **_method_view(table, row)
                )
    return found


@lru_cache
def _read(name: str, package: str = "airzoo_bench.leaderboard") -> str:
    return (resources.files(package) / "html" / name).read_text(encoding="utf-8")


def _style() -> str:
    """Return the stylesheet of the report, and what boards have besides."""
    return _read("style.css", "airzoo_bench.report") + _read("board.css")


def _environment(board: Json) -> jinja2.Environment:
    env = jinja2.Environment(
        loader=jinja2.FunctionLoader(_read),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        finalize=_visible,  # whatever a template forgot to have cleaned
        trim_blocks=True,
        lstrip_blocks=True,
    )
    env.filters |= {"shown": shown, "safe_url": safe_url, "host": _host}
    env.globals |= {
        "board": board,
        "cell": _cell,
        "kinds": _KINDS,
        "lead_of": _lead,
        "leaders": _leaders,
        "number": _text,
        "pipeline": _pipeline,
        "rank_text": _rank_text,
        "short_title": _short_title,
        "unit": lambda column: f"{_UNITS[column['unit']]} {_arrow(column)}",
        "units": _UNITS,
    }
    return env


# --- what strangers wrote ---


def shown(text: object, most: int = _MOST) -> str:
    """Return a text as it may stand in a page, on one line; it is still to be escaped."""
    return _shown(str(text), most)


@lru_cache(maxsize=4096)
def _shown(text: str, most: int) -> str:
    line = " ".join(text.split())
    letters, marks = [], 0
    for letter in line[: 4 * most]:
        kind = unicodedata.category(letter)
        marks = marks + 1 if kind in ("Mn", "Me") else 0
        if marks <= _MARKS:
            letters.append("\N{REPLACEMENT CHARACTER}" if kind in _HIDDEN else letter)
    if all(letter in _BLANK or letter in " \N{REPLACEMENT CHARACTER}" for letter in letters):
        return "(no visible text)"
    found = "".join(letters)
    return found if len(found) <= most else found[: most - 1] + "…"


def _visible(value: Any) -> Any:
    """Return what a page is about to print, without letters that are not seen but line breaks."""
    if not isinstance(value, str) or hasattr(value, "__html__") or value.isprintable():
        return value
    return "".join(
        "\N{REPLACEMENT CHARACTER}" if unicodedata.category(c) in _HIDDEN and c != "\n" else c
        for c in value
    )


def safe_url(address: object) -> str | None:
    """Return an address that may stand in a link: https, a host, no user; None of any other."""
    if not isinstance(address, str) or not _URL.fullmatch(address) or not address.isprintable():
        return None
    return address if _host(address) else None


def _host(address: str) -> str | None:
    try:
        parts = urlsplit(address)
        return None if "@" in parts.netloc else parts.hostname
    except ValueError:
        return None


# --- numbers ---


def _number(value: Any) -> float | None:
    """Return a number of board.json: infinite ones are texts there, and null is none."""
    return None if value is None else float(value)


def _text(column: Json, value: Any) -> str:
    """Write a number as tables show it: shares in percent."""
    found = _number(value)
    if found is None:
        return "–"
    return show_number(100 * found if column["unit"] == "share" else found, 2)


def _between(column: Json, low: Any, high: Any) -> str:
    return "" if low is None or high is None else f"{_text(column, low)} to {_text(column, high)}"


def _cell(
    column: Json, values: Sequence[Any], kind: str = "", mark: Any = "", at: Any = ""
) -> Markup:
    """Return the cell of a score, (value, low, high), and what it is sorted by."""
    value, low, high = values
    sort = "" if value is None else f"{_number(value):.9g}"
    between = _between(column, low, high)
    below = f'<span class="interval">{between}</span>' if between else ""
    placed = "" if at == "" else f' data-at="{at}"'
    text = "–" if value is None else f'<span class="value">{_text(column, value)}</span>'
    return Markup(f'<td class="num {kind}" data-v="{sort}"{placed}>{text}{mark}{below}</td>')


def _rank_text(rank: Sequence[int] | None) -> str:
    if rank is None:
        return ""
    return str(rank[0]) if rank[0] == rank[1] else f"{rank[0]}–{rank[1]}"


def _arrow(column: Json) -> str:
    return "↑" if column["higher_is_better"] else "↓"


def _lead(table: Json) -> Json:
    """Return the score that a table is ordered by, the first that any row has."""
    known = {key for row in table["rows"] if row["kind"] != "floor" for key in row["scores"]}
    found: Json = next((c for c in table["scores"] if c["key"] in known), table["scores"][0])
    return found


def _short_title(table: Json) -> str:
    """Return a table's title without the benchmark's title above it."""
    title, benchmark = shown(table["title"]), shown(table["benchmark_title"])
    rest = title.removeprefix(f"{benchmark}, ")
    return title if rest == title else rest[:1].upper() + rest[1:]


def _pipeline(row: Json) -> str:
    if row["stages"] is None:
        return ""
    return ", ".join([shown(row["stages"]), *(f"uses {shown(what)}" for what in row["uses"])])


# --- the front page ---


def _leaders(table: Json) -> list[Json]:
    """Return the first rows of a table, those that were scored here where there are any."""
    key = _lead(table)["key"]
    rows = [row for row in table["rows"] if row["kind"] != "floor" and key in row["scores"]]
    return ([row for row in rows if row["kind"] in _SCORED] or rows)[:_LEADING]


def _recent(tables: Sequence[Json]) -> list[tuple[str, Json, Json]]:
    """Return what came last: the date, the table and the row of each."""
    found = [
        (row["rescored"], table, row)
        for table in tables
        for row in table["rows"]
        if row["rescored"] and row["kind"] in _SCORED
    ]
    return sorted(found, key=lambda one: (one[0], one[2]["date"] or ""), reverse=True)[:_RECENT]


# --- tables ---


def _table_view(table: Json) -> dict[str, Any]:
    lead = _lead(table)
    numbers = [row["scores"].get(lead["key"], {}) for row in table["rows"]]
    scale = Scale.of(one.get(k) for one in numbers for k in ("value", "low", "high"))
    notes: dict[str, int] = {}
    rows = [_row_view(table, row, at, scale, notes) for at, row in enumerate(table["rows"])]
    methods = [row for row in table["rows"] if row["kind"] != "floor"]
    dated = [(row["rescored"] or row["date"] or "", row) for row in methods]
    return {
        "table": table,
        "rows": rows,
        "notes": notes,
        "scale": _between(lead, scale.low, scale.high) if scale else "",
        "views": _views(table),
        "more": any(not column["headline"] for column in table["scores"]),
        "timeline": timeline(
            [
                (date, float(row["scores"][lead["key"]]["value"]), shown(row["method"]))
                for date, row in sorted(dated, key=lambda pair: pair[0])
                if date and row["kind"] in _SCORED and lead["key"] in row["scores"]
            ],
            higher_is_better=lead["higher_is_better"],
            write=lambda value: _text(lead, value),
        ),
        "kinds_here": list(dict.fromkeys(row["kind"] for row in methods)),
        "pipelines": sorted({_pipeline(row) for row in methods} - {""}),
        "training": sorted({shown(n) for row in methods for n in row["training_data"] or ()}),
        "comparable": bool(table["pairs"]),
        "costs": any(row["seconds_per_query"] is not None for row in methods),
        "stated": any(row["date"] for row in methods),
    }


def _row_view(
    table: Json, row: Json, at: int, scale: Scale | None, notes: dict[str, int]
) -> dict[str, Any]:
    lead, scores = _lead(table), row["scores"]
    first = scores.get(lead["key"], {})
    count = sum(one["kind"] in _SCORED for one in table["rows"])
    marks: dict[str, list[int]] = {}
    for key, text in _notes(table, row):
        marks.setdefault(key, []).append(notes.setdefault(text, len(notes) + 1))
    cells = []
    for place, column in enumerate(table["scores"]):
        score = scores.get(column["key"], {})
        kind = " ".join(
            ["lead"] * (column is lead)
            + ["more"] * (not column["headline"])
            + ["tied"] * bool(score.get("near_best"))
        )
        values = [score.get(name) for name in ("value", "low", "high")]
        cells.append(_cell(column, values, kind, _links(marks.get(column["key"], ())), place))
    point = Point.of(first)
    training = row["training_data"]
    return {
        "row": row,
        "at": at,
        "marks": _links(marks.get("", ())),
        "cells": cells,
        "rank": _rank_text(first.get("rank")),
        "bar": rank_bar(first["rank"], count) if first.get("rank") else "",
        "drawn": interval(point, scale) if point and scale else "",
        "training": _training_text(training),
        "known": None if training is None else " ".join(map(shown, training)),
    }


def _training_text(training: Sequence[str] | None) -> str:
    if training is None:
        return ""
    names = [*map(shown, training[:_MOST_TRAINING])]
    more = len(training) - len(names)
    return ", ".join(names + [f"and {more} more"] * (more > 0)) or "none"


def _notes(table: Json, row: Json) -> Iterator[tuple[str, str]]:
    """Yield what is to be said of a row, or of one of its scores: the key and the sentence."""
    for note in row["notes"]:
        yield "", shown(note, 1000)
    titles = {column["key"]: shown(column["title"]) for column in table["scores"]}
    for one in row["findings"]:
        if not one["scene"]:
            title = titles.get(one["score"], shown(one["score"] or "a score"))
            place = one["score"] if one["score"] in row["scores"] else ""
            yield place, f"{shown(row['method'])}, {title}, printed {_finding(one)}"


def _finding(one: Json) -> str:
    """Return the audit's finding on a printed number, and its source."""
    source = f"; {shown(one['source'])}" if one["source"] else ""
    printed, why, grade = shown(one["printed"]), shown(one["why"], 1000), shown(one["grade"])
    return f"{printed}{source}: {why} (audit: {grade})"


def _links(numbers: Sequence[int]) -> Markup:
    """Return links to notes below the table."""
    return Markup("").join(
        Markup(f'<a class="mark" href="#note-{n}" aria-label="note {n}">†{n}</a>') for n in numbers
    )


def _views(table: Json) -> list[tuple[str, list[tuple[int, str, bool]]]]:
    """Return the parts of a benchmark that a table can show, by kind: place, title, whether few."""
    found, place = [], 0
    parts = [("Scenes", [(s["title"], s["queries"]) for s in table["scenes"]])]
    for one in table["conditions"]:
        groups = list(zip(one["labels"], one["counts"], strict=True))
        parts.append((shown(one["title"]).capitalize(), groups))
    for title, groups in parts:
        options = []
        for label, count in groups:
            said = "" if count is None else f" ({count:,} {'query' if count == 1 else 'queries'})"
            few = count is not None and count < FEW and table["unit"] == "query"
            options.append((place, f"{shown(label)}{said}", few))
            place += 1
        found.append((title, options))
    return found


def _view_data(table: Json) -> dict[str, Any]:
    """Return the numbers of scenes and conditions: a list a part, in it a row, in it a score."""
    keys = [column["key"] for column in table["scores"]]
    factors = {c["key"]: 100 if c["unit"] == "share" else 1 for c in table["scores"]}

    def rounded(key: str, value: Any) -> Any:
        number = _number(value)
        if number is None or not math.isfinite(number):
            return number
        return round(number * factors[key], 2)

    parts = []
    for scene in table["scenes"]:
        found = [row["scenes"].get(scene["id"], {}) for row in table["rows"]]
        parts.append([[[rounded(k, v) for v in one.get(k, ())] for k in keys] for one in found])
    for condition in table["conditions"]:
        found = [row["conditions"].get(condition["by"], {}) for row in table["rows"]]
        for group in range(len(condition["labels"])):
            parts.append(
                [[[rounded(k, one[k][group])] if k in one else [] for k in keys] for one in found]
            )
    return {"parts": parts}


# --- two methods compared ---


def _compared(table: Json) -> dict[str, Any]:
    """Return what the page that compares two methods holds; nothing where there are no pairs."""
    if not table["pairs"]:
        return {}
    first = next(iter(table["pairs"].values()))
    by_id = {row["id"]: row for row in table["rows"]}
    rows = [by_id[name] for name in first["ids"]]
    names = [shown(row["method"]) for row in rows]
    data = f"runs/{table['benchmark']}/{table['track']}"
    return {
        "methods": [
            {
                "id": row["id"],
                "name": f"{name} ({shown(row['team'])})" if names.count(name) > 1 else name,
                "run": f"{data}/{row['id']}/{row['version']}" if row["rescored"] else None,
            }
            for row, name in zip(rows, names, strict=True)
        ],
        "scene": table["scenes"][0]["id"],
        "scenes": [shown(scene["title"]) for scene in table["scenes"]],
        "scores": [
            {
                "title": shown(column["title"]),
                "unit": _UNITS[column["unit"]],
                "share": column["unit"] == "share",
                "higher": column["higher_is_better"],
                "values": [_number(row["scores"][column["key"]]["value"]) for row in rows],
                "scenes": [
                    [
                        _number(row["scenes"].get(scene["id"], {}).get(column["key"], [None])[0])
                        for row in rows
                    ]
                    for scene in table["scenes"]
                ],
                **{k: table["pairs"][column["key"]][k] for k in ("low", "high", "p", "p_holm")},
            }
            for column in table["scores"]
            if column["key"] in table["pairs"]
        ],
    }


# --- a method ---


def _method_view(table: Json, row: Json) -> dict[str, Any]:
    lead = _lead(table)
    versions = [one for one in row["history"] if one["table"] == table["id"]]
    points = [
        (f"version {one['number']}", float(one["scores"][lead["key"]]))
        for one in reversed(versions[:_MOST_VERSIONS])
        if one["scores"].get(lead["key"]) is not None
    ]
    text = [line for line in row["bibtex"].splitlines() if line.strip()]
    return {
        "table": table,
        "row": row,
        "facts": _facts(row),
        "links": [
            (name, url) for name in ("code", "paper", "weights") if (url := safe_url(row[name]))
        ],
        "findings": [_where(table, one) + _finding(one) for one in row["findings"]],
        "chart": history(points, lambda value: _text(lead, value)) if len(points) > 1 else "",
        "comparable": any(row["id"] in one["ids"] for one in table["pairs"].values()),
        "bibtex": "\n".join(("  " * line[0].isspace()) + shown(line, 2000) for line in text),
    }


def _facts(row: Json) -> list[tuple[str, list[str]]]:
    """Return titles and texts; those of a list stand apart, so that each keeps its direction."""
    training, seconds = row["training_data"], row["seconds_per_query"]
    cost = "" if seconds is None else f"{seconds:.3g} s a query"
    if cost and row["hardware"]:
        cost += f" on {shown(row['hardware'])}"
    facts: list[tuple[str, list[str]]] = [
        ("Source", [shown(row["source"], 1000)] if row["source"] else []),
        ("Team", [shown(row["team"])] if row["team"] else []),
        ("Authors", [*map(shown, row["authors"])]),
        ("Submitted", [row["date"] or ""]),
        ("Scored here", [row["rescored"] or ""]),
        ("Pipeline", [_pipeline(row)]),
        ("Training data", [] if training is None else [*map(shown, training)] or ["none"]),
        ("Cost, as claimed", [cost]),
        ("Licence", [shown(row["licence"])] if row["licence"] else []),
    ]
    return [(title, texts) for title, texts in facts if any(texts)]


def _where(table: Json, finding: Json) -> str:
    titles = {column["key"]: shown(column["title"]) for column in table["scores"]}
    scenes = {scene["id"]: shown(scene["title"]) for scene in table["scenes"]}
    score = titles.get(finding["score"], shown(finding["score"] or "a score"))
    scene = scenes.get(finding["scene"], "average")
    return f"{score}, {scene}, printed "
