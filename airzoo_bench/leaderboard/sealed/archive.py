"""Archives of sealed truth: a tar in age, written and read in pieces.

Its first member is the manifest. The tar is filled up with zeros, so that its size tells that of
the truth to an eighth at best.
"""

from __future__ import annotations

import io
import os
import tarfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from threading import Thread
from typing import IO, Any

from airzoo_bench.core.errors import BenchmarkError, UserError
from airzoo_bench.leaderboard.sealed.keys import load_pyrage

__all__ = ["Member", "opened_archive", "pieces_of", "read_pieces", "write_archive"]

PIECE = 1 << 20
_BLOCK = 512


@dataclass(frozen=True)
class Member:
    """A file of an archive.

    Attributes
    ----------
    name : str
        Its path, with slashes.
    size : int
    pieces : callable
        Yields its content.
    """

    name: str
    size: int
    pieces: Callable[[], Iterator[bytes]]


def pieces_of(path: Path) -> Iterator[bytes]:
    """Yield a file's content in pieces."""
    with path.open("rb") as stream:
        yield from read_pieces(stream)


def read_pieces(stream: IO[bytes]) -> Iterator[bytes]:
    """Yield what is left of an open file in pieces."""
    while piece := stream.read(PIECE):
        yield piece


def write_archive(stream: IO[bytes], members: Iterable[Member], recipient: Any) -> None:
    """Write files, encrypted to a recipient."""
    pyrage = load_pyrage()
    source, sink = _Source(_tar(members)), _Sink(stream)
    try:
        pyrage.encrypt_io(source, sink, [recipient])
    except pyrage.EncryptError:
        # It repeats errors of Python as text.
        for error in (source.failure, sink.failure):
            if error is not None:
                raise error from None
        raise


@contextmanager
def opened_archive(path: Path, key: Any) -> Iterator[Iterator[tuple[str, IO[bytes]]]]:
    """Read an archive from its beginning to its end."""
    if not path.is_file():
        raise BenchmarkError(
            "no such archive", where=path, expected="what `airzoo-bench seal` wrote"
        )
    ear, mouth = os.pipe()
    failures: list[BaseException] = []
    worker = Thread(target=_decrypt, args=(path, key, mouth, failures), daemon=True)
    worker.start()
    with os.fdopen(ear, "rb", buffering=0) as raw:
        stream = io.BufferedReader(raw, PIECE)
        try:
            yield _members(stream)
            while stream.read(PIECE):
                pass
        except (tarfile.TarError, EOFError) as error:
            failures.append(error)
        except BaseException:
            stream.close()  # the worker's pipe breaks, and it ends
            worker.join()
            _refuse_damage(path, failures)
            raise
    worker.join()
    _refuse_damage(path, failures)


def _refuse_damage(path: Path, failures: list[BaseException]) -> None:
    for error in failures:
        if isinstance(error, BrokenPipeError | UserError):
            continue
        no_key = "No matching keys" in str(error)
        raise BenchmarkError(
            "was sealed to another key, or its head is damaged"
            if no_key
            else "is damaged, cut off, or no archive of age",
            where=path,
            expected="what `airzoo-bench seal` wrote, and its key",
            fix="give the key that it was sealed to" if no_key else "copy the archive again",
        ) from None


def _decrypt(path: Path, key: Any, mouth: int, failures: list[BaseException]) -> None:
    pyrage = load_pyrage()
    with os.fdopen(mouth, "wb", buffering=0) as out, suppress(BrokenPipeError):
        try:
            with path.open("rb") as stream:
                pyrage.decrypt_io(stream, _Sink(out), [key])
        except (pyrage.DecryptError, OSError) as error:
            failures.append(error)


def _members(stream: IO[bytes]) -> Iterator[tuple[str, IO[bytes]]]:
    with tarfile.open(fileobj=stream, mode="r|", bufsize=_BLOCK * 128) as tar:
        for entry in tar:
            content = tar.extractfile(entry) if entry.isreg() else None
            if content is None:
                raise tarfile.TarError(f"{entry.name} is no file")
            yield entry.name, content


def _tar(members: Iterable[Member]) -> Iterator[bytes]:
    """Yield a tar of files that tells neither times nor owners, filled up with zeros."""
    total = 0
    for member in members:
        entry = tarfile.TarInfo(member.name)
        entry.size, entry.mode = member.size, 0o644
        head = entry.tobuf(tarfile.PAX_FORMAT, errors="strict")
        yield head
        seen = 0
        for piece in member.pieces():
            seen += len(piece)
            yield piece
        if seen != member.size:
            raise BenchmarkError("was changed while it was sealed", where=member.name)
        yield bytes(-seen % _BLOCK)
        total += len(head) + seen + (-seen % _BLOCK)
    left = _padded(total + 2 * _BLOCK) - total
    while left:
        piece = bytes(min(left, PIECE))
        left -= len(piece)
        yield piece


def _padded(size: int) -> int:
    """Round a size up so that few sizes are left: Padme (Nikitin et al., 2019), at most 12 %."""
    exponent = size.bit_length() - 1
    kept = exponent.bit_length()
    step = max(_BLOCK, 1 << (exponent - kept))
    return -(-size // step) * step


class _Source(io.RawIOBase):
    """Pieces as a file to read."""

    def __init__(self, pieces: Iterator[bytes]) -> None:
        self._pieces = pieces
        self._left = b""
        self.failure: Exception | None = None

    def readable(self) -> bool:
        return True

    def read(self, size: int = -1) -> bytes:
        while not self._left:
            try:
                piece = next(self._pieces, None)
            except (OSError, UserError) as error:
                self.failure = error
                raise
            if piece is None:
                return b""
            self._left = piece
        size = len(self._left) if size < 0 else size
        found, self._left = self._left[:size], self._left[size:]
        return found


class _Sink(io.RawIOBase):
    """A file or pipe that takes all of what is written to it."""

    def __init__(self, stream: IO[bytes]) -> None:
        self._stream = stream
        self.failure: Exception | None = None

    def writable(self) -> bool:
        return True

    def write(self, data: Any) -> int:
        view = memoryview(data)
        done = 0
        try:
            while done < len(view):
                done += self._stream.write(view[done:]) or 0
        except OSError as error:
            self.failure = error
            raise
        return done
