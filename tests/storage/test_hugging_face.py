"""Hugging Face: its client is asked for a file, or for a list page by page, and no more."""

from __future__ import annotations

import json
from collections.abc import Iterator
from hashlib import sha1
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, unquote, urlsplit

import pytest

from airzoo_bench.core.errors import StorageError
from airzoo_bench.storage.rasters import here
from airzoo_bench.storage.remote import files, names, stat
from airzoo_bench.storage.urls import Url, url_of
from tests.storage.servers import Answer, Asked, Front, serving

pytest.importorskip("huggingface_hub", reason="the extra download is not installed")
pytest.importorskip("fsspec", reason="the extra storage is not installed")

FILES = {"p/mine.npz": b"mine", "p/sub/a b.npz": b"more", "p/sub/c.npz": b"last", "pp/o": b"o"}
REPOSITORY, BUCKET, COMMIT = "/api/datasets/o/n", "/api/buckets/o/n", "c" * 40


def hub(asked: Asked) -> Answer:
    """Answer as Hugging Face does of the dataset o/n: its lists have pages of one entry."""
    place = urlsplit(asked.path)
    path, query = unquote(place.path), parse_qs(place.query)
    name = path.partition("/main")[2].strip("/")
    if path.startswith(f"{REPOSITORY}/tree/main"):
        return listed(name, place.path, asked.headers["Host"], query)
    if path == f"{REPOSITORY}/paths-info/main":
        wanted = parse_qs(asked.body.decode())["paths"]
        return as_json([one for one in everything() if one["path"] in wanted])
    if path.startswith(REPOSITORY):
        return as_json({"id": "o/n", "sha": COMMIT, "gated": False, "siblings": []})
    if path == BUCKET:
        times = {"createdAt": "2026-01-01T00:00:00.000Z"}
        return as_json({"id": "o/n", "private": False, "size": 9, "totalFiles": 4} | times)
    if path.startswith(f"{BUCKET}/tree"):  # by the beginnings of names
        found = [one for one in everything() if one["path"].startswith(path.rpartition("/")[2])]
        return as_json([{**one, "xetHash": "x"} for one in found if "size" in one])
    begin, end = asked.headers.get("Range", "bytes=0-999").removeprefix("bytes=").split("-")
    return Answer(206, {}, FILES[name][int(begin) : int(end) + 1])


def listed(folder: str, path: str, host: str, query: dict[str, list[str]]) -> Answer:
    deep, begin = query["recursive"][0].lower() == "true", int(query.get("cursor", ["0"])[0])
    below = [one for one in everything() if one["path"].startswith(f"{folder}/" if folder else "")]
    depth = folder.count("/") + bool(folder)
    found = [one for one in below if deep or one["path"].count("/") == depth]
    if not found:
        return Answer(404, {"X-Error-Code": "EntryNotFound"})
    more = f"<http://{host}{path}?recursive={deep}&cursor={begin + 1}>; rel=next"
    return as_json(found[begin : begin + 1], {"Link": more} if found[begin + 1 :] else {})


def everything() -> list[dict[str, Any]]:
    folders = ("p", "p/sub", "pp")
    return [{"type": "directory", "path": name, "oid": name} for name in folders] + [
        {"type": "file", "path": name, "size": len(data), "oid": sha1(data).hexdigest()}
        for name, data in FILES.items()
    ]


def as_json(value: object, headers: dict[str, str] | None = None) -> Answer:
    return Answer(
        200, {"Content-Type": "application/json"} | (headers or {}), json.dumps(value).encode()
    )


@pytest.fixture
def front(mirrors: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Front]:
    from huggingface_hub import HfFileSystem, constants

    for name in ("HF_TOKEN", "HUGGING_FACE_HUB_TOKEN"):
        monkeypatch.delenv(name, raising=False)
    with serving(hub) as made:
        monkeypatch.setattr(constants, "ENDPOINT", made.address)
        template = f"{made.address}/{{repo_id}}/resolve/{{revision}}/{{filename}}"
        monkeypatch.setattr(constants, "HUGGINGFACE_CO_URL_TEMPLATE", template)
        HfFileSystem.clear_instance_cache()
        yield made
        HfFileSystem.clear_instance_cache()


def as_url(text: str) -> Url:
    url = url_of(text)
    assert url is not None
    return url


def test_a_folder_is_listed_and_fetched(front: Front) -> None:
    url = as_url("hf://datasets/o/n/p")
    found = files(url)
    assert list(found) == ["mine.npz", "sub/a b.npz", "sub/c.npz"]
    assert all(found[name] == stat(url.child(name)) for name in found)
    assert names(url) == ["mine.npz", "sub"]
    assert names(url, folders=True) == ["sub"]
    assert names(as_url("hf://datasets/o/n")) == ["p", "pp"]
    assert names(as_url("hf://datasets/o/n/q")) == []
    folder = here("hf://datasets/o/n/p")
    assert (folder / "sub" / "a b.npz").read_bytes() == b"more"
    with pytest.raises(StorageError, match="no such file or folder"):
        here("hf://datasets/o/n/q")


def test_a_bucket_is_listed(front: Front) -> None:
    assert list(files(as_url("hf://buckets/o/n/p"))) == ["mine.npz", "sub/a b.npz", "sub/c.npz"]


def test_a_file_is_asked_for_without_its_folder(front: Front) -> None:
    assert stat(as_url("hf://datasets/o/n/p/mine.npz")).size == 4
    assert not [one.path for one in front.asked if "/tree/" in one.path]
