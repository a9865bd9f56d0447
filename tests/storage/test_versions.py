"""What is replaced while it is fetched, and put back later: no version's bytes stand for another's.

Each test puts the right content at a URL, replaces it during a download, and puts it back.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from airzoo_bench.benchmark.mirrored import data_here, resolved
from airzoo_bench.core.errors import StorageError
from airzoo_bench.results.files import results_here
from airzoo_bench.storage import rasters, remote
from airzoo_bench.storage.here import here
from airzoo_bench.storage.rasters import pointed_sha256, pointer_at
from tests.storage.conftest import Bucket
from tests.storage.contents import BAD, GOOD, putting
from tests.storage.servers import Answer, Asked, Front, serving


def once_it_was_read(name: str, *do: Callable[[], None]) -> Callable[[Asked, Answer], Answer]:
    """Do something after a file was asked for the first time, the second time, and so on."""
    left = iter(do)

    def change(asked: Asked, real: Answer) -> Answer:
        path, query = asked.path.partition("?")[::2]
        if asked.method == "GET" and path.endswith(name) and "prefix" not in query:
            next(left, lambda: None)()
        return real

    return change


def test_a_file_that_is_put_back_is_itself(bucket: Bucket) -> None:
    put = putting(bucket, "p/mine.npz")
    put(GOOD)
    bucket.front.change = once_it_was_read("mine.npz", lambda: put(BAD))
    found = here(bucket.url("p/mine.npz"))
    assert found.read_bytes() == BAD
    put(GOOD)
    again = here(bucket.url("p/mine.npz"))
    assert again.read_bytes() == GOOD
    assert found.read_bytes() == BAD  # a run that is under way reads what it began with


def test_a_folder_that_is_put_back_is_itself(bucket: Bucket) -> None:
    put = putting(bucket, "p/gallery/0.npz")
    putting(bucket, "p/queries.npz")(GOOD)
    put(GOOD)
    bucket.front.change = once_it_was_read("/0.npz", lambda: put(BAD))
    assert (here(bucket.url("p")) / "gallery" / "0.npz").read_bytes() == BAD
    put(GOOD)
    assert (here(bucket.url("p")) / "gallery" / "0.npz").read_bytes() == GOOD


@pytest.mark.parametrize("name", ["benchmark.toml", "plane.toml"])
def test_a_benchmark_that_is_put_back_is_itself(bucket: Bucket, name: str) -> None:
    key = {"benchmark.toml": "d/benchmark.toml", "plane.toml": "d/protocols/plane.toml"}
    for one in key.values():
        putting(bucket, one)(GOOD)
    put, path = putting(bucket, key[name]), key[name].removeprefix("d/")
    bucket.front.change = once_it_was_read(name, lambda: put(BAD))
    assert (data_here(bucket.url("d")) / path).read_bytes() == BAD
    put(GOOD)
    assert (data_here(bucket.url("d")) / path).read_bytes() == GOOD


def test_a_result_that_is_put_back_is_itself(bucket: Bucket) -> None:
    put = putting(bucket, "run/result.json")
    put(GOOD)
    bucket.front.change = once_it_was_read("result.json", lambda: put(BAD))
    assert results_here([bucket.url("run")])[0].read_bytes() == BAD
    put(GOOD)
    assert results_here([bucket.url("run")])[0].read_bytes() == GOOD


def test_another_cloud_than_benchmark_toml_states_does_not_stay(bucket: Bucket) -> None:
    putting(bucket, "d/benchmark.toml")(b"")
    put, sha = putting(bucket, "d/true.ply"), sha256(GOOD).hexdigest()
    put(BAD)
    scene = SimpleNamespace(
        images="photos", maps="maps", gallery=None, cloud="true.ply", cloud_sha256=sha
    )
    file: Any = SimpleNamespace(scenes=[scene])
    with pytest.raises(StorageError, match=r"is not the file that benchmark\.toml states"):
        resolved(data_here(bucket.url("d")), file, "true.ply")
    put(GOOD)
    assert resolved(data_here(bucket.url("d")), file, "true.ply").read_bytes() == GOOD


def put_at(path: Path, content: bytes, time_s: int) -> None:
    path.write_bytes(content)
    os.utime(path, (time_s, time_s))


def by_time(folder: Path) -> Callable[[Asked], Answer]:
    """Answer with files of which only size and time are stated."""

    def answer(asked: Asked) -> Answer:
        path = folder / asked.path.strip("/")
        content, time_s = path.read_bytes(), path.stat().st_mtime
        headers = {"Last-Modified": f"Mon, 01 Jan 2024 00:00:{int(time_s):02d} GMT"}
        start = int(asked.headers.get("Range", "bytes=0-").removeprefix("bytes=").partition("-")[0])
        if start:
            headers["Content-Range"] = f"bytes {start}-{len(content) - 1}/{len(content)}"
        return Answer(206 if start else 200, headers, content[start:])

    return answer


def test_a_server_that_states_times_only(tmp_path: Path, mirrors: Path) -> None:
    path = tmp_path / "p.npz"
    put_at(path, GOOD, 1)
    with serving(by_time(tmp_path)) as front:
        front.change = once_it_was_read("p.npz", lambda: put_at(path, BAD, 2))
        assert here(f"{front.address}/p.npz").read_bytes() in (GOOD, BAD)
        put_at(path, GOOD, 1)
        assert here(f"{front.address}/p.npz").read_bytes() == GOOD


def test_what_is_replaced_and_put_back_within_one_download(
    bucket: Bucket, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(remote, "_PIECE_BYTES", 4096)
    put = putting(bucket, "p/mine.npz")
    put(GOOD)
    # The second piece is of the other version; both before and after there is the first.
    bucket.front.change = once_it_was_read(
        "mine.npz", lambda: put(BAD), lambda: put(GOOD), lambda: None
    )
    assert here(bucket.url("p/mine.npz")).read_bytes() == GOOD


def test_a_kept_part_has_no_bytes_of_another_version(
    bucket: Bucket, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(remote, "_PIECE_BYTES", 4096)
    put = putting(bucket, "p/mine.npz")
    put(GOOD)
    replace = once_it_was_read("mine.npz", lambda: put(BAD))

    def change(asked: Asked, real: Answer) -> Answer:
        if "bytes=8192" in asked.headers.get("Range", ""):
            return Answer(503, {})
        return replace(asked, real)

    bucket.front.change = change
    with pytest.raises(StorageError, match="answered 503"):
        here(bucket.url("p/mine.npz"))
    bucket.front.change = None
    put(GOOD)
    assert here(bucket.url("p/mine.npz")).read_bytes() == GOOD


def cut_once(path: Path, other: bytes, size: int) -> Callable[[Asked, Answer], Answer]:
    """Break the first answer off, and replace the file."""
    left = [size]

    def change(asked: Asked, real: Answer) -> Answer:
        if asked.method != "GET" or not left:
            return real
        path.write_bytes(other)
        return Answer(real.status, real.headers, real.body[: left.pop()], len(real.body))

    return change


def test_a_web_download_goes_on_with_the_same_version_only(
    web: tuple[Path, Front], mirrors: Path
) -> None:
    folder, front = web
    (folder / "p.npz").write_bytes(GOOD)
    front.change = cut_once(folder / "p.npz", BAD, 4000)
    assert here(f"{front.address}/p.npz").read_bytes() == BAD
    (folder / "p.npz").write_bytes(GOOD)
    assert here(f"{front.address}/p.npz").read_bytes() == GOOD


def test_a_web_download_without_a_version_begins_anew(
    web: tuple[Path, Front], mirrors: Path
) -> None:
    folder, front = web
    (folder / "p.npz").write_bytes(GOOD)
    cut = cut_once(folder / "p.npz", BAD, 4000)

    def change(asked: Asked, real: Answer) -> Answer:
        real.headers.pop("ETag", None)
        return cut(asked, real)

    front.change = change
    assert here(f"{front.address}/p.npz").read_bytes() == BAD


def test_the_checksum_of_a_raster_is_of_one_version(
    bucket: Bucket, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rasters, "_PIECE_BYTES", 4096)
    put = putting(bucket, "p/dsm.tif")
    put(GOOD)
    path = here(bucket.url("p/dsm.tif"))
    pointer = pointer_at(path)
    assert pointer is not None
    bucket.front.change = once_it_was_read("dsm.tif", lambda: put(BAD))
    assert pointed_sha256(path, pointer) == sha256(BAD).hexdigest()
    put(GOOD)
    kept = pointer_at(path)
    assert kept is not None
    assert pointed_sha256(path, kept) == sha256(GOOD).hexdigest()


def test_what_changes_without_end_is_one_message(bucket: Bucket, mirrors: Path) -> None:
    put, contents = putting(bucket, "p/a.npz"), iter(bytes([n]) * 10 for n in range(100))
    put(GOOD)

    def change(asked: Asked, real: Answer) -> Answer:
        if asked.method == "GET" and "Range" in asked.headers:
            put(next(contents))
        return real

    bucket.front.change = change
    for place in ("p", "p/a.npz"):
        with pytest.raises(StorageError, match="changes while it is read"):
            here(bucket.url(place))
    assert not list(mirrors.rglob("a.npz"))
