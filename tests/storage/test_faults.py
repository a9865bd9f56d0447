"""Buckets that refuse, break, stop or change: one message, and nothing half-fetched is used."""

from __future__ import annotations

import shutil
import socket
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from airzoo_bench.benchmark.mirrored import data_here
from airzoo_bench.core.errors import StorageError, UserError
from airzoo_bench.storage import mirror, remote
from airzoo_bench.storage.here import here, location_of
from airzoo_bench.storage.remote import read_range
from tests.storage.conftest import Bucket
from tests.storage.faults import CONTENT, always, partial_files, s3_refusal
from tests.storage.servers import Answer, Asked
from tests.support import run_main, write_predictions


@pytest.fixture
def stored(bucket: Bucket) -> Bucket:
    """Return a bucket with a file."""
    bucket.client.put_object(Bucket=bucket.name, Key="p/mine.npz", Body=CONTENT)
    return bucket


@pytest.mark.parametrize(
    ("answer", "said", "fix"),
    [
        (s3_refusal(403, "AccessDenied"), "access is denied", "AWS_ACCESS_KEY_ID"),
        (s3_refusal(400, "ExpiredToken"), "the credentials have expired", "renew"),
        (s3_refusal(403, "InvalidAccessKeyId"), "the credentials are not valid", "AWS_PROFILE"),
        (s3_refusal(404, "NoSuchBucket"), "no such file or folder", "check bucket"),
        (s3_refusal(503, "SlowDown"), "answered 503, 3 times", "run this again later"),
        (s3_refusal(500, "InternalError"), "answered 500, 3 times", "run this again later"),
    ],
)
def test_what_s3_refuses_is_one_message(
    stored: Bucket, answer: Answer, said: str, fix: str, capsys: pytest.CaptureFixture[str]
) -> None:
    stored.front.change = always(answer)
    assert run_main("check", stored.url("p", "mine.npz")) == 2
    message = capsys.readouterr().err
    assert message.startswith(f"airzoo-bench: {stored.url('p/mine.npz')}: {said}")
    assert fix in message
    assert "Traceback" not in message


@pytest.mark.parametrize("key", ["p/yours.npz", "q"])
def test_a_key_that_is_not_there(stored: Bucket, key: str) -> None:
    with pytest.raises(StorageError, match="no such file or folder"):
        here(stored.url(key))


def test_a_key_that_no_disk_can_hold(stored: Bucket) -> None:
    stored.client.put_object(Bucket=stored.name, Key=f"long/{'x' * 300}", Body=b"x")
    with pytest.raises(UserError, match="cannot be written: File name too long"):
        here(stored.url("long"))


def test_a_bucket_that_is_not_there(stored: Bucket) -> None:
    with pytest.raises(StorageError, match="no such file or folder"):
        here("s3://nobody-has-this/x.npz")


def test_a_busy_storage_is_asked_again(stored: Bucket) -> None:
    times = iter([s3_refusal(503, "SlowDown"), s3_refusal(500, "InternalError")])
    stored.front.change = lambda _, real: next(times, real)
    assert here(stored.url("p", "mine.npz")).read_bytes() == CONTENT


def test_an_answer_that_ends_before_its_time(stored: Bucket, mirrors: Path) -> None:
    def cut(asked: Asked, real: Answer) -> Answer:
        if asked.method != "GET" or not asked.path.split("?")[0].endswith("mine.npz"):
            return real
        return Answer(real.status, real.headers, real.body[:-100], len(real.body))

    stored.front.change = cut
    with pytest.raises(StorageError, match=r"mine\.npz: cannot be reached") as caught:
        here(stored.url("p", "mine.npz"))
    assert caught.value.where == stored.url("p/mine.npz")
    assert not list(mirrors.rglob("mine.npz"))
    stored.front.change = None
    assert here(stored.url("p", "mine.npz")).read_bytes() == CONTENT


