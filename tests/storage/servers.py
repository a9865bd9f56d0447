"""A real server for tests: files by HTTP; it counts, and may answer otherwise."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from hashlib import sha256
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import unquote, urlsplit


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
        asked = Asked(self.command, self.path)
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

    do_GET = do_HEAD = answer_one  # noqa: N815

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
