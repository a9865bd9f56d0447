"""The pages of a board, made of board.json alone.

A page holds its style, its script and its data, so that it works from disk and loads nothing; its
policy allows these by their hashes. Whatever strangers wrote is shown on one line, without letters
that are not seen, and escaped; of their addresses only https links are left.
"""

from __future__ import annotations

import datetime
import math
import re
import unicodedata
from collections.abc import Mapping, Sequence
from functools import lru_cache
from importlib import resources
from typing import Any
from urllib.parse import urlsplit

import jinja2
from markupsafe import Markup, escape

from airzoo_bench.report.packing import content_policy, page_json
from airzoo_bench.tables.model import show_number

__all__ = ["render_pages", "safe_url", "shown"]

Json = Mapping[str, Any]

FEW = 20
"""Groups of fewer queries are greyed."""

_UNITS = {"share": "%", "m": "m", "deg": "°"}
_KINDS = {"reported": "reported, not re-scored", "sealed": "sealed", "floor": "no method"}
_KINDS |= {"re-scored": "scored here", "failed": "not scored"}
_SCORED = ("re-scored", "sealed")
_LEADING, _RECENT, _MOST_TRAINING = 3, 8, 4
_MOST, _MARKS = 300, 3  # marks on one letter: a pile of them covers other lines
_HIDDEN = {"Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"}
_BLANK = frozenset(" \N{REPLACEMENT CHARACTER}\u115f\u1160\u17b4\u17b5\u2800\u3164\uffa0")
_URL = re.compile(r"https://[^\s<>\"'`\\]+")
_INTERVAL_WIDTH, _HEIGHT, _EDGE = 112, 12, 4
_WIDE, _LOW, _LEFT = 720, 190, 46  # of a timeline


def render_pages(board: Json) -> dict[str, str]:
    """Return the HTML of every page by its path from the site's root."""
    tables = list(board["tables"].values())
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

    page("index.html", "front.html", recent=_recent(tables))
    page("about.html", "about.html", tables=tables)
    for table in tables:
        home = f"tables/{table['id']}"
        lead = _lead(table)
        view, data = _table_view(table, lead), {"parts": _parts(table)}
        page(f"{home}/index.html", "table.html", "board.js", data, table=table, lead=lead, **view)
        if table["pairs"]:
            compared = _compared(table)
            page(f"{home}/compare.html", "compare.html", "compare.js", compared, table=table)
        ranked = {name for one in table["pairs"].values() for name in one["ids"]}
        for row in table["rows"]:
            if row["kind"] != "floor":
                path, comparable = f"{home}/{row['id']}.html", row["id"] in ranked
                page(path, "method.html", "copy.js", table=table, row=row, comparable=comparable)
    return found


@lru_cache
def _read(name: str, package: str = "airzoo_bench.leaderboard") -> str:
    return (resources.files(package) / "html" / name).read_text(encoding="utf-8")


@lru_cache
def _style() -> str:
    """Return the stylesheet of the report, and the board's own additions."""
    return _read("style.css", "airzoo_bench.report") + _read("board.css")


def _environment(board: Json) -> jinja2.Environment:
    env = jinja2.Environment(
        loader=jinja2.FunctionLoader(_read),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        finalize=_visible,  # of whatever a template forgot to have cleaned
        trim_blocks=True,
        lstrip_blocks=True,
        auto_reload=False,
    )
    env.filters |= {"shown": shown, "safe_url": safe_url, "host": _host}
    env.globals |= {
        "board": board,
        "cell": _cell,
        "facts_of": _facts,
        "finding_text": _finding_text,
        "kinds": _KINDS,
        "lead_of": _lead,
        "leaders": _leaders,
        "number": _text,
        "pipeline": _pipeline,
        "rank_text": _rank_text,
        "short_title": _short_title,
        "unit": lambda column: (
            f"{_UNITS[column['unit']]} {'↑' if column['higher_is_better'] else '↓'}"
        ),
        "units": _UNITS,
    }
    return env


# --- texts of strangers ---


@lru_cache(maxsize=4096)
def _shown(text: str, most: int) -> str:
    line = " ".join(text.split())
    letters, marks = [], 0
    for letter in line[: 4 * most]:
        kind = unicodedata.category(letter)
        marks = marks + 1 if kind in ("Mn", "Me") else 0
        if marks <= _MARKS:
            letters.append("\N{REPLACEMENT CHARACTER}" if kind in _HIDDEN else letter)
    if all(letter in _BLANK for letter in letters):
        return "(no visible text)"
    found = "".join(letters)
    return found if len(found) <= most else found[: most - 1] + "…"


