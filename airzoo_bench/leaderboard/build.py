"""Builds the site of a board, a folder that appears whole, and shows it on this machine."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Callable, Mapping
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from airzoo_bench.core.errors import UsageError
from airzoo_bench.core.files import atomic_folder, check_new_folder, only_writer
from airzoo_bench.core.version import __version__
from airzoo_bench.leaderboard.board import Board
from airzoo_bench.leaderboard.measured import Entry, entries_of, forget_others, read_entries
from airzoo_bench.leaderboard.pages import render_pages
from airzoo_bench.leaderboard.tables import make_table
from airzoo_bench.protocol.model import find_protocol

BOARD_JSON = "board.json"
"""The file by which the folder of a site is known."""

_ADDRESS = "127.0.0.1"
_SCHEMA = 3
_FACTS = ("id", "kind", "method", "team", "source", "reason", "date", "rescored", "code", "paper")
_PARTS = ("value", "low", "high", "standard_error")
# An entry of a work whose commands are accents, letters and escaped signs, none of which acts.
_WORK = re.compile(r"\s*@(?!comment|preamble|string)[a-z]+\s*\{", re.IGNORECASE)
_ACTS = re.compile(r"\\([A-Za-z]*@|[A-Za-z]{3})|\\\Z|\^\^")
_TEX = {
    **{"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"},
    **{letter: f"\\{letter}" for letter in "{}#$%&_"},
    **{'"': "''", "@": "{@}"},
}


def build_board(
    runs: Path, submissions: Path, board: Board, data: Path, out: Path, note: Callable[[str], None]
) -> Path:
    """Build the site in place of an earlier one; folders of runs and submissions may be missing."""
    cache = out.with_name(f"{out.name}.cache")
    check_new_folder(out, replace=True, mark=BOARD_JSON)
    with only_writer(cache):
        entries = read_entries(runs, submissions, cache, note)
        versions = [one.measured for entry in entries for one in (entry, *entry.older)]
        forget_others({one.key for one in versions if one is not None}, cache)
        files = _site_files(_board_json(entries, board, data, cache), note)
        with atomic_folder(out, replace=True, mark=BOARD_JSON) as folder:
            for path, content in files.items():
                target = folder / path
                target.parent.mkdir(parents=True, exist_ok=True)
                target.write_text(content, encoding="utf-8", newline="")
    return out


def _board_json(entries: list[Entry], board: Board, data: Path, cache: Path) -> dict[str, Any]:
    """Return all that the pages show, tables in the order of leaderboard.toml."""
    tables = {}
    for benchmark in board.benchmarks:
        for name in benchmark.protocols:
            protocol = find_protocol(name, data)
            own = entries_of(entries, protocol)
            tables[name] = make_table(protocol, benchmark.title, own, cache)[0]
    dates = [row.rescored for table in tables.values() for row in table.rows if row.rescored]
    return {
        "schema": _SCHEMA,
        "title": board.title,
        "url": board.url,
        "repository": board.repository,
        "updated": max(dates, default=None),
        "made_with": __version__,
        "benchmarks": [
            {"name": one.name, "title": one.title, "tables": list(one.protocols)}
            for one in board.benchmarks
        ],
        "tables": {name: json.loads(table.model_dump_json()) for name, table in tables.items()},
    }


def _site_files(board: dict[str, Any], note: Callable[[str], None]) -> dict[str, str]:
    """Return the content of all files of the site by their paths."""
    files = {}
    for table in board["tables"].values():
        for row in table["rows"]:
            row["bibtex"] = bibtex(row, board["title"])
            if row["kind"] == "failed":
                note(f"{row['id']}: no score: {row['reason']}")
        files[f"tables/{table['id']}/table.csv"] = table_csv(table)
    text = json.dumps(board, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    files[BOARD_JSON] = f"{text}\n"
    return files | render_pages(board)


# --- downloads ---


def table_csv(table: Mapping[str, Any]) -> str:
    """Return the averages over scenes of a table, a line a row, numbers as in board.json."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    keys = [column["key"] for column in table["scores"]]
    ends = (*_PARTS, "rank_first", "rank_last")
    writer.writerow([*_FACTS, *(f"{key} {end}" for key in keys for end in ends)])
    for row in table["rows"]:
        # No spreadsheet may take a text for a formula.
        texts = [row[name] or "" for name in _FACTS]
        cells = [f"'{text}" if text[:1] in tuple("=+-@") else text for text in texts]
        for key in keys:
            score = row["scores"].get(key, {})
            cells += [score.get(name) for name in _PARTS] + [*(score.get("rank") or ("", ""))]
        writer.writerow(["" if cell is None else cell for cell in cells])
    return out.getvalue()


def bibtex(row: Mapping[str, Any], board: str) -> str:
    """Return a BibTeX entry: the authors' own if it is valid, else one from the metadata."""
    own = row["bibtex"].strip()
    if own and _is_one_entry(own):
        return f"{own}\n"
    address = re.sub(r"[{}\\%#]", "", row["paper"] or row["code"] or "")
    fields = {
        "title": f"{{{_escaped(row['method'])}}}",
        "author": " and ".join(f"{{{_escaped(name)}}}" for name in row["authors"]),
        "year": (row["date"] or "")[:4],
        "howpublished": f"\\url{{{address}}}" if address else "",
        "note": _escaped(f"{row['source'] or row['team']}; {board}".strip("; ")),
    }
    lines = [f"  {key} = {{{value}}}" for key, value in fields.items() if value]
    return f"@misc{{{row['id']},\n" + ",\n".join(lines) + "\n}\n"


def _is_one_entry(text: str) -> bool:
    """Whether it is the entry of a work, braces close where it ends, and no command acts."""
    depth, opened = 0, text.find("{")
    for place, letter in enumerate(text):
        depth += {"{": 1, "}": -1}.get(letter, 0)
        if depth < 0 or (depth == 0 and opened < place < len(text) - 1):
            return False
    return depth == 0 and _ACTS.search(text) is None and _WORK.match(text) is not None


def _escaped(text: str) -> str:
    return "".join(_TEX.get(letter, letter) for letter in text if letter.isprintable())


# --- serving ---


class _Handler(SimpleHTTPRequestHandler):
    """Answers GET and HEAD; says nothing to the terminal, and lets no browser store a page."""

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - the base class's name
        """Say nothing."""

    def end_headers(self) -> None:
        """Let no browser store a page that the next build replaces."""
        self.send_header("Cache-Control", "no-store")
        super().end_headers()


def serve_folder(site: Path, port: int, show: Callable[[str], None]) -> None:
    """Serve a site until Ctrl-C."""
    if not (site / BOARD_JSON).is_file():
        fix = f"airzoo-bench leaderboard build --out {site}"
        raise UsageError("not the site of a board", where=site, fix=fix)
    try:
        handler = partial(_Handler, directory=str(site))
        server = ThreadingHTTPServer((_ADDRESS, port), handler)
    except OSError as error:
        what = f"port {port} cannot be used: {error.strerror}"
        raise UsageError(what, fix="name another by --port, or 0") from error
    with server:
        show(f"http://{_ADDRESS}:{server.server_address[1]}/ (Ctrl-C ends it)\n")
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            show("\n")
