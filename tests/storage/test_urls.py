"""URLs that cannot be read or written, storages that refuse, break or change."""

from __future__ import annotations

import socket
import sys
from pathlib import Path

import pytest

from airzoo_bench.benchmark.folder import Benchmark, data_here, find_benchmark
from airzoo_bench.core.errors import BenchmarkError, StorageError, UserError
from airzoo_bench.storage.urls import (
    AbsentError,
    ensure_file,
    local_path,
    path_of,
    url_at,
    url_of,
)
from tests.storage.conftest import Bucket
from tests.storage.servers import Answer, Asked, Front, serving
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
def test_no_url_that_can_be_read(location: str, capsys: pytest.CaptureFixture[str]) -> None:
    for call in (
        ("check", location),
        ("eval", "retrieval", "p.npz", "--data", location),
        ("table", location),
    ):
        assert run_main(*call) == 2, call
        assert "s3://, gs://, hf://, https://" in capsys.readouterr().err, call


def test_nothing_is_written_to_urls(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_main("eval", "retrieval", "p.npz", "--out", "s3://bucket/runs") == 2
    assert "URL" in capsys.readouterr().err


def test_a_package_that_is_not_installed(monkeypatch: pytest.MonkeyPatch, copies: Path) -> None:
    monkeypatch.setitem(sys.modules, "gcsfs", None)
    with pytest.raises(UserError, match="gs://") as caught:
        local_path("gs://bucket/p.npz")
    assert "airzoo-bench[storage" in str(caught.value.fix)


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
    ("status", "code", "said"),
    [
        (403, "AccessDenied", "denied"),
        (404, "NoSuchBucket", "no such file"),
        (500, "InternalError", "cannot be read"),
    ],
)
def test_a_refusal_of_s3_is_one_message(
    stored: Bucket,
    status: int,
    code: str,
    said: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    body = f"<Error><Code>{code}</Code><Message>{code}</Message></Error>".encode()
    refusal = Answer(status, {"Content-Type": "application/xml"}, body)
    with serving(lambda _: refusal) as front:
        monkeypatch.setenv("AWS_ENDPOINT_URL", front.address)
        assert run_main("check", stored.url("p", "mine.npz")) == 2
    message = capsys.readouterr().err
    assert message.startswith(f"airzoo-bench: {stored.url('p/mine.npz')}: ")
    assert said in message
    assert "Traceback" not in message


@pytest.mark.parametrize(("status", "said"), [(404, "no such"), (403, "denied"), (503, "503")])
def test_a_refusal_of_a_web_server_is_one_message(
    web: tuple[Path, Front], status: int, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    _, front = web
    front.change = lambda asked, real: Answer(status, {})
    assert run_main("check", f"{front.address}/p.npz?signature=secret") == 2
    message = capsys.readouterr().err
    assert said in message
    assert "/p.npz" in message
    assert "secret" not in message


@pytest.mark.parametrize("key", ["p/yours.npz", "q"])
def test_a_key_that_is_not_there(stored: Bucket, key: str) -> None:
    with pytest.raises(AbsentError):
        local_path(stored.url(key))


def test_a_broken_answer_leaves_no_copy(web: tuple[Path, Front], copies: Path) -> None:
    def cut(asked: Asked, real: Answer) -> Answer:
        return Answer(real.status, real.headers, real.body[:-100], len(real.body))

    folder, front = web
    (folder / "mine.npz").write_bytes(CONTENT)
    url = f"{front.address}/mine.npz"
    front.change = cut
    with pytest.raises(StorageError) as caught:
        local_path(url)
    assert caught.value.where == url
    assert not [path for path in copies.rglob("*") if path.is_file()]
    front.change = None
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
def test_a_file_is_copied_again_only_when_it_has_changed(
    bucket: Bucket, web: tuple[Path, Front], where: str
) -> None:
    folder, front = web
    url = f"{front.address}/a%20cloud.tif" if where == "web" else bucket.url("a cloud.tif")
    for content in (b"old", b"new"):
        if where == "web":
            (folder / "a cloud.tif").write_bytes(content)
        else:
            bucket.put("a cloud.tif", content)
        front.asked.clear()
        for _ in range(2):
            assert local_path(url).read_bytes() == content
            assert ensure_file(local_path(url)).read_bytes() == content
        assert where == "bucket" or front.count("GET", "cloud.tif") == 1


@pytest.mark.parametrize("where", ["bucket", "web"])
def test_a_folder_is_that_of_the_storage(
    bucket: Bucket, web: tuple[Path, Front], where: str
) -> None:
    folder, front = web
    url = bucket.url("clouds") if where == "bucket" else f"{front.address}/clouds/"
    for names in (("east.ply", "deep/west.ply"), ("east.ply",)):
        if where == "bucket":
            for name in ("east.ply", "deep/west.ply"):
                bucket.client.delete_object(Bucket=bucket.name, Key=f"clouds/{name}")
        for name in names:
            bucket.put(f"clouds/{name}", CONTENT)
            (folder / "clouds" / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / "clouds" / name).write_bytes(CONTENT)
        if len(names) == 1:
            (folder / "clouds" / "deep" / "west.ply").unlink()
        there = local_path(url)
        found = {path.relative_to(there).as_posix() for path in there.rglob("*.ply")}
        assert found == set(names)


def test_a_bucket_without_a_benchmark(stored: Bucket) -> None:
    with pytest.raises(BenchmarkError) as caught:
        data_here(stored.url())
    assert caught.value.where == stored.url()


def test_a_benchmark_that_was_changed(stored: Bucket, data: Path) -> None:
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