def shown(text: object, most: int = _MOST) -> str:
    """Return a text as it may stand in a page, on one line; it is still to be escaped."""
    return _shown(str(text), most)


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


def _cell(column: Json, values: Sequence[Any], kind: str = "", at: Any = "") -> Markup:
    """Return the cell of a score, (value, low, high), and its key for sorting."""
    value, low, high = values
    if value is None:
        sort, text = "", "–"
    else:
        sort, text = f"{_number(value):.9g}", f'<span class="value">{_text(column, value)}</span>'
    if low is not None and high is not None:
        between = f"{_text(column, low)} to {_text(column, high)}"
        text += f'<span class="interval">{between}</span>'
    placed = "" if at == "" else f' data-at="{at}"'
    return Markup(f'<td class="num {kind}" data-v="{sort}"{placed}>{text}</td>')


def _rank_text(rank: Sequence[int] | None) -> str:
    return "" if rank is None else "–".join(map(str, dict.fromkeys(rank)))


def _lead(table: Json) -> Json:
    """Return the score that a table is ordered by, the first that any row has."""
    rows = [row for row in table["rows"] if row["kind"] != "floor"]
    scores: Sequence[Json] = table["scores"]
    return next((c for c in scores if any(c["key"] in r["scores"] for r in rows)), scores[0])


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


def _leaders(table: Json, lead: Json) -> list[Json]:
    """Return the first rows of a table, those that were scored here where there are any."""
    rows = [r for r in table["rows"] if r["kind"] != "floor" and lead["key"] in r["scores"]]
    return ([row for row in rows if row["kind"] in _SCORED] or rows)[:_LEADING]


def _recent(tables: Sequence[Json]) -> list[tuple[str, Json, Json]]:
    """Return the latest entries: the date, the table and the row of each."""
    found = [
        (row["rescored"], table, row)
        for table in tables
        for row in table["rows"]
        if row["rescored"] and row["kind"] in _SCORED
    ]
    return sorted(found, key=lambda one: (one[0], one[2]["date"] or ""), reverse=True)[:_RECENT]


# --- tables ---


def _table_view(table: Json, lead: Json) -> dict[str, Any]:
    """Return what the page of a table shows beside board.json."""
    methods = [row for row in table["rows"] if row["kind"] != "floor"]
    scores = [row["scores"].get(lead["key"], {}) for row in table["rows"]]
    ends = _finite(one.get(key) for one in scores for key in ("value", "low", "high"))
    low, high = (min(ends), max(ends)) if ends else (0.0, 0.0)
    dated = sorted(
        (row["rescored"] or row["date"], float(row["scores"][lead["key"]]["value"]), row["method"])
        for row in methods
        if (row["rescored"] or row["date"]) and row["kind"] in _SCORED
        and row["scores"].get(lead["key"], {}).get("value") is not None
    )  # fmt: skip
    return {
        "rows": [_row_view(table, lead, at, (low, high)) for at in range(len(table["rows"]))],
        "scale": f"{_text(lead, low)} to {_text(lead, high)}" if low < high else "",
        "views": _views(table),
        "more": any(not column["headline"] for column in table["scores"]),
        "timeline": _timeline([one for one in dated if math.isfinite(one[1])], lead),
        "kinds_here": list(dict.fromkeys(row["kind"] for row in methods)),
        "pipelines": sorted({_pipeline(row) for row in methods} - {""}),
        "training": sorted({shown(n) for row in methods for n in row["training_data"] or ()}),
        "comparable": bool(table["pairs"]),
        "costs": any(row["seconds_per_query"] is not None for row in methods),
        "stated": any(row["date"] for row in methods),
    }


