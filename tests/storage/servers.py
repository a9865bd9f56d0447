"""Real servers for tests: files by HTTP, and a front that passes on, counts and changes answers."""

from __future__ import annotations

import http.client
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from hashlib import sha256
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import unquote, urlsplit

from tests.support import HANGS_S

_NOT_PASSED_ON = {"transfer-encoding", "connection", "content-length", "date", "server"}


@dataclass
class Answer:
    """What a server says."""

    status: int
    headers: dict[str, str]
    body: bytes = b""
    stated_size: int | None = None


@dataclass
class Asked:
    """What a client asks for."""

    method: str
    path: str
    headers: dict[str, str]
    body: bytes = b""


Answering = Callable[[Asked], Answer]
Change = Callable[[Asked, Answer], Answer]


@dataclass
class Front:
    """A server at work; `change` may replace what it answers."""

    address: str
    asked: list[Asked] = field(default_factory=list)
    change: Change | None = None

    def count(self, method: str, name: str) -> int:
        """Return how often a path with this ending was asked for."""
        paths = [one.path.split("?")[0] for one in self.asked if one.method == method]
        return sum(path.endswith(name) for path in paths)


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    front: Front
    answering: Answering

    def answer_one(self) -> None:
        length = int(self.headers.get("Content-Length") or 0)
        asked = Asked(self.command, self.path, dict(self.headers), self.rfile.read(length))
        self.front.asked.append(asked)
        answer = self.answering(asked)
        if self.front.change is not None:
            answer = self.front.change(asked, answer)
        size = len(answer.body) if answer.stated_size is None else answer.stated_size
        self.send_response(answer.status)
        for name, value in answer.headers.items():
            self.send_header(name, value)
        self.send_header("Content-Length", str(size))
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(answer.body)
            self.close_connection |= size != len(answer.body)

    do_GET = do_HEAD = do_PUT = do_POST = do_DELETE = answer_one  # noqa: N815

    def log_message(self, *_: object) -> None:
        pass


@contextmanager
def serving(answering: Answering) -> Iterator[Front]:
    """Serve on a free port until the block ends."""
    own = {"answering": staticmethod(answering)}
    server = ThreadingHTTPServer(("127.0.0.1", 0), type("Handler", (_Handler,), own))
    server.daemon_threads = True
    front = Front(f"http://127.0.0.1:{server.server_address[1]}")
    server.RequestHandlerClass.front = front  # type: ignore[attr-defined]
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield front
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


def files_of(folder: Path) -> Answering:
    """Answer with the files of a folder and lists of its folders, as nginx does."""

    def answer(asked: Asked) -> Answer:
        path = folder / unquote(urlsplit(asked.path).path).strip("/")
        if path.is_dir():
            names = sorted(one.name + "/" * one.is_dir() for one in path.iterdir())
            page = "".join(f'<a href="{name}">{name}</a>\n' for name in names)
            return Answer(200, {"Content-Type": "text/html"}, page.encode())
        if not path.is_file():
            return Answer(404, {})
        content = path.read_bytes()
        headers = {"ETag": f'"{sha256(content).hexdigest()[:16]}"'}
        return Answer(200, headers, content, len(content))

    return answer


def passed_on(port: int) -> Answering:
    """Ask another server of this machine, and answer as it does."""

    def answer(asked: Asked) -> Answer:
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=HANGS_S)
        connection.request(asked.method, asked.path, asked.body, asked.headers)
        found = connection.getresponse()
        headers = {k: v for k, v in found.getheaders() if k.lower() not in _NOT_PASSED_ON}
        size = int(found.getheader("Content-Length") or 0) if asked.method == "HEAD" else None
        body = found.read()
        connection.close()
        return Answer(found.status, headers, body, size)

    return answer


@contextmanager
def moto() -> Iterator[int]:
    """Run moto's S3 server in a process of its own; yields its port."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with subprocess.Popen(command, env=os.environ | {"PYTHONWARNINGS": ""}, **quiet) as process:
        try:
            end = time.monotonic() + HANGS_S
            while time.monotonic() < end:
                try:
                    socket.create_connection(("127.0.0.1", port), 1).close()
                    break
                except OSError:
                    assert process.poll() is None, "moto's server does not start"
                    time.sleep(0.1)
            yield port
        finally:
            process.terminate()
