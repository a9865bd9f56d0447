"""From scenes as their files state them to a benchmark folder, for every dataset.

Each scene is a task, and is kept until all are finished: a run that was stopped goes on where it
was. `prepared.json` in a benchmark folder says what each scene was made from, so that a scene whose
files did not change is not made again.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter

from airzoo_bench.benchmark.folder import Benchmark, SceneFile
from airzoo_bench.core.errors import BenchmarkError, UsageError, UserError, counted
from airzoo_bench.core.files import atomic_folder, fingerprint, only_writer, temporary_folder
from airzoo_bench.core.progress import with_progress
from airzoo_bench.core.registry import DATASETS
from airzoo_bench.core.version import __version__
from airzoo_bench.datasets.content import make_content
from airzoo_bench.datasets.folder import (
    served_protocols,
    summary_of,
    write_folder_files,
    write_scene,
)
from airzoo_bench.datasets.settings import Prepared, PrepareSettings, SceneSummary
from airzoo_bench.datasets.truths import BenchmarkProtocols

RECORDS = "prepared.json"
_FILES = ("images", "dom", "dsm", "gallery", "maps", "cloud")


@dataclass(frozen=True)
class Record:
    """A finished scene: its entry of benchmark.toml, and what `prepare` prints of it.

    `key` is of what it was made from, see `scene_keys`.
    """

    key: str
    entry: SceneFile
    summary: SceneSummary

    def is_whole(self, home: Path) -> bool:
        """Whether a folder holds the scene, and all that it refers to is there."""
        named = [f"scenes/{self.entry.id}", *(getattr(self.entry, name) for name in _FILES)]
        return all((home / path).exists() for path in named if path is not None)


_Records = TypeAdapter(dict[str, Record])


def _read_records(folder: Path) -> dict[str, Record]:
    """Return the scenes that a folder holds; none where its records cannot be read."""
    try:
        return _Records.validate_json((folder / RECORDS).read_bytes())
    except (OSError, ValueError):
        return {}  # of another version, or damaged: the scenes are made again


def _write_records(folder: Path, records: Mapping[str, Record]) -> None:
    text = _Records.dump_json(dict(records), indent=1, exclude_none=True)
    (folder / RECORDS).write_bytes(text + b"\n")


def _copy_scene(scene: str, home: Path, folder: Path, copy: Callable[[str, str], object]) -> None:
    """Put a scene's files from a folder that is laid out as a benchmark into another."""
    for part in ("scenes", "data"):
        if (home / part / scene).is_dir():
            target = folder / part / scene
            shutil.copytree(home / part / scene, target, copy_function=copy, dirs_exist_ok=True)


