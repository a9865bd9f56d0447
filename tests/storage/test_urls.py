"""URLs that cannot be read or written, storages that refuse, break or change."""

from __future__ import annotations

import itertools
import os
import socket
import sys
from pathlib import Path

import pytest

from airzoo_bench.benchmark.folder import Benchmark, data_here, find_benchmark
from airzoo_bench.core.errors import BenchmarkError, StorageError, UserError
from airzoo_bench.storage.urls import AbsentError, ensure_file, local_path, path_of, url_at, url_of
from tests.storage.conftest import Bucket, Web
from tests.support import run_main

CONTENT = bytes(range(256)) * 40


@pytest.fixture
def stored(bucket: Bucket) -> Bucket:
    """Return a bucket with a file."""
    bucket.put("p/mine.npz", CONTENT)
    return bucket


@pytest.mark.parametrize(
    "location",
    ["ftp://host/data", "s3://", "https:///data", "s3://b/key?versionId=3", "s3://b/../c"],
)
def test_no_url_that_can_be_read_or_written(
    location: str, capsys: pytest.CaptureFixture[str]
) -> None:
    data, out = ("--data", location), ("--out", "s3://bucket/runs")
    predictions = ("eval", "retrieval", "p.npz")
    for call in (("check", location), (*predictions, *data), ("table", location)):
        assert run_main(*call) == 2, call
        assert "s3://, gs://, hf://, https://" in capsys.readouterr().err, call
    assert run_main(*predictions, *out) == 2
    assert "s3:" in capsys.readouterr().err


def test_a_package_that_is_not_installed(monkeypatch: pytest.MonkeyPatch, copies: Path) -> None:
    monkeypatch.setitem(sys.modules, "gcsfs", None)
    with pytest.raises(UserError, match=r"(?s)gs://.*airzoo-bench\[storage"):
        local_path("gs://bucket/p.npz")


