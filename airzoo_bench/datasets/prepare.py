"""From scenes as their files state them to a benchmark folder, for every dataset.

Each scene is a task, and is kept until all are finished: a run that was stopped goes on where it
was. `prepared.json` in a benchmark folder says what each scene was made from, so that a scene whose
files did not change is not made again.
"""

from __future__ import annotations

import errno
import json
import os
import re
import shutil
import socket
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, fields, replace
from functools import partial
from pathlib import Path
from typing import Any

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.benchmark.manifest import SceneFile
from airzoo_bench.core.errors import (
    BenchmarkError,
    RasterError,
    UsageError,
    UserError,
    agreeing,
    counted,
)
from airzoo_bench.core.files import (
    atomic_folder,
    cannot_write,
    fingerprint,
    only_run,
    temporary_folder,
)
from airzoo_bench.core.progress import Progress, shown
from airzoo_bench.core.validation import nearest
from airzoo_bench.core.version import __version__
from airzoo_bench.datasets.content import image_content, scene_content
from airzoo_bench.datasets.facts import SceneFacts
from airzoo_bench.datasets.folder import (
    served_protocols,
    summary_of,
    write_folder_files,
    write_scene,
)
from airzoo_bench.datasets.scenes import ImageScene, NativeScene
from airzoo_bench.datasets.settings import Prepared, PrepareSettings, SceneSummary, TrackSummary
from airzoo_bench.datasets.truths import BenchmarkProtocols
from airzoo_bench.evaluation.truth_accuracy import accuracy_notes
from airzoo_bench.geometry.raster_files import raster_files
from airzoo_bench.protocol.model import Protocol

__all__ = ["Source", "check_target", "chosen_scenes", "is_prepared", "prepare_scenes"]

RECORDS = "prepared.json"
_PARTS = ("scenes", "data")
_FILES = ("images", "dom", "dsm", "gallery", "maps", "cloud")
_MAPS = (".vrt", ".tif", ".tiff", ".png", ".jpg", ".jpeg", ".jp2", ".img", ".ecw", ".asc", ".bil")
_PACKED = (".zip", ".7z", ".rar", ".tar", ".tgz", ".gz", ".part", ".crdownload", ".aria2")
_OF_WRITING = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EFBIG)
# Options that do not change a scene.
_OF_THE_RUN = ("scene", "keep_going")
_WAY_OUT = "leave the scene out with --keep-going, or name those to make with --scene"


@dataclass(frozen=True)
class Source:
    """Scenes that are to be prepared, in this process or on a worker.

    `read` takes the options, a scene's id and a `Progress`; relative paths are seen from `home`.
    """

    scenes: Mapping[str, Sequence[Path]]
    read: Callable[[Any, str, Progress], NativeScene | ImageScene]
    options: Any
    home: Path = field(default_factory=Path.cwd)

    @property
    def option_texts(self) -> dict[str, str]:
        """The options that a scene depends on, as text, by the names of their fields."""
        names = [one.name for one in fields(self.options) if one.name not in _OF_THE_RUN]
        return {name: str(getattr(self.options, name)) for name in names}

    def native(self, scene: str, progress: Progress) -> NativeScene | ImageScene:
        """Read a scene; a worker may have another working folder."""
        options = self.options
        if Path.cwd() != self.home:
            values = {one.name: getattr(options, one.name) for one in fields(options)}
            seen = {name: self._absolute(value) for name, value in values.items()}
            options = replace(options, **seen)
        return self.read(options, scene, progress)

    def _absolute(self, value: Any) -> Any:
        """Return paths as absolute ones, also those in lists of SCENE=FILE."""
        if isinstance(value, Path):
            return self.home / value
        if isinstance(value, list):
            pairs = [(one, *str(one).partition("=")) for one in value]
            return [
                f"{name}={self.home / file}" if file and (self.home / file).exists() else one
                for one, name, _, file in pairs
            ]
        return value


