"""Benchmark folders at URLs, whose files are fetched when they are needed.

benchmark.toml and the protocols come first; the tables and the truth, of which benchmark.toml
states checksums, follow when the benchmark is opened, clouds and photos when they are read.
Rasters are read where they lie (`airzoo_bench.storage.mirror`).
"""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.core.files import MARK, data_location
from airzoo_bench.storage.mirror import (
    RASTERS,
    AbsentError,
    fetch,
    fetched,
    in_parallel,
    names,
    pointed,
)
from airzoo_bench.storage.urls import Url, copy_of, url_at, url_of

if TYPE_CHECKING:
    from airzoo_bench.benchmark.folder import BenchmarkFile

_PROTOCOLS = "protocols"


def data_here(location: str | Path | None = None) -> Path:
    """Return a benchmark folder, or the folder that holds some, as a path of this machine."""
    place = data_location() if location is None else location
    url = url_of(place)
    return Path(place) if url is None else _fetch_start(url)


def _fetch_start(url: Url) -> Path:
    """Fetch benchmark.toml and the protocols of a folder, or of all folders in it."""
    below = names(url)
    places = [url] if MARK in below else [url.child(name) for name in below]
    wanted = [file for files in in_parallel(_start_of, places) for file in files]
    if not wanted:
        raise BenchmarkError(
            "no benchmark lies here",
            where=url,
            expected=f"a folder with {MARK}, or one that holds such folders",
            fix="check bucket and folder; upload one that `airzoo-bench prepare` made",
        )
    kept, folder = set(in_parallel(fetch, wanted)), copy_of(url)
    for pattern in (MARK, f"{_PROTOCOLS}/*.toml"):
        for old in {*folder.glob(pattern), *folder.glob(f"*/{pattern}")} - kept:
            old.unlink()
    return folder


def _start_of(url: Url) -> list[Url]:
    """Return benchmark.toml and the protocols of a folder; nothing where it is none."""
    if MARK not in names(url):
        return []
    protocols = url.child(_PROTOCOLS)
    listed = [protocols.child(name) for name in names(protocols) if name.endswith(".toml")]
    return [url.child(MARK), *listed]


def fetch_truth(folder: Path, file: BenchmarkFile) -> None:
    """Fetch the tables and the truth of a benchmark, if its folder is a copy."""
    url = url_at(folder)
    if url is not None:
        in_parallel(fetch, [url.child(name) for name in file.checksums], file.checksums.values())


def resolved(folder: Path, file: BenchmarkFile, path: str) -> Path:
    """Return the path of a file or folder in benchmark.toml; files at a URL are fetched."""
    place = folder / path
    url = url_at(place)
    if url is None:
        return place
    clouds = {scene.cloud: scene.cloud_sha256 for scene in file.scenes}
    if clouds.get(path):
        with suppress(AbsentError):
            fetch(url, sha256=clouds[path])
        return place
    if path in _picture_folders(file) | {scene.maps for scene in file.scenes}:
        place.mkdir(parents=True, exist_ok=True)
        return place
    return (pointed if place.suffix.lower() in RASTERS else fetched)(place)


def _picture_folders(file: BenchmarkFile) -> set[str | None]:
    named = (one for scene in file.scenes for one in (scene.images, scene.gallery))
    return {one for one in named if not str(one).lower().endswith(RASTERS)}