@pytest.mark.parametrize(
    "address",
    [
        "http://me:secret@127.0.0.1:1/p.npz",
        "http://127.0.0.1:1/p.npz?k=secret",
        "http://me:secret@[::1/p.npz",
        "ftp://me:secret@host/p.npz",
    ],
)
def test_a_password_is_in_no_message(
    address: str, copies: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_main("check", address) == 2
    message = capsys.readouterr().err
    assert message.startswith("airzoo-bench: ")
    assert "secret" not in message


def test_a_path_says_its_url(copies: Path) -> None:
    url = url_of("HTTPS://host/a%20b/c?key=secret")
    assert url == "https://host/a%20b/c?key=secret"
    assert url_at(path_of(url) / "d e") == "https://host/a%20b/c/d%20e"
    assert url_at(copies / "s3" / "b" / ".." / ".." / ".." / "elsewhere") is None
    assert url_of("a/path") is None


@pytest.mark.parametrize(
    ("status", "said"), [(403, "denied"), (404, "no such file"), (500, "cannot be read")]
)
@pytest.mark.parametrize("where", ["bucket", "web"])
def test_a_refusal_is_one_message(
    stored: Bucket,
    web: Web,
    where: str,
    status: int,
    said: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    code = {403: "AccessDenied", 404: "NoSuchBucket", 500: "InternalError"}[status]
    web.status, web.body = status, f"<Error><Code>{code}</Code></Error>".encode()
    monkeypatch.setenv("AWS_ENDPOINT_URL", web.address)
    url = stored.url("p", "mine.npz") if where == "bucket" else f"{web.address}/p/mine.npz"
    assert run_main("check", url if where == "bucket" else f"{url}?signature=secret") == 2
    message = capsys.readouterr().err
    assert message.startswith(f"airzoo-bench: {url}: ")
    assert said in message
    assert "Traceback" not in message
    assert "secret" not in message


@pytest.mark.parametrize("key", ["p/yours.npz", "q"])
def test_a_key_that_is_not_there(stored: Bucket, key: str) -> None:
    with pytest.raises(AbsentError):
        local_path(stored.url(key))


def test_a_broken_answer_leaves_no_copy(web: Web, copies: Path) -> None:
    (web.folder / "mine.npz").write_bytes(CONTENT)
    url, web.cut = f"{web.address}/mine.npz", True
    with pytest.raises(StorageError) as caught:
        local_path(url)
    assert caught.value.where == url
    assert not [path for path in copies.rglob("*") if path.is_file()]
    web.cut = False
    assert local_path(url).read_bytes() == CONTENT


@pytest.mark.parametrize("lacking", ["endpoint", "credentials"])
def test_nobody_at_the_endpoint_and_no_credentials(
    stored: Bucket, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, lacking: str
) -> None:
    if lacking == "endpoint":
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            address = f"http://127.0.0.1:{free.getsockname()[1]}"
        monkeypatch.setenv("AWS_ENDPOINT_URL", address)
    else:
        for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
            monkeypatch.delenv(name)
        for name in ("AWS_SHARED_CREDENTIALS_FILE", "AWS_CONFIG_FILE"):
            monkeypatch.setenv(name, str(tmp_path / "none"))
    with pytest.raises(StorageError, match=f"(?i){lacking}"):
        local_path(stored.url("p", "mine.npz"))


@pytest.mark.parametrize("where", ["bucket", "web"])
def test_copies_are_those_of_the_storage(bucket: Bucket, web: Web, where: str) -> None:
    seconds = itertools.count(1_000_000_000)

    def put(name: str, content: bytes) -> None:
        bucket.put(name, content)
        (web.folder / name).parent.mkdir(parents=True, exist_ok=True)
        (web.folder / name).write_bytes(content)
        os.utime(web.folder / name, (next(seconds),) * 2)  # by which the server tells versions

    root = bucket.url() if where == "bucket" else web.address
    url = f"{root}/a%20cloud.tif" if where == "web" else f"{root}/a cloud.tif"
    for content in (b"old", b"new"):
        put("a cloud.tif", content)
        web.asked.clear()
        for _ in range(2):
            assert local_path(url).read_bytes() == content
            assert ensure_file(local_path(url)).read_bytes() == content
        assert where == "bucket" or web.asked.count("GET /a%20cloud.tif") == 1
    names = {"east.ply", "deep/west.ply"}
    for name in names:
        put(f"clouds/{name}", CONTENT)
    for expected in (names, {"east.ply"}):
        there = local_path(f"{root}/clouds/")
        assert {path.relative_to(there).as_posix() for path in there.rglob("*.ply")} == expected
        bucket.client.delete_object(Bucket=bucket.name, Key="clouds/deep/west.ply")
        (web.folder / "clouds" / "deep" / "west.ply").unlink(missing_ok=True)


def test_a_bucket_without_a_benchmark_and_with_a_changed_one(stored: Bucket, data: Path) -> None:
    with pytest.raises(BenchmarkError) as caught:
        data_here(stored.url())
    assert caught.value.where == stored.url()
    stored.upload(data, "data")
    name = min(path for path in data.rglob("scenes/**/*") if path.is_file())
    key = f"data/{name.relative_to(data)}"
    stored.put(key, b"other")
    with pytest.raises(BenchmarkError) as caught:
        find_benchmark("made", data_here(stored.url("data")))
    assert str(caught.value).startswith(str(path_of(stored.url(key))))


@pytest.mark.parametrize("name", ["../evil", "scenes/../../../../../evil", "/evil"])
def test_a_benchmark_writes_nowhere_else(
    stored: Bucket, data: Path, copies: Path, name: str
) -> None:
    text = (data / "made" / "benchmark.toml").read_text() + f'"{name}" = "{"0" * 64}"\n'
    stored.upload(data, "data")
    stored.put("evil", CONTENT)
    stored.put("data/made/benchmark.toml", text.encode())
    before = {path for path in copies.parent.rglob("*") if copies not in path.parents}
    with pytest.raises(BenchmarkError, match="evil"):
        Benchmark.open(data_here(stored.url("data/made")))
    after = {path for path in copies.parent.rglob("*") if copies not in path.parents}
    assert after - before <= {copies}