def _row_view(table: Json, lead: Json, at: int, scale: tuple[float, float]) -> dict[str, Any]:
    row = table["rows"][at]
    cells = []
    for place, column in enumerate(table["scores"]):
        score = row["scores"].get(column["key"], {})
        kind = " ".join(
            ["lead"] * (column is lead)
            + ["more"] * (not column["headline"])
            + ["tied"] * bool(score.get("near_best"))
        )
        cells.append(_cell(column, [score.get(k) for k in ("value", "low", "high")], kind, place))
    training, first = row["training_data"], row["scores"].get(lead["key"], {})
    names = [*map(shown, training or ())]
    more = [f"and {len(names) - _MOST_TRAINING} more"] if len(names) > _MOST_TRAINING else []
    return {
        "row": row,
        "at": at,
        "cells": cells,
        "rank": _rank_text(first.get("rank")),
        "drawn": _interval(first, scale) if scale[0] < scale[1] else "",
        "training": ", ".join(names[:_MOST_TRAINING] + more) or ("none" if training == [] else ""),
        "known": None if training is None else " ".join(names),
    }


def _views(table: Json) -> list[tuple[str, list[tuple[int, str, bool]]]]:
    """Return the parts of a benchmark that a table can show, by kind: place, title, whether few."""
    found, place = [], 0
    kinds = [("Scenes", [(s["title"], s["queries"]) for s in table["scenes"]])]
    for one in table["conditions"]:
        groups = list(zip(one["labels"], one["counts"], strict=True))
        kinds.append((shown(one["title"]).capitalize(), groups))
    for title, groups in kinds:
        options = []
        for label, count in groups:
            said = "" if count is None else f" ({count:,} {'query' if count == 1 else 'queries'})"
            few = count is not None and count < FEW and table["unit"] == "query"
            options.append((place, f"{shown(label)}{said}", few))
            place += 1
        found.append((title, options))
    return found


def _parts(table: Json) -> list[list[list[list[Any]]]]:
    """Return the numbers of scenes and conditions: a list a part, in it a row, in it a score."""
    factors = {c["key"]: 100 if c["unit"] == "share" else 1 for c in table["scores"]}

    def rounded(key: str, values: Sequence[Any]) -> list[Any]:
        numbers = map(_number, values)
        return [n if n is None or math.isinf(n) else round(n * factors[key], 2) for n in numbers]

    parts = []
    for scene in table["scenes"]:
        found = [row["scenes"].get(scene["id"], {}) for row in table["rows"]]
        parts.append([[rounded(key, one.get(key, ())) for key in factors] for one in found])
    for condition in table["conditions"]:
        found = [row["conditions"].get(condition["by"], {}) for row in table["rows"]]
        for group in range(len(condition["labels"])):
            parts.append(
                [
                    [rounded(k, one[k][group : group + 1] if k in one else ()) for k in factors]
                    for one in found
                ]
            )
    return parts


# --- two methods compared ---


def _compared(table: Json) -> dict[str, Any]:
    """Return the data of the page that compares two methods."""
    by_id = {row["id"]: row for row in table["rows"]}
    rows = [by_id[name] for name in next(iter(table["pairs"].values()))["ids"]]
    names = [shown(row["method"]) for row in rows]
    data = f"runs/{table['benchmark']}/{table['track']}"

    def of_scene(row: Json, scene: Json, key: str) -> float | None:
        return _number(row["scenes"].get(scene["id"], {}).get(key, [None])[0])

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
                "values": [_number(row["scores"][key]["value"]) for row in rows],
                "scenes": [
                    [of_scene(row, scene, key) for row in rows] for scene in table["scenes"]
                ],
                **{k: table["pairs"][key][k] for k in ("low", "high", "p", "p_holm")},
            }
            for column in table["scores"]
            if (key := column["key"]) in table["pairs"]
        ],
    }


# --- a method ---


def _facts(row: Json) -> list[tuple[str, list[str]]]:
    """Return titles and texts; those of a list stand apart, so that each keeps its direction."""
    training, seconds = row["training_data"], row["seconds_per_query"]
    cost = "" if seconds is None else f"{seconds:.3g} s a query"
    if cost and row["hardware"]:
        cost += f" on {shown(row['hardware'])}"
    facts: list[tuple[str, Sequence[str]]] = [
        ("Source", [row["source"]]),
        ("Team", [row["team"]]),
        ("Authors", row["authors"]),
        ("Submitted", [row["date"]]),
        ("Scored here", [row["rescored"]]),
        ("Pipeline", [_pipeline(row)]),
        ("Training data", ["none"] if training == [] else training or []),
        ("Cost, as claimed", [cost]),
        ("Licence", [row["licence"]]),
    ]
    return [(title, [shown(t, 1000) for t in texts]) for title, texts in facts if any(texts)]


