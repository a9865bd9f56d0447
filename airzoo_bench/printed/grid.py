"""A file's tables as fields with their lines: CSV with any separator, Markdown, LaTeX."""

from __future__ import annotations

import csv
import html
import io
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from airzoo_bench.errors import ResultError
from airzoo_bench.files import read_text
from airzoo_bench.printed.latex import Line, SpannedCell, latex_tables, looks_like_latex
from airzoo_bench.printed.marks import is_no_number, plain_name, read_marked
from airzoo_bench.printed.scores import is_known

__all__ = ["Grid", "read_grids"]

# Printed tables are small; checks compare methods with each other.
_LARGEST_BYTES = 2 << 20
# Before what a spreadsheet would take for a formula, as our own tables have it.
_DEFUSED = re.compile(r"^'(?=[=+@-])")
_SEPARATORS = (",", ";", "\t")
_NAMES = ("method", "scene")
_MENDS = {
    "CSV": "put a field that holds a comma into double quotes",
    "Markdown": "write | inside a field as \\|",
    "LaTeX": "write & inside a field as \\&, and end every row with \\\\",
}
_UNDER_HEAD = re.compile(r"\s*\|?\s*:?-+:?\s*(\|\s*:?-+:?\s*)*\|?\s*")
_NUMBER_LIKE = re.compile(r"[^A-Za-z@]*[0-9][^A-Za-z@]*|[+-]?[0-9]+[.,][0-9]+(?![0-9]* ?[a-z°]).*")


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
    rows : tuple of (int, tuple of str)
        Each with its line in the file.
    label : str
        Of the table, where the file holds several with labels.
    """

    kind: str
    columns: tuple[str, ...]
    groups: tuple[str, ...]
    rows: tuple[tuple[int, tuple[str, ...]], ...]
    label: str = ""

    @property
    def is_markup(self) -> bool:
        """LaTeX or Markdown, so that names too may be marked."""
        return self.kind != "CSV"


def read_grids(path: Path) -> list[Grid]:
    """Split a file into tables, and these into fields.

    Parameters
    ----------
    path : Path
        CSV (comma, semicolon or tab), Markdown tables, or LaTeX: rows, or whole environments.

    Raises
    ------
    ResultError
        The file is missing, is not UTF-8, is not valid, or a line has not as many fields as the
        first.
    """
    text = read_text(path, ResultError, "table of published numbers", _LARGEST_BYTES)
    text = text.removeprefix("\ufeff").replace("\r\n", "\n")
    if looks_like_latex(text):
        tables = latex_tables(path, text)
        several = len(tables) > 1
        return [
            grid
            for label, lines in tables
            for grid in _latex_grids(path, lines, label if several else "")
        ]
    if markdown := _markdown(text):
        return [_grid(path, "Markdown", lines) for lines in markdown]
    return [_grid(path, "CSV", list(_csv(path, text)))]


def _grid(path: Path, kind: str, lines: Sequence[tuple[int, list[str]]]) -> Grid:
    columns = tuple(name.strip() for name in lines[0][1]) if lines else ()
    for number, fields in lines:
        _check_width(path, kind, number, len(fields), len(columns))
    rows = tuple((line, tuple(fields)) for line, fields in lines[1:])
    return Grid(kind, columns, ("",) * len(columns), rows)


def _check_width(path: Path, kind: str, number: int, fields: int, columns: int) -> None:
    if fields != columns:
        raise ResultError(
            f"the line has not as many fields ({fields}) as the first ({columns})",
            where=f"{path}, line {number}",
            mend=_MENDS[kind],
        )


def _csv(path: Path, text: str) -> Iterator[tuple[int, list[str]]]:
    first = text.split("\n", 1)[0]
    separator = max(
        _SEPARATORS, key=lambda sign: (_names(first, sign), first.count(sign), sign == ",")
    )
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True)
    try:
        for fields in reader:
            if fields:
                yield reader.line_num, [_DEFUSED.sub("", field) for field in fields]
    except csv.Error as error:
        raise ResultError(
            f"not valid CSV: {error}",
            where=f"{path}, line {reader.line_num}",
            mend="close every double quote, and write one inside a field twice",
        ) from error


def _names(first: str, separator: str) -> int:
    names = [name.strip(' "\r').casefold() for name in first.split(separator)]
    return sum(name in names for name in _NAMES)


def _markdown(text: str) -> list[list[tuple[int, list[str]]]]:
    """Return the lines of each Markdown table: a head, a rule, and what follows up to a blank."""
    lines = text.split("\n")
    tables: list[list[tuple[int, list[str]]]] = []
    inside = False
    for index, line in enumerate(lines):
        following = lines[index + 1] if index + 1 < len(lines) else ""
        if "|" not in line:
            inside = False
        elif "|" in following and _UNDER_HEAD.fullmatch(following) and "-" in following:
            tables.append([])
            inside = True
        elif not inside and not tables and text.lstrip().startswith("|"):
            # Without a rule the first line is the head.
            tables.append([])
            inside = True
        if inside and not _UNDER_HEAD.fullmatch(line):
            tables[-1].append((index + 1, _markdown_fields(line)))
    return tables


def _markdown_fields(line: str) -> list[str]:
    inner = line.strip().removeprefix("|")
    inner = re.sub(r"(?<!\\)\|$", "", inner)
    fields = re.split(r"(?<!\\)\|", inner)
    return [html.unescape(re.sub(r"\\([^\w\s]|_)", r"\1", field).strip()) for field in fields]


def _latex_grids(path: Path, lines: Sequence[Line], label: str) -> Iterator[Grid]:
    """Yield a grid for each run of lines under heads of their own."""
    heads: list[Line] = []
    pending: list[Line] = []
    body: list[Line] = []
    for line in lines:
        if not _is_head(line):
            if pending and _is_new_head(pending, heads):
                if body:
                    yield _latex_grid(path, heads, body, label)
                heads, body = pending, []
            pending = []
            body.append(line)
        elif sum(bool(cell.text) for cell in line.cells) > 1 or line.cells[0].span == 1:
            pending.append(line)
    if not heads and pending:
        heads = pending
    if heads or body:
        yield _latex_grid(path, heads or body[:1], body if heads else body[1:], label)


def _is_head(line: Line) -> bool:
    """Whether no field of it, names aside, is a number or a dash."""
    return not any(_is_value(cell.text) for cell in line.cells[1:])


def _is_value(text: str) -> bool:
    # A field with a footnote is one too: it is refused where it is read.
    plain = plain_name(text)
    return bool(plain) and (
        is_no_number(plain)
        or not isinstance(read_marked(text), str)
        or bool(_NUMBER_LIKE.fullmatch(plain))
    )


def _is_new_head(lines: Sequence[Line], heads: Sequence[Line]) -> bool:
    """Whether lines amid others are a head: they name scores, or the first column anew."""
    if not heads:
        return True
    names = [plain_name(cell.text) for line in lines for cell in line.cells]
    return any(is_known(name) for name in names if name)


def _latex_grid(path: Path, heads: Sequence[Line], body: Sequence[Line], label: str) -> Grid:
    width = max(line.width for line in heads)
    levels = [_spread(line.cells, width) for line in heads]
    stacks = [list(dict.fromkeys(filter(None, column))) for column in zip(*levels, strict=True)]
    names = [stack[-1] if stack else "" for stack in stacks]
    groups = [" ".join(map(plain_name, stack[:-1])) for stack in stacks]
    used = [False] * width
    for line in body:
        _check_width(path, "LaTeX", line.number, line.width, width)
        for column, _ in _placed(line.cells):
            used[column] = True
    rows = [(line.number, _fields(path, line, names, used)) for line in body]
    kept = [column for column in range(width) if used[column] or not body]
    return Grid(
        "LaTeX",
        tuple(names[column] for column in kept),
        tuple(groups[column] for column in kept),
        tuple(rows),
        label,
    )


def _spread(cells: Iterable[SpannedCell], width: int) -> list[str]:
    texts = [cell.text for cell in cells for _ in range(cell.span)]
    return texts + [""] * (width - len(texts))


def _placed(cells: Iterable[SpannedCell]) -> Iterator[tuple[int, SpannedCell]]:
    column = 0
    for cell in cells:
        yield column, cell
        column += cell.span


def _fields(path: Path, line: Line, names: Sequence[str], used: Sequence[bool]) -> tuple[str, ...]:
    """Return a row's fields in the columns that any row begins a field in."""
    texts = [""] * len(names)
    for column, cell in _placed(line.cells):
        texts[column] = cell.text
        over = [i for i in range(column + 1, column + cell.span) if used[i]]
        if over and _is_value(cell.text) and not is_no_number(plain_name(cell.text)):
            raise ResultError(
                f"{cell.text[:80]!r} spans columns that hold different things",
                where=f"{path}, line {line.number}",
                expected="one number in each column",
            )
    return tuple(text for text, kept in zip(texts, used, strict=True) if kept)
