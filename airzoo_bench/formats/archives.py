"""Folders and archives as one thing: files by name, each as a file on disk when it is used."""

from __future__ import annotations

import lzma
import shutil
import stat
import tarfile
import tempfile
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from airzoo_bench.core.errors import PredictionError, UnreadableError
from airzoo_bench.core.files import temporary_folder

ARCHIVE_SUFFIXES = (".zip", ".tar", ".tar.gz", ".tgz", ".tar.xz", ".tar.bz2")
_MOST_FILES = 10_000
_DAMAGE = (
    *(EOFError, LookupError, NotImplementedError, OSError, OverflowError, RuntimeError, ValueError),
    *(lzma.LZMAError, tarfile.TarError, zipfile.BadZipFile, zlib.error),
)


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
            target = folder / PurePosixPath(member.name).name
            if shutil.disk_usage(folder).free < member.size:
                raise PredictionError(
                    f"no room on disk to unpack {member.name!r} of {member.size:,} bytes",
                    where=self.path,
                    fix="set TMPDIR to a folder on a larger disk",
                )
            try:
                self._unpack(member, target)
            except _DAMAGE as error:
                raise PredictionError(
                    f"{member.name!r} cannot be unpacked: {str(error)[:100]}",
                    where=self.path,
                    fix="write or copy the archive again",
                ) from error
            yield target

    def text(self, member: Member, limit_bytes: int) -> str:
        """Return the first bytes of a member as text."""
        with self.file(member) as path:
            return path.read_bytes()[:limit_bytes].decode("utf-8", "replace")

    def _unpack(self, member: Member, target: Path) -> None:
        with target.open("wb") as out:
            if _is_zip(self.path):
                with zipfile.ZipFile(self.path) as archive, archive.open(member.name) as source:
                    shutil.copyfileobj(source, out)
                return
            with tarfile.open(self.path) as tape:
                for info in tape:
                    found = tape.extractfile(info) if info.isreg() else None
                    if found is not None and info.name.removeprefix("./") == member.name:
                        shutil.copyfileobj(found, out)
                        return


def open_bundle(path: Path, limit_bytes: int) -> Bundle:
    """List the files of a folder, a zip or a tar archive, without unpacking any."""
    packed = path.is_file() and (_is_zip(path) or path.name.endswith(ARCHIVE_SUFFIXES))
    if not path.is_dir() and not packed:
        raise UnreadableError(
            "no folder and no archive of predictions" if path.exists() else "no such predictions",
            where=path,
            expected=f"a folder, or an archive {', '.join(ARCHIVE_SUFFIXES)}",
        )
    try:
        if path.is_dir():
            members = _folder_members(path)
        elif _is_zip(path):
            members = _zip_members(path)
        else:
            members = _tar_members(path, limit_bytes)
        _check_names(path, members)
        total = sum(member.size for member in members)
        if total > limit_bytes and packed:
            raise ValueError(f"unpacks to {total:,} bytes, more than {limit_bytes:,}")
    except _DAMAGE as error:
        raise UnreadableError(
            str(error)[:200] or "is damaged",
            where=path,
            expected="plain files only, such as school.ply, each name once",
            fix="pack or copy the files again, or give the folder",
        ) from error
    visible = [member for member in members if not _is_hidden(member.name)]
    return Bundle(path, tuple(sorted(visible, key=lambda member: member.name)))


def _is_hidden(name: str) -> bool:
    return any(part.startswith((".", "__MACOSX")) for part in name.split("/"))


def _is_zip(path: Path) -> bool:
    # Not zipfile.is_zipfile, which also takes a tar archive with an npz at its end for a zip.
    with path.open("rb") as stream:
        return stream.read(4) in (b"PK\x03\x04", b"PK\x05\x06")


def _folder_members(path: Path) -> list[Member]:
    root, members = path.resolve(), []
    for one in path.rglob("*"):
        name = one.relative_to(path).as_posix()
        if one.is_symlink() and not one.resolve().is_relative_to(root):
            raise ValueError(f"{name[:80]!r} is a link that leads out of the folder")
        if one.is_file():
            members.append(Member(name, one.stat().st_size))
        elif not one.is_dir():
            raise ValueError(f"{name[:80]!r} is a pipe, a device or a link to nothing")
    return members


def _zip_members(path: Path) -> list[Member]:
    with zipfile.ZipFile(path) as archive:
        infos = [info for info in archive.infolist() if not info.is_dir()]
    for info in infos:
        if stat.S_IFMT(info.external_attr >> 16) not in (0, stat.S_IFREG):
            raise ValueError(f"{info.filename[:80]!r} is a link or a device")
    return [Member(info.filename, info.file_size) for info in infos]


def _tar_members(path: Path, limit_bytes: int) -> list[Member]:
    members, total = [], 0
    with tarfile.open(path) as archive:
        for info in archive:
            if not (info.isreg() or info.isdir()) or info.issparse():
                raise ValueError(f"{info.name[:80]!r} is a link or a device")
            if info.isreg():
                members.append(Member(info.name.removeprefix("./"), info.size))
                total += info.size
            if total > limit_bytes:  # before it is unpacked to find the next header
                break
    return members


def _check_names(path: Path, members: list[Member]) -> None:
    if len(members) > _MOST_FILES:
        raise ValueError(f"holds more than {_MOST_FILES:,} files")
    seen: set[str] = set()
    for name in (member.name for member in members):
        plain = name.isprintable() and not {"\\", ":"} & set(name)
        if not plain or {"", ".", ".."} & set(name.split("/")):
            raise ValueError(f"the name {name[:80]!r} leads out of it or is no plain path")
        if name.casefold() in seen:
            raise ValueError(f"{name[:80]!r} stands in it more than once")
        if not path.is_dir() and name.lower().endswith((*ARCHIVE_SUFFIXES, ".gz")):
            raise ValueError(f"{name[:80]!r} is an archive inside")
        seen.add(name.casefold())
