"""Builds the site of a board, a folder that appears whole, and shows it on this machine."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

from airzoo_bench.core.errors import SubmissionError, UsageError
from airzoo_bench.core.files import atomic_folder, check_new_folder, only_writer
from airzoo_bench.leaderboard.board import Board
from airzoo_bench.leaderboard.board_json import make_board, plain_json
from airzoo_bench.leaderboard.downloads import bibtex, table_csv
from airzoo_bench.leaderboard.entries import read_entries, read_results, waiting
from airzoo_bench.leaderboard.measured import forget_others
from airzoo_bench.leaderboard.pages import render_pages

__all__ = ["Given", "build_board", "serve_folder"]

BOARD_JSON = "board.json"
"""The file by which the folder of a site is known."""

_ADDRESS = "127.0.0.1"


@dataclass(frozen=True)
class Given:
    """The inputs of a board.

    Folders of runs and of submissions need not be there; results are plain ones, as `table` takes
    them; prepared benchmarks in the folder of data may have protocols of their own.
    """

    runs: Path
    submissions: Path
    results: Sequence[Path]
    board: Board | None
    data: Path


def build_board(given: Given, out: Path, cache: Path, note: Callable[[str], None]) -> Path:
    """Build the site, in place of an earlier one."""
    check_new_folder(out, replace=True, mark=BOARD_JSON)
    out.parent.mkdir(parents=True, exist_ok=True)
    try:
        with only_writer(out):
            cache.mkdir(parents=True, exist_ok=True)
            files = _files(given, cache, note)
            with atomic_folder(out, replace=True, mark=BOARD_JSON) as folder:
                for path, content in files.items():
                    target = folder / path
                    target.parent.mkdir(parents=True, exist_ok=True)
                    target.write_text(content, encoding="utf-8", newline="")
    except BlockingIOError as error:
        fix = "wait until it has ended"
        raise SubmissionError("another build writes it", where=out, fix=fix) from error
    return out


def _files(given: Given, cache: Path, note: Callable[[str], None]) -> dict[str, str]:
    """Return the content of all files of the site by their paths."""
    entries = read_entries(given.runs, cache, note)
    entries += waiting(given.submissions, entries)
    entries += read_results(given.results, cache)
    every = [one.measured for entry in entries for one in (entry, *entry.older)]
    forget_others({one.kept for one in every if one is not None}, cache)
    board = plain_json(make_board(entries, given.board, given.data, cache))
    files = {}
    for table in board["tables"].values():
        for row in table["rows"]:
            row["bibtex"] = bibtex(row, board["title"])
            if row["kind"] == "failed":
                note(f"{row['id']}: no score: {row['reason']}")
        files[f"tables/{table['id']}/table.csv"] = table_csv(table)
    files[BOARD_JSON] = json.dumps(board, ensure_ascii=False, separators=(",", ":")) + "\n"
    return files | render_pages(board)


class _Handler(SimpleHTTPRequestHandler):
    """Answers GET and HEAD; says nothing to the terminal."""

    def send_head(self):  # type: ignore[no-untyped-def]
        """Refuse what leads out of the folder, also by a symbolic link, and lists of folders."""
        root = Path(self.directory).resolve()
        path = Path(self.translate_path(self.path)).resolve()
        path = path / "index.html" if path.is_dir() else path
        if not path.is_relative_to(root) or not path.is_file():
            self.send_error(404)
            return None
        return super().send_head()

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - the base class's name
        """Keep quiet."""

    def end_headers(self) -> None:
        """Let no browser keep a page that the next build replaces."""
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
    handler = partial(_Handler, directory=str(site))
    try:
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