@dataclass(frozen=True)
class Part:
    """A finished scene: its entry of benchmark.toml, and what `prepare` prints of it.

    `home` holds it as a benchmark folder does; `key` is of what it was made from (`scene_keys`).
    """

    home: Path
    key: str
    entry: SceneFile
    summary: SceneSummary
    options: Mapping[str, str]

    @property
    def is_whole(self) -> bool:
        """Whether the scene and all that it refers to is there, such as a map made of its tiles."""
        named = [f"scenes/{self.entry.id}", *(getattr(self.entry, name) for name in _FILES)]
        return all((self.home / path).exists() for path in named if path is not None)

    def add_to(self, folder: Path, copy: Callable[[str, str], object]) -> None:
        """Put the scene's files into a benchmark folder."""
        for part in _PARTS:
            source, target = (home / part / self.entry.id for home in (self.home, folder))
            if source.is_dir():
                shutil.copytree(source, target, copy_function=copy, dirs_exist_ok=True)

    def keep(self, staging: Path, copy: Callable[[str, str], object]) -> Part:
        """Put the scene into the folder of finished scenes."""
        home = staging / self.entry.id
        with temporary_folder(staging, self.entry.id) as temporary:
            self.add_to(temporary, copy)
            write_records(temporary, [self])
            shutil.rmtree(home, ignore_errors=True)
            temporary.replace(home)
        return replace(self, home=home)


def write_records(folder: Path, parts: Iterable[Part]) -> None:
    """Write what scenes were made from."""
    records = {
        part.entry.id: {
            "key": part.key,
            "entry": part.entry.model_dump(mode="json", exclude_none=True),
            "summary": asdict(part.summary),
            "options": dict(part.options),
        }
        for part in parts
    }
    text = json.dumps(records, indent=1, ensure_ascii=False)
    (folder / RECORDS).write_text(text + "\n", encoding="utf-8")


