"""Builds the site of a board: board.json, tables as CSV, and pages made of board.json alone.

A page holds its style, its script and its data, so that it works from disk and loads nothing; its
policy allows these by their hashes. The rules of submission.toml keep hidden letters and other
addresses than https out of strangers' texts; pages escape them.
"""

from __future__ import annotations

import csv
import datetime
import io
import json
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup

from airzoo_bench.core.errors import SubmissionError
from airzoo_bench.core.files import atomic_folder, atomic_write, check_new_folder, fingerprint
from airzoo_bench.core.version import __version__
from airzoo_bench.leaderboard.answers import PICTURES_FILE, Entry, Keep, read_entries
from airzoo_bench.leaderboard.board import BOARD_FILE, Board
from airzoo_bench.leaderboard.tables import empty_table, make_table
from airzoo_bench.protocol.model import protocol_files
from airzoo_bench.report.packing import TEMPLATES, content_policy, page_json
from airzoo_bench.tables.model import show_number

Json = Mapping[str, Any]

BOARD_JSON = "board.json"  # by which the folder of a site is known

_FACTS = ("id", "kind", "method", "team", "source", "reason", "date", "rescored", "code", "paper")
_PARTS = ("value", "low", "high", "standard_error")
_SCORED = ("re-scored", "sealed")
_COMPARED = ("id", "method", "team", "scores", "scenes", "history")
_LEADING = 3


