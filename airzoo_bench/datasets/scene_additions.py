"""Scenes that are added to a benchmark folder: what is in it, and whether they fit."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from airzoo_bench.benchmark.folder import Benchmark, differences
from airzoo_bench.core.errors import BenchmarkError
from airzoo_bench.datasets.scene_parts import ScenePart, read_parts, tracks_only
from airzoo_bench.datasets.truths import BenchmarkProtocols
from airzoo_bench.protocol.lookup import load_protocol
from airzoo_bench.protocol.model import Protocol

__all__ = ["extended_protocols", "parts_of"]


def parts_of(folder: Path) -> dict[str, ScenePart]:
    """Return the scenes of a complete benchmark folder, from wherever it is."""
    known, benchmark = read_parts(folder), Benchmark.open(folder)
    return {
        entry.id: known.get(entry.id)
        or ScenePart(folder, "", entry, tracks_only(benchmark.scene_folder(entry.id)))
        for entry in benchmark.file.scenes
    }


def extended_protocols(
    folder: Path, protocols: BenchmarkProtocols, scenes: Sequence[str]
) -> BenchmarkProtocols:
    """Return the protocols of a folder with further scenes.

    Raises
    ------
    BenchmarkError
        It has one of them already, or its truth was made by other settings.
    """
    benchmark = Benchmark.open(folder)
    twice = [scene for scene in scenes if scene in {one.id for one in benchmark.file.scenes}]
    if twice:
        raise BenchmarkError(
            f"has a scene {twice[0]} already", where=folder, fix="name the scene to add otherwise"
        )
    olds = [load_protocol(path) for path in sorted((folder / "protocols").glob("*.toml"))]
    found: dict[str, Protocol] = {}
    for old in olds:
        new = next((of for of in protocols.every if of.track == old.track), None)
        if new is None:
            raise BenchmarkError(
                f"has truth for {old.track}, and the scenes to add have none", where=folder
            )
        differ = differences(benchmark.file.tracks[old.track], new.truth_settings())
        if differ:
            raise BenchmarkError(
                "its truth was made by other settings:\n    " + "\n    ".join(differ),
                where=folder,
                expected="the same settings for all scenes of a benchmark",
                fix="give the options that the folder was made with, such as --tile-size",
            )
        added = tuple(one for one in new.scenes if one.id in scenes)
        found[old.track] = old.model_copy(update={"scenes": (*old.scenes, *added)})
    return BenchmarkProtocols(**found)  # type: ignore[arg-type]
