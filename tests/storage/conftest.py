"""A bucket and a web server for the tests of URLs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from uuid import uuid4

import pytest

from tests.storage.servers import Front, files_of, moto, passed_on, serving

KEYS = {
    "AWS_ACCESS_KEY_ID": "testing",
    "AWS_SECRET_ACCESS_KEY": "testing",
    "AWS_DEFAULT_REGION": "us-east-1",
    "AWS_REGION": "us-east-1",
    "AWS_EC2_METADATA_DISABLED": "true",
}


@dataclass
class Bucket:
    """A bucket on a real server, behind a front that counts."""

    name: str
    front: Front
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
def s3() -> Iterator[tuple[Front, Any]]:
    pytest.importorskip("s3fs", reason="the extra storage is not installed")
    pytest.importorskip("moto.server", reason="moto, an S3 server, is not installed")
    import boto3

    names = {"aws_access_key_id": "testing", "aws_secret_access_key": "testing"}
    with moto() as port, serving(passed_on(port)) as front:
        endpoint = f"http://127.0.0.1:{port}"
        yield front, boto3.client("s3", endpoint_url=endpoint, region_name="us-east-1", **names)


@pytest.fixture
def bucket(
    s3: tuple[Front, Any], copies: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Bucket]:
    """Return an empty bucket; everything goes through a front."""
    import s3fs

    front, client = s3
    for name, value in KEYS.items():
        monkeypatch.setenv(name, value)
    monkeypatch.delenv("AWS_PROFILE", raising=False)
    monkeypatch.setenv("AWS_ENDPOINT_URL", front.address)
    front.asked.clear()
    front.change = None
    name = f"b-{uuid4().hex[:12]}"
    client.create_bucket(Bucket=name)
    s3fs.S3FileSystem.clear_instance_cache()
    yield Bucket(name, front, client)
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
