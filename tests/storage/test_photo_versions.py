"""Photos of a benchmark at a URL: all of the versions that one list states."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from airzoo_bench.benchmark.mirrored import data_here, resolved
from airzoo_bench.core.errors import StorageError
from airzoo_bench.storage.mirror import fetched
from tests.storage.conftest import Bucket
from tests.storage.contents import BAD, GOOD, putting
from tests.storage.servers import Front


def photos_of(place: str, folder: str = "photos") -> Path:
    """Open a benchmark folder as a run does, and return its folder of photos."""
    scene = SimpleNamespace(
        images="photos", maps=None, gallery="gallery", cloud=None, cloud_sha256=None
    )
    file: Any = SimpleNamespace(scenes=[scene])
    return resolved(data_here(place), file, folder)


@pytest.fixture
def photos(bucket: Bucket) -> Bucket:
    """Return a bucket with a benchmark of three photos."""
    putting(bucket, "d/benchmark.toml")(b"")
    for name in ("a.jpg", "b.jpg", "more/c.jpg"):
        putting(bucket, f"d/photos/{name}")(GOOD)
    return bucket


def test_photos_that_were_replaced_are_fetched_anew(photos: Bucket) -> None:
    first = photos_of(photos.url("d"))
    assert fetched(first / "a.jpg").read_bytes() == GOOD
    putting(photos, "d/photos/a.jpg")(BAD)
    second = photos_of(photos.url("d"))
    assert fetched(second / "a.jpg").read_bytes() == BAD
    assert fetched(second / "more" / "c.jpg").read_bytes() == GOOD
    assert (
        first / "a.jpg"
    ).read_bytes() == GOOD  # a run that is under way reads what it began with
    putting(photos, "d/photos/a.jpg")(GOOD)
    photos.front.sent.clear()
    assert not fetched(photos_of(photos.url("d")) / "d.jpg").exists()
    assert fetched(photos_of(photos.url("d")) / "more" / "c.jpg").read_bytes() == GOOD


def test_photos_are_of_the_versions_that_were_listed(photos: Bucket) -> None:
    folder = photos_of(photos.url("d"))
    fetched(folder / "a.jpg")
    putting(photos, "d/photos/b.jpg")(BAD)
    with pytest.raises(StorageError, match="changes while it is read") as caught:
        fetched(folder / "b.jpg")
    assert caught.value.where == photos.url("d", "photos", "b.jpg")


def test_photos_that_are_there_are_not_asked_for(photos: Bucket) -> None:
    for name in ("a.jpg", "b.jpg"):
        fetched(photos_of(photos.url("d")) / name)
    photos.front.asked.clear()
    folder = photos_of(photos.url("d"))
    assert [fetched(folder / name).read_bytes() for name in ("a.jpg", "b.jpg")] == [GOOD, GOOD]
    lists = [one.path for one in photos.front.asked if "prefix=d%2Fphotos" in one.path]
    assert len(lists) == 1
    assert not [one.path for one in photos.front.asked if ".jpg" in one.path]


def test_a_gallery_of_images_is_a_folder(photos: Bucket) -> None:
    putting(photos, "d/gallery/one.png")(GOOD)
    folder = photos_of(photos.url("d"), "gallery")
    assert folder.is_dir()
    assert fetched(folder / "one.png").read_bytes() == GOOD


def test_photos_of_a_web_server_are_fetched_one_by_one(
    web: tuple[Path, Front], mirrors: Path
) -> None:
    folder, front = web
    (folder / "d" / "photos").mkdir(parents=True)
    (folder / "d" / "benchmark.toml").touch()
    for name in ("a.jpg", "b.jpg"):
        (folder / "d" / "photos" / name).write_bytes(GOOD)
    assert fetched(photos_of(f"{front.address}/d") / "a.jpg").read_bytes() == GOOD
    assert front.count("b.jpg") == 0
