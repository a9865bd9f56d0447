"""A file's tables, each to be read by itself: CSV with any separator, Markdown, LaTeX."""

from __future__ import annotations

import csv
import html
import io
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import accumulate
from pathlib import Path

from airzoo_bench.core.errors import ResultError
from airzoo_bench.core.files import read_text
from airzoo_bench.tables.printed.annotations import read_marked
from airzoo_bench.tables.printed.grid import Grid, GridRow, check_width
from airzoo_bench.tables.printed.latex import lines_of, looks_like_latex
from airzoo_bench.tables.printed.latex_grids import latex_grids
from airzoo_bench.tables.printed.latex_source import Macro, macros_of, text_of
from airzoo_bench.tables.printed.scores import is_known
from airzoo_bench.tables.printed.tabulars import Tabular, tabulars_of

__all__ = ["Source", "read_sources"]

# Printed tables are small; checks compare methods with each other.
_LARGEST_BYTES = 2 << 20
_MOST_TABLES = 200
_MOST_COLUMNS = 1000
# Before what a spreadsheet would take for a formula, as our own tables have it.
_DEFUSED = re.compile(r"^'(?=[=+@-])")
_SEPARATORS = (",", ";", "\t")
_NAMES = ("method", "scene")
# Of a line without its blanks.
_MARKDOWN_RULE = re.compile(r"\|?:?-+:?(\|:?-+:?)*\|?")
_HEADING = re.compile(r" {0,3}#{1,6}\s")
_LINK = re.compile(r"!?\[([^][]*)\]\([^()]*\)")
_BREAK = re.compile(r"<br\s*/?>", re.IGNORECASE)
# Tags that colour, underline or place what they hold.
_STYLE = re.compile(r"<(?:span|font|div|p|a)\s[^<>]*>|</?(?:span|font|div|p|a|center)>")
_HTML_TABLE = re.compile(r"<table\b", re.IGNORECASE)
_INPUT = re.compile(r"\\(?:input|include|subfile|import)\s*\{([^{}]*)\}")


@dataclass(frozen=True)
class Source:
    """One table of a file.

    Attributes
    ----------
    label : str
        What the file calls it; empty where the file holds no other.
    line : int
        Where it begins.
    read : callable
        Returns its grids, or raises `ResultError`.
    """

    label: str
    line: int
    read: Callable[[], list[Grid]]


def read_sources(path: Path) -> tuple[list[Source], list[str]]:
    """Find the tables of a file, and what of it is not read.

    Parameters
    ----------
    path : Path
        CSV (comma, semicolon or tab), Markdown tables, or LaTeX: rows, environments, or a paper.

    Raises
    ------
    ResultError
        The file is missing, is not UTF-8, or holds too many tables.
    """
    text = read_text(path, ResultError, "table of published numbers", _LARGEST_BYTES)
    text = text.removeprefix("\ufeff").replace("\r\n", "\n")
    markdown = _markdown(path, text)
    is_page = path.suffix.casefold() in (".md", ".markdown")
    if not (is_page and markdown) and looks_like_latex(text):
        return _latex(path, text)
    in_html = len(_HTML_TABLE.findall(text)) if is_page else 0
    notes = [f"tables in HTML are not read: {in_html}"] if in_html else []
    if is_page and not markdown and "," not in text.partition("\n")[0]:
        raise ResultError(
            notes[0] if notes else "no table",
            where=path,
            expected="a Markdown table: a line of names, a rule such as |---|---|, a line a method",
        )
    whole = Source("", 1, lambda: [_grid(path, "CSV", list(_csv(path, text)), "")])
    return _counted(path, markdown or [whole]), notes


def _counted(path: Path, sources: list[Source]) -> list[Source]:
    if len(sources) > _MOST_TABLES:
        raise ResultError(
            f"{len(sources)} tables", where=path, expected=f"at most {_MOST_TABLES} in one file"
        )
    return sources


def _latex(path: Path, source: str) -> tuple[list[Source], list[str]]:
    text = text_of(source)
    macros = macros_of(text)
    places = tabulars_of(text)
    several = len(places) > 1
    sources, line, at = [], 1, 0
    for place in places:
        line, at = line + text.count("\n", at, place.start), place.start
        label = (place.label or f"table in line {line}") if several else ""
        sources.append(
            Source(label, line, partial(_latex_source, path, text, place, macros, label))
        )
    left = list(dict.fromkeys(_INPUT.findall(text)))
    shown = ", ".join(left[:5]) + (" ..." if len(left) > 5 else "")
    notes = [f"files that it inputs are not read: {shown[:200]}"] if left else []
    return _counted(path, sources), notes


def _latex_source(
    path: Path, text: str, place: Tabular, macros: dict[str, Macro], label: str
) -> list[Grid]:
    return latex_grids(path, lines_of(path, text, place, macros), label)