def _link_or_copy(source: str, target: str) -> None:
    """Give a file a second name, on disks that know such, else copy it."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copyfile(source, target)


def _stamps(path: Path, target: Path) -> Iterator[tuple[str, int, int]]:
    """Yield name, size and time of change of a file, or of every file below a folder."""
    files = [path] if path.exists() else []
    if path.is_dir():
        files = []
        for home, folders, names in os.walk(path, followlinks=True):
            folders[:] = [one for one in folders if one[0] != "." and Path(home, one) != target]
            files += [file for name in names if (file := Path(home, name)).exists()]
    for file in files:
        status = file.stat()
        yield str(file), status.st_size, status.st_mtime_ns


@dataclass
class Run:
    """Scenes that are being finished, each in a folder of its own in `staging`.

    `scenes` have the files that each is read from; relative paths are seen from `home`.
    """

    dataset: Any
    options: Any
    settings: PrepareSettings
    scenes: Mapping[str, Sequence[Path]]
    protocols: BenchmarkProtocols
    home: Path = field(default_factory=Path.cwd)
    keys: dict[str, str] = field(default_factory=dict)
    records: dict[str, Record] = field(default_factory=dict)

    @property
    def staging(self) -> Path:
        """Where finished scenes are kept until all are."""
        return self.settings.folder.absolute().parent / f".{self.protocols.benchmark}.prepare"

    def scene_keys(self) -> dict[str, str]:
        """Return for each scene the SHA-256 of its inputs."""
        stamps: dict[Path, list[tuple[str, int, int]]] = {}
        settings, keys = self.settings, {}
        flags = [settings.tiles_on_disk, settings.crops_on_disk, settings.copy]
        names = [one.name for one in fields(self.options) if one.name != "scene"]
        options = {name: str(getattr(self.options, name)) for name in names}
        for scene, given in self.scenes.items():
            paths = sorted({path.resolve() for path in given})
            for path in paths:
                if path not in stamps:
                    stamps[path] = sorted(_stamps(path, settings.folder.resolve()))
            rules = [
                [one.track, one.truth_settings(), one.scenes[0].title, one.scenes[0].queries]
                for one in self.protocols.for_scene(scene).restrict([scene]).every
            ]
            files = [[str(path), stamps[path]] for path in paths]
            keys[scene] = fingerprint([__version__, options, flags, scene, rules, files])
        return keys

    def is_prepared(self) -> bool:
        """Whether the folder is complete, and made from files that did not change since."""
        folder = self.settings.folder
        records = _read_records(folder)
        keys = self.scene_keys() if records else {}
        if {scene: record.key for scene, record in records.items()} != keys:
            raise UsageError(
                "the folder exists already, made from other scenes, options or files, or by "
                "another version of this suite",
                where=folder,
                fix="choose another --name or --out, or replace this one with --force",
            )
        if not records or not all(record.is_whole(folder) for record in records.values()):
            return False
        Benchmark.open(folder)
        return True

    def prepare(self) -> Prepared:
        """Make the benchmark folder."""
        # Runs into other folders share the finished scenes, by the benchmark's name.
        with only_writer(self.staging):
            try:
                self.finish()
                prepared = self.assemble()
            except BaseException:
                if len(self.keys) > 1 and self.staging.is_dir() and any(self.staging.iterdir()):
                    self.settings.note(f"finished scenes stay in {self.staging} for the next run")
                else:
                    shutil.rmtree(self.staging, ignore_errors=True)
                raise
            shutil.rmtree(self.staging, ignore_errors=True)
            return prepared

    def finish(self) -> None:
        """Take the scenes that earlier runs finished, and make the others, each a task."""
        progress = self.settings.progress
        self.keys = with_progress(self.scene_keys, "looking through the source", progress)
        made = self._take_finished()
        scenes = [scene for scene in self.scenes if scene not in made]
        found = self.settings.engine.map(
            _task, scenes, shared=self, stage="scenes", name="scene {}".format
        )
        label = f"scene {scenes[0]}" if len(scenes) == 1 else "scenes"
        made |= zip(scenes, progress(found, label, len(scenes)), strict=True)
        # As they come in the protocols, whichever were there before.
        self.records = {scene: made[scene] for scene in self.scenes}

    def _take_finished(self) -> dict[str, Record]:
        """Take the scenes that nothing has changed for since they were finished."""
        places = [self.staging / scene for scene in self.scenes]
        if not self.settings.replace:
            folder, name = self.settings.folder, self.protocols.benchmark
            places += [folder, folder.with_name(name), folder.with_name(f"{name}-partial")]
        found = {one.key: (one, home) for home in places for one in _unchanged_records(home)}
        taken = {}
        for scene, key in self.keys.items():
            if key in found:
                self.settings.note(f"scene {scene}: nothing changed since it was made, taken as is")
                taken[scene], home = found[key]
                if home != self.staging / scene:
                    self.keep(taken[scene], home, shutil.copyfile)
        return taken

    def keep(self, record: Record, home: Path, copy: Callable[[str, str], object]) -> None:
        """Put a scene among the finished ones."""
        scene = record.entry.id
        with temporary_folder(self.staging, scene) as temporary:
            _copy_scene(scene, home, temporary, copy)
            _write_records(temporary, {scene: record})
            shutil.rmtree(self.staging / scene, ignore_errors=True)
            temporary.replace(self.staging / scene)

    def assemble(self) -> Prepared:
        """Make the folder of the scenes that were finished."""
        settings, records = self.settings, self.records
        made, folder = self.protocols.restrict(records), settings.folder
        if made is not self.protocols:
            left_out = [scene for scene in self.protocols.titles if scene not in made.titles]
            settings.note(
                f"warning: {len(made.titles)} of {counted(len(self.protocols.titles), 'scene')}, "
                f"without {', '.join(left_out)}: the benchmark is named {made.benchmark}, and its "
                "scores are not those of the whole"
            )
            if folder.name == self.protocols.benchmark:
                folder = folder.with_name(made.benchmark)
        summaries = {scene: record.summary for scene, record in records.items()}
        served = served_protocols(made, summaries, folder)

        def write_scenes() -> None:
            for scene in records:
                _copy_scene(scene, self.staging / scene, staged, _link_or_copy)
            _write_records(staged, records)
            write_folder_files(staged, served, [record.entry for record in records.values()])

        with atomic_folder(folder, replace=settings.replace) as staged:
            with_progress(write_scenes, "writing the folder", settings.progress)
        return Prepared(folder, {one.name: one.track for one in served}, summaries)


def _task(run: Run, scene: str) -> Record:
    """Make a scene and keep it among the finished ones."""
    if Path.cwd() != run.home:  # on a cluster
        os.chdir(run.home)
    try:
        with DATASETS.blaming(run.dataset.name, f", reading scene {scene}"):
            native = run.dataset.read(run.options, scene, run.settings.progress)
        content = make_content(native, run.protocols)
        summary = summary_of(content, run.protocols, native.notes)
        with temporary_folder(run.staging, scene) as temporary:
            entry = write_scene(temporary, content, run.protocols.titles[scene], run.settings)
            entry = entry.model_copy(update={"warnings": summary.warnings or None})
            record = Record(run.keys[scene], entry, summary)
            run.keep(record, temporary, _link_or_copy)
    except UserError as fault:
        if len(run.scenes) > 1 and not fault.fix:
            fault.fix = "correct it, or make the other scenes alone with --scene"
        raise
    return record


def _unchanged_records(place: Path) -> Iterable[Record]:
    """Return the scenes of a place, none where one of its files was changed."""
    if (place / "benchmark.toml").is_file():
        try:
            Benchmark.open(place)
        except BenchmarkError:
            return []
    return _read_records(place).values()
