"""Tables as they are read: names of columns, lines of fields, and what is said of each number."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from airzoo_bench.core.errors import ResultError

__all__ = ["Field", "Grid", "GridRow", "Layout", "check_width", "is_method_title"]

# What papers, and our own tables, call the column of names.
METHOD_NAMES = frozenset(
    ("method", "methods", "model", "models", "approach", "approaches", "algorithm", "matcher")
) | {"network", "baseline", "descriptor", "technique"}
_MENDS = {
    "CSV": "put a field that holds a comma into double quotes",
    "Markdown": "write | inside a field as \\|",
    "LaTeX": "write & inside a field as \\&, and end every row with \\\\",
}


@dataclass(frozen=True)
class GridRow:
    """One line of fields.

    Attributes
    ----------
    line : int
        Of the file.
    texts : tuple of str
        As many as the grid has columns.
    section : int
        Rules and titles divide a table into sections; this is the number of its own.
    title : str
        What stands above its section, from side to side; empty where nothing does.
    """

    line: int
    texts: tuple[str, ...]
    section: int = 0
    title: str = ""


@dataclass(frozen=True)
class Grid:
    """A first line of names, and lines of as many fields.

    Attributes
    ----------
    kind : str
        CSV, Markdown or LaTeX; in the latter two names may be marked.
    groups : tuple of str
        What stands above the name of each column; empty where nothing does.
    label : str
        Of the table, where the file holds several.
    """

    kind: str
    columns: tuple[str, ...]
    groups: tuple[str, ...]
    rows: tuple[GridRow, ...]
    label: str = ""

    @property
    def is_markup(self) -> bool:
        """LaTeX or Markdown, so that names too may be marked."""
        return self.kind != "CSV"


def check_width(path: Path, kind: str, line: int, fields: int, columns: int) -> None:
    """Refuse a line that has not as many fields as the first."""
    if fields != columns:
        raise ResultError(
            f"the line has not as many fields ({fields}) as the first ({columns})",
            where=f"{path}, line {line}",
            fix=_MENDS[kind],
        )


def is_method_title(name: str) -> bool:
    """Whether a column of this name holds methods."""
    return name.casefold() in METHOD_NAMES


@dataclass(frozen=True)
class Field:
    """What the file says of one printed number.

    Attributes
    ----------
    texts : mapping of str to str
        By the names of the columns of a long table.
    columns : mapping of str to str
        How the file calls them, where otherwise.
    may_average : bool
        Whether the scene stands above columns without an average next to it, so that it may be a
        benchmark.
    row : GridRow or None
        The line of a wide table that it stands in.
    extra : tuple of (str, str)
        What else the line says in words or in numbers that are no known scores, by column.
    """

    path: Path
    line: int
    texts: Mapping[str, str]
    columns: Mapping[str, str]
    may_average: bool = False
    row: GridRow | None = None
    extra: tuple[tuple[str, str], ...] = ()

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
