"""Finished scenes on disk: what they were made from, and whether that is as it was.

A benchmark folder is made of parts, one a scene, and `prepared.json` in it says what each was made
from. While `prepare` runs, parts stand in a hidden folder next to the one that they become.
"""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from airzoo_bench import __version__
from airzoo_bench.benchmark.manifest import SceneFile
from airzoo_bench.core.errors import RasterError
from airzoo_bench.core.files import fingerprint, temporary_folder
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.dataset import PrepareSettings, SceneSummary, TrackSummary
from airzoo_bench.datasets.truths import BenchmarkProtocols
from airzoo_bench.geometry.raster_files import raster_files

__all__ = [
    "RECORDS",
    "ScenePart",
    "SceneSource",
    "changed_options",
    "is_kept",
    "link_or_copy",
    "needed_files",
    "options_of",
    "read_parts",
    "scene_keys",
    "write_records",
]

RECORDS = "prepared.json"
_PARTS = ("scenes", "data")
_FILES = ("images", "dom", "dsm", "gallery", "maps", "cloud")
_MAPS = (".vrt", ".tif", ".tiff", ".png", ".jpg", ".jpeg", ".jp2", ".img", ".ecw", ".asc", ".bil")
_NUMBER = re.compile(r"[-+.\deE]*")
# Options that do not change a scene.
_OF_THE_RUN = ("scene", "keep_going")


@dataclass(frozen=True)
class SceneSource:
    """Scenes that are to be prepared, wherever that is done: it can be pickled.

    Attributes
    ----------
    scenes : tuple of str
    read : callable
        Takes options, a scene's id and a `Progress`, returns what the scene's files state.
    files : callable
        Takes a scene's id, returns the files and folders that it is read from.
    options : object
        The dataset's options, a dataclass.
    keep_going : bool
        Leave out scenes that cannot be read.
    home : Path
        The folder that relative paths are seen from.
    """

    scenes: tuple[str, ...]
    read: Callable[[Any, str, Progress], Any]
    files: Callable[[str], Iterable[Path]]
    options: Any
    keep_going: bool = False
    home: Path = field(default_factory=Path.cwd)

    def native(self, scene: str, progress: Progress) -> Any:
        """Read a scene; this process may be another's than the source's, and work elsewhere."""
        if Path.cwd() == self.home:
            return self.read(self.options, scene, progress)
        values = {one.name: getattr(self.options, one.name) for one in fields(self.options)}
        seen = {name: self._seen(value) for name, value in values.items()}
        return self.read(replace(self.options, **seen), scene, progress)

    def _seen(self, value: Any) -> Any:
        """Return paths as absolute ones, also those in lists of NAME=FILE."""
        if isinstance(value, Path):
            return self.home / value
        if isinstance(value, list):
            return [self._seen_file(one) for one in value]
        return value

    def _seen_file(self, given: Any) -> Any:
        name, _, file = given.partition("=") if isinstance(given, str) else ("", "", "")
        is_there = not _NUMBER.fullmatch(file) and (self.home / file).exists()
        return f"{name}={self.home / file}" if is_there else given


@dataclass(frozen=True)
class ScenePart:
    """A finished scene: what a folder's benchmark.toml says of it, and what `prepare` prints.

    Attributes
    ----------
    home : Path
        The folder that holds it, as a benchmark folder does: ``scenes/ID``, perhaps ``data/ID``.
    key : str
        Of what it was made from, see `scene_keys`.
    entry : SceneFile
    summary : SceneSummary
        Its tracks are those that have truth.
    options : mapping of str to str
        Those of `prepare` that it was made with.
    """

    home: Path
    key: str
    entry: SceneFile
    summary: SceneSummary
    options: Mapping[str, str] = field(default_factory=dict)

    @property
    def is_whole(self) -> bool:
        """Whether the scene and all that it refers to is there, such as a map made of its tiles."""
        named = [f"scenes/{self.entry.id}", *(getattr(self.entry, name) for name in _FILES)]
        return all((self.home / path).exists() for path in named if path is not None)

    def add_to(self, folder: Path, copy: Callable[[str, str], object]) -> None:
        """Put the scene's files into a benchmark folder."""
        for part in _PARTS:
            source = self.home / part / self.entry.id
            if source.is_dir():
                target = folder / part / self.entry.id
                shutil.copytree(source, target, copy_function=copy, dirs_exist_ok=True)

    def keep(self, staging: Path, copy: Callable[[str, str], object]) -> ScenePart:
        """Put the scene into the folder of finished scenes, unless it was finished there before."""
        home = staging / self.entry.id
        with temporary_folder(staging, self.entry.id) as temporary:
            self.add_to(temporary, copy)
            write_records(temporary, [self])
            if not is_kept(home, self.key):  # a task may be done twice
                shutil.rmtree(home, ignore_errors=True)
                temporary.replace(home)
        return replace(self, home=home)


