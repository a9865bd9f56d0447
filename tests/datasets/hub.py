"""A server on this machine that speaks what a client of Hugging Face needs to fetch a dataset."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread
from typing import Any
from urllib.parse import unquote, urlsplit

LARGE = 100
"""Files of so many bytes are in large file storage."""


@dataclass
class Hub:
    """The files of a dataset, and how its server behaves.

    `status` is answered to paths that begin so, `wrong` are files whose bytes are not what the list
    says; of a `gated` dataset nothing is given without the token. `fetched` are the files asked.
    """

    files: dict[str, bytes]
    gated: bool = False
    token: str = "hf_right"
    status: dict[str, int] = field(default_factory=dict)
    wrong: set[str] = field(default_factory=set)
    fetched: list[str] = field(default_factory=list)

    @property
    def commit(self) -> str:
        """The commit, another one for other files."""
        return hashlib.sha1(repr(self.files).encode(), usedforsecurity=False).hexdigest()

    def digest(self, name: str) -> str:
        """Return the digest that the list has."""
        data = self.files[name]
        if len(data) >= LARGE:
            return hashlib.sha256(data).hexdigest()
        blob = b"blob %d\0" % len(data) + data
        return hashlib.sha1(blob, usedforsecurity=False).hexdigest()

    def tree(self) -> list[dict[str, Any]]:
        """Return the list of files as the hub has it."""
        listed = []
        for path, data in self.files.items():
            oid = self.digest(path)
            entry: dict[str, Any] = {"type": "file", "path": path, "size": len(data), "oid": oid}
            if len(data) >= LARGE:
                entry["lfs"] = {"oid": oid, "size": len(data), "pointerSize": 130}
            listed.append(entry)
        return listed


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

    def do_HEAD(self) -> None:
        self.do_GET()

    def do_GET(self) -> None:
        hub, path = self.of, unquote(urlsplit(self.path).path)
        let_in = not hub.gated or self.headers.get("Authorization") == f"Bearer {hub.token}"
        status = next((code for begin, code in hub.status.items() if path.startswith(begin)), None)
        api = "/api/datasets/who/park"
        if status is not None:
            self._send(status, b"{}")
        elif not let_in and ("/resolve/" in path or "auth-check" in path):
            self._send(403, b"{}", {"X-Error-Code": "GatedRepo"})
        elif path.startswith(f"{api}/tree/"):
            self._send(200, json.dumps(hub.tree()).encode())
        elif path.startswith(api):
            gated = "manual" if hub.gated else False
            info = {"id": "who/park", "sha": hub.commit, "gated": gated, "siblings": []}
            self._send(200, json.dumps(info).encode())
        else:
            name = path.partition(f"/resolve/{hub.commit}/")[2]
            data = hub.files[name]
            hub.fetched += [name] * (self.command == "GET")
            data = bytes(len(data)) if name in hub.wrong else data
            headers = {"ETag": f'"{hub.digest(name)}"', "X-Repo-Commit": hub.commit}
            self._send(200, data, headers)

    def _send(self, status: int, body: bytes, headers: dict[str, str] | None = None) -> None:
        self.send_response(status)
        for name, value in (headers or {}).items():
            self.send_header(name, value)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)
