"""The truth of one track in a folder of its own, for platforms that score elsewhere."""

from __future__ import annotations

import shutil
from pathlib import Path

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.benchmark.manifest import SceneFile, write_benchmark_file
from airzoo_bench.protocol.lookup import protocol_files
from airzoo_bench.protocol.model import Protocol

__all__ = ["write_reference"]

# What scoring reads beside the truth, by track; of others' tracks, all that there is.
_PARTS = {"retrieval": (), "matching": ("dom", "dsm", "maps"), "reconstruction": ("cloud",)}
_EVERY = ("dom", "dsm", "gallery", "maps", "cloud")


def write_reference(benchmark: Benchmark, protocol: Protocol, folder: Path) -> None:
    """Write a benchmark folder with what a protocol's track is scored with, and without photos.

    Parameters
    ----------
    benchmark : Benchmark
        Which must fit the protocol.
    protocol : Protocol
    folder : Path
        Empty.

    Raises
    ------
    BenchmarkError
        See `Benchmark.check_fits`.
    """
    benchmark.check_fits(protocol)
    wanted = {scene.id for scene in protocol.scenes}
    scenes = [scene for scene in benchmark.file.scenes if scene.id in wanted]
    for scene in scenes:
        home = benchmark.scene_folder(scene.id)
        target = folder / "scenes" / scene.id
        shutil.copytree(home / protocol.track, target / protocol.track)
        shutil.copyfile(home / "queries.csv", target / "queries.csv")
    (folder / "protocols").mkdir()
    source = protocol_files(benchmark.folder)[protocol.name]
    shutil.copyfile(source, folder / "protocols" / f"{protocol.name}.toml")
    file = benchmark.file.model_copy(
        update={
            "tracks": {protocol.track: benchmark.file.tracks[protocol.track]},
            "scenes": tuple(
                _with_parts(benchmark, scene, protocol.track, folder) for scene in scenes
            ),
        }
    )
    write_benchmark_file(folder, file)


def _with_parts(benchmark: Benchmark, scene: SceneFile, track: str, folder: Path) -> SceneFile:
    """Copy the maps and clouds of a scene that its track reads; photos are not among them."""
    parts = _PARTS.get(track, _EVERY)
    changes: dict[str, str | None] = {"images": "images", **dict.fromkeys(_EVERY)}
    for part in parts:
        stated = getattr(scene, part)
        if stated is None:
            continue
        source = benchmark.resolve(stated)
        place = f"data/{scene.id}/{part}{source.suffix}"
        (folder / place).parent.mkdir(parents=True, exist_ok=True)
        if source.is_dir():
            shutil.copytree(source, folder / place)
        else:
            shutil.copyfile(source, folder / place)
        changes[part] = place
    for part in ("dsm", "cloud"):
        if part not in parts:
            changes[f"{part}_sha256"] = None
    return scene.model_copy(update=changes)
