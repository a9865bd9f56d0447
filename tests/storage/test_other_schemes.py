"""Schemes of which no real server can be had here: how their clients are called."""

from __future__ import annotations

import json
from collections.abc import Iterator
from hashlib import md5
from pathlib import Path
from urllib.parse import parse_qs, unquote, urlsplit

import pytest

from airzoo_bench.core.errors import StorageError
from airzoo_bench.storage.rasters import Pointer, here
from airzoo_bench.storage.remote import _relative
from airzoo_bench.storage.urls import url_of
from tests.storage.servers import Answer, Asked, Front, serving

OBJECTS = {"p/mine.npz": b"mine" * 100, "p/sub/more.npz": b"more"}


def cloud_storage(asked: Asked) -> Answer:
    """Answer as Google's JSON interface does, as far as reading goes."""
    place = urlsplit(asked.path)
    name = unquote(place.path.partition("/o/")[2])
    if place.path.endswith("/o"):
        prefix = parse_qs(place.query).get("prefix", [""])[0]
        items = [_described(one) for one in OBJECTS if one.startswith(prefix)]
        begin = int(parse_qs(place.query).get("pageToken", ["0"])[0])
        end = begin + int(parse_qs(place.query).get("maxResults", ["1000"])[0])
        page = {"items": items[begin:end]} | ({"nextPageToken": str(end)} if items[end:] else {})
        return Answer(200, {"Content-Type": "application/json"}, json.dumps(page).encode())
    if name not in OBJECTS:
        return Answer(404, {"Content-Type": "application/json"}, b'{"error": {"code": 404}}')
    if "alt=media" not in place.query:
        body = json.dumps(_described(name)).encode()
        return Answer(200, {"Content-Type": "application/json"}, body)
    begin, end = asked.headers.get("Range", "bytes=0-9999").removeprefix("bytes=").split("-")
    return Answer(206, {}, OBJECTS[name][int(begin) : int(end) + 1])


def _described(name: str) -> dict[str, str]:
    content = OBJECTS[name]
    version = md5(content, usedforsecurity=False).hexdigest()
    return {"bucket": "b", "name": name, "size": str(len(content)), "etag": version}


@pytest.fixture
def cloud(mirrors: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Front]:
    gcsfs = pytest.importorskip("gcsfs", reason="the extra storage is not installed")
    with serving(cloud_storage) as front:
        monkeypatch.setenv("STORAGE_EMULATOR_HOST", front.address)
        gcsfs.GCSFileSystem.clear_instance_cache()
        yield front
        gcsfs.GCSFileSystem.clear_instance_cache()


def test_a_file_and_a_folder_of_google_s(cloud: Front) -> None:
    assert here("gs://b/p/mine.npz").read_bytes() == OBJECTS["p/mine.npz"]
    folder = here("gs://b/p")
    found = {f"p/{one.relative_to(folder)}": one.read_bytes() for one in folder.rglob("*.npz")}
    assert found == OBJECTS
    with pytest.raises(StorageError, match="no such file or folder"):
        here("gs://b/q")


def pointer(url: str) -> Pointer:
    return Pointer(url, "")


def test_names_for_gdal(monkeypatch: pytest.MonkeyPatch) -> None:
    assert pointer("s3://b/a b.tif").virtual == "/vsis3/b/a b.tif"
    assert pointer("gs://b/a.tif").virtual == "/vsigs/b/a.tif"
    web = pointer("https://host/a%20b.tif?key=1")
    assert web.virtual == "/vsicurl/https://host/a%20b.tif?key=1"
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:9000")
    settings = pointer("s3://b/a.tif").settings()
    assert settings["AWS_S3_ENDPOINT"] == "127.0.0.1:9000"
    assert settings["AWS_HTTPS"] == "NO"
    assert settings["AWS_VIRTUAL_HOSTING"] == "FALSE"
    assert "AWS_HTTPS" not in web.settings()
    monkeypatch.setenv("HF_TOKEN", "secret")
    assert "secret" in str(pointer("hf://datasets/o/n/a.tif").settings())
    assert "secret" not in str(web.settings())


@pytest.mark.parametrize(
    ("asked", "listed", "relative"),
    [
        ("https://h/p", "https://h/p/a/b.npz", "a/b.npz"),
        ("https://h", "https://h/a.npz", "a.npz"),
        ("https://h/p", "https://h/p", ""),
        ("https://h/p", "https://h/pp/a.npz", ""),
        ("https://h/p", "https://h/p/a%20b.npz?k=1", "a b.npz"),
        ("https://h/p", "https://other/p/a.npz", ""),
    ],
)
def test_listed_names(asked: str, listed: str, relative: str) -> None:
    url = url_of(asked)
    assert url is not None
    assert _relative(url, listed) == relative
