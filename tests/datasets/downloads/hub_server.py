"""A server on this machine that speaks what a client of Hugging Face needs to fetch a dataset."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread
from typing import Any
from urllib.parse import unquote, urlsplit

COMMIT = "c" * 40
LARGE = 100
"""Files of so many bytes are in large file storage."""


@dataclass
class Hub:
    """A dataset and how its server behaves.

    Attributes
    ----------
    files : dict of str to bytes
    repository : str
    gated : bool
        Files and access are refused without the token.
    status : dict of str to int
        By the beginning of a path, what is answered instead.
    cut : dict of str to int
        By file, after how many bytes the connection ends (once).
    wrong : set of str
        Files whose bytes are not what the list says.
    asked : list of (method, path, range)
    """

    files: dict[str, bytes]
    repository: str = "who/park"
    gated: bool = False
    token: str = "hf_right"
    status: dict[str, int] = field(default_factory=dict)
    cut: dict[str, int] = field(default_factory=dict)
    wrong: set[str] = field(default_factory=set)
    asked: list[tuple[str, str, str | None]] = field(default_factory=list)

    def fetched(self) -> list[tuple[str, str | None]]:
        """Return the files that were fetched, with the range."""
        return [
            (path.partition(COMMIT)[2].strip("/"), span)
            for _, path, span in self.asked
            if "/resolve/" in path
        ]

    def tree(self) -> list[dict[str, Any]]:
        """Return the list of files as the hub has it."""
        return [self._listed(path, data) for path, data in self.files.items()]

    def _listed(self, path: str, data: bytes) -> dict[str, Any]:
        blob = hashlib.sha1(b"blob %d\0" % len(data) + data, usedforsecurity=False).hexdigest()
        entry: dict[str, Any] = {"type": "file", "path": path, "size": len(data), "oid": blob}
        if len(data) >= LARGE:
            oid = hashlib.sha256(data).hexdigest()
            entry["lfs"] = {"oid": oid, "size": len(data), "pointerSize": 130}
        return entry


@contextmanager
def served(hub: Hub) -> Iterator[str]:
    """Serve a dataset and yield the address."""

    class Handler(_Handler):
        of = hub

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = Thread(target=server.serve_forever, args=(0.02,), daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


class _Handler(BaseHTTPRequestHandler):
    of: Hub

    def log_message(self, *_: object) -> None:
        pass

    def do_GET(self) -> None:
        self._answer()

    def do_HEAD(self) -> None:
        self._answer()

    def _answer(self) -> None:
        hub, path = self.of, unquote(urlsplit(self.path).path)
        hub.asked.append((self.command, path, self.headers.get("Range")))
        api = f"/api/datasets/{hub.repository}"
        status = next((code for begin, code in hub.status.items() if path.startswith(begin)), None)
        if status is not None:
            self._send(status, b"{}")
        elif not path.startswith((api, f"/datasets/{hub.repository}/")):
            self._send(404, b"{}", {"X-Error-Code": "RepoNotFound"})
        elif hub.gated and not self._let_in() and ("/resolve/" in path or "auth-check" in path):
            self._send(403, b"{}", {"X-Error-Code": "GatedRepo"})
        elif path.startswith(f"{api}/tree/"):
            self._send(200, json.dumps(hub.tree()).encode())
        elif path.startswith(api):
            gated = "manual" if hub.gated else False
            info = {"id": hub.repository, "sha": COMMIT, "gated": gated, "siblings": []}
            self._send(200, json.dumps(info).encode())
        else:
            self._send_file(path.partition(f"/resolve/{COMMIT}/")[2])

    def _let_in(self) -> bool:
        return self.headers.get("Authorization") == f"Bearer {self.of.token}"

    def _send_file(self, name: str) -> None:
        data = self.of.files[name]
        if name in self.of.wrong:
            data = bytes(len(data))
        span = re.fullmatch(r"bytes=(\d+)-", self.headers.get("Range") or "")
        start = int(span[1]) if span else 0
        headers = {"ETag": f'"{hashlib.sha256(data).hexdigest()}"', "X-Repo-Commit": COMMIT}
        if span:
            headers["Content-Range"] = f"bytes {start}-{len(data) - 1}/{len(data)}"
        self._send(206 if span else 200, data[start:], headers, self.of.cut.pop(name, None))

    def _send(
        self,
        status: int,
        body: bytes,
        headers: dict[str, str] | None = None,
        cut: int | None = None,
    ) -> None:
        self.send_response(status)
        for name, value in (headers or {}).items():
            self.send_header(name, value)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body[:cut])
        self.close_connection = cut is not None
