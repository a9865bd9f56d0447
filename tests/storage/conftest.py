"""Servers and buckets for the tests of locations."""

from __future__ import annotations

from collections.abc import Callable, Iterator
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

    def upload(self, folder: Path, prefix: str, **settings: Any) -> None:
        """Upload all files of a folder, or one file."""
        files = [folder] if folder.is_file() else [p for p in folder.rglob("*") if p.is_file()]
        for path in files:
            below = path.name if folder.is_file() else path.relative_to(folder).as_posix()
            key = f"{prefix}/{below}" if prefix else below
            self.client.put_object(Bucket=self.name, Key=key, Body=path.read_bytes(), **settings)

    def listed(self) -> list[str]:
        found = self.client.list_objects_v2(Bucket=self.name)
        return [one["Key"] for one in found.get("Contents", [])]


@pytest.fixture(scope="session")
def s3_port() -> Iterator[int]:
    pytest.importorskip("s3fs", reason="the extra storage is not installed")
    pytest.importorskip(
        "moto.server", reason="moto, the S3 server of these tests, is not installed"
    )
    with moto() as port:
        yield port


@pytest.fixture(scope="session")
def s3_client(s3_port: int) -> Any:
    import boto3

    names = {"aws_access_key_id": "testing", "aws_secret_access_key": "testing"}
    endpoint = f"http://127.0.0.1:{s3_port}"
    return boto3.client("s3", endpoint_url=endpoint, region_name="us-east-1", **names)


@pytest.fixture(scope="session")
def s3_front(s3_port: int) -> Iterator[Front]:
    with serving(passed_on(s3_port)) as front:
        yield front


@pytest.fixture
def bucket(
    s3_front: Front, s3_client: Any, mirrors: Path, monkeypatch: pytest.MonkeyPatch
) -> Bucket:
    """Return an empty bucket; everything goes through a front."""
    for name, value in KEYS.items():
        monkeypatch.setenv(name, value)
    monkeypatch.delenv("AWS_PROFILE", raising=False)
    monkeypatch.setenv("AWS_ENDPOINT_URL", s3_front.address)
    s3_front.asked.clear()
    s3_front.sent.clear()
    s3_front.change = None
    name = f"b-{uuid4().hex[:12]}"
    s3_client.create_bucket(Bucket=name)
    return Bucket(name, s3_front, s3_client)


@pytest.fixture
def other_client() -> Iterator[None]:
    """Let the environment be looked at anew, by this test and by the next."""
    import s3fs

    s3fs.S3FileSystem.clear_instance_cache()
    yield
    s3fs.S3FileSystem.clear_instance_cache()


@pytest.fixture
def mirrors(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of mirrors, an own one."""
    monkeypatch.setenv("AIRZOO_BENCH_CACHE", str(tmp_path / "mirrors"))
    return tmp_path / "mirrors"


@pytest.fixture
def web(tmp_path: Path, mirrors: Path) -> Iterator[tuple[Path, Front]]:
    """Return a folder and the server that shows it."""
    pytest.importorskip("aiohttp", reason="the extra storage is not installed")
    folder = tmp_path / "www"
    folder.mkdir()
    with serving(files_of(folder)) as front:
        yield folder, front


Run = Callable[..., Any]