def read_parts(folder: Path) -> dict[str, Part]:
    """Return the scenes that a folder's records are of; none where they cannot be read."""
    try:
        records = json.loads((folder / RECORDS).read_text(encoding="utf-8"))
        return {scene: _part(folder, record) for scene, record in records.items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return {}  # of another version, or damaged: the scenes are made again


def _part(folder: Path, record: Mapping[str, Any]) -> Part:
    values = dict(record["summary"])
    tracks = {name: TrackSummary(**one) for name, one in values["tracks"].items()}
    texts = {key: tuple(values[key]) for key in ("facts", "warnings", "notes")}
    summary = SceneSummary(values["photos"], tracks=tracks, **texts)
    return Part(folder, record["key"], SceneFile(**record["entry"]), summary, record["options"])


def scene_keys(
    source: Source, protocols: BenchmarkProtocols, settings: PrepareSettings
) -> dict[str, str]:
    """Return for each scene the SHA-256 of what it depends on."""
    stamps: dict[Path, list[tuple[str, int, int]]] = {}
    flags = [settings.tiles_on_disk, settings.crops_on_disk, settings.copy]
    keys = {}
    for scene, given in source.scenes.items():
        paths = sorted({path.resolve() for path in given})
        for path in paths:
            if path not in stamps:
                stamps[path] = sorted(_stamps(path, settings.folder))
        of_scene = protocols.of_scene(scene).of_scenes([scene]).every
        rules = [
            [of.track, of.truth_settings(), of.scenes[0].title, of.scenes[0].queries]
            for of in of_scene
        ]
        files = [[str(path), stamps[path]] for path in paths]
        keys[scene] = fingerprint([__version__, source.option_texts, flags, scene, rules, files])
    return keys


def _stamps(path: Path, target: Path) -> Iterator[tuple[str, int, int]]:
    """Yield name, size and time of change of a file, or of every file below a folder."""
    if not path.is_dir():
        for file in _files_of(path):
            found = file.stat()
            yield "" if file == path else str(file), found.st_size, found.st_mtime_ns
        return
    made = target.resolve()
    for home, folders, files in os.walk(path, followlinks=True):
        place = Path(home)
        folders[:] = [
            one for one in folders if one[0] != "." and (place / one) not in (made, path.parent)
        ]
        for file in (place / name for name in files):
            if file.exists():
                found = file.stat()
                yield file.relative_to(path).as_posix(), found.st_size, found.st_mtime_ns


def _files_of(path: Path) -> list[Path]:
    """Return a file, and those that a map has next to it or is made of."""
    if path.suffix.lower() in _MAPS and path.is_file():
        try:
            return raster_files(path)
        except RasterError:  # no raster, which whoever reads it will say
            pass
    return [path] if path.exists() else []


def chosen_scenes(
    there: Mapping[str, Sequence[Path]], only: Sequence[str] | None, source: Path
) -> dict[str, Sequence[Path]]:
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
    return {scene: files for scene, files in there.items() if only is None or scene in only}


def _unpack(scenes: Sequence[str], source: Path) -> str | None:
    """Say which archives or unfinished downloads are named as scenes that are not there."""
    files = sorted(path.name for path in source.iterdir()) if source.is_dir() else ()
    packed = [
        name
        for name in files
        if name.lower().endswith(_PACKED)
        and any(re.search(rf"(?<!\w){re.escape(scene)}(?!\w)", name) for scene in scenes)
    ]
    return f"finish or unpack {', '.join(packed[:3])}" if packed else None


def check_target(sources: Iterable[Path], folder: Path) -> None:
    """Refuse to make a folder that holds the sources."""
    for source in sources:
        if folder.resolve() in (source.resolve(), *source.resolve().parents):
            raise UsageError(
                f"the folder to make holds {source}, which it is made from",
                where=folder,
                fix="name another --out",
            )


def is_prepared(source: Source, protocols: BenchmarkProtocols, settings: PrepareSettings) -> bool:
    """Whether the folder is there, complete, and made from files that did not change since."""
    if not (settings.folder / RECORDS).is_file():
        return False
    parts = read_parts(settings.folder)
    if parts and {s: part.key for s, part in parts.items()} != scene_keys(
        source, protocols, settings
    ):
        raise UsageError(
            f"the folder exists already, made {_difference(parts, source)}",
            where=settings.folder,
            fix="name another folder with --out, or replace this one with --force",
        )
    if not parts or not all(part.is_whole for part in parts.values()):
        return False
    Benchmark.open(settings.folder)
    return True


def _difference(parts: Mapping[str, Part], source: Source) -> str:
    """Say which scenes and options a folder was made with, where they are others now."""
    now, before = source.option_texts, next(iter(parts.values())).options
    said = [
        f"--{name.replace('_', '-')} {before[name]}, now {now[name]}"
        for name in now
        if before.get(name, now[name]) != now[name]
    ]
    if set(parts) != set(source.scenes):
        said.append(f"scenes {', '.join(parts)}, now {', '.join(source.scenes)}")
    if said:
        return f"with {'; '.join(said)}"
    return "from files that have changed since, or by another version of this suite"


def prepare_scenes(
    source: Source, protocols: BenchmarkProtocols, settings: PrepareSettings
) -> Prepared:
    """Make the benchmark folder of some scenes."""
    run = _Run(source, protocols, settings)
    # Runs into other folders share the finished scenes, by the benchmark's name.
    what, otherwise = (
        "another run is making this benchmark here",
        "name a folder elsewhere with --out",
    )
    with _writing(settings.folder), only_run(run.staging, what, settings.folder.parent, otherwise):
        try:
            run.finish()
            return run.assemble()
        finally:
            run.clear()


@dataclass
class _Run:
    """Scenes that are being finished."""

    source: Source
    protocols: BenchmarkProtocols
    settings: PrepareSettings
    keys: dict[str, str] = field(default_factory=dict)
    parts: dict[str, Part] = field(default_factory=dict)
    facts: dict[str, SceneFacts] = field(default_factory=dict)
    failed: dict[str, str] = field(default_factory=dict)
    made: bool = False

    @property
    def staging(self) -> Path:
        """Where finished scenes are kept until all are."""
        return self.settings.folder.absolute().parent / f".{self.protocols.benchmark}.prepare"

    @property
    def kept(self) -> list[str]:
        """The scenes that the next run can take as they are."""
        found = {scene: read_parts(self.staging / scene).get(scene) for scene in self.keys}
        return [scene for scene, part in found.items() if part and part.key == self.keys[scene]]

    def clear(self) -> None:
        """Remove the finished scenes, unless another run can go on from them."""
        if self.made or len(self.source.scenes) == 1 or not self.kept:
            shutil.rmtree(self.staging, ignore_errors=True)

    def finish(self) -> None:
        """Finish the scenes, or say which of them are kept."""
        progress = self.settings.progress
        keys = partial(scene_keys, self.source, self.protocols, self.settings)
        self.keys = shown(keys, "looking through the source", progress)
        self.staging.mkdir(parents=True, exist_ok=True)
        try:
            shown(self._take, "looking through earlier runs", progress)
            self._make([scene for scene in self.source.scenes if scene not in self.parts])
        except (UserError, KeyboardInterrupt):
            kept = len(self.kept)
            if kept and len(self.source.scenes) > 1:
                self.settings.note(
                    f"{counted(kept, 'finished scene')} of {len(self.source.scenes)} "
                    f"{agreeing(kept, 'is', 'are')} kept in {self.staging}; the same command goes "
                    "on from there"
                )
            raise
        if not self.parts:
            raise BenchmarkError(
                "no scene could be made:\n" + "\n".join(self.failed.values()),
                where=self.settings.folder,
            )
        # As they come in the protocols, whichever were there before.
        ordered = (scene for scene in self.source.scenes if scene in self.parts)
        self.parts = {scene: self.parts[scene] for scene in ordered}

    def _take(self) -> None:
        """Take the scenes that nothing has changed for since they were finished."""
        places = [self.staging / scene for scene in self.source.scenes]
        if not self.settings.replace:
            folder, name = self.settings.folder, self.protocols.benchmark
            places += [folder, folder.with_name(name), folder.with_name(f"{name}-partial")]
        parts = [part for place in places for part in _unchanged_parts(place)]
        found = {part.key: part for part in parts}
        for scene, key in self.keys.items():
            if key in found:
                self.settings.note(
                    f"scene {scene}: nothing changed since it was made, taken as it is"
                )
                part, home = found[key], self.staging / scene
                kept = part if part.home == home else part.keep(self.staging, shutil.copyfile)
                self.parts[scene] = kept

    def _make(self, scenes: Sequence[str]) -> None:
        """Make scenes, each a task."""
        engine, progress = self.settings.engine, self.settings.progress
        found = engine.map(_task, scenes, shared=self, stage="scenes", name=_scene_name)
        label = f"scene {scenes[0]}" if len(scenes) == 1 else "scenes"
        for scene, made in zip(scenes, progress(found, label, len(scenes)), strict=True):
            if isinstance(made, UserError):
                self.failed[scene] = str(made)
                continue
            self.parts[scene], facts = made
            if not self.parts[scene].is_whole:
                raise _unseen("this machine does not see what a worker made", f"scene {scene}")
            if facts is not None:
                self.facts[scene] = facts

    def assemble(self) -> Prepared:
        """Make the folder of the scenes that were finished."""
        settings, parts = self.settings, self.parts
        made = self.protocols.of_scenes(parts)
        folder = settings.folder
        if made is not self.protocols:
            settings.note(self._only_some(made))
            if folder.name == self.protocols.benchmark:
                folder = folder.with_name(made.benchmark)
        tracks = {scene: tuple(part.summary.tracks) for scene, part in parts.items()}
        served = served_protocols(made, tracks, folder)
        with atomic_folder(folder, replace=settings.replace) as staged:
            put = partial(self._put_together, staged, served)
            shown(put, "writing the folder", settings.progress)
        self.made = True
        accuracy = {scene: part.entry.truth_accuracy_m for scene, part in parts.items()}
        for protocol in served:
            for sentence in accuracy_notes(protocol, accuracy):
                settings.note(f"warning: {sentence}")
        return Prepared(
            folder,
            {protocol.name: protocol.track for protocol in served},
            {scene: part.summary for scene, part in parts.items()},
            self.facts,
            self.failed,
        )

    def _put_together(self, folder: Path, served: Sequence[Protocol]) -> None:
        parts = self.parts.values()
        for part in parts:
            part.add_to(folder, _link_or_copy)
        write_records(folder, parts)
        write_folder_files(folder, served, [part.entry for part in parts])

    def _only_some(self, made: BenchmarkProtocols) -> str:
        left_out = [scene for scene in self.protocols.titles if scene not in made.titles]
        options = self.source.options
        asked, place = getattr(options, "scene", None), getattr(options, "source", None)
        packed = None if asked or place is None else _unpack(left_out, place)
        return (
            f"warning: {len(made.titles)} of {counted(len(self.protocols.titles), 'scene')}, "
            f"without {', '.join(left_out)}: the benchmark is named {made.benchmark}, and its "
            f"scores are not those of the whole{f'; {packed}' if packed else ''}"
        )


@contextmanager
def _writing(folder: Path) -> Iterator[None]:
    """Name the folder where the disk takes no more."""
    try:
        yield
    except OSError as error:
        if error.errno not in _OF_WRITING:  # it is a file that is read
            raise
        raise cannot_write(folder, error) from None


def _scene_name(scene: str) -> str:
    return f"scene {scene}"


def _task(run: _Run, scene: str) -> tuple[Part, SceneFacts | None] | UserError:
    """Make a scene and keep it among the finished ones."""
    hidden = [path for path in (run.staging, *run.source.scenes[scene]) if not path.exists()]
    if hidden and hidden[0].is_absolute():
        raise _unseen(f"a worker on {socket.gethostname()} does not see this", hidden[0])
    try:
        with _writing(run.settings.folder):
            return _made(run, scene)
    except UserError as fault:
        if getattr(run.source.options, "keep_going", False):
            return fault
        if len(run.source.scenes) > 1:
            fault.fix = f"{fault.fix}; or {_WAY_OUT}" if fault.fix else _WAY_OUT
        raise


def _made(run: _Run, scene: str) -> tuple[Part, SceneFacts | None]:
    source, protocols = run.source, run.protocols
    native = source.native(scene, run.settings.progress)
    content = (
        image_content(native, protocols)
        if isinstance(native, ImageScene)
        else scene_content(native, protocols)
    )
    summary = summary_of(content, protocols, native.notes)
    with temporary_folder(run.staging, scene) as temporary:
        entry = write_scene(temporary, content, protocols.titles[scene], run.settings)
        part = Part(temporary, run.keys[scene], entry, summary, source.option_texts)
        return part.keep(run.staging, _link_or_copy), content.facts


def _unseen(what: str, where: object) -> UserError:
    return UserError(
        what,
        where=where,
        expected="source, data root and the folder to make on a file system that this machine and "
        "all workers see, under the same paths",
        fix="put them there, or leave out --scheduler",
    )


def _unchanged_parts(place: Path) -> list[Part]:
    """Return the scenes of a place, none where one of its files was changed."""
    if (place / "benchmark.toml").is_file():
        try:
            Benchmark.open(place)
        except BenchmarkError:
            return []
    return list(read_parts(place).values())


def _link_or_copy(source: str, target: str) -> None:
    """Give a file a second name, on disks that know such, else copy it."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copyfile(source, target)
