"""Builds the site of a board, a folder that appears whole, and shows it on this machine."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.files import atomic_folder, check_new_folder
from airzoo_bench.core.version import __version__
from airzoo_bench.leaderboard.answers import read_entries
from airzoo_bench.leaderboard.board import Board
from airzoo_bench.leaderboard.pages import render_pages
from airzoo_bench.leaderboard.tables import make_table
from airzoo_bench.protocol.model import find_protocol

BOARD_JSON = "board.json"
"""The file by which the folder of a site is known."""

_ADDRESS = "127.0.0.1"
_FACTS = ("id", "kind", "method", "team", "source", "reason", "date", "rescored", "code", "paper")
_PARTS = ("value", "low", "high", "standard_error")


def build_board(runs: Path, submissions: Path, board: Board, data: Path, out: Path) -> list[str]:
    """Build the site in place of an earlier one, and return why submissions are not shown.

    Folders of runs and submissions may be missing.
    """
    check_new_folder(out, replace=True, mark=BOARD_JSON)
    content = board_json(runs, submissions, board, data, out.with_name(f"{out.name}.cache"))
    tables = content["tables"].values()
    files = {f"tables/{table['id']}/table.csv": table_csv(table) for table in tables}
    text = json.dumps(content, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    files |= {BOARD_JSON: f"{text}\n"} | render_pages(content)
    with atomic_folder(out, replace=True, mark=BOARD_JSON) as folder:
        for path, page in files.items():
            target = folder / path
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_text(page, encoding="utf-8", newline="")
    failed = [row for table in tables for row in table["rows"] if row["kind"] == "failed"]
    return [f"{row['id']}: no score: {row['reason']}" for row in failed]


def board_json(
    runs: Path, submissions: Path, board: Board, data: Path, cache: Path
) -> dict[str, Any]:
    """Return all that the pages show, tables in the order of leaderboard.toml."""
    entries, tables = read_entries(runs, submissions), {}
    for benchmark in board.benchmarks:
        for name in benchmark.protocols:
            made = make_table(find_protocol(name, data), benchmark.title, entries, cache)
            tables[name] = json.loads(made.model_dump_json())
            for row in tables[name]["rows"]:
                row["bibtex"] = row["bibtex"] or bibtex(row, board.title)
    dates = [row["rescored"] for table in tables.values() for row in table["rows"]]
    return {
        "schema": 3,
        "title": board.title,
        "url": board.url,
        "repository": board.repository,
        "updated": max(filter(None, dates), default=None),
        "made_with": __version__,
        "benchmarks": [
            {"name": one.name, "title": one.title, "tables": list(one.protocols)}
            for one in board.benchmarks
        ],
        "tables": tables,
    }


def table_csv(table: Mapping[str, Any]) -> str:
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


def bibtex(row: Mapping[str, Any], board: str) -> str:
    """Return a BibTeX entry made from what a row states."""

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
    key = row["id"].replace("~", "-")
    return f"@misc{{{key},\n" + ",\n".join(lines) + "\n}\n"


def serve_folder(site: Path, port: int, show: Callable[[str], None]) -> None:
    """Serve a site until Ctrl-C."""
    if not (site / BOARD_JSON).is_file():
        fix = f"airzoo-bench leaderboard build --out {site}"
        raise UsageError("not the site of a board", where=site, fix=fix)
    handler = partial(SimpleHTTPRequestHandler, directory=str(site))
    try:
        server = ThreadingHTTPServer((_ADDRESS, port), handler)
    except OSError as error:
        what = f"port {port} cannot be used: {error.strerror}"
        raise UsageError(what, fix="name another by --port, or 0") from error
    with server, suppress(KeyboardInterrupt):
        show(f"http://{_ADDRESS}:{server.server_address[1]}/ (Ctrl-C ends it)\n")
        server.serve_forever()
