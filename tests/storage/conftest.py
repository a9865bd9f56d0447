"""A bucket and a web server for the tests of URLs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from uuid import uuid4

import pytest

from tests.storage.servers import Front, files_of, serving

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


@pytest.fixture
def web(tmp_path: Path, copies: Path) -> Iterator[tuple[Path, Front]]:
    """Return a folder and the server that shows it."""
    pytest.importorskip("aiohttp", reason="the extra storage is not installed")
    folder = tmp_path / "www"
    folder.mkdir()
    with serving(files_of(folder)) as front:
        yield folder, front
