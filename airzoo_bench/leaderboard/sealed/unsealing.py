"""Opening a sealed truth: as much of the folder that was sealed as scoring needs."""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from pydantic import ValidationError

from airzoo_bench.benchmark.folder import Benchmark
from airzoo_bench.core.errors import BenchmarkError, UserError
from airzoo_bench.core.files import clear_abandoned, temporary_folder
from airzoo_bench.leaderboard.sealed.archive import opened_archive, read_pieces
from airzoo_bench.leaderboard.sealed.contents import MANIFEST, Contents, SealedFile, commitment

__all__ = ["OpenTruth", "clear_truth", "memory_folder", "opened_truth"]

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


@contextmanager
def opened_truth(public: Path, archive: Path, key: Any) -> Iterator[OpenTruth]:
    """Open the truth for scoring, in memory where the system has files there."""
    committed = _commitment_of(public)
    home = memory_folder()
    try:
        with temporary_folder(home, _NAME) as folder:
            contents = _extract(archive, key, committed, folder)
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
    clear_abandoned(memory_folder() / _NAME)


def _extract(archive: Path, key: Any, committed: str, target: Path) -> Contents:
    """Write the sealed files of an archive."""
    with opened_archive(archive, key) as members:
        contents = _contents(next(members, None), archive)
        if commitment(contents) != committed:
            raise BenchmarkError(
                "belongs to another public folder",
                where=archive,
                expected=f"the archive of commitment {committed[:12]}…",
                fix="take the public folder and the archive of one run of `seal`",
            )
        left = {name for name, file in contents.files.items() if file.how == "sealed"}
        for member, content in members:
            name = member.removeprefix("files/")
            file = contents.files.get(name)
            if file is None or file.how == "public":
                raise BenchmarkError(f"holds {name!r}, which nobody sealed", where=archive)
            if file.how == "sealed":  # earlier archives also hold what was cut out of photos
                _write(target / name, read_pieces(content), file, archive)
                left.discard(name)
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
