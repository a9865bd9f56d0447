"""A bucket and a web server for the tests of URLs."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from uuid import uuid4

import pytest

KEYS = {
    "AWS_ACCESS_KEY_ID": "testing",
    "AWS_SECRET_ACCESS_KEY": "testing",
    "AWS_DEFAULT_REGION": "us-east-1",
    "AWS_REGION": "us-east-1",
    "AWS_EC2_METADATA_DISABLED": "true",
}


@dataclass
class Bucket:
    """A bucket on a real server."""

    name: str
    client: Any

    def url(self, *names: str) -> str:
        return "/".join([f"s3://{self.name}", *names])

    def put(self, key: str, content: bytes) -> None:
        self.client.put_object(Bucket=self.name, Key=key, Body=content)

    def upload(self, place: Path, prefix: str) -> None:
        """Upload all files of a folder, or one file."""
        for path in [place] if place.is_file() else place.rglob("*"):
            if path.is_file():
                below = path.name if place == path else path.relative_to(place).as_posix()
                self.put(f"{prefix}/{below}", path.read_bytes())


@pytest.fixture(scope="session")
def s3_address() -> Iterator[str]:
    pytest.importorskip("s3fs", reason="the extra storage is not installed")
    moto = pytest.importorskip("moto.server", reason="moto, an S3 server, is not installed")
    server = moto.ThreadedMotoServer("127.0.0.1", 0, verbose=False)
    server.start()
    yield "http://{}:{}".format(*server.get_host_and_port())
    server.stop()


@pytest.fixture
def bucket(s3_address: str, copies: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bucket]:
    """Return an empty bucket."""
    import boto3
    import s3fs

    for name, value in KEYS.items():
        monkeypatch.setenv(name, value)
    monkeypatch.delenv("AWS_PROFILE", raising=False)
    monkeypatch.setenv("AWS_ENDPOINT_URL", s3_address)
    made = Bucket(f"b-{uuid4().hex[:12]}", boto3.client("s3"))
    made.client.create_bucket(Bucket=made.name)
    s3fs.S3FileSystem.clear_instance_cache()
    yield made
    s3fs.S3FileSystem.clear_instance_cache()


@pytest.fixture
def copies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of copies, an own one."""
    monkeypatch.setenv("AIRZOO_BENCH_CACHE", str(tmp_path / "copies"))
    return tmp_path / "copies"


@dataclass
class Web:
    """A web server of a folder at work; it may refuse with a status, or cut what it sends."""

    folder: Path
    address: str = ""
    asked: list[str] = field(default_factory=list)
    status: int = 0
    body: bytes = b""
    cut: bool = False


class _Handler(SimpleHTTPRequestHandler):
    def __init__(self, web: Web, *arguments: Any) -> None:
        self.web = web
        super().__init__(*arguments, directory=str(web.folder))

    def do_GET(self) -> None:
        self.web.asked.append(f"{self.command} {self.path}")
        if self.web.status:
            self.send_response(self.web.status)
            self.send_header("Content-Length", str(len(self.web.body)))
            self.end_headers()
            self.wfile.write(self.web.body * (self.command != "HEAD"))
        elif self.command == "HEAD":
            super().do_HEAD()
        else:
            super().do_GET()

    do_HEAD = do_GET  # noqa: N815

    def copyfile(self, source: Any, outputfile: Any) -> None:
        outputfile.write(source.read()[: -100 if self.web.cut else None])

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def web(tmp_path: Path, copies: Path) -> Iterator[Web]:
    """Return a folder and the server that shows it."""
    pytest.importorskip("aiohttp", reason="the extra storage is not installed")
    made = Web(tmp_path / "www")
    made.folder.mkdir()
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(_Handler, made))
    server.daemon_threads = True
    made.address = f"http://127.0.0.1:{server.server_address[1]}"
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield made
    server.shutdown()
    server.server_close()
    thread.join()
