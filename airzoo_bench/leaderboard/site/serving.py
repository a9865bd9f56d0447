"""Shows a built site on this machine: read only, no file outside of its folder."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

from airzoo_bench.core.errors import UsageError
from airzoo_bench.leaderboard.site.api_files import MARK

__all__ = ["serve_folder"]

_ADDRESS = "127.0.0.1"


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
    if not (site / MARK).is_file():
        raise UsageError(
            "not the site of a board",
            where=site,
            expected=f"a folder with {MARK}",
            fix=f"airzoo-bench leaderboard build --out {site}",
        )
    handler = partial(_Handler, directory=str(site))
    try:
        server = ThreadingHTTPServer((_ADDRESS, port), handler)
    except OSError as error:
        raise UsageError(
            f"port {port} cannot be used: {error.strerror}", fix="name another by --port, or 0"
        ) from error
    with server:
        show(f"http://{_ADDRESS}:{server.server_address[1]}/ (Ctrl-C ends it)\n")
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            show("\n")