def build_board(scored: Path, submissions: Path, board: Board, data: Path, out: Path) -> list[str]:
    """Build a site of the runs in `scored` in place of an earlier one; return what is not shown."""
    check_new_folder(out, replace=True, mark=BOARD_JSON)
    cache = out.with_name(f"{out.name}.cache")
    with _open_texts(cache / "texts.json") as keep:
        entries = read_entries(scored / "runs", submissions, keep)
        content = board_json(entries, board, data, cache, keep)
        pages = render_pages(content, scored, keep)
    tables = content["tables"].values()
    files = {f"tables/{table['id']}/table.csv": table_csv(table) for table in tables}
    text = json.dumps(content, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    files |= {BOARD_JSON: f"{text}\n"} | pages
    with atomic_folder(out, replace=True, mark=BOARD_JSON) as folder:
        for path, page in files.items():
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (folder / path).write_text(page, encoding="utf-8", newline="")
    failed = [row for table in tables for row in table["rows"] if row["kind"] == "failed"]
    return [f"{row['id']}: no score: {row['reason']}" for row in failed]


@contextmanager
def _open_texts(file: Path) -> Iterator[Keep]:
    """Yield a function that makes a part, or takes the last build's of the same code and input."""
    known, used = json.loads(file.read_text("utf-8")) if file.is_file() else {}, dict[str, Any]()
    home = Path(__file__).parents[1]  # tables, tests and the report's parts are on pages too
    sources = sorted([*home.rglob("*.py"), *home.rglob("html/*")])
    code = fingerprint([one.read_text("utf-8") for one in sources])

    def keep(shown: Any, make: Callable[[], Any]) -> Any:
        key = fingerprint([code, shown])
        return used.setdefault(key, known[key] if key in known else make())

    yield keep
    with atomic_write(file, "w") as stream:
        stream.write(json.dumps(used, ensure_ascii=False))


def board_json(
    entries: Sequence[Entry], board: Board, data: Path, cache: Path, keep: Keep
) -> dict[str, Any]:
    """Return all numbers and texts of the pages, tables in the order of leaderboard.toml."""
    tables, files = {}, protocol_files(data)
    for benchmark in board.benchmarks:
        for name in benchmark.protocols:
            shown = [name, benchmark.title, files[name].read_text("utf-8") if name in files else ""]
            empty = keep(shown, partial(empty_table, name, data, benchmark.title))
            if empty["benchmark"] != benchmark.name:
                raise SubmissionError(f"{name} is not of {benchmark.name}", where=BOARD_FILE)
            tables[name] = make_table(empty, entries, cache)
            for row in tables[name]["rows"]:
                row["bibtex"] = bibtex(row, board.title)
    dates = [row["rescored"] for table in tables.values() for row in table["rows"]]
    head = {"schema": 3, **board.model_dump(include={"title", "url", "repository"})}
    head |= {"updated": max(filter(None, dates), default=None), "made_with": __version__}
    listed = ((one.name, one.title, one.protocols) for one in board.benchmarks)
    head["benchmarks"] = [
        dict(zip(("name", "title", "tables"), one, strict=True)) for one in listed
    ]
    return head | {"tables": tables}


def table_csv(table: Json) -> str:
    """Return the averages over scenes of a table, a line a row, numbers as in board.json."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    keys = [column["key"] for column in table["scores"]]
    ends = (*_PARTS, "rank_first", "rank_last")
    writer.writerow([*_FACTS, *(f"{key} {end}" for key in keys for end in ends)])
    for row in table["rows"]:
        # No spreadsheet may take a text for a formula.
        cells = [re.sub("^([=+@-])", r"'\1", row[name] or "") for name in _FACTS]
        for key in keys:
            score = row["scores"].get(key, {})
            cells += [score.get(name) for name in _PARTS] + [*(score.get("rank") or ("", ""))]
        writer.writerow(cells)
    return out.getvalue()


def bibtex(row: Json, board: str) -> str:
    """Return the BibTeX entry of a row."""

    def escaped(text: str) -> str:
        return re.sub("([#$%&_])", r"\\\1", re.sub(r'[{}\\~^@"]', "", text))

    address = re.sub(r"[{}\\%#]", "", row["paper"] or row["code"] or "")
    fields = {
        "title": f"{{{escaped(row['method'])}}}",
        "author": " and ".join(f"{{{escaped(name)}}}" for name in row["authors"]),
        "year": (row["date"] or "")[:4],
        "howpublished": f"\\url{{{address}}}" if address else "",
        "note": escaped(f"{row['source'] or row['team']}; {board}".strip("; ")),
    }
    lines = [f"  {key} = {{{value}}}" for key, value in fields.items() if value]
    return ",\n".join([f"@misc{{{row['id'].replace('~', '-')}", *lines]) + "\n}\n"


# --- pages ---


def render_pages(board: Json, scored: Path, keep: Keep) -> dict[str, str]:
    """Return the HTML of every page by its path from the site's root.

    `scored` holds the pictures of runs; `keep` makes a page of a method from all that it shows.
    """
    found, rooms = {}, ("airzoo_bench.leaderboard", "airzoo_bench.report")
    loader = jinja2.ChoiceLoader([jinja2.PackageLoader(room, "html") for room in rooms])
    env = TEMPLATES.overlay(loader=loader, finalize=_show_visible)
    more = {"board": board, "lead_of": _lead, "leaders": _leaders, "text": _text}
    env.globals = env.globals | more  # a dictionary that the overlay does not share
    read = lru_cache(lambda name: loader.get_source(env, name)[0])
    head = {key: value for key, value in board.items() if key not in ("updated", "tables")}

    def page(path: str, template: str, script: str = "", data: Any = None, **values: Any) -> None:
        def make() -> str:
            sheets = ["style.css", "board.css"] + ["pictures.css"] * bool(values.get("pictures"))
            style = "".join(map(read, sheets))
            code = f'(function () {{\n"use strict";\n{read(script)}}})();\n' if script else ""
            own = {
                "policy": content_policy(code, style),
                "here": path,
                "root": "../" * path.count("/"),
            }
            own |= {"style": Markup(style), "script": Markup(code)}
            shown = None if data is None else Markup(page_json(data))
            return env.get_template(template).render(values | own, data=shown)

        found[path] = keep([path, values.pop("by")], make) if "by" in values else make()

    page("index.html", "front.html")
    page("about.html", "about.html", tables=[*board["tables"].values()])
    for table in board["tables"].values():
        home, lead = f"tables/{table['id']}", _lead(table)
        values = _values(table["rows"], lead, "value", "low", "high") or [0.0]
        ends = (min(values), max(values)) if min(values) < max(values) else None
        views = {"table": table, "lead": lead, "ends": ends, "curve": _timeline(table, lead)}
        shown = [{name: row[name] for name in ("scenes", "conditions")} for row in table["rows"]]
        data = {"scores": table["scores"], "rows": shown}
        page(f"{home}/index.html", "table.html", "board.js", data, **views)
        ranked = next(iter(table["pairs"].values()), {"ids": ()})["ids"]
        if ranked:
            members = [row for row in table["rows"] if row["id"] in ranked]
            data = {name: table[name] for name in ("scores", "scenes", "pairs")}
            data["rows"] = [{name: row[name] for name in _COMPARED} for row in members]
            page(f"{home}/compare.html", "compare.html", "compare.js", data, table=table)
        of_all = {key: value for key, value in table.items() if key not in ("rows", "pairs")}
        same = fingerprint([head, of_all, *map(read, loader.list_templates())])
        for row in table["rows"]:
            if row["kind"] != "floor":
                views = {"row": row, "comparable": row["id"] in ranked}
                views["pictures"] = read_pictures(scored, row["history"])
                views |= {"by": [same, dict(views)], "table": of_all}
                page(f"{home}/{row['id']}.html", "method.html", "copy.js", **views)
    return found


def read_pictures(scored: Path, history: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Read the pictures of the newest run in the history of a row."""
    paths = (scored / version["files"] / PICTURES_FILE for version in history[:1])
    texts = (path.read_text(encoding="utf-8") for path in paths if path.is_file())
    return next(map(json.loads, texts), {})


def _show_visible(value: Any) -> Any:
    """Return a value of a page without letters that are not seen, except line breaks."""
    if not isinstance(value, str) or hasattr(value, "__html__") or value.isprintable():
        return value
    shown = (c if c.isprintable() or c == "\n" else "\N{REPLACEMENT CHARACTER}" for c in value)
    return "".join(shown)


def _text(column: Json, value: Any) -> str:
    """Write a number as tables show it: shares in percent."""
    factor = 100 if column["unit"] == "share" else 1
    return "–" if value is None else show_number(float(value) * factor, 2)


def _values(rows: Sequence[Json], lead: Json, *keys: str) -> list[float]:
    """Return the finite numbers of a score."""
    found = (row["scores"].get(lead["key"], {}).get(key) for row in rows for key in keys)
    return [*filter(math.isfinite, (float(one) for one in found if one is not None))]


def _lead(table: Json) -> Json:
    """Return the score that a table is ordered by, the first that any row has."""
    rows = [row for row in table["rows"] if row["kind"] != "floor"]
    scores: Sequence[Json] = table["scores"]
    return next((c for c in scores if any(c["key"] in r["scores"] for r in rows)), scores[0])


def _leaders(table: Json, lead: Json) -> list[Json]:
    """Return the first rows of a table, those that were scored here where there are any."""
    rows = [r for r in table["rows"] if r["kind"] != "floor" and lead["key"] in r["scores"]]
    return ([row for row in rows if row["kind"] in _SCORED] or rows)[:_LEADING]


def _timeline(table: Json, lead: Json) -> list[tuple[Any, ...]]:
    """Return three or more scored methods by date: its place and the score's, the best so far."""
    dated = sorted(
        (row["rescored"], value, row["method"])
        for row in table["rows"]
        if row["kind"] in _SCORED
        for value in _values([row], lead, "value")
    )
    days = [datetime.date.fromisoformat(date).toordinal() for date, _, _ in dated]
    values = [value for _, value, _ in dated]
    if len(dated) < 3 or days[0] == days[-1] or min(values) == max(values):
        return []
    best, pick, found = values[0], max if lead["higher_is_better"] else min, []
    for day, (date, value, name) in zip(days, dated, strict=True):
        best = pick(best, value)
        up = [(one - min(values)) / (max(values) - min(values)) for one in (value, best)]
        across = (day - days[0]) / (days[-1] - days[0])
        found.append((date, across, *up, name, _text(lead, value)))
    return found