def _grid(path: Path, kind: str, lines: Sequence[tuple[int, list[str]]], label: str) -> Grid:
    columns = tuple(name.strip() for name in lines[0][1]) if lines else ()
    if len(columns) > _MOST_COLUMNS:
        raise ResultError(
            f"a table of {len(columns)} columns", where=path, expected=f"at most {_MOST_COLUMNS}"
        )
    if kind == "Markdown":
        lines = _fitted(lines, columns)
    for number, fields in lines:
        check_width(path, kind, number, len(fields), len(columns))
    groups = ("",) * len(columns)
    if kind == "Markdown" and len(set(columns)) < len(columns) and _are_groups(lines[1:2]):
        groups, lines = _spread(lines[1][1]), lines[1:]
    rows = tuple(_rows(lines[1:], titled=kind == "Markdown"))
    return Grid(kind, columns, groups, rows, label)


def _are_groups(lines: Sequence[tuple[int, list[str]]]) -> bool:
    """Whether a line of words below the header says what its columns are of."""
    return any(not fields[0] and not re.search(r"\d", "".join(fields)) for _, fields in lines)


def _spread(fields: Sequence[str]) -> tuple[str, ...]:
    """Let each word reach to the next."""
    return tuple(accumulate(fields, lambda above, text: text or above))


def _fitted(
    lines: Sequence[tuple[int, list[str]]], columns: Sequence[str]
) -> list[tuple[int, list[str]]]:
    """End Markdown lines where their header does, as they are shown.

    Only empty fields go, and they come only under headers below which there are no numbers, such as
    references: else a line lacks a number, and nobody knows which.
    """
    width = len(columns)
    kept = [(n, fields if any(fields[width:]) else fields[:width]) for n, fields in lines]
    # A lone first field is a title or a footnote, and lacks nothing.
    least = min(len(fields) for _, fields in kept if any(fields[1:]) or fields is kept[0][1])
    texts = [text for _, fields in kept for text in fields[least:]]
    if any(map(is_known, columns[least:])) or not all(
        isinstance(read_marked(t), str) for t in texts
    ):
        return kept
    return [(n, fields + [""] * (width - len(fields))) for n, fields in kept]


def _rows(lines: Sequence[tuple[int, list[str]]], *, titled: bool) -> Iterator[GridRow]:
    """Take rows of a lone first field, where they can be, for the titles of those below."""
    section, title = 0, ""
    for number, fields in lines:
        if titled and fields[0] and len(fields) > 1 and not any(fields[1:]):
            section, title = section + 1, fields[0]
        else:
            yield GridRow(number, tuple(fields), section, title)


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
            fix="close every double quote, and write one inside a field twice",
        ) from error


def _names(first: str, separator: str) -> int:
    names = [name.strip(' "\r').casefold() for name in first.split(separator)]
    return sum(name in names for name in _NAMES)


def _markdown(path: Path, text: str) -> list[Source]:
    """Find Markdown tables: a header, a rule, and what follows up to a blank."""
    found = _markdown_tables(text)
    several = len(found) > 1
    seen: dict[str, int] = {}
    sources = []
    for heading, lines in found:
        number = seen[heading] = seen.get(heading, 0) + 1
        name = f"{heading} ({number})" if heading and number > 1 else heading
        label = (name or f"table in line {lines[0][0]}") if several else ""
        sources.append(Source(label, lines[0][0], partial(_markdown_grids, path, lines, label)))
    return sources


def _markdown_grids(path: Path, lines: Sequence[tuple[int, str]], label: str) -> list[Grid]:
    return [_grid(path, "Markdown", [(n, _markdown_fields(line)) for n, line in lines], label)]


def _markdown_tables(text: str) -> list[tuple[str, list[tuple[int, str]]]]:
    """Return the lines of each table with the heading above it."""
    lines = text.split("\n")
    tables: list[tuple[str, list[tuple[int, str]]]] = []
    inside, heading = False, ""
    for index, line in enumerate(lines):
        following = lines[index + 1] if index + 1 < len(lines) else ""
        if _HEADING.match(line):
            heading = _LINK.sub(r"\1", line).strip(" \t#")[:80]
        if "|" not in line:
            inside = False
        elif _is_rule(following) and "|" in following:
            tables.append((heading, []))
            inside = True
        elif not inside and not tables and text.lstrip().startswith("|"):
            # Without a rule the first line is the header.
            tables.append((heading, []))
            inside = True
        if inside and not _is_rule(line):
            tables[-1][1].append((index + 1, line))
    return [table for table in tables if table[1]]


def _is_rule(line: str) -> bool:
    return bool(_MARKDOWN_RULE.fullmatch("".join(line.split())))


def _markdown_fields(line: str) -> list[str]:
    inner = line.strip().removeprefix("|")
    inner = re.sub(r"(?<!\\)\|$", "", inner)
    fields = re.split(r"(?<!\\)\|", inner)
    return [_markdown_text(field) for field in fields]


def _markdown_text(field: str) -> str:
    text = _STYLE.sub("", _LINK.sub(r"\1", _BREAK.sub(" ", field)))
    return html.unescape(re.sub(r"\\([^\w\s]|_)", r"\1", text).strip())
