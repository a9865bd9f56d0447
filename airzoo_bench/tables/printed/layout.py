"""What a file says of each printed number, whatever the layout of its table."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from airzoo_bench.tables.printed.grid import GridRow

__all__ = ["Field", "Layout"]


@dataclass(frozen=True)
class Field:
    """What the file says of one printed number.

    Attributes
    ----------
    path : Path
    line : int
    texts : mapping of str to str
        By the names of the columns of a long table.
    columns : mapping of str to str
        How the file calls them, where otherwise.
    may_average : bool
        Whether the scene stands above columns without an average beside it, so that it may be a
        benchmark.
    row : GridRow or None
        The line of a wide table that it stands in.
    beside : tuple of (str, str)
        What else the line says in words or in numbers that are no known scores, by column.
    """

    path: Path
    line: int
    texts: Mapping[str, str]
    columns: Mapping[str, str]
    may_average: bool = False
    row: GridRow | None = None
    beside: tuple[tuple[str, str], ...] = ()

    def __getitem__(self, name: str) -> str:
        return self.texts.get(name, "")

    def where(self, name: str) -> str:
        """Return file, line and column, for messages."""
        return f"{self.path}, line {self.line}, column {self.columns.get(name, name)[:80]!r}"


@dataclass(frozen=True)
class Layout:
    """All fields, the columns that were not used, and whether a column says what is bold.

    `notes` say what was read otherwise than it stands there.
    """

    fields: tuple[Field, ...]
    unused: tuple[str, ...]
    has_bold: bool
    notes: tuple[str, ...] = ()