def _finding_text(table: Json, one: Json) -> str:
    """Return the audit's finding on a printed number, and its source."""
    titles = {column["key"]: column["title"] for column in table["scores"]}
    scenes = {scene["id"]: scene["title"] for scene in table["scenes"]}
    score = shown(titles.get(one["score"], one["score"] or "a score"))
    scene = shown(scenes.get(one["scene"], "average"))
    source = f"; {shown(one['source'])}" if one["source"] else ""
    printed, why, grade = shown(one["printed"]), shown(one["why"], 1000), shown(one["grade"])
    return f"{score}, {scene}, printed {printed}{source}: {why} (audit: {grade})"


# --- drawings ---


def _finite(values: Any) -> list[float]:
    found = [float(value) for value in values if value is not None]
    return [value for value in found if math.isfinite(value)]


def _between(value: float, ends: tuple[float, float], first: float, last: float) -> float:
    """Return a value's place between two places, clipped at the ends."""
    share = (value - ends[0]) / (ends[1] - ends[0])
    return first + min(max(share, 0.0), 1.0) * (last - first)


def _interval(score: Json, scale: tuple[float, float]) -> Markup:
    """Draw a value as a dot and its interval as a line, on the scale of a column."""
    last = _INTERVAL_WIDTH - _EDGE
    if not _finite([score.get("value")]):
        return Markup("")
    drawn = _line("rule", _EDGE, last, 6)
    if score["low"] is not None and score["high"] is not None:
        low, high = (_between(float(score[k]), scale, _EDGE, last) for k in ("low", "high"))
        drawn += _line("whisker", low, high, 6)
    x = _between(float(score["value"]), scale, _EDGE, last)
    return _svg(
        _INTERVAL_WIDTH, _HEIGHT, f'{drawn}<circle class="dot" cx="{_px(x)}" cy="6" r="3"/>'
    )


def _timeline(entries: Sequence[tuple[str, float, str]], lead: Json) -> Markup:
    """Draw three or more scores by their dates, which ascend, and the best so far."""
    days = [datetime.date.fromisoformat(date).toordinal() for date, _, _ in entries]
    values = [value for _, value, _ in entries]
    if len(entries) < 3 or days[0] == days[-1] or min(values) == max(values):
        return Markup("")
    across, up = (days[0], days[-1]), (min(values), max(values))
    bottom, right = _LOW - 26, _WIDE - 12
    dots, rules, best = "", "", math.nan
    steps: list[tuple[float, float]] = []
    for value in up:
        y = _between(value, up, bottom, 14)
        rules += _line("rule", _LEFT, right, y) + _words(
            _LEFT - 6, y + 4, _text(lead, value), "end"
        )
    for day, (date, value, name) in zip(days, entries, strict=True):
        x, y = _between(day, across, _LEFT + 8, right - 8), _between(value, up, bottom, 14)
        if not steps or (value > best if lead["higher_is_better"] else value < best):
            steps += [(x, steps[-1][1] if steps else y), (x, y)]
            best = value
        title = f"<title>{escape(shown(name))}, {_text(lead, value)}, {date}</title>"
        dots += f'<circle class="dot" cx="{_px(x)}" cy="{_px(y)}" r="3.5">{title}</circle>'
    steps.append((right, steps[-1][1]))
    line = " ".join(f"{_px(x)},{_px(y)}" for x, y in steps)
    dates = _words(_LEFT, _LOW - 6, entries[0][0], "start")
    dates += _words(right, _LOW - 6, entries[-1][0], "end")
    return _svg(_WIDE, _LOW, f'<polyline class="path" points="{line}"/>{rules}{dots}{dates}')


def _svg(width: float, height: float, drawn: str) -> Markup:
    size = f'width="{width}" height="{height}" viewBox="0 0 {width} {height}"'
    return Markup(f'<svg {size} aria-hidden="true" focusable="false">{drawn}</svg>')


def _line(kind: str, first: float, last: float, y: float) -> str:
    ends = f'x1="{_px(first)}" x2="{_px(last)}" y1="{_px(y)}" y2="{_px(y)}"'
    return f'<line class="{kind}" {ends}/>'


def _words(x: float, y: float, text: str, anchor: str) -> str:
    return f'<text x="{_px(x)}" y="{_px(y)}" text-anchor="{anchor}">{escape(text)}</text>'


def _px(value: float) -> str:
    """Write a length to a tenth of a pixel, the same on every machine."""
    return f"{value:.1f}".removesuffix(".0")
