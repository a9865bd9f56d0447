"""Builds the site of a board, a folder that appears whole, and shows it on this machine."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from airzoo_bench.core.errors import SubmissionError, UsageError
from airzoo_bench.core.files import atomic_folder, check_new_folder, only_writer
from airzoo_bench.leaderboard.board import Board
from airzoo_bench.leaderboard.board_json import make_board, plain_json
from airzoo_bench.leaderboard.measured import Entry, forget_others, measure, read_entries
from airzoo_bench.leaderboard.pages import render_pages
from airzoo_bench.results.files import result_paths

__all__ = ["bibtex", "build_board", "serve_folder", "table_csv"]

BOARD_JSON = "board.json"
"""The file by which the folder of a site is known."""

_ADDRESS = "127.0.0.1"
_FACTS = ("id", "kind", "method", "team", "source", "reason", "date", "rescored", "code", "paper")
_PARTS = ("value", "low", "high", "standard_error")
# An entry of a work whose commands are accents, letters, escaped signs and the look of text.
_WORK = re.compile(r"\s*@(?!comment|preamble|string)[a-z]+\s*\{", re.IGNORECASE)
_COMMAND = re.compile(r"\\([A-Za-z@]+|.|\Z)", re.DOTALL)
_HARMLESS = re.compile(
    r"""["'`^\\~=.&%$#_{} ,-]|[bcdHijklLoOrtuv]|ae|AE|oe|OE|aa|AA|ss|emph|em|it|bf|tt|sc|url|href"""
    r"|text(it|bf|tt|sc|superscript|subscript|endash|emdash|asciitilde)|math(cal|rm|bb|bf|it)"
    r"|l?dots|pi|alpha|beta|[gG]amma|[dD]elta|[lL]ambda|[sS]igma|dh|DH|th|TH|dj|DJ|ng|NG"
)
_TEX = {
    **{"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"},
    **{letter: f"\\{letter}" for letter in "{}#$%&_"},
    **{'"': "''", "@": "{@}"},
}


def build_board(
    runs: Path,
    submissions: Path,
    results: Sequence[Path],
    board: Board | None,
    data: Path,
    out: Path,
    note: Callable[[str], None],
) -> Path:
    """Build the site in place of an earlier one; folders of runs and submissions may be missing.

    Results are plain ones, as `table` takes them; a fault of one is the user's own.
    """
    cache = out.with_name(f"{out.name}.cache")
    check_new_folder(out, replace=True, mark=BOARD_JSON)
    cache.mkdir(parents=True, exist_ok=True)
    try:
        with only_writer(out):
            entries = read_entries(runs, submissions, cache, note)
            plain = [measure(file, cache) for file in sorted(result_paths(results))]
            entries += [Entry(None, measured=one) for one in plain]
            versions = [one.measured for entry in entries for one in (entry, *entry.older)]
            forget_others({one.key for one in versions if one is not None}, cache)
            files = _site_files(plain_json(make_board(entries, board, data, cache)), note)
            with atomic_folder(out, replace=True, mark=BOARD_JSON) as folder:
                for path, content in files.items():
                    target = folder / path
                    target.parent.mkdir(parents=True, exist_ok=True)
                    target.write_text(content, encoding="utf-8", newline="")
    except BlockingIOError as error:
        fix = "wait until it has ended"
        raise SubmissionError("another build writes it", where=out, fix=fix) from error
    return out


def _site_files(board: dict[str, Any], note: Callable[[str], None]) -> dict[str, str]:
    """Return the content of all files of the site by their paths."""
    files = {}
    for table in board["tables"].values():
        for row in table["rows"]:
            row["bibtex"] = bibtex(row, board["title"])
            if row["kind"] == "failed":
                note(f"{row['id']}: no score: {row['reason']}")
        files[f"tables/{table['id']}/table.csv"] = table_csv(table)
    files[BOARD_JSON] = json.dumps(board, ensure_ascii=False, separators=(",", ":")) + "\n"
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
    harmless = all(map(_HARMLESS.fullmatch, _COMMAND.findall(text)))
    caret = "^^" in text  # TeX reads ^^5c as a backslash
    return depth == 0 and harmless and not caret and _WORK.match(text) is not None


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
        self.send_header("X-Content-Type-Options", "nosniff")
        super().end_headers()


def serve_folder(site: Path, port: int, show: Callable[[str], None]) -> None:
    """Serve a site until Ctrl-C."""
    if not (site / BOARD_JSON).is_file():
        raise UsageError(
            "not the site of a board",
            where=site,
            expected=f"a folder with {BOARD_JSON}",
            fix=f"airzoo-bench leaderboard build --out {site}",
        )
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
