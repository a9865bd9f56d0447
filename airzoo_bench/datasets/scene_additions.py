"""Scenes that are added to a benchmark folder: what is in it, and whether they fit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from airzoo_bench.benchmark.folder import Benchmark, differences
from airzoo_bench.benchmark.queries import POSE_COLUMNS
from airzoo_bench.benchmark.tables import read_table
from airzoo_bench.core.errors import BenchmarkError, first_of
from airzoo_bench.core.files import sha256_of
from airzoo_bench.datasets.scene_parts import ScenePart, read_parts, tracks_only
from airzoo_bench.datasets.truths import BenchmarkProtocols
from airzoo_bench.protocol.lookup import load_protocol
from airzoo_bench.protocol.model import Protocol

__all__ = ["extended_protocols", "parts_of", "shared_photos"]


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


def shared_photos(before: Mapping[str, ScenePart], added: Mapping[str, ScenePart]) -> Iterator[str]:
    """Yield a warning for each two scenes that share photos.

    Photos are the same where their bytes are or, where those of a scene are no longer there, their
    poses.

    Raises
    ------
    BenchmarkError
        Half of an added scene's photos or more are another's: the flight would count twice.
    """
    for scene, part in added.items():
        for other, old in before.items():
            same, photos = _same_photos(part, old)
            what = f"{first_of(same, photos, noun='photo')} of scene {scene}"
            if 2 * len(same) >= max(photos, 1):
                raise BenchmarkError(
                    f"{what} are photos of scene {other}",
                    where=old.home,
                    expected="each flight once: its queries would count twice in every mean",
                    fix=f"add another flight, or make a folder of its own of {scene} (--out)",
                )
            if same:
                yield f"{what} are photos of scene {other} too, and count twice in every mean"


def _same_photos(part: ScenePart, old: ScenePart) -> tuple[list[str], int]:
    """Return the names of a scene's photos that are another's, and how many there are."""
    ours, theirs = _photos(part), _photos(old)
    if not all(path.is_file() for path, _ in theirs.values()):
        poses = {pose for _, pose in theirs.values()} - {None}
        return [name for name, (_, pose) in ours.items() if pose in poses], len(ours)
    by_size: dict[int, list[Path]] = {}
    for path, _ in theirs.values():
        by_size.setdefault(path.stat().st_size, []).append(path)
    alike = {name: (path, by_size.get(path.stat().st_size)) for name, (path, _) in ours.items()}
    return [
        name
        for name, (path, others) in alike.items()
        if others and sha256_of(path) in map(sha256_of, others)
    ], len(ours)


def _photos(part: ScenePart) -> dict[str, tuple[Path, tuple[float, ...] | None]]:
    """Return the file and the pose, if there is one, of each photo of a scene."""
    table = read_table(part.home / "scenes" / part.entry.id / "queries.csv", ("id", "image"))
    files = [part.home / part.entry.images / name for name in table["image"]]
    posed = set(POSE_COLUMNS) <= set(table.columns)
    poses = list(zip(*(table[name] for name in POSE_COLUMNS), strict=True)) if posed else []
    return {
        name: (file, poses[row] if posed else None)
        for row, (name, file) in enumerate(zip(table["image"], files, strict=True))
    }
