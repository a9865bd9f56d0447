"""The canonical benchmark folder, which ``prepare`` writes and every track reads.

::

    benchmark.toml              name, version, settings of the truth, scenes, checksums
    protocols/<name>.toml       the protocol that the truth was made for
    scenes/<scene>/queries.csv  a row a photo: camera, pose, prior, conditions
    scenes/<scene>/<track>/...  the truth of a track

Images and rasters may stand in the folder or where the user keeps them; the truth is always inside
and every file of it is held to its checksum.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import tomli_w
from pydantic import BaseModel, ConfigDict, Field

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.core.files import DATA_VARIABLE, MARK, atomic_write, data_location, sha256_of
from airzoo_bench.core.registry import TRACKS
from airzoo_bench.core.validation import SAFE_NAME, read_toml, validated
from airzoo_bench.storage.urls import (
    client_of,
    ensure_file,
    fetch_listed,
    in_parallel,
    path_of,
    url_at,
    url_of,
)

PartT = TypeVar("PartT")

_DEMO = Path(__file__).parents[1] / "demo" / "airzoo-demo"

_BY_HAND = (
    "correct it (docs/benchmark-folder.md says what is expected), then run `airzoo-bench manifest "
    "{folder} --force`"
)


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class SceneFile(_Model):
    """A scene as benchmark.toml describes it; docs/benchmark-folder.md says what each key is.

    Paths are relative to the benchmark folder, or absolute where the data were left in place.
    `warnings` are those of `prepare`, each with its code at the end.
    """

    id: Annotated[str, Field(pattern=SAFE_NAME)]
    title: str
    crs: str | None = None
    plane_height_m: Annotated[float, Field(allow_inf_nan=False)] | None = None
    images: str
    dom: str | None = None
    dsm: str | None = None
    dsm_sha256: str | None = None
    gallery: str | None = None
    maps: str | None = None
    cloud: str | None = None
    cloud_sha256: str | None = None
    truth_accuracy_m: Annotated[float, Field(gt=0, allow_inf_nan=False)] | None = None
    warnings: tuple[str, ...] | None = None


class SealedTruth(_Model):
    """The SHA-256 of an archive of the truth, which holds a salt of 256 bits and lies elsewhere."""

    commitment: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class BenchmarkFile(_Model):
    """The content of benchmark.toml.

    `tracks` holds, by track, section and key, the settings that the truth was made by; `by_hand`
    says that `airzoo-bench manifest` filled in what `prepare` writes.
    """

    schema_version: Literal[1] = Field(alias="schema")
    name: Annotated[str, Field(pattern=SAFE_NAME)]
    version: Annotated[int, Field(ge=1)]
    title: str
    tracks: dict[str, dict[str, dict[str, Any]]]
    scenes: tuple[SceneFile, ...]
    checksums: dict[str, str]
    by_hand: Literal[True] | None = None
    sealed: SealedTruth | None = None


def write_benchmark_file(folder: Path, file: BenchmarkFile) -> None:
    """Write benchmark.toml with the checksums of all files under scenes/."""
    sums = {name: sha256_of(folder / name) for name in _truth_files(folder)}
    values = file.model_dump(mode="json", by_alias=True, exclude_none=True) | {"checksums": sums}
    with atomic_write(folder / "benchmark.toml") as stream:
        stream.write(tomli_w.dumps(values).encode())


def _truth_files(folder: Path) -> list[str]:
    scenes = folder / "scenes"
    of_tracks = (path for name in TRACKS.names() for path in scenes.glob(f"*/{name}/*"))
    found = sorted([*scenes.glob("*/*"), *of_tracks])
    files = (path for path in found if path.is_file())
    return [path.relative_to(folder).as_posix() for path in files if path.name[0] != "."]


def verify(folder: Path, file: BenchmarkFile) -> None:
    """Compare all files under scenes/ with their checksums."""
    scenes = {scene.id for scene in file.scenes}
    for name in _truth_files(folder):
        if name.split("/")[1] in scenes and name not in file.checksums:
            raise BenchmarkError(
                "has no checksum in benchmark.toml",
                where=folder / name,
                expected="only files that `airzoo-bench prepare` wrote",
                fix="remove the file, or prepare the benchmark again",
            )
    for name, expected in file.checksums.items():
        path = folder / name
        if not path.is_file() or sha256_of(path) != expected:
            state = "was changed since it was prepared" if path.is_file() else "is missing"
            raise BenchmarkError(
                f"a file of the benchmark {state}",
                where=path,
                expected=f"SHA-256 {expected[:12]}…, as benchmark.toml says",
                fix="copy the folder again, or prepare the benchmark again",
            )


def needed(part: PartT | None, what: str, scene: str) -> PartT:
    """Return a part that a scene may lack, where a track cannot do without."""
    if part is None:
        raise BenchmarkError(
            f"scene {scene} has no {what}",
            fix="choose a track or rule of truth that does without, or prepare it with one",
        )
    return part


@dataclass(frozen=True)
class Benchmark:
    """An opened benchmark folder."""

    folder: Path
    file: BenchmarkFile

    @classmethod
    def open(cls, folder: Path, *, sealed: bool = False) -> Benchmark:
        """Open a benchmark folder and hold its files to their checksums."""
        path = folder / "benchmark.toml"
        if not path.is_file():
            raise BenchmarkError(
                "no benchmark folder here",
                where=folder,
                expected="a folder with benchmark.toml, as `airzoo-bench prepare` writes it",
                fix=f"name it with --data, or set {DATA_VARIABLE} to the folder that holds it",
            )
        data = read_toml(path, BenchmarkError, "benchmark file")
        file = validated(data, BenchmarkFile, BenchmarkError, path, "benchmark file")
        benchmark = cls(folder, file)
        if url_at(folder) is not None:
            in_parallel(ensure_file, [folder / name for name in file.checksums])
        with benchmark.fixes():
            verify(folder, file)
        if file.sealed is not None and not sealed:
            raise BenchmarkError(
                f"the truth of {file.name} is sealed: only its host can score predictions",
                where=folder,
                fix="look at them with `airzoo-bench check`, and enter the benchmark's board",
            )
        return benchmark

    @contextmanager
    def fixes(self) -> Iterator[None]:
        """Say of faults within how they are mended in a folder that `prepare` did not make."""
        try:
            yield
        except BenchmarkError as error:
            if self.file.by_hand and "prepare" in (error.fix or "prepare"):
                error.fix = _BY_HAND.format(folder=self.folder)
            raise

    @property
    def name(self) -> str:
        """The benchmark's name, as protocols give it."""
        return self.file.name

    @property
    def is_sealed(self) -> bool:
        """Whether the folder is without its truth."""
        return self.file.sealed is not None

    def scene(self, scene_id: str) -> SceneFile:
        """Return the entry of one scene."""
        return next(scene for scene in self.file.scenes if scene.id == scene_id)

    def warnings_of(self, scenes: Collection[str]) -> list[str]:
        """Return a note with the codes of what `prepare` warned of in some scenes."""
        texts = [
            text for one in self.file.scenes if one.id in scenes for text in one.warnings or ()
        ]
        codes = dict.fromkeys(re.findall(r"\[([a-z0-9-]+)\]$", "\n".join(texts), re.MULTILINE))
        where = "benchmark.toml has the texts, docs/brighton.md explains them"
        return [f"prepare warned of {', '.join(codes)} ({where})"] if codes else []

    def scene_folder(self, scene_id: str) -> Path:
        """Return the folder of one scene's tables and truth."""
        return self.folder / "scenes" / scene_id

    def resolve(self, path: str) -> Path:
        """Return the place of a file or folder that benchmark.toml names."""
        folders = {one for scene in self.file.scenes for one in (scene.images, scene.maps)}
        is_folder = path in folders or not Path(path).suffix
        return self.folder / path if is_folder else ensure_file(self.folder / path)

    @property
    def image_folders(self) -> tuple[Path, ...]:
        """The folder itself, and those in it of photos and of galleries of images."""
        named = [one for scene in self.file.scenes for one in (scene.images, scene.gallery) if one]
        places = [self.folder, *(self.folder / one for one in named)]
        return tuple(place for place in dict.fromkeys(places) if place.is_dir())

    def check_fits(self, protocol: Any) -> None:
        """Refuse a protocol that the truth in this folder was not made for."""
        missing = {s.id for s in protocol.scenes} - {s.id for s in self.file.scenes}
        if missing:
            raise BenchmarkError(
                f"lacks the scenes {', '.join(sorted(missing))} of protocol {protocol.name}",
                where=self.folder,
                fix="prepare them, or choose the protocol that the folder was made for",
            )
        have = self.file.tracks.get(protocol.track)
        if have is None:
            raise BenchmarkError(
                f"has no truth for {protocol.track}, only for {', '.join(self.file.tracks)}",
                where=self.folder,
                fix="prepare it with a protocol of that track",
            )
        found = [
            f"{section}.{key}: {ours.get(key)} in the folder, {theirs.get(key)} in the protocol"
            for section, theirs in protocol.truth_settings().items()
            for ours in [have.get(section, {})]
            for key in sorted({*ours, *theirs})
            if ours.get(key) != theirs.get(key)
        ]
        if found:
            raise BenchmarkError(
                f"its truth was made with other settings than protocol {protocol.name}:\n    "
                + "\n    ".join(found),
                where=self.folder,
                fix="use the protocol in its protocols/ folder, or prepare it again with this one",
            )


