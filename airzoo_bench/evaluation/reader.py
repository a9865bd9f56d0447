"""The contract of readers: files as a method writes them become predictions of a track."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from airzoo_bench.core.errors import UnreadableError, UsageError
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
        what, expected = f"{text[:40]!r} is no size of a picture", "width and height, as 640x480"
        raise UsageError(what, where="--image-size", expected=expected)
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
    says how they are recognised, `methods` who writes them.
    """

    track: ClassVar[str]
    title: str
    layout: str
    methods: tuple[str, ...] = ()

    @abstractmethod
    def recognise(self, path: Path) -> float:
        """Return from 0 to 1 how sure it is that a path is its own, by the content of the files."""

    @abstractmethod
    def read(self, path: Path, reading: Reading) -> ReadPredictions:
        """Read a path into predictions."""


def reader_named(name: str) -> Reader:
    """Return the reader of a name."""
    names = READERS.names()
    if name not in names:
        raise UsageError(
            f"there is no reader {name[:80]!r}{nearest(name[:80], names)}",
            where="--reader",
            expected="one of " + ", ".join(names),
        )
    found: Reader = READERS.get(name)
    return found


def find_reader(path: Path, track: str | None = None) -> str | None:
    """Return the name of the reader that recognises a path, if one does."""
    readers = {name: reader_named(name) for name in READERS.names()}
    sure = {name: one.recognise(path) for name, one in readers.items() if one.track == track}
    if max(sure.values(), default=0.0) < POSSIBLE:
        found = {name: one.recognise(path) for name, one in readers.items()}
        sure = {name: value for name, value in found.items() if value >= SURE}
    most = [name for name, value in sure.items() if value == max(sure.values())]
    if len(most) > 1:
        raise UnreadableError(
            f"could be {' or '.join(readers[name].title for name in most)}",
            where=path,
            fix=f"say which: {' or '.join(f'--reader {name}' for name in most)}",
        )
    return most[0] if most else None