def link_or_copy(source: str, target: str) -> None:
    """Give a file a second name, on disks that know such, else copy it."""
    try:
        os.link(source, target)
    except OSError:
        shutil.copyfile(source, target)


def write_records(folder: Path, parts: Iterable[ScenePart]) -> None:
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


def read_parts(folder: Path) -> dict[str, ScenePart]:
    """Return the scenes that a folder's records are of; none where they cannot be read."""
    try:
        records = json.loads((folder / RECORDS).read_text(encoding="utf-8"))
        return {scene: _part(folder, record) for scene, record in records.items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return {}  # of another version, or damaged: the scenes are made again


def is_kept(home: Path, key: str) -> bool:
    """Whether a folder holds the finished scene of a key."""
    return any(part.key == key for part in read_parts(home).values())


def _part(folder: Path, record: Mapping[str, Any]) -> ScenePart:
    values = dict(record["summary"])
    tracks = {name: TrackSummary(**one) for name, one in values["tracks"].items()}
    texts = {key: tuple(values[key]) for key in ("facts", "warnings", "notes")}
    summary = SceneSummary(values["photos"], tracks=tracks, **texts)
    entry, options = SceneFile(**record["entry"]), dict(record["options"])
    return ScenePart(folder, record["key"], entry, summary, options)


def scene_keys(
    source: SceneSource, protocols: BenchmarkProtocols, settings: PrepareSettings
) -> dict[str, str]:
    """Return for each scene the SHA-256 of what its part depends on."""
    stamps: dict[Path, list[tuple[str, int, int]]] = {}
    common = [
        __version__,
        options_of(source),
        [settings.tiles_on_disk, settings.crops_on_disk, settings.copy],
    ]
    keys = {}
    for scene in source.scenes:
        paths = needed_files(source, scene)
        for path in paths:
            if path not in stamps:
                stamps[path] = sorted(_stamps(path, settings.folder))
        of_scene = protocols.of_scene(scene).of_scenes([scene])
        rules = [[of.track, of.truth_settings(), _published(of, scene)] for of in of_scene.every]
        files = [[str(path), stamps[path]] for path in paths]
        keys[scene] = fingerprint([*common, scene, rules, files])
    return keys


def needed_files(source: SceneSource, scene: str) -> list[Path]:
    """Return the absolute paths of the files and folders that a scene is read from."""
    return sorted({path.resolve() for path in source.files(scene)})


def options_of(source: SceneSource) -> dict[str, str]:
    """Return the options that a scene depends on, as text, by the names of their fields."""
    values = {one.name: getattr(source.options, one.name) for one in fields(source.options)}
    return {name: str(value) for name, value in values.items() if name not in _OF_THE_RUN}


def changed_options(parts: Mapping[str, ScenePart], source: SceneSource) -> list[str]:
    """Say which scenes and options parts were made with, where they are others now."""
    said = []
    if set(parts) != set(source.scenes):
        said.append(f"scenes {', '.join(parts)}, now {', '.join(source.scenes)}")
    now, before = options_of(source), next(iter(parts.values())).options
    said += [
        f"{_given(name, before[name])}, now {_given(name, now[name])}"
        for name in now
        if name in before and before[name] != now[name]
    ]
    return said


def _given(name: str, value: str) -> str:
    option = f"--{name.replace('_', '-')}"
    return f"without {option}" if value == "None" else f"{option} {value}"


def _published(protocol: Any, scene: str) -> list[Any]:
    return [[one.title, one.queries] for one in protocol.scenes if one.id == scene]


def _files_of(path: Path) -> list[Path]:
    """Return a file, and those that a map has next to it or is made of."""
    if path.suffix.lower() not in _MAPS or not path.is_file():
        return [path] if path.exists() else []
    try:
        return raster_files(path)
    except RasterError:  # no raster, which whoever reads it will say
        return [path]


def _stamps(path: Path, target: Path) -> Iterator[tuple[str, int, int]]:
    """Yield name, size and time of change of a file, or of every file below a folder."""
    if not path.is_dir():
        for file in _files_of(path):
            found = file.stat()
            name = "" if file == path else str(file)
            yield name, found.st_size, found.st_mtime_ns
        return
    made = target.resolve()
    for home, folders, files in os.walk(path, followlinks=True):
        place = Path(home)
        folders[:] = [
            one for one in folders if one[0] != "." and (place / one) not in (made, path.parent)
        ]
        for name in files:
            file = place / name
            if file.exists():
                found = file.stat()
                yield file.relative_to(path).as_posix(), found.st_size, found.st_mtime_ns
