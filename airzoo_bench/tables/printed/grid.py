"""A table as a first line of names, and lines of as many fields."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from airzoo_bench.core.errors import ResultError

__all__ = ["Grid", "GridRow", "check_width", "is_method_head"]

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
    columns : tuple of str
    groups : tuple of str
        What stands above the name of each column; empty where nothing does.
    rows : tuple of GridRow
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


def is_method_head(name: str) -> bool:
    """Whether a column of this name holds methods."""
    return name.casefold() in METHOD_NAMES
