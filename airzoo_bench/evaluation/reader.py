"""What a reader is: files as a method writes them become predictions of a track."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from airzoo_bench.core.errors import PredictionError, UnreadableError, UsageError
from airzoo_bench.core.registry import READERS
from airzoo_bench.core.validation import nearest
from airzoo_bench.evaluation.track import Predictions
from airzoo_bench.protocol.model import Protocol

__all__ = [
    "POSSIBLE",
    "SURE",
    "ReadPredictions",
    "Reader",
    "Reading",
    "find_reader",
    "read_native",
    "reader_named",
    "refuse_names",
]

SURE = 0.5
"""A reader that is less sure than this does not take a path for its own."""

POSSIBLE = 0.25
"""One that is as sure takes it where its track is the one that is asked for."""

_OR = ", or "


@dataclass(frozen=True, eq=False)
class Reading:
    """What a reader is given besides the path.

    Attributes
    ----------
    protocol : Protocol
        What the predictions are for.
    truths : sequence
        Of the protocol's scenes, in its order, as `Track.truth` returns them: readers
        take names of queries, tiles and photos from them, and nothing else. Empty where the
        benchmark folder is missing.
    names : Path or None
        A list of image names, a line each, in the order in which the method saw them.
    memory_bytes : int
        The most that reading may hold.
    folders : tuple of Path
        The benchmark's own and those of its images. Predictions may name any folder of the
        computer; only what lies in these, or below the predictions, may be listed for them.
    scenes : tuple of str
        Ids of all scenes of the benchmark, also of those that the protocol leaves out: a path that
        names one of them is of no other.
    image_size : (width, height) or None
        Of the pictures that a matcher was given, for files that do not state it.
    """

    protocol: Protocol
    truths: Sequence[Any]
    names: Path | None
    memory_bytes: int
    folders: tuple[Path, ...] = ()
    scenes: tuple[str, ...] = ()
    image_size: tuple[float, float] | None = None


def picture_size(text: str | None) -> tuple[float, float] | None:
    """Return the width and height that a text such as "640x480" states."""
    found = re.fullmatch(r"([1-9]\d{0,5})x([1-9]\d{0,5})", text or "")
    if text is not None and found is None:
        raise UsageError(
            f"{text[:40]!r} is no size of a picture",
            where="--image-size",
            expected="width and height in pixels, such as 640x480",
        )
    return None if found is None else (float(found[1]), float(found[2]))


@dataclass(frozen=True, eq=False)
class ReadPredictions:
    """What a reader made of a path.

    Attributes
    ----------
    predictions : Predictions
        Of the reader's track.
    conventions : tuple of str
        What was taken to be so, in short sentences: pixel centres, axes, order of quaternions,
        names by order. They stand in the result.
    notes : tuple of str
        What a reader of the numbers must know.
    beside : tuple of Path
        Files that were read besides the path, such as lists next to it: the result states their
        checksums.
    """

    predictions: Predictions
    conventions: tuple[str, ...]
    notes: tuple[str, ...] = ()
    beside: tuple[Path, ...] = ()


class Reader(ABC):
    """Reads what one method, or a family of methods, writes.

    Its module is imported to list the readers: NumPy and the like are imported in its methods.

    Attributes
    ----------
    track : str
        Whose predictions it makes.
    title : str
        What it reads, for people: "descriptors of VPR-methods-evaluation".
    layout : str
        How the files are recognised, in a sentence.
    methods : tuple of str
        Who writes this.
    takes_names : bool
        Whether it reads `Reading.names`. Where it does not, `--names` is refused.
    takes_image_size : bool
        The same of `Reading.image_size`.
    """

    track: ClassVar[str]
    title: ClassVar[str]
    layout: ClassVar[str]
    methods: ClassVar[tuple[str, ...]] = ()
    takes_names: ClassVar[bool] = False
    takes_image_size: ClassVar[bool] = False

    @abstractmethod
    def recognise(self, path: Path) -> float:
        """Say how sure it is that a path is its own, from what the files hold."""

    @abstractmethod
    def read(self, path: Path, reading: Reading) -> ReadPredictions:
        """Read a path into predictions."""


def reader_named(name: str) -> Reader:
    """Return the reader of a name."""
    if name not in READERS.names():
        raise UsageError(
            f"there is no reader {name[:80]!r}{nearest(name[:80], READERS.names())}",
            where="--reader",
            expected="one of " + ", ".join(READERS.names()),
            fix="`airzoo-bench readers` says what each reads",
        )
    found: Reader = READERS.get(name)
    return found


def find_reader(path: Path, track: str | None = None) -> str | None:
    """Return the name of the reader that a path is of; None where it is of no reader."""
    readers: dict[str, Reader] = {name: READERS.get(name) for name in READERS.names()}
    sure = {name: reader.recognise(path) for name, reader in readers.items()}
    own = {name: value for name, value in sure.items() if readers[name].track == track}
    if max(own.values(), default=0.0) >= POSSIBLE:
        sure = own
    most = max(sure.values(), default=0.0)
    found = [name for name, value in sure.items() if value == most]
    if most < (POSSIBLE if sure is own else SURE):
        return None
    if len(found) > 1:
        raise UnreadableError(
            f"could be {' or '.join(readers[name].title for name in found)}",
            where=path,
            expected="files of one layout",
            fix=f"say which: {' or '.join(f'--reader {name}' for name in found)}",
        )
    return found[0]


def read_native(reader: Reader, path: Path, reading: Reading) -> ReadPredictions:
    """Read what a method wrote."""
    if not reader.takes_names:
        refuse_names(reading, path, reader.title)
    if reading.image_size is not None and not reader.takes_image_size:
        raise PredictionError(
            f"read as {reader.title}, whose pixels are of no stated size; --image-size is for "
            "matches in resized pictures",
            where=path,
            fix="leave it out",
        )
    try:
        return reader.read(path, reading)
    except PredictionError as error:
        if not reader.takes_names:
            error.fix = _without_names(error.fix)
        raise
    except (IsADirectoryError, NotADirectoryError) as error:
        raise UnreadableError(
            f"{(error.strerror or '').lower()}, and so not {reader.title}",
            where=error.filename,
            expected=reader.title,
            fix="name the right file or folder; `airzoo-bench readers` lists what is read",
        ) from error


def refuse_names(reading: Reading, where: Path, title: str) -> None:
    """Refuse `--names` for files that name their images; unused, it would be called read."""
    if reading.names is not None:
        raise PredictionError(
            f"read as {title}, where images have names; --names is for files without",
            where=where,
            fix="leave it out",
        )


def _without_names(fix: str | None) -> str | None:
    """Leave out the ways to mend a fault that give names."""
    ways = [way for way in (fix or "").split(_OR) if "--names" not in way]
    return _OR.join(ways) or None
