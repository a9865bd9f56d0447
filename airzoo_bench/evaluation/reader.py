"""The contract of readers: files as a method writes them become predictions of a track."""

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

SURE = 0.5
"""A reader that is less sure than this does not take a path for its own."""

POSSIBLE = 0.25
"""One that is as sure takes it where its track is the one that is asked for."""


@dataclass(frozen=True, eq=False)
class Reading:
    """The input of a reader besides the path.

    `truths` are those of the protocol's scenes, perhaps sealed: readers take names of queries,
    tiles and photos from them, and nothing else. `names` is a list of image names, a line each, in
    the order in which the method saw them; `image_size` that of the pictures that a matcher was
    given, for files that do not state it. Predictions may name any folder of the computer: only
    what lies in `folders`, or below the predictions, may be listed for them. `scenes` are those of
    the benchmark, also without the protocol: a path that names one of them is of no other.
    """

    protocol: Protocol
    truths: Sequence[Any]
    names: Path | None
    memory_bytes: int
    folders: tuple[Path, ...] = ()
    scenes: tuple[str, ...] = ()
    image_size: tuple[float, float] | None = None


def image_size_of(text: str | None) -> tuple[float, float] | None:
    """Return the width and height that a text such as "640x480" states."""
    if text is None:
        return None
    found = re.fullmatch(r"([1-9]\d{0,5})x([1-9]\d{0,5})", text)
    if found is None:
        raise UsageError(
            f"{text[:40]!r} is no size of a picture",
            where="--image-size",
            expected="width and height in pixels, such as 640x480",
        )
    return float(found[1]), float(found[2])


@dataclass(frozen=True, eq=False)
class ReadPredictions:
    """Predictions as a reader has read them.

    `conventions` say for the result what was taken to be so: pixel centres, axes, quaternions.
    `beside` are the files read besides the path; the result states their checksums.
    """

    predictions: Predictions
    conventions: tuple[str, ...]
    notes: tuple[str, ...] = ()
    beside: tuple[Path, ...] = ()


class Reader(ABC):
    """Reads what one method, or a family of methods, writes, into predictions of a track.

    `title` names the files for people, such as "descriptors of VPR-methods-evaluation", `layout`
    says how they are recognised, `methods` who writes them. A reader that does not take names or an
    image size refuses them.
    """

    track: ClassVar[str]
    title: str
    layout: str
    methods: tuple[str, ...] = ()
    takes_names: ClassVar[bool] = False
    takes_image_size: ClassVar[bool] = False

    @abstractmethod
    def recognise(self, path: Path) -> float:
        """Return from 0 to 1 how sure it is that a path is its own, by the content of the files."""

    @abstractmethod
    def read(self, path: Path, reading: Reading) -> ReadPredictions:
        """Read a path into predictions."""

    def check_options(self, path: Path, reading: Reading) -> None:
        """Refuse names and sizes that the files state themselves: they would not be used."""
        if not self.takes_names:
            refuse_option("--names", reading.names, self.title, path)
        if not self.takes_image_size:
            refuse_option("--image-size", reading.image_size, self.title, path)


def refuse_option(option: str, value: object, title: str, where: Path) -> None:
    """Refuse an option that the files make needless."""
    if value is not None:
        raise PredictionError(
            f"read as {title}, which says all by itself: {option} is not used",
            where=where,
            fix="leave it out",
        )


def reader_named(name: str) -> Reader:
    """Return the reader of a name."""
    names = READERS.names()
    if name in names:
        found: Reader = READERS.get(name)
        return found
    raise UsageError(
        f"there is no reader {name[:80]!r}{nearest(name[:80], names)}",
        where="--reader",
        expected="one of " + ", ".join(names),
        fix="`airzoo-bench readers` says what each reads",
    )


def find_reader(path: Path, track: str | None = None) -> str | None:
    """Return the name of the reader that recognises a path, if one does."""
    readers: dict[str, Reader] = {name: READERS.get(name) for name in READERS.names()}
    sure = {name: one.recognise(path) for name, one in readers.items() if one.track == track}
    least = POSSIBLE if max(sure.values(), default=0.0) >= POSSIBLE else SURE
    if least == SURE:
        sure = {name: reader.recognise(path) for name, reader in readers.items()}
    most = max(sure.values(), default=0.0)
    found = [name for name, value in sure.items() if value == most]
    if most < least:
        return None
    if len(found) > 1:
        raise UnreadableError(
            f"could be {' or '.join(readers[name].title for name in found)}",
            where=path,
            expected="files of one layout",
            fix=f"say which: {' or '.join(f'--reader {name}' for name in found)}",
        )
    return found[0]
