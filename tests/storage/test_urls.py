"""Files at URLs: what storages hold, how they refuse, break or change, and whole runs over them."""

from __future__ import annotations

import itertools
import os
import shutil
import socket
import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, ClassVar
from uuid import uuid4

import pytest
import rasterio

import airzoo_bench as ab
from airzoo_bench.benchmark.folder import Benchmark, data_here, find_benchmark, write_benchmark_file
from airzoo_bench.core.errors import BenchmarkError, StorageError, UsageError, UserError
from airzoo_bench.core.files import sha256_of
from airzoo_bench.storage import urls
from airzoo_bench.storage.urls import AbsentError, ensure_file, local_path, path_of, url_at, url_of
from tests.matching.world import make_world
from tests.support import run_main, write_predictions

CONTENT = bytes(range(256)) * 40

KEYS = {"AWS_ACCESS_KEY_ID": "testing", "AWS_SECRET_ACCESS_KEY": "testing"}
KEYS |= {"AWS_REGION": "us-east-1", "AWS_DEFAULT_REGION": "us-east-1"}
KEYS |= {"AWS_EC2_METADATA_DISABLED": "true"}


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


@pytest.fixture(scope="module")
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


class Web(SimpleHTTPRequestHandler):
    """A web server of a folder at work; it may refuse with a status, or cut what it sends."""

    folder: Path
    address: str
    asked: ClassVar[list[str]] = []
    status, body, cut = 0, b"", False

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments, directory=str(self.folder))

    def do_GET(self) -> None:
        self.asked.append(f"{self.command} {self.path}")
        if self.status:
            self.send_response(self.status)
            self.send_header("Content-Length", str(len(self.body)))
            self.end_headers()
            self.wfile.write(self.body * (self.command != "HEAD"))
        else:
            getattr(super(), f"do_{self.command}")()

    do_HEAD = do_GET  # noqa: N815

    def copyfile(self, source: Any, outputfile: Any) -> None:
        outputfile.write(source.read()[: -100 if self.cut else None])

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def web(tmp_path: Path, copies: Path) -> Iterator[type[Web]]:
    """Return a folder and the server that shows it."""
    pytest.importorskip("aiohttp", reason="the extra storage is not installed")
    (tmp_path / "www").mkdir()

    class Own(Web):
        folder, asked = tmp_path / "www", []

    with ThreadingHTTPServer(("127.0.0.1", 0), Own) as server:
        server.daemon_threads = True
        Own.address = f"http://127.0.0.1:{server.server_address[1]}"
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield Own
        server.shutdown()


@pytest.mark.parametrize(
    "location",
    [
        *("ftp://host/data", "s3://", "https:///data", "s3://b/key?versionId=3", "s3://b/../c"),
        *("http://me:secret@[::1/p.npz", "ftp://me:secret@host/p.npz"),
    ],
)
def test_what_is_no_url_is_refused_without_a_password(location: str) -> None:
    with pytest.raises(UsageError, match="s3://, gs://, hf://, https://") as caught:
        url_of(location)
    assert "secret" not in str(caught.value)


def test_a_path_says_its_url(copies: Path) -> None:
    url = url_of("HTTPS://host/a%20b/c?key=secret")
    assert url == "https://host/a%20b/c?key=secret"
    assert url_at(path_of(url) / "d e") == "https://host/a%20b/c/d%20e"
    assert url_at(copies / "s3" / "b" / ".." / ".." / ".." / "elsewhere") is None
    assert url_of("a/path") is None


def test_a_package_that_is_not_installed(monkeypatch: pytest.MonkeyPatch, copies: Path) -> None:
    monkeypatch.setitem(sys.modules, "gcsfs", None)
    with pytest.raises(UserError, match=r"(?s)gs://.*airzoo-bench\[storage"):
        local_path("gs://bucket/p.npz")


def test_a_bug_of_this_package_is_no_fault_of_the_storage(copies: Path) -> None:
    with pytest.raises(KeyError), urls.client_of("https://host/a"):
        os.environ["AIRZOO_BENCH_NOTHING"]


@pytest.mark.parametrize(
    ("status", "said"), [(403, "denied"), (404, "no such file"), (500, "cannot be read")]
)
@pytest.mark.parametrize("where", ["bucket", "web"])
def test_a_refusal_is_one_message(bucket, web, where, status, said, capsys, monkeypatch) -> None:
    code = {403: "AccessDenied", 404: "NoSuchBucket", 500: "InternalError"}[status]
    web.status, web.body = status, f"<Error><Code>{code}</Code></Error>".encode()
    monkeypatch.setenv("AWS_ENDPOINT_URL", web.address)
    url = bucket.url("p", "mine.npz") if where == "bucket" else f"{web.address}/p/mine.npz"
    assert run_main("check", url if where == "bucket" else f"{url}?signature=secret") == 2
    message = capsys.readouterr().err
    assert message.startswith(f"airzoo-bench: {url}: ")
    assert said in message
    assert "Traceback" not in message
    assert "secret" not in message


@pytest.mark.parametrize("lacking", ["endpoint", "credentials", "key", "folder"])
def test_what_a_bucket_lacks(
    bucket: Bucket, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, lacking: str
) -> None:
    bucket.put("p/mine.npz", CONTENT)
    if lacking == "endpoint":
        with socket.create_server(("127.0.0.1", 0)) as free:
            address = f"http://127.0.0.1:{free.getsockname()[1]}"
        monkeypatch.setenv("AWS_ENDPOINT_URL", address)
    if lacking == "credentials":
        for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
            monkeypatch.delenv(name)
        for name in ("AWS_SHARED_CREDENTIALS_FILE", "AWS_CONFIG_FILE"):
            monkeypatch.setenv(name, str(tmp_path / "none"))
    key = {"key": "p/yours.npz", "folder": "q"}.get(lacking, "p/mine.npz")
    with pytest.raises(StorageError, match=f"(?i){lacking}|no such file") as caught:
        local_path(bucket.url(key))
    assert isinstance(caught.value, AbsentError) == (lacking in ("key", "folder"))


