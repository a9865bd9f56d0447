"""Unsealing: the folder that was sealed, byte for byte, or as much of it as scoring needs."""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from pydantic import ValidationError

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.errors import BenchmarkError, UserError
from airzoo_bench.core.files import atomic_folder
from airzoo_bench.core.progress import Progress, silent
from airzoo_bench.core.temporaries import clear_abandoned, temporary_folder
from airzoo_bench.leaderboard.sealed.archive import opened_archive, pieces_of, read_pieces
from airzoo_bench.leaderboard.sealed.contents import MANIFEST, Contents, SealedFile, commitment

__all__ = ["OpenTruth", "clear_truth", "memory_folder", "opened_truth", "unseal"]

_MANIFEST_BYTES = 1 << 30
_MEMORY = Path("/dev/shm")  # files in memory, on Linux
_NAME = "airzoo-truth"


@dataclass(frozen=True)
class OpenTruth:
    """A truth that is open.

    Attributes
    ----------
    folder : Path
        A benchmark folder: the truth, and links to public files. Photos may be missing.
    salt : str
        256 bits that lie in the archive alone, in hexadecimal.
    """

    folder: Path
    salt: str


def unseal(
    public: Path,
    archive: Path,
    key: Any,
    out: Path,
    *,
    replace: bool = False,
    progress: Progress = silent,
) -> None:
    """Write the folder that was sealed, the same to the last byte of every file.

    Parameters
    ----------
    public, archive : Path
        As `sealing.seal` wrote them.
    key : pyrage.x25519.Identity
        See `keys.read_key`.
    out : Path
        The folder to write.
    replace : bool
        Whether a folder that stands there is replaced.
    progress : Progress

    Raises
    ------
    UserError
        The archive is damaged, sealed to another key or of another public folder, a public file
        was changed, or the folder cannot be written.
    """
    committed = _commitment_of(public)
    with atomic_folder(out, replace=replace) as staged:
        contents = _extract(archive, key, committed, staged, _filled(public), progress)
        for name, file in contents.files.items():
            if file.how == "public":
                _write(staged / name, pieces_of(_there(public / name)), file, public / name)


@contextmanager
def opened_truth(public: Path, archive: Path, key: Any) -> Iterator[OpenTruth]:
    """Open the truth for scoring, in memory where the system has files there.

    The folder is private to its owner. It is removed however the block ends, by SIGTERM too; what
    SIGKILL leaves is removed by the next call, and by a restart of the machine where it was in
    memory.

    Yields
    ------
    OpenTruth

    Raises
    ------
    UserError
        See `unseal`.
    """
    committed = _commitment_of(public)
    home = memory_folder()
    try:
        with temporary_folder(home, _NAME) as folder:
            contents = _extract(archive, key, committed, folder, None, silent)
            for name, file in contents.files.items():
                if file.how == "public":
                    (folder / name).parent.mkdir(parents=True, exist_ok=True)
                    (folder / name).symlink_to(_there(public / name).resolve())
            yield OpenTruth(folder, contents.salt)
    except OSError as error:
        if not str(error.filename or home).startswith(str(home)):
            raise
        raise UserError(
            f"the truth cannot be opened: {error.strerror or error}",
            where=home,
            fix="make room there",
        ) from error


def memory_folder() -> Path:
    """Return where a truth is opened: in memory, else among temporary files."""
    return _MEMORY if os.access(_MEMORY, os.W_OK | os.X_OK) else Path(tempfile.gettempdir())


def clear_truth() -> None:
    """Remove what a killed run has left of a truth that was open."""
    clear_abandoned(memory_folder())


Fill = Callable[[Path, str, SealedFile, IO[bytes]], None]


def _extract(
    archive: Path, key: Any, committed: str, target: Path, fill: Fill | None, progress: Progress
) -> Contents:
    """Write the files of an archive; `fill` makes those that were cut, which else are left out."""
    with opened_archive(archive, key) as members:
        contents = _contents(next(members, None), archive)
        if commitment(contents) != committed:
            raise BenchmarkError(
                "belongs to another public folder",
                where=archive,
                expected=f"the archive of commitment {committed[:12]}…",
                fix="take the public folder and the archive of one run of `seal`",
            )
        left = {n: f for n, f in contents.files.items() if f.how != "public"}
        for member, content in progress(members, "files", len(left)):
            name = member.removeprefix("files/")
            file = left.pop(name, None)
            if file is None:
                raise BenchmarkError(f"holds {name!r}, which nobody sealed", where=archive)
            if file.how == "sealed":
                _write(target / name, read_pieces(content), file, archive)
            elif fill is not None:
                fill(target / name, name, file, content)
    if left:
        raise BenchmarkError(f"lacks {len(left):,} files of the truth", where=archive)
    return contents


def _contents(member: tuple[str, IO[bytes]] | None, archive: Path) -> Contents:
    if member is None or member[0] != MANIFEST:
        raise BenchmarkError("no archive of a truth", where=archive, expected="what `seal` wrote")
    try:
        return Contents.model_validate_json(member[1].read(_MANIFEST_BYTES))
    except ValidationError as error:
        raise BenchmarkError(
            f"an archive of another version: {error.errors()[0]['msg']}", where=archive
        ) from None


def _filled(public: Path) -> Fill:
    """Return what makes an original photo of the public one and what was cut out of it."""

    def fill(path: Path, name: str, file: SealedFile, content: IO[bytes]) -> None:
        def pieces() -> Iterator[bytes]:
            done = 0
            with _there(public / name).open("rb") as kept:
                for offset, length in file.cuts:
                    yield kept.read(offset - done)
                    yield content.read(length)
                    done = offset + length
                yield kept.read()

        _write(path, pieces(), file, public / name)

    return fill


def _write(path: Path, pieces: Iterator[bytes], file: SealedFile, where: Path) -> None:
    """Write a file, and hold it to its checksum."""
    path.parent.mkdir(parents=True, exist_ok=True)
    digest = hashlib.sha256()
    with path.open("wb") as stream:
        for piece in pieces:
            digest.update(piece)
            stream.write(piece)
    if digest.hexdigest() != file.sha256:
        raise BenchmarkError(
            "was changed since it was sealed",
            where=where,
            expected=f"the file that becomes SHA-256 {file.sha256[:12]}…",
            fix="copy the public folder again",
        )


def _there(path: Path) -> Path:
    if not path.is_file():
        raise BenchmarkError(
            "a file of the public folder is missing", where=path, fix="copy the folder again"
        )
    return path


def _commitment_of(public: Path) -> str:
    sealed = Benchmark.open(public, sealed=True).file.sealed
    if sealed is None:
        raise BenchmarkError(
            "is not sealed: the truth is in it",
            where=public,
            expected="the public folder that `airzoo-bench seal` wrote",
        )
    return sealed.commitment