def data_here(location: str | Path | None = None) -> Path:
    """Return a benchmark folder, or the folder that holds some, as a path of this machine.

    Of folders at a URL, benchmark.toml and the protocols are fetched at once, tables and truth
    when the benchmark is opened, clouds, rasters and photos when they are read.
    """
    place = data_location() if location is None else location
    url = url_of(place)
    if url is None:
        return Path(place)
    ensure_file.cache_clear()
    url = url.rstrip("/")
    with client_of(url) as client:
        found = client.glob(f"{url}/{MARK}") or client.glob(f"{url}/*/{MARK}")
        for mark in tuple(found):
            found += client.glob(f"{mark.removesuffix(MARK)}protocols/*.toml")
        fetch_listed(client, found)
    if not found:
        raise BenchmarkError(
            "no benchmark lies here",
            where=url,
            fix="check bucket and folder; upload one that `airzoo-bench prepare` made",
        )
    return path_of(url)


def benchmark_place(name: str, data: Path) -> Path:
    """Return where a benchmark's folder would be: `data`, one in it, or the shipped demo."""
    if (data / "benchmark.toml").is_file():
        return data
    is_shipped = name == _DEMO.name and not (data / name / "benchmark.toml").is_file()
    return _DEMO if is_shipped else data / name


def find_benchmark(name: str, data: Path, *, sealed: bool = False) -> Benchmark:
    """Open a benchmark by name."""
    folder = benchmark_place(name, data)
    if not folder.is_dir():
        there = ", ".join(sorted(path.parent.name for path in data.glob(f"*/{MARK}"))) or "none"
        raise BenchmarkError(
            f"benchmark {name} is not there",
            where=data,
            expected=f"a folder {name}/ (benchmark folders found: {there})",
            fix=f"name it with --data, or set {DATA_VARIABLE}, or make it with "
            f"`airzoo-bench prepare`; a part of it has protocols of its own, {name}-partial-...",
        )
    benchmark = Benchmark.open(folder, sealed=sealed)
    if benchmark.name != name:
        raise BenchmarkError(
            f"holds benchmark {benchmark.name}, not {name}",
            where=folder,
            fix="name the right folder with --data, or name the right protocol with --protocol",
        )
    return benchmark
