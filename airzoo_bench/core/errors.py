"""Errors of the user, each with one clear message, and the words that messages are made of.

The command line prints a message and exits with code 2; what is no `UserError` is a bug of the
suite and keeps its traceback.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from traceback import walk_tb
from typing import Self

FIX_COPY = "write or copy the file again"
_SLIPS = (KeyError, IndexError, TypeError, AttributeError)  # of others, see Registry.blaming
_PANIC = "pyo3_runtime"  # of what Rust raises, which is no Exception and has no name


class UserError(Exception):
    """Something in the input is wrong and the user can fix it.

    `what` is wrong, in one sentence without a full stop; `where` is the file, and the field or key
    in it; `expected` is what would have been right, and `fix` is what to do about it.
    """

    def __init__(
        self,
        what: str,
        *,
        where: object = None,
        expected: str | None = None,
        fix: str | None = None,
    ) -> None:
        # Whoever names a file can put line breaks there, and what follows would pass for a message.
        self.where = None if where is None else str(where).replace("\n", "\\x0a")
        self.what, self.expected, self.fix = what, expected, fix
        super().__init__(str(self))

    def inside(self, place: object) -> Self:
        """Return the same error inside of a larger place, such as a file."""
        where = str(place) if self.where is None else f"{place}, {self.where}"
        return type(self)(self.what, where=where, expected=self.expected, fix=self.fix)

    def __str__(self) -> str:
        said = self.what if self.where is None else f"{self.where}: {self.what}"
        said += f"\n  expected: {self.expected}" if self.expected else ""
        return said + (f"\n  fix:      {self.fix}" if self.fix else "")


class ArgumentError(UserError, ValueError):
    """A function of the Python face was called with an argument that it cannot work with."""


class UsageError(UserError):
    """The command line was called with arguments that do not fit together."""


class ProtocolError(UserError):
    """A protocol is unknown or not named, or its file is not valid."""


class BenchmarkError(UserError):
    """A benchmark folder is missing, damaged, or does not fit the protocol."""


class PredictionError(UserError):
    """A prediction file cannot be scored as it is."""


class UnreadableError(PredictionError):
    """A prediction file is not there, or is no file of its kind."""


class ResultError(UserError):
    """A result file cannot be read, or results cannot be put side by side."""


class StorageError(UserError):
    """A URL cannot be read or written."""


class SubmissionError(UserError):
    """A submission, or the board that it is for, is not as it must be."""


class RasterError(UserError):
    """A GeoTIFF lacks a georeference, a CRS, or valid heights."""


class CameraError(UserError):
    """A camera or pose is not one: singular intrinsics, a rotation that does not rotate."""


@contextmanager
def readable(
    path: object,
    what: str,
    *,
    kind: type[UserError] = PredictionError,
    expected: str | None = None,
    fix: str = FIX_COPY,
) -> Iterator[None]:
    """Turn what a library raises over a file's content into an error that says what is wrong."""
    try:
        with warnings.catch_warnings(action="ignore"):
            yield
    except BaseException as error:
        is_fault = isinstance(error, Exception) or type(error).__module__ == _PANIC
        body = [frame.f_globals for frame, _ in walk_tb(error.__traceback__)][:2][-1]["__name__"]
        is_slip = isinstance(error, _SLIPS) and not body.startswith("airzoo_bench.")
        if isinstance(error, UserError) or is_slip or not is_fault:
            raise
        said = f"{what}: {printable(error) or type(error).__name__}"
        raise kind(said, where=path, expected=expected, fix=fix) from error


def printable(text: object) -> str:
    """Return the first 200 characters of a text, with blanks for those that do not print."""
    return "".join(one if one.isprintable() else " " for one in str(text)[:200]).strip()


def first_of(
    names: Iterable[object], total: int | None = None, shown: int = 3, noun: str = ""
) -> str:
    """Count names and show the first few, for messages."""
    listed = [str(name) for name in names]
    known = len(listed) if total is None else total
    count = counted(known, noun) if noun else f"{known:,}"
    count = count if total is None else f"{len(listed):,} of {count}"
    label = f"first {shown}: " if len(listed) > shown else ""
    return f"{count} ({label}{', '.join(listed[:shown])})"


def plural(noun: str) -> str:
    """Return ``queries`` of ``query``, ``scenes`` of ``scene``, ``matches`` of ``match``."""
    if noun.endswith("y") and noun[-2:-1] not in "aeiou":
        return f"{noun[:-1]}ies"
    return f"{noun}es" if noun.endswith(("s", "x", "ch", "sh")) else f"{noun}s"


def counted(number: int, noun: str, several: str | None = None) -> str:
    """Return ``1 scene``, ``18 queries``, ``12,000 points have``."""
    return f"{number:,} {noun if number == 1 else several or plural(noun)}"
