"""Benchmark folders at URLs, of which files are fetched when they are needed.

A mirror begins with benchmark.toml and the protocols; the tables and the truth, of which
benchmark.toml states checksums, follow when the benchmark is opened, clouds and photos when they
are read. Rasters are read where they lie (`airzoo_bench.storage.mirror`).
"""

from __future__ import annotations

from pathlib import Path

from airzoo_bench.benchmark.manifest import BenchmarkFile
from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.core.files import MARK, data_location
from airzoo_bench.storage.mirror import RASTERS, Mirror, fetched, mirror_of, pointed, versions_of
from airzoo_bench.storage.remote import Entry, absent_is_absent, find, names
from airzoo_bench.storage.urls import Url, url_of

_PROTOCOLS = "protocols"


def data_here(location: str | Path | None = None) -> Path:
    """Return a benchmark folder, or the folder that holds some, as a path of this machine."""
    place = data_location() if location is None else location
    url = url_of(place)
    return Path(place) if url is None else _mirror_start(url)


def _mirror_start(url: Url) -> Path:
    """Mirror benchmark.toml and the protocols of a folder, or of all folders in it."""
    found = _listed(url, "") or {
        name: entry
        for folder in names(url, folders=True)
        for name, entry in _listed(url, f"{folder}/").items()
    }
    if not found:
        raise BenchmarkError(
            "no benchmark lies here",
            where=url,
            expected=f"a folder with {MARK}, or one that holds such folders",
            fix="check bucket and folder; upload one that `airzoo-bench prepare` made",
        )
    mirror = Mirror.of(url, versions_of(found))
    mirror.fetch_all(dict.fromkeys(found))
    return mirror.tree


def _listed(url: Url, folder: str) -> dict[str, Entry]:
    """Return benchmark.toml and the protocols of a folder; nothing where it is none."""
    mark = find(url.child(folder + MARK))
    if mark is None or mark.is_folder:
        return {}
    listed = names(url.child(folder + _PROTOCOLS))
    protocols = [f"{folder}{_PROTOCOLS}/{name}" for name in listed if name.endswith(".toml")]
    found = {name: find(url.child(name)) for name in protocols}
    return {folder + MARK: mark} | {name: one for name, one in found.items() if one is not None}


def fetch_truth(folder: Path, file: BenchmarkFile) -> None:
    """Fetch the tables and the truth of a benchmark, if its folder is a mirror."""
    found = mirror_of(folder)
    if found is not None:
        mirror, below = found
        prefix = f"{below}/" if below else ""
        mirror.fetch_all({prefix + name: sha for name, sha in file.checksums.items()})


def resolved(folder: Path, file: BenchmarkFile, path: str) -> Path:
    """Return the path of a file or folder in benchmark.toml; a mirror fetches files."""
    place = folder / path
    found = mirror_of(place)
    if found is None:
        return place
    clouds = {scene.cloud: scene.cloud_sha256 for scene in file.scenes}
    if clouds.get(path):  # no other may stay in the mirror
        with absent_is_absent():
            found[0].fetch(found[1], sha256=clouds[path])
        return place
    if path in _picture_folders(file) | {scene.maps for scene in file.scenes}:
        place.mkdir(parents=True, exist_ok=True)
        return place
    return (pointed if place.suffix.lower() in RASTERS else fetched)(place)


def _picture_folders(file: BenchmarkFile) -> set[str | None]:
    named = (one for scene in file.scenes for one in (scene.images, scene.gallery))
    return {one for one in named if not str(one).lower().endswith(RASTERS)}
