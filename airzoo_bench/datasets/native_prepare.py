"""From scenes as their files state them to a benchmark folder, for every dataset.

Each scene is finished by itself, and kept until all are: a run that was stopped goes on where it
was, and scenes whose files did not change are not made again.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.errors import UsageError, counted
from airzoo_bench.core.files import atomic_folder, only_run
from airzoo_bench.core.progress import shown
from airzoo_bench.core.validation import nearest
from airzoo_bench.datasets.dataset import Prepared, PrepareSettings
from airzoo_bench.datasets.folder import served_protocols, write_folder_files
from airzoo_bench.datasets.scene_parts import (
    RECORDS,
    ScenePart,
    SceneSource,
    changed_options,
    link_or_copy,
    read_parts,
    scene_keys,
    write_records,
)
from airzoo_bench.datasets.scene_run import SceneRun
from airzoo_bench.datasets.scene_tasks import faults_of_writing
from airzoo_bench.datasets.truths import BenchmarkProtocols
from airzoo_bench.evaluation.truth_accuracy import accuracy_notes
from airzoo_bench.protocol.model import Protocol

__all__ = ["chosen_scenes", "is_prepared", "prepare_scenes"]

_PACKED = (".zip", ".7z", ".rar", ".tar", ".tgz", ".tar.gz", ".part", ".crdownload", ".aria2")


def chosen_scenes(
    there: Sequence[str], only: Sequence[str] | None, source: Path
) -> tuple[str, ...]:
    """Return the scenes that were asked for, in the order of those that are there."""
    unknown = [scene for scene in only or () if scene not in there]
    if unknown:
        raise UsageError(
            f"there is no scene {', '.join(map(repr, unknown))} below {source}"
            + nearest(unknown[0], list(there), 1),
            where="--scene",
            expected="some of " + ", ".join(there),
            fix=_unpack(unknown, source)
            or "download or unpack it there, or name a scene that is there",
        )
    return tuple(scene for scene in there if only is None or scene in only)


def _unpack(scenes: Sequence[str], source: Path) -> str | None:
    """Say which archives or unfinished downloads are named as scenes that are not there."""
    files = (path.name for path in source.iterdir()) if source.is_dir() else ()
    packed = [
        name
        for name in sorted(files)
        if name.lower().endswith(_PACKED)
        and any(re.search(rf"(?<!\w){re.escape(scene)}(?!\w)", name) for scene in scenes)
    ]
    return f"finish or unpack {', '.join(packed[:3])}" if packed else None


def is_prepared(
    source: SceneSource, protocols: BenchmarkProtocols, settings: PrepareSettings
) -> bool:
    """Whether the folder is there, complete, and made from files that did not change since."""
    if not (settings.folder / RECORDS).is_file():
        return False
    parts = read_parts(settings.folder)
    keys = {scene: part.key for scene, part in parts.items()}
    if parts and keys != scene_keys(source, protocols, settings):
        changed = changed_options(parts, source)
        raise UsageError(
            "the folder exists already, made "
            + (
                f"with {'; '.join(changed)}"
                if changed
                else "from files that have changed since, or by another version of this suite"
            ),
            where=settings.folder,
            fix="name another folder with --out, or replace this one with --force",
        )
    if not parts or not all(part.is_whole for part in parts.values()):
        return False
    Benchmark.open(settings.folder)
    return True


def prepare_scenes(
    source: SceneSource, protocols: BenchmarkProtocols, settings: PrepareSettings
) -> Prepared:
    """Make the benchmark folder of some scenes."""
    with faults_of_writing(settings.folder), _alone(settings.folder):
        return _prepared(source, protocols, settings)


def _prepared(
    source: SceneSource, protocols: BenchmarkProtocols, settings: PrepareSettings
) -> Prepared:
    run = SceneRun(source, protocols, settings)
    # Runs into other folders share the finished scenes, by the benchmark's name.
    with _alone(run.staging):
        try:
            run.finish()
            return _assembled(run)
        finally:
            run.clear()


def _alone(folder: Path) -> AbstractContextManager[None]:
    """Keep other runs from a folder that both would fill or clear; see `only_run`."""
    return only_run(
        folder,
        "another run is making this benchmark here",
        folder.parent,
        "name a folder elsewhere with --out",
    )


def _assembled(run: SceneRun) -> Prepared:
    """Make the folder of the scenes that were finished."""
    settings, parts = run.settings, run.parts
    made = run.protocols.of_scenes(parts)
    folder = _named(settings.folder, run.protocols, made)
    if made is not run.protocols:
        settings.note(_only_some(run, made))
    tracks = {scene: tuple(part.summary.tracks) for scene, part in parts.items()}
    served = served_protocols(made, tracks, folder)
    write = partial(_write, folder, served, parts, replaced=settings.replace)
    shown(write, "writing the folder", settings.progress)
    run.made = True
    accuracy = {scene: part.entry.truth_accuracy_m for scene, part in parts.items()}
    for protocol in served:
        for sentence in accuracy_notes(protocol, accuracy):
            settings.note(f"warning: {sentence}")
    return Prepared(
        folder,
        {protocol.name: protocol.track for protocol in served},
        {scene: part.summary for scene, part in run.parts.items()},
        run.facts,
        run.failed,
    )


def _write(
    folder: Path, served: Sequence[Protocol], parts: Mapping[str, ScenePart], *, replaced: bool
) -> None:
    with atomic_folder(folder, replace=replaced) as staged:
        for part in parts.values():
            part.add_to(staged, link_or_copy)
        write_records(staged, parts.values())
        write_folder_files(staged, served, [part.entry for part in parts.values()])


def _named(folder: Path, whole: BenchmarkProtocols, made: BenchmarkProtocols) -> Path:
    """Return the folder to make: one that is named as the whole never holds a part of it."""
    named_as_whole = folder.name == whole.every[0].benchmark
    return folder.with_name(made.every[0].benchmark) if named_as_whole else folder


def _only_some(run: SceneRun, made: BenchmarkProtocols) -> str:
    titles, asked = run.protocols.titles, getattr(run.source.options, "scene", None)
    left_out = [scene for scene in titles if scene not in made.titles]
    place = getattr(run.source.options, "source", None)
    packed = None if asked or place is None else _unpack(left_out, place)
    return (
        f"warning: {len(made.titles)} of {counted(len(titles), 'scene')}, without "
        f"{', '.join(left_out)}: the benchmark is named {made.every[0].benchmark}, and its scores "
        f"are not those of the whole{f'; {packed}' if packed else ''}"
    )
