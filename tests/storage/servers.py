"""Real servers for tests: files by HTTP with ranges, and a front that counts, answers and cuts."""

from __future__ import annotations

import http.client
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.request
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from hashlib import sha256
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import unquote, urlsplit

from tests.support import HANGS_S

HOME = Path(__file__).parents[2]
SENT = "/-/sent"
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
    sent: Counter[str] = field(default_factory=Counter)
    change: Change | None = None

    def count(self, name: str) -> int:
        """Return how often a path with this ending was asked for."""
        return sum(one.path.split("?")[0].endswith(name) for one in self.asked)


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    front: Front
    answering: Answering

    def answer_one(self) -> None:
        length = int(self.headers.get("Content-Length") or 0)
        asked = Asked(self.command, self.path, dict(self.headers), self.rfile.read(length))
        self.front.asked.append(asked)
        if self.path == SENT:
            answer = Answer(200, {}, json.dumps(self.front.sent).encode())
        else:
            answer = self.answering(asked)
        if self.front.change is not None:
            answer = self.front.change(asked, answer)
        self._send(answer)

    def _send(self, answer: Answer) -> None:
        size = len(answer.body) if answer.stated_size is None else answer.stated_size
        self.send_response(answer.status)
        for name, value in answer.headers.items():
            self.send_header(name, value)
        self.send_header("Content-Length", str(size))
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(answer.body)
            self.front.sent[unquote(urlsplit(self.path).path)] += len(answer.body)
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


def files_of(folder: Path, *, ranges: bool = True, listing: bool = True) -> Answering:
    """Answer with the files of a folder, as nginx does."""

    def answer(asked: Asked) -> Answer:
        path = folder / unquote(urlsplit(asked.path).path).strip("/")
        if path.is_dir() and listing:
            names = sorted(one.name + "/" * one.is_dir() for one in path.iterdir())
            page = "".join(f'<a href="{name}">{name}</a>\n' for name in names)
            return Answer(200, {"Content-Type": "text/html"}, page.encode())
        if not path.is_file():
            return Answer(404, {})
        content = path.read_bytes()
        headers = {"ETag": f'"{sha256(content).hexdigest()[:16]}"'}
        wanted = re.fullmatch(r"bytes=(\d+)-(\d*)", asked.headers.get("Range", ""))
        if asked.method == "HEAD":
            return Answer(200, headers, b"", len(content))
        if wanted is None or not ranges:
            return Answer(200, headers, content)
        start, end = int(wanted[1]), min(int(wanted[2] or 1 << 60), len(content) - 1)
        headers["Content-Range"] = f"bytes {start}-{end}/{len(content)}"
        return Answer(206, headers, content[start : end + 1])

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


@dataclass(frozen=True)
class Apart:
    """A front in a process of its own: GDAL holds Python's lock while it waits for an answer."""

    address: str

    def sent(self, path: str) -> int:
        """Return how many bytes of a path were sent."""
        with urllib.request.urlopen(self.address + SENT, timeout=HANGS_S) as answer:
            return int(json.load(answer).get(path, 0))


@contextmanager
def serving_apart(kind: str, argument: object) -> Iterator[Apart]:
    """Serve from another process: "files" of a folder, or what is "passed" on to a port."""
    command = [sys.executable, "-m", __name__, kind, str(argument)]
    with subprocess.Popen(command, cwd=HOME, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            yield Apart(process.stdout.readline().strip())
        finally:
            process.terminate()


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
            _await(port, process)
            yield port
        finally:
            process.terminate()


def _await(port: int, process: subprocess.Popen[bytes]) -> None:
    end = time.monotonic() + HANGS_S
    while time.monotonic() < end and process.poll() is None:
        try:
            socket.create_connection(("127.0.0.1", port), 1).close()
        except OSError:
            time.sleep(0.1)
        else:
            return
    raise RuntimeError("moto's server does not start")


if __name__ == "__main__":
    kind, argument = sys.argv[1:]
    with serving(files_of(Path(argument)) if kind == "files" else passed_on(int(argument))) as here:
        sys.stdout.write(f"{here.address}\n")
        sys.stdout.flush()
        signal.pause()
