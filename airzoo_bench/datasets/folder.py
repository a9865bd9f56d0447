"""Writing the parts of a benchmark folder that all datasets share."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

import tomli_w

from airzoo_bench.benchmark import BenchmarkFile, SceneFile, write_benchmark_file
from airzoo_bench.datasets.sources import PhotoSources
from airzoo_bench.protocol import Protocol

__all__ = ["copied", "left_in_place", "write_folder_files"]


def left_in_place(sources: PhotoSources) -> dict[str, str]:
    """Return where photos, map and surface model are, as benchmark.toml names them."""
    return {key: str(getattr(sources, key).resolve()) for key in ("images", "dom", "dsm")}


def copied(
    folder: Path, scene: str, sources: PhotoSources, names: tuple[str, ...]
) -> dict[str, str]:
    """Copy photos, map and surface model into the folder, and return where they are."""
    home = Path("data") / scene
    for name in names:
        target = folder / home / "images" / name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(sources.images / name, target)
    for key in ("dom", "dsm"):
        shutil.copyfile(getattr(sources, key), folder / home / f"{key}.tif")
    kept = {"images": home / "images", "dom": home / "dom.tif", "dsm": home / "dsm.tif"}
    return {key: path.as_posix() for key, path in kept.items()}


def write_folder_files(folder: Path, protocols: Sequence[Protocol], scene: SceneFile) -> None:
    """Write benchmark.toml and the protocols that the truth was made for."""
    (folder / "protocols").mkdir()
    for protocol in protocols:
        values = protocol.model_dump(mode="json", by_alias=True, exclude_none=True)
        target = folder / "protocols" / f"{protocol.name}.toml"
        target.write_text(tomli_w.dumps(values), encoding="utf-8")
    file = BenchmarkFile(
        schema=1,
        name=protocols[0].benchmark,
        version=1,
        title=protocols[0].benchmark,
        tracks={protocol.track: protocol.truth_settings() for protocol in protocols},
        scenes=(scene,),
        checksums={},
    )
    write_benchmark_file(folder, file)
