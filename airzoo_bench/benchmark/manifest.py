"""benchmark.toml, the manifest of a benchmark folder, and the checksums in it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import tomli_w
from pydantic import BaseModel, ConfigDict, Field

from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.core.files import atomic_write, sha256_of
from airzoo_bench.core.registry import TRACKS
from airzoo_bench.core.validation import SAFE_NAME


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class SceneFile(_Model):
    """A scene as benchmark.toml describes it; docs/benchmark-folder.md says what each key is.

    Paths are relative to the benchmark folder, or absolute where the data were left in place.
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


class SealedTruth(_Model):
    """The SHA-256 over a salt of 256 bits and the checksums of a truth that lies elsewhere."""

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
        if not path.is_file():
            raise BenchmarkError(
                "a file of the benchmark is missing",
                where=path,
                expected="all files of tables and truth that benchmark.toml names",
                fix="copy the folder again, or prepare the benchmark again",
            )
        if sha256_of(path) != expected:
            raise BenchmarkError(
                "a file of the benchmark was changed since it was prepared",
                where=path,
                expected=f"SHA-256 {expected[:12]}…",
                fix="prepare the benchmark again, so that its scores can be compared",
            )
