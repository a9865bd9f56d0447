"""What lies below a URL."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from airzoo_bench.benchmark.mirrored import data_here
from airzoo_bench.core.errors import StorageError, UserError
from airzoo_bench.results.files import results_here
from airzoo_bench.storage import remote
from airzoo_bench.storage.rasters import here
from airzoo_bench.storage.remote import files, names
from airzoo_bench.storage.urls import Url, url_of
from tests.storage.conftest import Bucket
from tests.storage.servers import Answer, Asked, Front, serving


def as_url(text: str) -> Url:
    url = url_of(text)
    assert url is not None
    return url


@pytest.fixture
def many(bucket: Bucket) -> Bucket:
    """Return a bucket with folders in folders."""
    for name in ("p/", "p/a", "p/b/", "p/b/c", "p/b/d", "p/e", "p/f g/h", "pp"):
        content = b"" if name.endswith("/") else b"x"
        bucket.client.put_object(Bucket=bucket.name, Key=name, Body=content)
    bucket.front.asked.clear()
    return bucket


def test_names_below_a_folder(many: Bucket) -> None:
    url = as_url(many.url("p"))
    assert list(files(url)) == ["a", "b/c", "b/d", "e", "f g/h"]
    assert names(url) == ["a", "b", "e", "f g"]
    assert names(url, folders=True) == ["b", "f g"]
    assert names(as_url(many.url())) == ["p", "pp"]
    assert names(as_url(many.url("q"))) == []
    assert sorted(one.name for one in here(many.url("p")).iterdir()) == ["a", "b", "e", "f g"]


@pytest.fixture
def application(mirrors: Path) -> Iterator[Front]:
    pytest.importorskip("aiohttp", reason="the extra storage is not installed")
    page = Answer(
        200,
        {"Content-Type": "text/html"},
        b'<a href="docs/">d</a><a href="c/">c</a><a href="./">.</a>',
    )
    with serving(lambda _: page) as front:
        yield front


def test_a_server_that_shows_a_page_anywhere(
    application: Front, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(remote, "_MOST_FOLDERS", 40)
    with pytest.raises(StorageError, match="shows more than 40 folders"):
        here(f"{application.address}/mine.npz")
    assert len(application.asked) < 45
    with pytest.raises(UserError, match="no benchmark lies here"):
        data_here(f"{application.address}/data")


def test_a_folder_that_cannot_be_listed_is_not_left_out(web: tuple[Path, Front]) -> None:
    folder, front = web
    (folder / "p" / "gallery").mkdir(parents=True)
    (folder / "p" / "queries.npz").write_bytes(b"x")

    def refuse(asked: Asked, real: Answer) -> Answer:
        return Answer(403, {}) if "gallery" in asked.path else real

    front.change = refuse
    with pytest.raises(StorageError, match="access is denied"):
        here(f"{front.address}/p")


def test_a_slash_at_the_end_is_the_folder(bucket: Bucket) -> None:
    for name in ("pre", "pre/mine.npz", "run.json", "run.json/result.json", "file"):
        bucket.client.put_object(Bucket=bucket.name, Key=name, Body=name.encode())
    assert here(bucket.url("pre")).read_bytes() == b"pre"
    folder = here(bucket.url("pre/"))
    assert [one.name for one in folder.iterdir()] == ["mine.npz"]
    with pytest.raises(StorageError, match="no such file or folder"):
        here(bucket.url("file/"))
    for location, content in (("run.json", b"run.json"), ("run.json/", b"run.json/result.json")):
        assert results_here([bucket.url(location)])[0].read_bytes() == content


def test_a_version_is_not_read(bucket: Bucket) -> None:
    with pytest.raises(UserError, match="only the newest is read"):
        here(bucket.url("p/mine.npz?versionId=abc"))
