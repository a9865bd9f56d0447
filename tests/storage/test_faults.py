"""Buckets that refuse, break, stop or change: one message, and nothing half-fetched is used."""

from __future__ import annotations

import socket
from collections.abc import Callable
from pathlib import Path

import pytest

from airzoo_bench.benchmark.mirrored import data_here
from airzoo_bench.core.errors import StorageError, UserError
from airzoo_bench.storage.mirror import here
from tests.storage.conftest import Bucket
from tests.storage.servers import Answer, Asked, Front
from tests.support import run_main, write_predictions

CONTENT = bytes(range(256)) * 40


def s3_refusal(status: int, code: str) -> Answer:
    body = f"<Error><Code>{code}</Code><Message>{code}</Message></Error>".encode()
    return Answer(status, {"Content-Type": "application/xml"}, body)


def always(answer: Answer, method: str | None = None) -> Callable[[Asked, Answer], Answer]:
    return lambda asked, real: answer if method in (None, asked.method) else real


@pytest.fixture
def stored(bucket: Bucket) -> Bucket:
    """Return a bucket with a file."""
    bucket.client.put_object(Bucket=bucket.name, Key="p/mine.npz", Body=CONTENT)
    return bucket


@pytest.mark.parametrize(
    ("answer", "said", "fix"),
    [
        (s3_refusal(403, "AccessDenied"), "access is denied", "AWS_ACCESS_KEY_ID"),
        (s3_refusal(404, "NoSuchBucket"), "no such file or folder", "check bucket"),
        (s3_refusal(500, "InternalError"), "refuses or cannot be reached", "run this again"),
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
    with pytest.raises(StorageError, match=r"mine\.npz: refuses or cannot be") as caught:
        here(stored.url("p", "mine.npz"))
    assert caught.value.where == stored.url("p/mine.npz")
    assert not list(mirrors.rglob("mine.npz"))
    stored.front.change = None
    assert here(stored.url("p", "mine.npz")).read_bytes() == CONTENT


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
    with pytest.raises(StorageError, match=r"(?i)credentials"):
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


@pytest.mark.parametrize(("status", "said"), [(404, "no such"), (403, "denied"), (503, "503")])
def test_what_a_web_server_refuses(
    web: tuple[Path, Front], status: int, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    _, front = web
    front.change = always(Answer(status, {}))
    assert run_main("check", f"{front.address}/p.npz?signature=secret") == 2
    message = capsys.readouterr().err
    assert said in message
    assert "/p.npz?…" in message
    assert "secret" not in message
