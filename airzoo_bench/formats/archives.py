"""Folders and zip archives as one thing: files by name, each as a file on disk when it is used."""

from __future__ import annotations

import shutil
import stat
import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from airzoo_bench.core.errors import UnreadableError, readable
from airzoo_bench.core.files import temporary_folder

ARCHIVE_SUFFIXES = (".zip",)
_MOST_FILES = 10_000


@dataclass(frozen=True)
class Member:
    """A file of a bundle: its name, ``/`` between folders, and its size in bytes."""

    name: str
    size: int


@dataclass(frozen=True)
class Bundle:
    """The files of a folder or an archive, in the order of their names."""

    path: Path
    members: tuple[Member, ...]

    @contextmanager
    def file(self, member: Member) -> Iterator[Path]:
        """Give a member as a file on disk, for as long as it is used."""
        if self.path.is_dir():
            yield self.path / member.name
            return
        with temporary_folder(Path(tempfile.gettempdir()), "airzoo-bench") as folder:
            target, what = folder / PurePosixPath(member.name).name, f"{member.name!r}"
            with (
                readable(self.path, f"{what} cannot be unpacked into {folder.parent}"),
                zipfile.ZipFile(self.path) as archive,
                target.open("wb") as out,
            ):
                shutil.copyfileobj(archive.open(member.name), out)
            yield target

    def text(self, member: Member, limit_bytes: int) -> str:
        """Return the first bytes of a member as text."""
        with self.file(member) as path:
            return path.read_bytes()[:limit_bytes].decode("utf-8", "replace")


def open_bundle(path: Path, limit_bytes: int) -> Bundle:
    """List the files of a folder or a zip archive, without unpacking any."""
    packed = path.is_file() and path.suffix.lower() in ARCHIVE_SUFFIXES
    if not path.is_dir() and not packed:
        raise UnreadableError(
            "no folder and no archive of predictions" if path.exists() else "no such predictions",
            where=path,
            expected="a folder, or a .zip archive",
            fix="unpack archives of other kinds, and name the folder",
        )
    what, expected = "cannot be read", "plain files only, such as school.ply, each name once"
    with readable(path, what, kind=UnreadableError, expected=expected):
        members = _zip_members(path) if packed else _folder_members(path)
        _check_names(members)
        total = sum(member.size for member in members)
        if total > limit_bytes and packed:
            raise ValueError(f"unpacks to {total:,} bytes, more than {limit_bytes:,}")
    hidden = (".", "__MACOSX")
    shown = (one for one in members if not any(p.startswith(hidden) for p in one.name.split("/")))
    return Bundle(path, tuple(sorted(shown, key=lambda member: member.name)))


def _folder_members(path: Path) -> list[Member]:
    root, members = path.resolve(), []
    for one in path.rglob("*"):
        name = one.relative_to(path).as_posix()
        outside = one.is_symlink() and not one.resolve().is_relative_to(root)
        if outside or not (one.is_file() or one.is_dir()):
            raise ValueError(f"{name[:80]!r} is a link out of the folder, a pipe or a device")
        if one.is_file():
            members.append(Member(name, one.stat().st_size))
    return members


def _zip_members(path: Path) -> list[Member]:
    with zipfile.ZipFile(path) as archive:
        infos = [info for info in archive.infolist() if not info.is_dir()]
    for info in infos:
        if stat.S_IFMT(info.external_attr >> 16) not in (0, stat.S_IFREG):
            raise ValueError(f"{info.filename[:80]!r} is a link or a device")
    return [Member(info.filename, info.file_size) for info in infos]


def _check_names(members: list[Member]) -> None:
    if len(members) > _MOST_FILES:
        raise ValueError(f"holds more than {_MOST_FILES:,} files")
    seen: set[str] = set()
    for name in (member.name for member in members):
        plain = name.isprintable() and not {"\\", ":"} & set(name)
        if not plain or {"", ".", ".."} & set(name.split("/")):
            raise ValueError(f"the name {name[:80]!r} leads out of it or is no plain path")
        if name.casefold() in seen:
            raise ValueError(f"{name[:80]!r} is there more than once")
        seen.add(name.casefold())
