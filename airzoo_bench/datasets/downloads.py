"""Fetching a published benchmark: what is lacking, room for it, and files that are verified."""

from __future__ import annotations

import errno
import hashlib
import json
import shutil
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, Protocol

from airzoo_bench.core.errors import BenchmarkError, UsageError, first_of
from airzoo_bench.core.files import atomic_write
from airzoo_bench.core.progress import Progress
from airzoo_bench.datasets.hub import HubFile

__all__ = ["Plan", "download", "of_scenes", "planned"]

_HOME = ".airzoo-bench"
_LIST = "verified.json"
_BLOCK = 1 << 20
_SHA256 = 64  # hexadecimal digits; SHA-1 has 40


class Source(Protocol):
    """Where files are fetched from, such as `hub.HubDataset`."""

    def fetch(self, file: HubFile, part: Path) -> None:
        """Fetch a file's bytes behind those that `part` has already."""


@dataclass(frozen=True)
class Plan:
    """What a download has to do.

    Attributes
    ----------
    folder : Path
    files : tuple of HubFile
        All that are wanted.
    lacking : tuple of HubFile
        Of these, those to fetch.
    needed, free : int
        Bytes: still to fetch, and room on the disk.
    """

    folder: Path
    files: tuple[HubFile, ...]
    lacking: tuple[HubFile, ...]
    needed: int
    free: int


def of_scenes(
    files: Sequence[HubFile], patterns: Mapping[str, Sequence[str]], scenes: Sequence[str]
) -> list[HubFile]:
    """Return the files of some scenes, and those that belong to none."""
    others = [one for scene, of in patterns.items() if scene not in scenes for one in of]
    wanted = [one for scene in scenes for one in patterns[scene]]
    for scene in scenes:
        if not any(fnmatchcase(file.path, one) for file in files for one in patterns[scene]):
            raise UsageError(
                f"no file of scene {scene} is listed",
                where="--scene",
                expected=" or ".join(patterns[scene]),
                fix="leave --scene out to fetch all, and name scenes at `prepare`",
            )
    return [
        file
        for file in files
        if any(fnmatchcase(file.path, one) for one in wanted)
        or not any(fnmatchcase(file.path, one) for one in others)
    ]


def planned(folder: Path, files: Sequence[HubFile], progress: Progress) -> Plan:
    """Look which files are there already, and how much room the others need."""
    record = _read_record(folder)
    lacking: list[HubFile] = []
    strange: list[HubFile] = []
    for file in progress(files, "files", len(files)):
        target = folder / file.path
        if not target.is_file():
            lacking.append(file)
        elif not _is_verified(target, file, record):
            ours = record.get(file.path, {}).get("digest")
            (lacking if ours and _digest(target, ours) == ours else strange).append(file)
    if strange:
        raise BenchmarkError(
            "files of these names are there, and are not those that are published: "
            f"{first_of([repr(file.path) for file in strange], len(files))}",
            where=folder,
            fix="remove them, or name another folder with --to",
        )
    _write_record(folder, record)
    needed = sum(file.size - _size(_part(folder, file)) for file in lacking)
    return Plan(folder, tuple(files), tuple(lacking), needed, shutil.disk_usage(_near(folder)).free)


def download(plan: Plan, source: Source, progress: Progress) -> None:
    """Fetch the lacking files; each appears when it is whole and verified."""
    record = _read_record(plan.folder)
    for file in progress(plan.lacking, "files", len(plan.lacking)):
        part = _part(plan.folder, file)
        try:
            part.parent.mkdir(parents=True, exist_ok=True)
            _fetch_verified(file, part, source, plan.folder)
        except OSError as error:
            if error.errno not in (errno.ENOSPC, errno.EDQUOT):
                raise
            raise UsageError(
                "the disk is full",
                where=plan.folder,
                fix="make room and run this again: what is there is kept",
            ) from error
        target = plan.folder / file.path
        target.parent.mkdir(parents=True, exist_ok=True)
        part.replace(target)
        record[file.path] = _entry(target, file)
        _write_record(plan.folder, record)


def _fetch_verified(file: HubFile, part: Path, source: Source, folder: Path) -> None:
    """Fetch a file; what was begun and turns out wrong is fetched once more from the start."""
    for begun in (_size(part) > 0, False):
        if _size(part) > file.size:
            part.unlink()
        if _size(part) < file.size or not part.exists():
            source.fetch(file, part)
        if _size(part) == file.size and _digest(part, file.digest) == file.digest:
            return
        part.unlink(missing_ok=True)
        if not begun:
            break
    raise BenchmarkError(
        f"{file.path} is damaged: what came is not what the dataset's list says",
        where=folder,
        expected=f"{file.size} bytes with the checksum {file.digest}",
        fix="run this again; where it stays so, tell the owners of the dataset",
    )


def _is_verified(target: Path, file: HubFile, record: dict[str, Any]) -> bool:
    """Whether a file is the published one: it stands as recorded, or its bytes are the same."""
    if record.get(file.path) == _entry(target, file):
        return True
    if _size(target) != file.size or _digest(target, file.digest) != file.digest:
        return False
    record[file.path] = _entry(target, file)
    return True


def _entry(target: Path, file: HubFile) -> dict[str, Any]:
    status = target.stat()
    return {"digest": file.digest, "size": status.st_size, "modified_ns": status.st_mtime_ns}


def _part(folder: Path, file: HubFile) -> Path:
    return folder / _HOME / f"{file.digest}.part"


def _size(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0


def _digest(path: Path, like: str) -> str:
    """Return the checksum of the kind that another one is of."""
    if len(like) == _SHA256:
        digest = hashlib.sha256()
    else:
        digest = hashlib.sha1(b"blob %d\0" % _size(path), usedforsecurity=False)
    with path.open("rb") as file:
        while block := file.read(_BLOCK):
            digest.update(block)
    return digest.hexdigest()


def _near(folder: Path) -> Path:
    """Return the folder, or the nearest above it that is there."""
    return next(place for place in (folder, *folder.resolve().parents) if place.exists())


def _read_record(folder: Path) -> dict[str, Any]:
    path = folder / _HOME / _LIST
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, ValueError):  # then files are verified by their bytes
        return {}
    return dict(_entries(found))


def _entries(found: Any) -> Iterator[tuple[str, dict[str, Any]]]:
    for path, entry in found.items() if isinstance(found, dict) else ():
        if isinstance(entry, dict) and isinstance(entry.get("digest"), str):
            yield path, entry


def _write_record(folder: Path, record: dict[str, Any]) -> None:
    if record:
        (folder / _HOME).mkdir(parents=True, exist_ok=True)
        with atomic_write(folder / _HOME / _LIST, "w") as file:
            json.dump(record, file, indent=1, sort_keys=True)
