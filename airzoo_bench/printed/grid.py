"""A table's text as fields with their lines: CSV with any separator, Markdown, rows of LaTeX."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from airzoo_bench.errors import ResultError
from airzoo_bench.files import read_text

__all__ = ["Grid", "read_grid"]

# Printed tables are small; checks compare methods with each other.
_LARGEST_BYTES = 2 << 20
_SEPARATORS = (",", ";", "\t")
_RULES = re.compile(
    r"\\(toprule|midrule|bottomrule|hline|addlinespace|centering|(begin|end)\{[a-z*]+\}"
    r"(\[[^]]*\])?(\{[lcrSpX|@{}. !]*\})?|cmidrule(\([lr]+\))?\{[0-9-]+\}|cline\{[0-9-]+\})"
)
_COMMENT = re.compile(r"(?<!\\)%.*")
_ROW = re.compile(r"(?<!\\)&.*\\\\")
_SPANS = re.compile(r"\\multi(column|row)\b")


@dataclass(frozen=True)
class Grid:
    """A first line of names, and lines of as many fields.

    Attributes
    ----------
    columns : tuple of str
    rows : tuple of (int, tuple of str)
        Each with its line in the file.
    is_markup : bool
        LaTeX or Markdown, so that names too may be marked.
    """

    columns: tuple[str, ...]
    rows: tuple[tuple[int, tuple[str, ...]], ...]
    is_markup: bool


def read_grid(path: Path) -> Grid:
    """Split a table into fields.

    Parameters
    ----------
    path : Path
        CSV (comma, semicolon or tab), a Markdown table, or the rows of a LaTeX table.

    Raises
    ------
    ResultError
        The file is missing, is not UTF-8, is not valid, or a line has not as many fields as the
        first.
    """
    text = read_text(path, ResultError, "table of published numbers", _LARGEST_BYTES)
    text = text.removeprefix("\ufeff")
    is_markdown, is_latex = text.lstrip().startswith("|"), bool(_ROW.search(text))
    if is_markdown:
        lines = list(_markdown(text))
    else:
        lines = list(_latex(path, text) if is_latex else _csv(path, text))
    columns = tuple(name.strip() for name in lines[0][1]) if lines else ()
    for line, fields in lines:
        if len(fields) != len(columns):
            raise ResultError(
                f"the line has not as many fields ({len(fields)}) as the first ({len(columns)})",
                where=f"{path}, line {line}",
                mend="put a field that holds a comma into double quotes",
            )
    rows = tuple((line, tuple(fields)) for line, fields in lines[1:])
    return Grid(columns, rows, is_markdown or is_latex)


def _csv(path: Path, text: str) -> Iterator[tuple[int, list[str]]]:
    first = text.split("\n", 1)[0]
    separator = max(_SEPARATORS, key=lambda sign: (_names_method(first, sign), sign == ","))
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True)
    try:
        for fields in reader:
            if fields:
                yield reader.line_num, fields
    except csv.Error as error:
        raise ResultError(
            f"not valid CSV: {error}",
            where=f"{path}, line {reader.line_num}",
            mend="close every double quote, and write one inside a field twice",
        ) from error


def _names_method(first: str, separator: str) -> bool:
    return "method" in [name.strip(' "\r').casefold() for name in first.split(separator)]


def _markdown(text: str) -> Iterator[tuple[int, list[str]]]:
    for number, line in enumerate(text.splitlines(), 1):
        if not line.lstrip().startswith("|") or re.fullmatch(r"[\s|:-]+", line):
            continue
        inner = line.strip().removeprefix("|").removesuffix("|")
        fields = re.split(r"(?<!\\)\|", inner)
        yield number, [re.sub(r"\\([^\w\s])", r"\1", field).strip() for field in fields]


def _latex(path: Path, text: str) -> Iterator[tuple[int, list[str]]]:
    started, pending = 1, ""
    for number, raw in enumerate(text.splitlines(), 1):
        line = _RULES.sub("", _COMMENT.sub("", raw)).strip()
        if _SPANS.search(line):
            raise ResultError(
                "a field that spans several columns or rows",
                where=f"{path}, line {number}",
                expected="one name above each column, one field in each",
                mend="write the head in one line, and names that stand for several rows into each",
            )
        started = started if pending else number
        pending = f"{pending} {line}".strip()
        *complete, pending = re.split(r"\\\\(?:\[[^]]*\])?", pending)
        for row in complete:
            if row.strip():
                yield started, [field.strip() for field in re.split(r"(?<!\\)&", row)]
            started = number
    if pending.strip():
        raise ResultError(
            f"{pending.strip()[:80]!r} is no row of a table",
            where=f"{path}, line {started}",
            expected="rows that end with \\\\, and nothing else than rules between them",
        )