def test_a_download_goes_on_where_it_broke(
    stored: Bucket, mirrors: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(remote, "_PIECE_BYTES", 4096)
    broken = s3_refusal(500, "InternalError")
    stored.front.change = lambda asked, real: (
        broken if "bytes=8192" in asked.headers.get("Range", "") else real
    )
    with pytest.raises(StorageError, match="answered 500"):
        here(stored.url("p", "mine.npz"))
    (part,) = partial_files(mirrors)
    assert part.read_bytes() == CONTENT[:8192]
    stored.front.change = None
    stored.front.asked.clear()
    assert here(stored.url("p", "mine.npz")).read_bytes() == CONTENT
    ranges = [one.headers["Range"] for one in stored.front.asked if "Range" in one.headers]
    assert ranges == [f"bytes=8192-{len(CONTENT) - 1}"]
    assert partial_files(mirrors) == []


def test_what_changes_midway_is_fetched_anew(
    stored: Bucket, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(remote, "_PIECE_BYTES", 4096)
    other = CONTENT[::-1]

    def change(asked: Asked, real: Answer) -> Answer:
        if "bytes=4096" in asked.headers.get("Range", ""):
            stored.client.put_object(Bucket=stored.name, Key="p/mine.npz", Body=other)
        return real

    stored.front.change = change
    assert here(stored.url("p", "mine.npz")).read_bytes() == other


def test_what_changes_all_the_time_is_not_used(stored: Bucket, mirrors: Path) -> None:
    numbers = iter(range(100))

    def change(asked: Asked, real: Answer) -> Answer:
        if asked.method == "GET" and "Range" in asked.headers:
            body = CONTENT + str(next(numbers)).encode()
            stored.client.put_object(Bucket=stored.name, Key="p/mine.npz", Body=body)
        return real

    stored.front.change = change
    with pytest.raises(StorageError, match="changes while it is read"):
        here(stored.url("p", "mine.npz"))
    assert not list(mirrors.rglob("mine.npz"))


def test_a_folder_that_changes_while_it_is_read(stored: Bucket) -> None:
    def add(asked: Asked, real: Answer) -> Answer:
        if asked.method == "GET" and "Range" in asked.headers:
            stored.client.put_object(Bucket=stored.name, Key="p/late.npz", Body=b"late")
        return real

    stored.front.change = add
    found = here(stored.url("p"))
    assert sorted(path.name for path in found.iterdir()) == ["late.npz", "mine.npz"]


@pytest.mark.usefixtures("other_client")
def test_nobody_at_the_endpoint(stored: Bucket, monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{free.getsockname()[1]}")
    with pytest.raises(StorageError, match="cannot be reached") as caught:
        here(stored.url("p", "mine.npz"))
    assert "AWS_ENDPOINT_URL" in (caught.value.fix or "")


@pytest.mark.usefixtures("other_client")
def test_no_credentials(stored: Bucket, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        monkeypatch.delenv(name)
    for name in ("AWS_SHARED_CREDENTIALS_FILE", "AWS_CONFIG_FILE"):
        monkeypatch.setenv(name, str(tmp_path / "none"))
    with pytest.raises(StorageError, match="no credentials are set"):
        here(stored.url("p", "mine.npz"))


def test_a_bucket_without_a_benchmark(stored: Bucket) -> None:
    with pytest.raises(UserError, match="no benchmark lies here") as caught:
        data_here(stored.url())
    assert caught.value.where == stored.url()


def test_a_benchmark_that_was_changed(stored: Bucket, data: Path, tmp_path: Path) -> None:
    stored.upload(data, "data")
    names = sorted(path for path in data.rglob("scenes/**/*") if path.is_file())
    key = f"data/{names[0].relative_to(data)}"
    stored.client.put_object(Bucket=stored.name, Key=key, Body=b"other")
    path = write_predictions(tmp_path / "p.npz", "made-retrieval", query_ids=["x"])
    from airzoo_bench.benchmark.folder import find_benchmark

    with pytest.raises(StorageError, match="is not the file that") as caught:
        find_benchmark("made", data_here(stored.url("data")))
    assert caught.value.where == stored.url(key)
    stored.client.put_object(Bucket=stored.name, Key=key, Body=names[0].read_bytes())
    assert find_benchmark("made", data_here(stored.url("data"))).name == "made"
    assert path.is_file()


@pytest.mark.parametrize("name", ["../evil", "scenes/../../../evil", "/evil", "a\\b", "scenes//x"])
def test_a_benchmark_writes_nowhere_else(stored: Bucket, data: Path, name: str) -> None:
    text = (data / "made" / "benchmark.toml").read_text()
    text += f"{name!r} = '{'0' * 64}'\n" if "\\" in name else f'"{name}" = "{"0" * 64}"\n'
    stored.client.put_object(Bucket=stored.name, Key="made/benchmark.toml", Body=text.encode())
    from airzoo_bench.benchmark.folder import Benchmark

    with pytest.raises(UserError, match="would not lie in its folder"):
        Benchmark.open(data_here(stored.url("made")))


def test_no_room_on_the_disk(
    stored: Bucket, monkeypatch: pytest.MonkeyPatch, mirrors: Path
) -> None:
    usage: Any = type("Usage", (), {"free": 10})
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage)
    with pytest.raises(UserError, match="the disk is full") as caught:
        here(stored.url("p", "mine.npz"))
    assert "AIRZOO_BENCH_CACHE" in (caught.value.fix or "")
    assert not list(mirrors.rglob("mine.npz"))


def test_several_at_once_fetch_once(stored: Bucket) -> None:
    with ThreadPoolExecutor(4) as pool:
        paths = list(pool.map(here, [stored.url("p", "mine.npz")] * 4))
    assert {path.read_bytes() for path in paths} == {CONTENT}
    assert stored.front.sent[f"/{stored.name}/p/mine.npz"] == len(CONTENT)


def test_a_task_elsewhere_finds_the_same(
    stored: Bucket, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What a client names by `location_of`, a worker with a cache of its own finds by `here`."""
    location = location_of(here(stored.url("p")) / "mine.npz")
    assert location == stored.url("p/mine.npz")
    monkeypatch.setenv("AIRZOO_BENCH_CACHE", str(tmp_path / "of-a-worker"))
    found = here(location)
    assert found.read_bytes() == CONTENT
    assert found.is_relative_to(tmp_path / "of-a-worker")
    assert here(tmp_path) == tmp_path
    assert location_of(tmp_path) == str(tmp_path)


def test_ranges(stored: Bucket, tmp_path: Path) -> None:
    url = stored.url("p", "mine.npz")
    (tmp_path / "here").write_bytes(CONTENT)
    for place in (url, tmp_path / "here"):
        assert read_range(place, 1000, 500) == CONTENT[1000:1500]
        assert read_range(place, 0, 0) == b""
        with pytest.raises(StorageError):
            read_range(place, len(CONTENT) - 10, 20)


def test_messages_name_the_url(stored: Bucket) -> None:
    path = here(stored.url("p", "mine.npz"))
    assert mirror.in_urls(f"{path}: no") == f"{stored.url('p/mine.npz')}: no"