def test_a_broken_answer_leaves_no_copy(web: type[Web], copies: Path) -> None:
    (web.folder / "mine.npz").write_bytes(CONTENT)
    url, web.cut = f"{web.address}/mine.npz", True
    with pytest.raises(StorageError) as caught:
        local_path(url)
    assert caught.value.where == url
    assert not [path for path in copies.rglob("*") if path.is_file()]
    web.cut = False
    assert local_path(url).read_bytes() == CONTENT


@pytest.mark.parametrize("where", ["bucket", "web"])
def test_copies_are_those_of_the_storage(bucket: Bucket, web: type[Web], where: str) -> None:
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


def test_a_bucket_without_a_benchmark_with_a_changed_one_and_with_a_hostile_one(
    bucket: Bucket, data: Path, copies: Path
) -> None:
    with pytest.raises(BenchmarkError) as caught:
        data_here(bucket.url())
    assert caught.value.where == bucket.url()
    bucket.upload(data, "data")
    bucket.put("evil", CONTENT)
    text = (data / "made" / "benchmark.toml").read_text()
    before = {path for path in copies.parent.rglob("*") if copies not in path.parents}
    for name in ("../evil", "scenes/../../../../../evil", "/evil"):
        bucket.put("data/made/benchmark.toml", f'{text}"{name}" = "{"0" * 64}"\n'.encode())
        with pytest.raises(BenchmarkError, match="evil"):
            Benchmark.open(data_here(bucket.url("data/made")))
    after = {path for path in copies.parent.rglob("*") if copies not in path.parents}
    assert after - before <= {copies}
    bucket.put("data/made/benchmark.toml", text.encode())
    name = min(path for path in data.rglob("scenes/**/*") if path.is_file())
    key = f"data/{name.relative_to(data)}"
    bucket.put(key, b"other")
    with pytest.raises(BenchmarkError) as caught:
        find_benchmark("made", data_here(bucket.url("data")))
    assert str(caught.value).startswith(str(path_of(bucket.url(key))))


# --- whole runs ---

Run = Callable[..., Any]


def run(command: Run, track: str, predictions: object, data: object, out: Path) -> dict[str, bytes]:
    """Evaluate, and return the files of the run by name."""
    done = command("eval", track, predictions, "--data", data, "--out", out, "--method", "m")
    assert done.exit_code == 0, done.output
    return {path.name: path.read_bytes() for path in out.iterdir()}


def test_runs_from_a_bucket_and_a_web_server_have_the_bytes_of_a_run_here(
    command: Run,
    bucket: Bucket,
    web: type[Web],
    data: Path,
    tmp_path: Path,
    perfect: dict[str, Any],
) -> None:
    predictions = write_predictions(tmp_path / "mine.npz", "made-retrieval", **perfect)
    here = run(command, "retrieval", predictions, data, tmp_path / "here")
    bucket.upload(data, "benchmarks")
    bucket.upload(predictions, "predictions")
    bucket.upload(tmp_path / "here", "run")
    there, benchmarks = bucket.url("predictions/mine.npz"), bucket.url("benchmarks")
    assert run(command, "retrieval", there, benchmarks, tmp_path / "there") == here
    compared = command("compare", bucket.url("run"), tmp_path / "there")  # which reads the records
    assert compared.exit_code == 0, compared.output
    shutil.copytree(data, web.folder / "data")
    shutil.copy(predictions, web.folder / "mine.npz")
    address = web.address
    web_run = run(command, "retrieval", f"{address}/mine.npz", f"{address}/data", tmp_path / "web")
    assert web_run == here
    scored = ab.evaluate(there, data=benchmarks)
    assert ab.load_result(bucket.url("run")).to_frame().equals(scored.to_frame())
    benchmark = ab.load_benchmark(bucket.url("benchmarks/made"))
    assert [scene.id for scene in benchmark.scenes] == ["east", "west"]


def test_maps_and_surface_models_in_a_bucket(command: Run, bucket: Bucket, tmp_path: Path) -> None:
    world = make_world(tmp_path)
    predictions = tmp_path / "mine.npz"
    world.write(predictions, world.matches())
    benchmark = Benchmark.open(world.folder)
    (scene,) = benchmark.file.scenes
    (world.folder / "maps").mkdir()
    for kind in ("dom", "dsm"):
        shutil.copy(tmp_path / "sources" / f"{kind}.tif", world.folder / "maps" / f"{kind}.tif")
    dsm = world.folder / "maps" / "dsm.tif"
    changes = {"dom": "maps/dom.tif", "dsm": "maps/dsm.tif", "dsm_sha256": sha256_of(dsm)}
    scenes = (scene.model_copy(update=changes),)
    write_benchmark_file(world.folder, benchmark.file.model_copy(update={"scenes": scenes}))
    bucket.upload(world.folder, "data")
    here = run(command, "matching", predictions, world.folder, tmp_path / "a")
    assert run(command, "matching", predictions, bucket.url("data"), tmp_path / "b") == here
    with rasterio.open(dsm, "r+") as raster:
        raster.write(raster.read(1) + 1, 1)
    bucket.upload(dsm, "data/maps")
    with pytest.raises(BenchmarkError):
        ab.evaluate(predictions, data=bucket.url("data"))
