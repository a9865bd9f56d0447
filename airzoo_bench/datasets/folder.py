"""Writing the parts of a benchmark folder that all datasets share."""

from __future__ import annotations

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import tomli_w

from airzoo_bench.benchmark.manifest import BenchmarkFile, SceneFile, write_benchmark_file
from airzoo_bench.benchmark.queries import write_queries
from airzoo_bench.matching.truth import MatchingTruth
from airzoo_bench.matching.truth import write_truth as write_matching_truth
from airzoo_bench.protocol.model import Protocol
from airzoo_bench.reconstruction.truth import ReconstructionTruth
from airzoo_bench.reconstruction.truth import write_truth as write_reconstruction_truth
from airzoo_bench.retrieval.prepare import PreparedScene
from airzoo_bench.retrieval.truth import write_truth as write_retrieval_truth

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["SceneTruths", "copied", "left_in_place", "write_folder_files", "write_scene"]


@dataclass(frozen=True, eq=False)
class SceneTruths:
    """The table of a scene's photos and its truth, by track; None where a track has none."""

    photos: pd.DataFrame
    retrieval: PreparedScene | None
    matching: MatchingTruth | None
    reconstruction: ReconstructionTruth | None


def left_in_place(sources: Mapping[str, Path]) -> dict[str, str]:
    """Return where photos, maps and clouds are, as benchmark.toml names them."""
    return {key: str(path.resolve()) for key, path in sources.items()}


def copied(
    folder: Path, scene: str, sources: Mapping[str, Path], names: Sequence[str]
) -> dict[str, str]:
    """Copy photos, maps and clouds into the folder, and return where they are.

    Parameters
    ----------
    folder : Path
        The benchmark folder.
    scene : str
    sources : mapping of str to Path
        By the name that benchmark.toml has for it; ``images`` is a folder.
    names : sequence of str
        The photos to copy, relative to ``images``.
    """
    home = Path("data") / scene
    for name in names:
        _copy(sources["images"] / name, folder / home / "images" / name)
    kept = {"images": home / "images"}
    for key, source in sources.items():
        if key != "images":
            kept[key] = home / f"{key}{source.suffix.lower()}"
            _copy(source, folder / kept[key])
    return {key: path.as_posix() for key, path in kept.items()}


def write_scene(folder: Path, scene: str, truths: SceneTruths) -> Path:
    """Write a scene's table of photos and its truth; returns the scene's folder."""
    home = folder / "scenes" / scene
    write_queries(home, truths.photos)
    if truths.retrieval is not None:
        write_retrieval_truth(home, truths.retrieval.truth, truths.retrieval.overlaps)
    if truths.matching is not None:
        write_matching_truth(home, truths.matching)
    if truths.reconstruction is not None:
        write_reconstruction_truth(home, truths.reconstruction)
    return home


def write_folder_files(
    folder: Path, protocols: Sequence[Protocol], scenes: Sequence[SceneFile]
) -> None:
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
        scenes=tuple(scenes),
        checksums={},
    )
    write_benchmark_file(folder, file)


def _copy(source: Path, target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(source, target)
