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
from typing import IO

from airzoo_bench.core.errors import PredictionError, UnreadableError
from airzoo_bench.core.files import temporary_folder

__all__ = ["ARCHIVE_SUFFIXES", "Bundle", "Member", "open_bundle"]

ARCHIVE_SUFFIXES = (".zip", ".tar", ".tar.gz", ".tgz", ".tar.xz", ".tar.bz2")
_NESTED = (*ARCHIVE_SUFFIXES, ".gz", ".xz", ".bz2", ".7z", ".rar")
_MOST_FILES = 10_000
_LONGEST_NAME = 256
_CHUNK_BYTES = 1 << 20
_DAMAGE = (
    EOFError,
    NotImplementedError,
    OverflowError,
    RecursionError,
    RuntimeError,
    ValueError,
    lzma.LZMAError,
    tarfile.TarError,
    zipfile.BadZipFile,
    zlib.error,
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
                raise self._error(
                    f"no room on disk to unpack {member.name!r} of {member.size:,} bytes",
                    fix="set TMPDIR to a folder on a larger disk",
                )
            self._unpack(member, target)
            yield target

    def text(self, member: Member, limit_bytes: int) -> str:
        """Return a small member as text."""
        if member.size > limit_bytes:
            raise self._error(f"{member.name!r} has {member.size:,} bytes", fix="shorten it")
        with self.file(member) as path:
            try:
                return path.read_text(encoding="utf-8")
            except UnicodeDecodeError as error:
                raise self._error(f"{member.name!r} is not text in UTF-8") from error

    def _unpack(self, member: Member, target: Path) -> None:
        try:
            with target.open("wb") as out:
                if _is_zip(self.path):
                    with zipfile.ZipFile(self.path) as pack, pack.open(member.name) as source:
                        done = _copy(source, out, member.size)
                else:
                    with (
                        tarfile.open(self.path) as tape,
                        _tar_stream(tape, member) as source,
                    ):
                        done = _copy(source, out, member.size)
        except (*_DAMAGE, OSError) as error:
            raise self._error(
                f"{member.name!r} cannot be unpacked: {str(error)[:100]}",
                fix="write or copy the archive again",
            ) from error
        if done != member.size:
            raise self._error(
                f"{member.name!r} unpacks to another size than the archive says",
                fix="write or copy the archive again",
            )

    def _error(self, what: str, fix: str | None = None) -> PredictionError:
        return PredictionError(what, where=self.path, fix=fix)


def open_bundle(path: Path, limit_bytes: int) -> Bundle:
    """List the files of a folder, a zip or a tar archive, without unpacking any."""
    if path.is_dir():
        members = list(_folder_members(path))
    elif path.is_file() and _is_zip(path):
        members = _zip_members(path)
    elif path.is_file() and path.name.endswith(ARCHIVE_SUFFIXES):
        members = _tar_members(path, limit_bytes)
    else:
        raise UnreadableError(
            "no folder and no archive of predictions" if path.exists() else "no such predictions",
            where=path,
            expected=f"a folder, or an archive {', '.join(ARCHIVE_SUFFIXES)}",
        )
    _check(path, members, limit_bytes)
    visible = [member for member in members if not _is_hidden(member.name)]
    return Bundle(path, tuple(sorted(visible, key=lambda member: member.name)))


def _is_zip(path: Path) -> bool:
    # Not zipfile.is_zipfile, which also takes a tar archive with an npz at its end for a zip.
    with path.open("rb") as stream:
        return stream.read(4) in (b"PK\x03\x04", b"PK\x05\x06")


def _folder_members(path: Path) -> Iterator[Member]:
    root = path.resolve()
    for number, one in enumerate(path.rglob("*")):
        if number >= _MOST_FILES:
            raise _refused(path, f"holds more than {_MOST_FILES:,} files")
        name = one.relative_to(path).as_posix()
        if one.is_symlink() and not one.resolve().is_relative_to(root):
            raise _refused(path, f"{name[:80]!r} is a link that leads out of the folder")
        kind = one.stat(follow_symlinks=one.exists()).st_mode
        if stat.S_ISREG(kind):
            yield Member(name, one.stat().st_size)
        elif not stat.S_ISDIR(kind):
            raise _refused(path, f"{name[:80]!r} is a pipe, a device or a link to nothing")


def _zip_members(path: Path) -> list[Member]:
    try:
        with zipfile.ZipFile(path) as archive:
            infos = [info for info in archive.infolist() if not info.filename.endswith("/")]
    except (*_DAMAGE, OSError) as error:
        raise _refused(path, f"is a damaged zip archive: {str(error)[:100]}") from error
    for info in infos:
        kind = stat.S_IFMT(info.external_attr >> 16)
        if kind not in (0, stat.S_IFREG):
            raise _refused(path, f"{info.filename[:80]!r} is a link or a device")
        if info.flag_bits & 0x1:
            raise _refused(path, f"{info.filename[:80]!r} is encrypted")
    return [Member(info.filename, info.file_size) for info in infos]


def _tar_members(path: Path, limit_bytes: int) -> list[Member]:
    members: list[Member] = []
    total = 0
    try:
        with tarfile.open(path) as archive:
            for info in archive:
                if info.isdir():
                    continue
                if not info.isreg() or info.issparse():
                    raise _refused(path, f"{info.name[:80]!r} is a link or a device")
                members.append(Member(info.name.removeprefix("./"), info.size))
                total += info.size
                # Before the next header is read: to find it, this file must be unpacked.
                if total > limit_bytes or len(members) > _MOST_FILES:
                    break
    except (*_DAMAGE, OSError) as error:
        raise _refused(path, f"is a damaged tar archive: {str(error)[:100]}") from error
    return members


def _check(path: Path, members: list[Member], limit_bytes: int) -> None:
    if len(members) > _MOST_FILES:
        raise _refused(path, f"holds more than {_MOST_FILES:,} files")
    total = sum(member.size for member in members)
    if total > limit_bytes and not path.is_dir():
        raise _refused(path, f"unpacks to {total:,} bytes, more than {limit_bytes:,}")
    seen: set[str] = set()
    for member in members:
        name = member.name
        if not _is_safe(name):
            raise _refused(path, f"the name {name[:80]!r} leads out of it or is no plain path")
        if name.casefold() in seen:
            raise _refused(path, f"{name[:80]!r} stands in it more than once")
        if name.lower().endswith(_NESTED) and not path.is_dir():
            raise _refused(path, f"{name[:80]!r} is an archive inside")
        seen.add(name.casefold())


def _is_safe(name: str) -> bool:
    parts = name.split("/")
    plain = name.isprintable() and "\\" not in name and ":" not in name
    return plain and 0 < len(name) <= _LONGEST_NAME and not {"", ".", ".."} & set(parts)


def _is_hidden(name: str) -> bool:
    return any(part.startswith((".", "__MACOSX")) for part in name.split("/"))


def _tar_stream(archive: tarfile.TarFile, member: Member) -> IO[bytes]:
    for info in archive:
        if info.name.removeprefix("./") == member.name:
            stream = archive.extractfile(info)
            if stream is not None:
                return stream
    raise tarfile.ReadError("it is not there any more")


def _copy(source: IO[bytes], out: IO[bytes], size: int) -> int:
    # One byte more than announced is enough to know that the size is wrong.
    done = 0
    while done <= size and (chunk := source.read(min(_CHUNK_BYTES, size + 1 - done))):
        out.write(chunk)
        done += len(chunk)
    return done


def _refused(path: Path, what: str) -> UnreadableError:
    return UnreadableError(
        what,
        where=path,
        expected="plain files only, such as school.ply, each name once",
        fix="pack the files again, or give the folder",
    )
