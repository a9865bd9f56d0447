"""The rows of a LaTeX table under their headers, of which it may have several."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from airzoo_bench.core.errors import ResultError
from airzoo_bench.tables.printed.annotations import is_no_number, plain_name, read_marked
from airzoo_bench.tables.printed.grid import Grid, GridRow, check_width, is_method_title
from airzoo_bench.tables.printed.latex import Line, SpannedCell
from airzoo_bench.tables.printed.scores import is_known

__all__ = ["latex_grids"]

_NUMBER_LIKE = re.compile(r"[^A-Za-z@]*[0-9][^A-Za-z@]*|[+-]?[0-9]+[.,][0-9]+(?![0-9]* ?[a-z°]).*")
_YEAR = re.compile(r"(?:19|20)[0-9]{2}")
_LONGEST_VALUE = 200
_MOST_HEADERS = 12
_MOST_FIELDS = 200_000


@dataclass
class _Block:
    """Lines under headers of their own; each with the number and the title of its section."""

    headers: list[Line] = field(default_factory=list)
    body: list[tuple[Line, int, str]] = field(default_factory=list)


def latex_grids(path: Path, lines: Sequence[Line], label: str) -> list[Grid]:
    """Return a grid for each run of lines under headers of their own.

    Raises
    ------
    ResultError
        A line has not as many fields as its headers, or there are too many.
    """
    return [_grid(path, block, label) for block in _blocks(lines) if block.headers or block.body]


def _blocks(lines: Sequence[Line]) -> Iterator[_Block]:
    block, pending = _Block(), list[Line]()
    section, title = 0, ""
    for index, line in enumerate(lines):
        section += line.ruled
        if _is_title(line):
            section, title = section + 1, plain_name(line.cells[0].text)
            # A lone name may be the first line of a header as well.
            if line.cells[0].span == 1:
                pending.append(line)
        elif _is_header(line) or _is_above_header(lines, index):
            pending.append(line)
        else:
            if pending and _is_new_header(pending, block.headers):
                if block.body:
                    yield block
                block = _Block(pending)
            pending = []
            block.body.append((line, section, title))
    if not block.headers and not block.body:
        block.headers = pending
    yield block


def _is_title(line: Line) -> bool:
    """Whether only the first field of a line holds something, which is no number of a column."""
    first, *others = line.cells
    # A number over several columns is of none of them, and a year is the name of a group.
    is_name = first.span > 1 or bool(_YEAR.fullmatch(plain_name(first.text)))
    is_alone = bool(first.text) and not any(cell.text for cell in others)
    return is_alone and (is_name or not _is_value(first.text))


def _is_header(line: Line) -> bool:
    """Whether it names the column of methods, or no field of it, names aside, is a number."""
    if is_method_title(plain_name(line.cells[0].text)):
        return True
    return not any(_is_value(cell.text) for cell in line.cells[1:])


def _is_above_header(lines: Sequence[Line], index: int) -> bool:
    """Whether a line of numbers over several columns each, such as years, stands above a header."""
    line, following = lines[index], lines[index + 1 : index + 2]
    filled = [cell for cell in line.cells if cell.text]
    spans = not line.cells[0].text and all(cell.span > 1 for cell in filled)
    return spans and bool(following) and _is_header(following[0]) and _names_scores(following)


def _is_value(text: str) -> bool:
    # A field with a footnote is one too: it is refused where it is read.
    plain = plain_name(text)
    return 0 < len(plain) <= _LONGEST_VALUE and (
        is_no_number(plain)
        or not isinstance(read_marked(text), str)
        or bool(_NUMBER_LIKE.fullmatch(plain))
    )


def _names_scores(lines: Iterable[Line]) -> bool:
    names = (plain_name(cell.text) for line in lines for cell in line.cells)
    return any(is_known(name) for name in names if name)


def _is_new_header(lines: Sequence[Line], headers: Sequence[Line]) -> bool:
    """Whether lines amid others are a header: they name scores, or the column of methods anew."""
    named = any(is_method_title(plain_name(line.cells[0].text)) for line in lines)
    return not headers or named or _names_scores(lines)


def _grid(path: Path, block: _Block, label: str) -> Grid:
    headers, body = block.headers, block.body
    if not headers:
        headers, body = [body[0][0]], body[1:]
    names, groups = _names(headers[-_MOST_HEADERS:])
    width = len(names)
    if width * len(body) > _MOST_FIELDS:
        raise ResultError(
            f"a table of {len(body)} rows and {width} columns",
            where=f"{path}, line {headers[0].number}",
            expected=f"at most {_MOST_FIELDS:,} fields",
        )
    used = [False] * width
    for line, _, _ in body:
        check_width(path, "LaTeX", line.number, line.width, width)
        for column, _ in _placed(line.cells):
            used[column] = True
    kept = [column for column in range(width) if used[column] or not body]
    rows = tuple(
        GridRow(line.number, _fields(path, line, used), section, title)
        for line, section, title in body
    )
    columns = tuple(names[column] for column in kept)
    return Grid("LaTeX", columns, tuple(groups[column] for column in kept), rows, label)


def _names(headers: Sequence[Line]) -> tuple[list[str], list[str]]:
    """Return the names of columns, and what stands above each."""
    width = max(line.width for line in headers)
    levels = [_spread(line.cells, width) for line in headers]
    stacks = [list(dict.fromkeys(filter(None, column))) for column in zip(*levels, strict=True)]
    names = [stack[-1] if stack else "" for stack in stacks]
    return names, [" ".join(map(plain_name, stack[:-1])) for stack in stacks]


def _spread(cells: Iterable[SpannedCell], width: int) -> list[str]:
    texts = [cell.text for cell in cells for _ in range(cell.span)]
    return texts + [""] * (width - len(texts))


def _placed(cells: Iterable[SpannedCell]) -> Iterator[tuple[int, SpannedCell]]:
    column = 0
    for cell in cells:
        yield column, cell
        column += cell.span


def _fields(path: Path, line: Line, used: Sequence[bool]) -> tuple[str, ...]:
    """Return a row's fields in the columns that any row begins a field in."""
    texts = [""] * len(used)
    for column, cell in _placed(line.cells):
        texts[column] = cell.text
        over = any(used[column + 1 : column + cell.span])
        if over and _is_value(cell.text) and not is_no_number(plain_name(cell.text)):
            raise ResultError(
                f"{cell.text[:80]!r} spans columns that hold different things",
                where=f"{path}, line {line.number}",
                expected="one number in each column",
            )
    return tuple(text for text, kept in zip(texts, used, strict=True) if kept)
