"""Printed numbers as data: each with its place, and all of a file."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from fractions import Fraction
from typing import TypeVar

from airzoo_bench.tables.printed.column_titles import is_summary_name
from airzoo_bench.tables.printed.numbers import Interval, Rounded
from airzoo_bench.tables.printed.scores import Score

__all__ = ["PrintedValue", "Published", "grouped"]

S = TypeVar("S")
T = TypeVar("T")


@dataclass(frozen=True)
class PrintedValue:
    """A printed number and where it stands.

    Attributes
    ----------
    line : int
        Of the file.
    full : int
        What a share of all is printed as: 100 or 1.
    gain : Rounded or None
        The difference that is printed next to it.
    bold : bool or None
        None where the file does not say.
    queries : int or None
        Of its scene, where the file says so.
    may_average : bool
        Whether its scene may be a benchmark of several: it stands above columns, without an
        average next to it.
    section : int
        Of the rows of its table, which rules and titles divide.
    competes : bool
        Not so where it is printed in grey, as an upper bound is.
    partial : bool
        Whether some column of its table could not be read.
    domain : str
        A table of the same benchmark, by which all such tables are told from others; empty where
        the file tells benchmarks apart by itself.
    known_as : str
        What the first of those tables calls the score; empty where it is the same.
    """

    line: int
    table: str
    benchmark: str
    track: str
    scene: str
    method: str
    score: Score
    unit: str
    full: int
    number: Rounded
    gain: Rounded | None
    bold: bool | None
    queries: int | None
    may_average: bool = False
    section: int = 0
    competes: bool = True
    partial: bool = False
    domain: str = ""
    known_as: str = ""

    @property
    def is_summary(self) -> bool:
        """Whether it stands for several scenes."""
        return is_summary_name(self.scene)

    @property
    def is_pooled(self) -> bool:
        """Whether it says of itself that it is over all queries, whatever their scene."""
        return self.scene.casefold() == "pooled"

    @property
    def is_of_one_set(self) -> bool:
        """Whether it is of one set of queries or one cloud for certain, and no average of such."""
        return not (self.is_summary or self.may_average)

    @property
    def group(self) -> tuple[str, str]:
        """Benchmark and track: what scenes and their averages have in common."""
        return self.benchmark or self.domain, self.track

    @property
    def measure(self) -> str:
        """What the score is called in all tables of its benchmark."""
        return self.known_as or self.score.name

    @property
    def place(self) -> str:
        """Benchmark and scene, for people."""
        return ", ".join(part for part in (self.benchmark, self.scene) if part)

    @property
    def share(self) -> Interval:
        """The interval of the true number, as a share from 0 to 1."""
        return self.number.interval.times(Fraction(1, self.full))


@dataclass(frozen=True)
class Published:
    """The numbers of one file, in its order.

    Attributes
    ----------
    source : str
        The file's name.
    has_bold : bool
        Whether the file says what is bold.
    notes : tuple of str
        What was read otherwise than it stands there, and what was left out.
    """

    source: str
    cells: tuple[PrintedValue, ...]
    unused_columns: tuple[str, ...]
    has_bold: bool
    notes: tuple[str, ...] = ()

    def by(self, key: Callable[[PrintedValue], T]) -> dict[T, list[PrintedValue]]:
        """Group the cells, in the order of the file."""
        return grouped(self.cells, key)


def grouped(items: Iterable[S], key: Callable[[S], T]) -> dict[T, list[S]]:
    """Group items, in their order."""
    groups: dict[T, list[S]] = {}
    for item in items:
        groups.setdefault(key(item), []).append(item)
    return groups
